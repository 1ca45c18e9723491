"""`palpate read`: what single images of a sensor say."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import palpate
from palpate.cli.console import Report, complain
from palpate.cli.options import Force, Orientation, Sensor, SensorUnit, arg
from palpate.errors import PalpateError, SettingError
from palpate.files import in_file, new_file
from palpate.types.choices import DEFAULT_SENSOR

if TYPE_CHECKING:
    from palpate.touch.one_image import ImageReader, ImageReading

PICTURE = Path("runs/read.png")
"""The picture where no other is named; the next one replaces it."""


def read(
    images: Annotated[tuple[Path, ...], arg("IMAGE [IMAGE ...]", "required")],
    /,
    *,
    untouched: Annotated[tuple[Path, ...], arg("IMAGE", "none; or --calibration")] = (),
    unit: SensorUnit = SensorUnit(),
    sensor: Sensor = DEFAULT_SENSOR,
    orientation: Orientation = "",
    out: Annotated[Path | None, arg("PICTURE.png", "runs/read.png, replaced each time")] = None,
    force: Force = False,
) -> Report:
    """Show what single images say: contact, its direction or its place on a flat pad, each with sigma, and a picture.

    With --json it prints a list, an object for each image.

    Example: palpate read press.png --untouched still.png

    Args:
        images: Images of one sensor unit.
        untouched: Images of its untouched gel, in place of --calibration.
        out: The picture to write.
    """
    from palpate.pipeline.reading_figure import MOST, in_words, write_picture
    from palpate.types.sensor_file import known_sensor

    if not images:
        raise SettingError("read takes an image or several: palpate read IMAGE ... --untouched STILL.png")
    if bool(untouched) == (unit.calibration is not None):
        raise SettingError("read: give either --untouched images or --calibration UNIT.npz")
    if out is not None:
        new_file(out, force)
    reader, look = _opened(untouched, unit, sensor, orientation)
    readings: dict[str, ImageReading] = {}
    for file in images:
        try:
            with in_file(file):
                readings[str(file)] = reader.read(look(file))
        except PalpateError as error:
            if len(images) == 1:
                raise
            complain(error)
    picture = out or PICTURE
    if readings:
        picture.parent.mkdir(exist_ok=True)
        write_picture(readings, picture, overwrite=force or out is None)
    is_flat = known_sensor(sensor).flat_width > 0.0
    data = [about_reading(name, reading, is_flat) for name, reading in readings.items()]
    shown = {name: {"contact": reading.contact, "says": in_words(reading)} for name, reading in readings.items()}
    of_several = f" of the first {MOST}" if len(readings) > MOST else ""
    notes = [f"picture{of_several}: {picture}"] if readings else []
    return Report("images", data, {"images": shown}, notes=notes, code=3 if len(readings) < len(images) else 0)


def about_reading(name: str, reading: "ImageReading", is_flat: bool) -> dict[str, Any]:
    """Return the reading of an image as plain data, in degrees or on a flat pad millimetres; null without contact."""
    about: dict[str, Any] = {"file": name, "contact": reading.contact}
    if reading.place is not None or (is_flat and reading.direction is None):
        place, sigma = reading.place or (None, None)
        return about | {"place_mm": place and 1e3 * place, "place_sigma_mm": sigma and 1e3 * sigma}
    angle, sigma = reading.direction or (None, None)
    return about | {"direction_deg": angle and degrees(angle), "direction_sigma_deg": sigma and degrees(sigma)}


def _opened(untouched: tuple[Path, ...], unit: SensorUnit, sensor: str, orientation: str) -> tuple["ImageReader", Any]:
    """Return the reader of a unit, and the function that reads an image from a file."""
    from functools import partial

    from palpate.cli.recordings import check_still, image_of
    from palpate.touch.background import background_of
    from palpate.touch.one_image import ImageReader
    from palpate.touch.touch_model import SHIPPED_OF, shipped_model
    from palpate.types.sensor_file import known_sensor

    profile = known_sensor(sensor)
    seek_markers = unit.markers == "auto"
    reader: Any = None  # an own sensor without a model is read by the middles of its imprints
    if unit.model:
        reader = palpate.TouchModel(unit.model)
    elif profile.name in SHIPPED_OF:
        reader = shipped_model(profile.name)
    look = partial(image_of, profile, orientation, reader is not None and reader.is_shipped)
    if unit.calibration is not None:
        return ImageReader(profile, palpate.load_calibration(unit.calibration), reader, seek_markers), look
    still = [look(path) for path in untouched]
    check_still(still, untouched)
    return ImageReader(profile, palpate.Calibration(background_of(still)), reader, seek_markers), look
