"""`palpate calibrate`: the untouched gel of a sensor unit, the orientation of its images and errors of directions."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.console import print_json, print_line, progress_bar
from palpate.cli.options import Force, Json, arg, check_new
from palpate.cli.recordings import noise_levels
from palpate.errors import FileError, SettingError

if TYPE_CHECKING:
    from palpate.touch.calibration import Calibration
    from palpate.types.recording import Recording
    from palpate.types.sensor import SensorProfile

Result = tuple["Calibration", dict[str, Any], str]
"""A calibration, numbers about it for --json, and a description."""


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
            presses on an object with known outline and poses, or on a disc that stays anywhere.
        untouched: Images of the untouched gel, in place of FILE. A recording of presses needs neither.
        sensor: Sensor of the images in files: digit or gelsight-mini.
        model: Folder of the touch model that reads the presses.
    """
    from palpate import io as formats
    from palpate.touch.calibration import Calibration, write_calibration
    from palpate.touch.press_calibration import calibrate as by_recording
    from palpate.touch.press_calibration import untouched_frames

    is_table = presses is not None and presses.suffix.lower() == ".csv"
    if presses is not None and file is None and not untouched and not is_table:
        file = presses  # shows the untouched gel between presses
    if (file is None) == (not untouched):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --presses")
    if model is not None and presses is None:
        raise SettingError("calibrate: --model is only used with --presses")
    check_new(out, force)
    paths = [path for path in (file, None if is_table else presses) if path is not None]
    recordings = {path: formats.load_recording(path) for path in paths}
    profile, rest = _sensor_of(recordings, sensor), None if file is None else recordings[file]
    if presses is not None:
        given = presses if is_table else recordings[presses]
        calibration, numbers, found = _by_presses(presses, given, rest, untouched, profile, model)
    elif rest is not None:
        with progress_bar("calibrating", len(untouched_frames(rest))) as progress:
            background, frames = by_recording(rest, progress)
        calibration, numbers = Calibration(background), {"frames": frames}
        found = f"from {frames} frames without contact"
    else:
        calibration, numbers, found = _by_images(untouched, profile if sensor else None)
    write_calibration(calibration, out, overwrite=force)
    height, width = calibration.background.mean.shape[:2]
    levels = noise_levels(calibration)
    if json:
        size = {"height": height, "width": width, "noise_levels": levels}
        print_json({"file": file and str(file), "out": str(out), **size, **numbers})
    else:
        noise = "unknown from a single image" if levels is None else f"{levels:.1f} grey levels"
        print_line(f"{out}: {height} x {width} px, noise {noise}, {found}")
    return 0


def _by_images(untouched: tuple[Path, ...], sensor: "SensorProfile | None") -> Result:
    """Calibrate by images of the untouched gel, of the size of a sensor's if one is named."""
    from palpate.touch.background import background_of
    from palpate.touch.calibration import Calibration, misfit
    from palpate.touch.press_calibration import read_image

    images = [read_image(each, grey=True) for each in untouched]
    size, *others = (f"{image.shape[0]} x {image.shape[1]} px" for image in images)
    for each, other in zip(untouched[1:], others, strict=True):
        if other != size:
            raise FileError(f"{each}: is an image of {other}, and {untouched[0]} of {size}")
    calibration = Calibration(background_of(images), file=untouched[0])
    if sensor is not None and (wrong := misfit(calibration, sensor)):
        raise FileError(wrong)
    return calibration, {"images": len(images)}, f"from {len(images)} image{'s' * (len(images) > 1)}"


def _by_presses(
    path: Path,
    presses: "Path | Recording",
    rest: "Recording | None",
    untouched: tuple[Path, ...],
    sensor: "SensorProfile",
    model: Path | None,
) -> Result:
    """Calibrate by presses, of a table or a recording, and the untouched gel."""
    from palpate.files import in_file
    from palpate.lab.train.samples import presses_of
    from palpate.touch.cells import is_grey
    from palpate.touch.pipeline import GREY
    from palpate.touch.press_calibration import learn_from_presses, read_image, read_presses, untouched_images
    from palpate.touch.touch_model import TouchModel, shipped_model

    may_be_grey = model is not None  # a model of the user's own
    still = [read_image(each, may_be_grey) for each in untouched] if rest is None else list(untouched_images(rest))
    given = read_presses(presses, may_be_grey, in_order=True) if isinstance(presses, Path) else presses_of(presses)
    for name, images in ((rest and rest.file, still), (path, given.images)):
        if not may_be_grey and any(map(is_grey, images)):
            raise FileError(f"{name}: {GREY}")
    with in_file(path):
        fit = learn_from_presses(given, still, sensor, TouchModel(model) if model else shipped_model(sensor.name))
    view, direction = fit.calibration.view, fit.calibration.direction
    offset, scatter, known = math.degrees(direction.offset), math.degrees(fit.scatter), given.is_measured
    numbers = {
        "presses": len(given.images),
        "view": str(view),
        "keeps_left_and_right": view.keeps_left_and_right,
        "offset_deg": offset if known else None,
        "scale": direction.scale if known else None,
        "scatter_deg": scatter,
    }
    error = f"are off by {offset:+.2f} degrees and {direction.scale - 1.0:+.1%}, and scatter" if known else "scatter"
    lines = [
        f"images read {view}; {len(given.images)} presses: directions {error} by {scatter:.2f} degrees",
        "Presses find left and right only; up and down, and the order of colours of an unusual unit, may be wrong.",
    ]
    if not view.keeps_left_and_right:
        wrong = "angles of the wrong sign" if known else "presses in the wrong order"
        lines.append(f"Left and right are exchanged, as with {wrong}: positive is towards +y.")
    return fit.calibration, numbers, "\n".join(lines)


def _sensor_of(recordings: "dict[Path, Recording]", name: str | None) -> "SensorProfile":
    """Return the named sensor, else that of recordings, else a DIGIT; SettingError if a recording's is another."""
    from palpate.types.sensor import DIGIT, known_sensor

    given = [recording.sensor for recording in recordings.values()]
    sensor = known_sensor(name) if name else given[0] if given else DIGIT
    for path, recording in recordings.items():
        if recording.sensor.name != sensor.name:
            raise SettingError(f"{path}: is of sensor {recording.sensor.name!r}, expected {sensor.name!r}")
    return sensor
