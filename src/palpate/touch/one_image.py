"""Reading of one image of a sensor unit: contact, and where or from which direction, with standard deviations.

A tracker learns the errors that all readings of a unit share from many images; here they are part of the sigma.
"""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Image
from palpate.config import Priors
from palpate.errors import SettingError
from palpate.touch.calibration import Calibration, calibrated
from palpate.touch.cells import is_grey
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.imprint_middle import place_on_unit, read_imprint
from palpate.touch.markers import check_markers, find_markers
from palpate.touch.reader import GREY, angle_factor, misfit
from palpate.touch.touch_model import Difference, TouchModel, difference_in_light, reduced
from palpate.types.sensor import SensorProfile


@dataclass(frozen=True, eq=False)
class ImageReading:
    """Contents of one image."""

    image: Image
    """The image (height, width, 3), as the profile has it."""
    untouched: Image
    """The untouched gel (height, width, 3)."""
    contact: bool
    direction: tuple[float, float] | None = None
    """Contact direction on a round gel and its standard deviation [rad]; None without contact and on a flat pad."""
    place: tuple[float, float] | None = None
    """Place along y of a flat pad and its standard deviation [m]; None without contact and on a round gel."""
    column: tuple[float, float] | None = None
    """Column of the image that shows it, and its standard deviation [px]; None without contact."""


class ImageReader:
    """Reader of single images of one unit, with a touch model or, without any, by the middles of imprints."""

    def __init__(
        self, sensor: SensorProfile, calibration: Calibration, model: TouchModel | None, seek_markers: bool = True
    ) -> None:
        """Take the sensor, the unit with its untouched gel, and the model. Raises SettingError if they do not fit."""
        wrong = "" if model is None else misfit(sensor, model)
        if not wrong and model is not None and model.is_shipped and is_grey(calibration.background.mean):
            wrong = GREY
        if not wrong and (not sensor.image_width or sensor.pixel_pitch is None):
            wrong = f"sensor {sensor.name!r} has no images, or no pixel_pitch"
        if wrong:
            raise SettingError(wrong)
        self._profile = sensor
        self._sensor = calibrated(sensor, calibration)
        self._calibration = calibration
        self._model = model
        self._seek_markers = seek_markers
        self._markers = find_markers(calibration.background.mean) if seek_markers else None

    def read(self, image: Image) -> ImageReading:
        """Return the reading of a camera's image. Raises SettingError if it is no image of this unit."""
        gel = self._calibration.background.mean
        if self._markers and image.shape == gel.shape:
            check_markers(self._calibration.view.of(image), gel, self._markers)
        detector = ContactDetector(self._profile, self._calibration, self._seek_markers)
        viewed = detector.read(image)
        contact = bool(detector.update(viewed))
        assert detector.background is not None
        mean = detector.background.mean
        untouched = np.rint(mean).astype(np.uint8)
        if not contact:
            return ImageReading(viewed, untouched, contact)
        direction, place = self._measured(difference_in_light(viewed, reduced(mean)))
        if place is not None:
            column = self._column(place[0] + self._calibration.place_offset, place[1])
            return ImageReading(viewed, untouched, contact, place=place, column=column)
        if direction is None:
            return ImageReading(viewed, untouched, contact)
        shown = direction[0] + self._calibration.direction.offset
        column = self._column(self._sensor.radius * math.sin(shown), self._sensor.radius * direction[1])
        return ImageReading(viewed, untouched, contact, direction=direction, column=column)

    def _measured(self, difference: Difference) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Return direction [rad] or, of a flat pad, place [m], each with its standard deviation; None for the other."""
        if self._sensor.flat_width > 0.0 and (self._model is None or "place" in self._model.settings.spread):
            found = place_on_unit(self._model, difference, self._sensor, self._calibration.place_spread)
            return None, None if found is None else self._place(*found)
        if self._model is None:
            imprint = read_imprint(difference, self._sensor)
            if imprint is None:
                return None, None
            sine = imprint[0] / max(self._sensor.radius, abs(imprint[0]) + 1e-9)
            return self._direction(math.asin(sine), imprint[1] / (self._sensor.radius**2 * (1.0 - sine**2))), None
        angle, variance = self._model.read(difference)["direction"][:2]
        factor = angle_factor(self._model, self._sensor)
        scale = self._model.settings.spread["direction"].scale
        return self._direction(factor * angle, factor**2 * variance * scale), None

    def _place(self, measured: float, variance: float) -> tuple[float, float]:
        """Return a place along y and its standard deviation [m], from that in the image and its variance [m^2]."""
        place = measured - self._calibration.place_offset
        of_units = 3e-4  # [m] standard deviation of the place of an image on the pad
        offset_sigma = self._calibration.place_offset_sigma or of_units
        return place, math.hypot(math.sqrt(variance), offset_sigma, self._sensor.pixel_pitch_sigma * place)

    def _direction(self, measured: float, variance: float) -> tuple[float, float]:
        """Return a contact direction and its standard deviation [rad], from that in the image and its variance."""
        correction = self._calibration.direction
        priors = Priors()
        angle = (measured - correction.offset) / correction.scale
        offset_sigma = correction.offset_sigma or priors.direction_bias[1]
        scale_sigma = correction.scale_sigma or math.hypot(priors.direction_scale[1], self._sensor.pixel_pitch_sigma)
        return angle, math.hypot(math.sqrt(variance), offset_sigma, scale_sigma * angle) / correction.scale

    def _column(self, y: float, sigma: float) -> tuple[float, float]:
        """Return the column that shows a place along y of the pad [m], and its standard deviation [px]."""
        pitch = self._sensor.pixel_pitch or 1.0
        return 0.5 * (self._sensor.image_width - 1) + y / pitch, sigma / pitch
