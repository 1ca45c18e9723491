"""`palpate convert`: one format to another."""

from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.options import Bag, Force, Json, arg, check_new, positional


def convert(
    source: Annotated[tyro.conf.Positional[Path], positional("IN", "File in any known format.")],
    target: Annotated[
        tyro.conf.Positional[Path],
        positional("OUT", "File to write; its extension gives the format: .mcap, .tum, .csv."),
    ],
    /,
    *,
    from_: Annotated[str | None, arg("FORMAT", "detected from the content", name="from")] = None,
    lossy: bool = False,
    force: Force = False,
    json: Json = False,
    bag: Bag = Bag(),
) -> int:
    """Convert a recording or a trajectory from one format to another, or a bag to a recording.

    Example: palpate convert robot.bag push.mcap --shape 0.09x0.06 --lossy

    Args:
        from_: Format of IN.
        lossy: Convert although the format of OUT cannot hold everything in IN.
    """
    from palpate import io as formats
    from palpate.cli.console import busy, print_json, print_line
    from palpate.errors import SettingError
    from palpate.types.recording import Recording

    check_new(target, force)
    if bag.time_offset == "fit":
        raise SettingError("--time-offset fit: only for palpate track")
    if from_ is not None and bag != Bag():
        raise SettingError("--from cannot be combined with options for bags")
    with busy(f"converting {source.name}"):
        reading = formats.read(source, from_) if bag == Bag() else bag.read(source)
        lost: list[str] = []
        if isinstance(reading, tuple):  # a bag of other messages
            lost = ["poses between images", "heights and tilts", *(f"topic {name}" for name in reading.mapping.unused)]
            reading = reading.recording
        lost += formats.lost(reading, target)
        if lost and not lossy:
            raise SettingError(f"{target} would lack {', '.join(lost)}; --lossy converts all the same")
        formats.write(reading, target, overwrite=force)
    kind = "recording" if isinstance(reading, Recording) else "trajectory"
    if json:
        print_json({"in": str(source), "out": str(target), "holds": kind, "frames": len(reading), "left_out": lost})
    else:
        print_line(f"{target}: {kind} of {len(reading)} frames{', without ' if lost else ''}{', '.join(lost)}")
    return 0
