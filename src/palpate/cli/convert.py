"""`palpate convert`: one format to another."""

from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.bag_options import BAG_DEFAULTS, Bag, read_to_convert
from palpate.cli.options import ForceOption, JsonOption, check_new


def convert(
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="IN", help="File in any known format.")],
    target: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(
            metavar="OUT", help="File to write; its extension says the format: .mcap, .json, .tum, .csv."
        ),
    ],
    /,
    *,
    from_: Annotated[
        str | None,
        tyro.conf.arg(
            name="from",
            metavar="FORMAT",
            help="Format of IN.",
            help_behavior_hint="(default: from its content)",
        ),
    ] = None,
    lossy: Annotated[bool, tyro.conf.arg(help="Leave out what the format of OUT cannot hold.")] = False,
    bag: Bag = BAG_DEFAULTS,
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Convert a recording or a trajectory from one format to another, or a bag to a recording."""
    from palpate import io as formats
    from palpate.cli.console import busy, print_json, print_line
    from palpate.errors import SettingError
    from palpate.types.recording import Recording

    check_new(target, force)
    with busy(f"converting {source.name}"):
        if bag.time_offset == "fit":
            raise SettingError("--time-offset fit is for palpate track, which says what it finds")
        if from_ is not None and bag != BAG_DEFAULTS:
            raise SettingError("--from names a format, and the options for bags are for a bag; only one of them goes")
        if bag == BAG_DEFAULTS:
            data, left_out = formats.read(source, from_), []
        else:
            data, left_out = read_to_convert(source, bag)
        left_out += formats.lost(data, target)
        if left_out and not lossy:
            raise SettingError(f"{target} would lack {', '.join(left_out)}; --lossy converts all the same")
        formats.write(data, target, overwrite=force)
    what = "recording" if isinstance(data, Recording) else "trajectory"
    if json:
        print_json({"in": str(source), "out": str(target), "holds": what, "frames": len(data), "left_out": left_out})
    else:
        print_line(f"{target}: {what} of {len(data)} frames{', without ' if left_out else ''}{', '.join(left_out)}")
    return 0
