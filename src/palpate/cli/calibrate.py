"""`palpate calibrate`: the untouched gel of a sensor unit, the orientation of its images and errors of directions."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.cli.console import print_line, report
from palpate.cli.options import Force, Json, Orientation, Sensor, arg, check_new
from palpate.cli.recordings import about_calibration
from palpate.errors import FileError, SettingError

if TYPE_CHECKING:
    from palpate.types.images import Image


def metres(words: str) -> float:
    """Return a length such as 8mm [m]; raises SettingError on anything else."""
    from palpate.checks import METRES
    from palpate.files import numbers_of

    found = re.fullmatch(r"\s*([0-9.]+)\s*(mm|cm|m|in)\s*", words)
    number = numbers_of([found[1]]) if found else None
    if not found or not number or number[0] <= 0.0:
        raise SettingError(f"--ruler: found the length {words!r}; expected a number above 0 and its unit, such as 8mm")
    return number[0] * METRES[found[2]]


def calibrate(
    file: Annotated[Path | None, arg("[FILE]", "none")] = None,
    /,
    *,
    out: Annotated[Path, arg("UNIT.npz")],
    presses: Annotated[Path | None, arg("PRESSES.csv", "none")] = None,
    untouched: Annotated[tuple[Path, ...], arg("IMAGE", "none")] = (),
    ruler: Annotated[tuple[str, Path] | None, arg("LENGTH IMAGE", "none")] = None,
    sensor: Sensor = "digit",
    orientation: Orientation = "",
    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Calibrate a sensor unit: its untouched gel, by a ruler the scale of its images, by presses their orientation.

    Untouched images are files, or the frames of a recording that its contact flags call untouched (all frames if it has
    no flags).

    Example: palpate calibrate --presses presses.csv --untouched still.png --out unit.npz

    Args:
        file: A recording with images, some of them without contact.
        out: File of the calibration.
        presses: Five or more presses, which also show errors of directions: a CSV of images (column file) at known
            contact angles (column angle_deg) or places along the pad's width (column place_mm) or, with the column file
            alone, by hand in order from -y to +y, which finds left and right only.
        untouched: Images of the untouched gel, in place of FILE.
        ruler: Distance of two edges, such as a caliper's jaws, or balls that are pressed in side by side across the
            image, as 8mm, and the image that shows them.
        model: Folder of the touch model that reads the presses.
    """
    from palpate import io as formats
    from palpate.files import in_file
    from palpate.touch.background import background_of
    from palpate.touch.calibration import Calibration, write_calibration
    from palpate.touch.cells import is_grey
    from palpate.touch.pipeline import GREY
    from palpate.touch.press_calibration import (
        Ruler,
        learn_from_presses,
        read_presses,
        untouched_frames,
        untouched_images,
        with_ruler,
    )
    from palpate.touch.touch_model import TouchModel, shipped_model
    from palpate.types.images import camera_view, fitted, read_image
    from palpate.types.sensor import known_sensor

    if (file is None) == (not untouched):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --presses")
    check_new(out, force)
    recording = formats.load_recording(file).oriented(orientation) if file else None
    profile = recording.sensor if recording else known_sensor(sensor)
    size, view = (profile.image_height, profile.image_width), camera_view(orientation)

    def look(path: Path) -> "Image":
        with in_file(path):
            return fitted(read_image(path), size, view)

    scale = Ruler(look(ruler[1]), metres(ruler[0])) if ruler else None
    still = untouched_images(recording) if recording else map(look, untouched)
    numbers: dict[str, Any] = {"untouched": len(untouched_frames(recording) if recording else untouched)}
    if presses is None:
        calibration = Calibration(background_of(still))
        if ruler and scale:
            with in_file(ruler[1]):
                calibration = with_ruler(calibration, scale, profile)
    else:
        still, pressed = list(still), read_presses(presses, look, profile)
        with in_file(presses):
            if model is None and any(map(is_grey, (*still, *pressed.images))):
                raise FileError(GREY)
            reader = TouchModel(model) if model else shipped_model(profile.name)
            fit = learn_from_presses(pressed, still, profile, reader, scale)
        calibration = fit.calibration
        numbers |= {"presses": len(pressed.images), "keeps_left_and_right": calibration.view.keeps_left_and_right}
        numbers["scatter_deg"] = math.degrees(fit.scatter)
    write_calibration(calibration, out, overwrite=force)
    files = {"file": file and str(file), "out": str(out)}
    report(json, "calibration", files | numbers | about_calibration(calibration))
    if presses is not None and not json:
        print_line("Presses find left and right only; up and down may be wrong.")
        if not calibration.view.keeps_left_and_right:
            print_line("Left and right are exchanged, as with wrong signs or order of presses: positive is towards +y.")
    return 0
