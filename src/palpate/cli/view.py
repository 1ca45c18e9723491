"""`palpate view`: shows a run or a recording in Rerun."""

from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.options import Force, arg, check_new, positional


def view(
    path: Annotated[
        tyro.conf.Positional[Path],
        positional("RUN|RECORDING", "Folder of a run, or a recording in any known format.", required=True),
    ],
    /,
    *,
    save: Annotated[Path | None, arg("FILE.rrd", "a window; without a display, <name>.rrd")] = None,
    force: Force = False,
) -> int:
    """Show a run or a recording in Rerun: the push from above, touch, errors, status and friction over time.

    Example: palpate view runs/push

    Args:
        save: Write a file for Rerun instead of opening a window.
    """
    from palpate.cli.console import busy, print_line
    from palpate.viewer.rerun_view import has_display, save_scene, show_scene
    from palpate.viewer.scene import load_scene

    file = save if save or has_display() else Path(f"{path.resolve().stem}.rrd")
    if file:
        check_new(file, force)
    with busy(f"reading {path.name}"):
        scene = load_scene(path)
        if file is None:
            show_scene(scene)
            return 0
        save_scene(scene, file, force)
    print_line(f"{file}: open it with `rerun {file}`, which a computer with a display and rerun-sdk 0.41 has")
    return 0
