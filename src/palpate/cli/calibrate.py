"""`palpate calibrate`: the untouched gel of a sensor unit, the orientation of its images and errors of directions."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import Force, Json, arg, check_new

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
        out: File of the calibration. The figure of presses goes beside it (.png).
        presses: Five or more presses: a CSV of images (column file) at known contact angles (column angle_deg) or, with
            the column file alone, by hand in order from -y to +y, which finds left and right only; or a recording of
            presses on an object with known outline and poses, or on a disc that stays anywhere.
        untouched: Images of the untouched gel, in place of FILE. A recording of presses needs neither.
        sensor: Sensor of the images in files: digit or gelsight-mini.
        model: Folder of the touch model that reads the presses.
    """
    from palpate.cli.console import number, print_json, print_line
    from palpate.cli.info import noise_levels
    from palpate.errors import SettingError
    from palpate.touch.calibration import write_calibration

    if file is None and not untouched and presses is not None and presses.suffix.lower() != ".csv":
        file = presses  # shows the untouched gel between presses
    if (file is None) == (not untouched):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --presses")
    if model is not None and presses is None:
        raise SettingError("calibrate: --model is only used with --presses")
    if presses is not None and out.suffix.lower() == ".png":
        raise SettingError(f"--out {out}: is the name of the figure of presses; use a name that ends in .npz")
    check_new(out, force)
    if presses is not None:
        calibration, numbers, found = _from_presses(presses, file, untouched, sensor, model, out, force)
    elif file is not None:
        calibration, numbers, found = _from_recording(file, sensor)
    else:
        calibration, numbers, found = _from_images(untouched, sensor)
    write_calibration(calibration, out, overwrite=force)
    height, width = calibration.background.mean.shape[:2]
    noise = noise_levels(calibration)
    if json:
        size = {"height": height, "width": width, "noise_levels": noise}
        print_json({"file": None if file is None else str(file), "out": str(out), **size, **numbers})
    else:
        levels = "unknown from a single image" if noise is None else f"{number(noise)} grey levels"
        print_line(f"{out}: {height} x {width} px, noise {levels}, {found}")
    return 0


def _from_recording(file: Path, sensor: str | None) -> Result:
    """Calibrate by the frames of a recording without contact."""
    from palpate import io as formats
    from palpate.cli.console import progress_bar
    from palpate.touch.calibration import Calibration, calibrate, untouched_frames

    recording = formats.load_recording(file)
    _sensor_of({file: recording}, sensor)
    with progress_bar(f"calibrating on {file.name}", len(untouched_frames(recording))) as progress:
        background, frames = calibrate(recording, progress)
    return Calibration(background), {"frames": frames}, f"from {frames} frames without contact"


def _from_images(untouched: tuple[Path, ...], sensor: str | None) -> Result:
    """Calibrate by images of the untouched gel."""
    from palpate.errors import FileError
    from palpate.touch.background import background_of_stills
    from palpate.touch.calibration import Calibration, misfit
    from palpate.touch.press_files import read_image
    from palpate.types.sensor import known_sensor

    images = [read_image(each, grey=True) for each in untouched]
    (height, width), first = images[0].shape[:2], untouched[0]
    for each, image in zip(untouched, images, strict=True):
        if image.shape[:2] != (height, width):
            found = f"{image.shape[0]} x {image.shape[1]} px"
            raise FileError(f"{each}: is an image of {found}, and {first} of {height} x {width}")
    calibration = Calibration(background_of_stills(images), file=first)
    if sensor is not None and (wrong := misfit(calibration, known_sensor(sensor))):
        raise FileError(wrong)
    return calibration, {"images": len(images)}, f"from {len(images)} image{'s' * (len(images) > 1)}"


def _from_presses(
    presses: Path,
    file: Path | None,
    untouched: tuple[Path, ...],
    sensor_name: str | None,
    model: Path | None,
    out: Path,
    force: bool,
) -> Result:
    """Calibrate by presses and untouched images, and draw a figure of the fit."""
    from palpate import io as formats
    from palpate.errors import FileError
    from palpate.files import in_file, whole_file
    from palpate.lab.train.presses_of import presses_of
    from palpate.touch.background import is_grey
    from palpate.touch.calibration import untouched_images
    from palpate.touch.pipeline import GREY
    from palpate.touch.press_calibration import learn_from_presses
    from palpate.touch.press_figure import press_figure
    from palpate.touch.press_files import read_image, read_presses
    from palpate.touch.touch_model import TouchModel, shipped_model

    figure = out.with_suffix(".png")
    check_new(figure, force)
    is_table = presses.suffix.lower() == ".csv"
    paths = (file, None if is_table else presses)
    recordings = {path: formats.load_recording(path) for path in paths if path is not None}
    sensor = _sensor_of(recordings, sensor_name)
    may_be_grey = model is not None  # a model of the user's own
    if file is None:
        rest = [read_image(each, may_be_grey) for each in untouched]
    else:
        rest = list(untouched_images(recordings[file]))
    given = read_presses(presses, may_be_grey, in_order=True) if is_table else presses_of(recordings[presses])
    for each, images in ((file, rest), (presses, given.images)):
        if not may_be_grey and any(map(is_grey, images)):
            raise FileError(f"{each}: {GREY}")
    with in_file(presses):
        fit = learn_from_presses(given, rest, sensor, TouchModel(model) if model else shipped_model(sensor.name))
    with whole_file(figure, overwrite=force) as part:
        press_figure(given, fit).savefig(part, dpi=110, format="png")
    view, direction = fit.calibration.view, fit.calibration.direction
    offset, scatter, known = math.degrees(direction.offset), math.degrees(fit.scatter), given.is_measured
    numbers = {
        "presses": len(given.images),
        "view": str(view),
        "keeps_left_and_right": view.keeps_left_and_right,
        "offset_deg": offset if known else None,
        "scale": direction.scale if known else None,
        "scatter_deg": scatter,
        "picture": str(figure),
    }
    found = f"directions scatter by {scatter:.2f} degrees about the imprints"
    if known:
        found = f"directions are off by {offset:+.2f} degrees and {direction.scale - 1.0:+.1%}, scatter {scatter:.2f}"
    caution = (
        "Presses find left and right only; up and down, and the order of colours of an unusual unit, may be wrong."
    )
    if not view.keeps_left_and_right:
        wrong = "angles of the wrong sign" if known else "presses in the wrong order"
        caution += f"\nLeft and right are exchanged, as with {wrong}: positive is towards +y."
    found = f"images read {view}; {len(given.images)} presses: {found}; see {figure}"
    return fit.calibration, numbers, f"{found}\n{caution}"


def _sensor_of(recordings: "dict[Path, Recording]", name: str | None) -> "SensorProfile":
    """Return the sensor of recordings or the named one, by default a DIGIT; SettingError if they differ."""
    from palpate.errors import SettingError
    from palpate.types.sensor import DIGIT, known_sensor

    sensors = {str(path): recording.sensor for path, recording in recordings.items()}
    if name is not None:
        sensors[f"--sensor {name}"] = known_sensor(name)
    if not sensors:
        return DIGIT
    (path, first), *others = sensors.items()
    for other, sensor in others:
        if sensor.name != first.name:
            raise SettingError(f"{path}: is of sensor {first.name!r}, and {other} is {sensor.name!r}")
    return first
