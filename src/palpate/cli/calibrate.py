"""`palpate calibrate`: how a sensor unit looks while nothing touches it."""

from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.options import ForceOption, JsonOption, check_new


def calibrate(
    file: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(help="A recording with images, of which some show no contact.")
    ],
    /,
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="UNIT.npz", help="File of the calibration.")],
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Learn a sensor unit's untouched images, their mean and noise, from a recording's frames without contact.

    Its contact flags say which frames these are; where it has none, they are all, and nothing may touch.
    """
    import numpy as np

    from palpate import formats
    from palpate.cli.console import print_json, print_line, progress_bar
    from palpate.touch.background import write_background
    from palpate.touch.calibration import calibrate, untouched_frames

    check_new(out, force)
    recording = formats.load_recording(file)
    with progress_bar(f"calibrating on {file.name}", len(untouched_frames(recording))) as progress:
        background, frames = calibrate(recording, progress)
    write_background(background, out, overwrite=force)
    height, width = background.mean.shape[:2]
    noise = float(np.median(background.deviation))
    if json:
        print_json(
            {
                "file": str(file),
                "out": str(out),
                "frames": frames,
                "height": height,
                "width": width,
                "noise_levels": noise,
            }
        )
    else:
        print_line(f"{out}: {height} x {width} px, noise {noise:.1f} grey levels, from {frames} frames without contact")
    return 0
