"""`palpate calibrate`: the untouched gel of a sensor unit, the orientation of its images and errors of directions."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.console import print_line, report
from palpate.cli.options import Force, Json, Orientation, arg, check_new
from palpate.cli.recordings import about_calibration
from palpate.errors import FileError, SettingError

if TYPE_CHECKING:
    from palpate.types.images import Image


def calibrate(
    file: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(metavar="[FILE]", help="A recording with images, some of them without contact."),
    ] = None,
    /,
    *,
    out: Annotated[Path, arg("UNIT.npz")],
    presses: Annotated[Path | None, arg("PRESSES", "none")] = None,
    untouched: Annotated[tuple[Path, ...], arg("IMAGE", "none")] = (),
    sensor: Annotated[str | None, arg("NAME", "the recording's, else digit")] = None,
    orientation: Orientation = "",
    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Calibrate a sensor unit: its untouched gel and, from presses, the orientation of images and direction errors.

    Untouched images are files, or the frames of a recording that its contact flags call untouched (all frames if it has
    no flags).

    Example: palpate calibrate --presses presses.csv --untouched still.png --out unit.npz

    Args:
        out: File of the calibration.
        presses: Five or more presses: a CSV of images (column file) at known contact angles (column angle_deg) or, with
            the column file alone, by hand in order from -y to +y, which finds left and right only; or a recording of
            presses on an object with known outline and poses.
        untouched: Images of the untouched gel, in place of FILE. A recording of presses needs neither.
        sensor: Sensor of the images in files: digit or gelsight-mini.
        model: Folder of the touch model that reads the presses.
    """
    from palpate import io as formats
    from palpate.files import in_file
    from palpate.lab.train.samples import presses_of
    from palpate.touch.background import background_of
    from palpate.touch.calibration import Calibration, write_calibration
    from palpate.touch.cells import is_grey
    from palpate.touch.pipeline import GREY
    from palpate.touch.press_calibration import learn_from_presses, read_presses, untouched_frames, untouched_images
    from palpate.touch.touch_model import TouchModel, shipped_model
    from palpate.types.images import camera_view, fitted, read_image
    from palpate.types.sensor import DIGIT, known_sensor

    is_table = presses is not None and presses.suffix.lower() == ".csv"
    if presses is not None and file is None and not untouched and not is_table:
        file = presses  # shows the untouched gel between presses
    if (file is None) == (not untouched):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --presses")
    check_new(out, force)
    paths = [path for path in (file, None if is_table else presses) if path is not None]
    recordings = {path: formats.load_recording(path).oriented(orientation) for path in paths}
    given = [recording.sensor for recording in recordings.values()]
    profile = known_sensor(sensor) if sensor else given[0] if given else DIGIT
    for path, recording in recordings.items():
        if recording.sensor.name != profile.name:
            raise SettingError(f"{path}: is of sensor {recording.sensor.name!r}, expected {profile.name!r}")
    size, view = (profile.image_height, profile.image_width), camera_view(orientation)

    def look(path: Path) -> "Image":
        with in_file(path):
            return fitted(read_image(path), size, view)

    if presses is not None:
        still = [look(each) for each in untouched] if file is None else list(untouched_images(recordings[file]))
        pressed = read_presses(presses, look, in_order=True) if is_table else presses_of(recordings[presses])
        with in_file(presses):
            if model is None and any(map(is_grey, (*still, *pressed.images))):
                raise FileError(GREY)
            reader = TouchModel(model) if model else shipped_model(profile.name)
            fit = learn_from_presses(pressed, still, profile, reader)
        calibration = fit.calibration
        keeps = calibration.view.keeps_left_and_right
        numbers: dict[str, Any] = {"presses": len(pressed.images), "keeps_left_and_right": keeps}
        numbers["scatter_deg"] = math.degrees(fit.scatter)
    else:
        if file is None:
            images, numbers = [look(each) for each in untouched], {"images": len(untouched)}
        else:
            frames = len(untouched_frames(recordings[file]))
            images, numbers = untouched_images(recordings[file]), {"frames": frames}
        calibration = Calibration(background_of(images))
    write_calibration(calibration, out, overwrite=force)
    files = {"file": file and str(file), "out": str(out)}
    report(json, "calibration", files | numbers | about_calibration(calibration))
    if presses is not None and not json:
        print_line("Presses find left and right only; up and down may be wrong.")
        if not calibration.view.keeps_left_and_right:
            print_line("Left and right are exchanged, as with wrong signs or order of presses: positive is towards +y.")
    return 0
