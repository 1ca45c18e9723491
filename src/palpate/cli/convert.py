"""`palpate convert`: one format to another."""

from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.options import Bag, Force, Json, check_new, positional


def convert(
    source: Annotated[tyro.conf.Positional[Path], positional("IN", "File in any known format.")],
    target: Annotated[
        tyro.conf.Positional[Path],
        positional("OUT", "File to write; its extension gives the format: .mcap, .tum, .csv."),
    ],
    /,
    *,
    force: Force = False,
    json: Json = False,
    bag: Bag = Bag(),
) -> int:
    """Convert a recording or a trajectory from one format to another, or a bag to a recording.

    A .tum of a recording holds the object's true poses.

    Example: palpate convert robot.bag push.mcap --shape 0.09x0.06
    """
    from palpate import io as formats
    from palpate.cli.console import busy, print_json, print_line
    from palpate.errors import SettingError
    from palpate.types.recording import Recording

    check_new(target, force)
    if bag.time_offset == "fit":
        raise SettingError("--time-offset fit: only for palpate track")
    with busy(f"converting {source.name}"):
        reading = formats.read(source) if bag == Bag() else bag.read(source)
        if isinstance(reading, tuple):  # a bag of other messages
            reading = reading.recording
        formats.write(reading, target, overwrite=force)
    kind = "recording" if isinstance(reading, Recording) else "trajectory"
    if json:
        print_json({"in": str(source), "out": str(target), "holds": kind, "frames": len(reading)})
    else:
        print_line(f"{target}: {kind} of {len(reading)} frames")
    return 0
