"""Touch measurements of a frame of contact, by a touch model from its image or by another source."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from palpate.arrays import Image, Levels
from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.touch.background import Background
from palpate.touch.calibration import UNCORRECTED, Calibration, calibrated
from palpate.touch.cells import Light, is_grey
from palpate.touch.imprint_middle import place_of_push
from palpate.touch.indentation import added_variance, is_measured, sunk_with
from palpate.touch.touch_model import (
    COLUMNS,
    LEAST_CORNER_LOG_ODDS,
    ROWS,
    SHIPPED_OF,
    Difference,
    Reading,
    TouchModel,
    difference_in_light,
    no_shipped_model,
    reduced,
    shipped_model,
)
from palpate.types.choices import TactileChoice
from palpate.types.measurements import ContactCorner, ContactDirection, ContactPlace, Frame, Measurement, Turn
from palpate.types.sensor import SensorProfile

GREY = "images are grey, and the touch model reads colours"


@runtime_checkable
class Touch(Protocol):
    """Source of touch measurements of a user's own, for `Tracker`."""

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """Return the measurements of a frame of contact."""
        ...

    def end_contact(self) -> None:
        """Forget this contact: the next frame begins another."""
        ...


class TouchReader:
    """Touch measurements of one sensor, from its images, ground truth, a user's own source, or none."""

    def __init__(
        self,
        tactile: TactileChoice,
        sensor: SensorProfile,
        model: TouchModel | None = None,
        calibration: Calibration | None = None,
        own: Touch | None = None,
    ) -> None:
        """Take the source of measurements; `model` is by default the one that comes with palpate for this sensor.

        Raises SettingError if the images are to be read, and there is no model or it does not fit the sensor.
        """
        self.tactile: TactileChoice = tactile
        """Source of the measurements; in place of auto, the source chosen once the untouched gel is known."""
        self.reason = ""
        """Reason for that choice; empty if the source was given."""
        self.sunk = 0.0
        """Indentation beyond the usual one, as the images of this contact show it [m]; 0 where they do not."""
        self._own = own
        self._may_choose = own is None and tactile == "auto"  # until a touch model is chosen
        self._correction = calibration.direction if calibration else UNCORRECTED
        self._background: Background | None = None
        self._mean: Levels = np.zeros(0, np.float32)  # of the background, reduced
        if model is None and sensor.name in SHIPPED_OF:
            model = shipped_model(sensor.name)
        self._model = model
        self.needs_colours = model is not None and model.is_shipped
        """True if the touch model is one that comes with palpate, as those need images with colours."""
        self._sensor = calibrated(sensor, calibration)
        self._angle_factor = angle_factor(model, self._sensor)
        self._place_offset = calibration.place_offset if calibration else 0.0  # [m]
        # A push shears the gel, and balls that are only pressed show no more than what the unit adds to that.
        self._spread_of_middles = max(calibration.place_spread, 1.0) if calibration else 1.0
        spread = {} if model is None else model.settings.spread
        self._variance_factors = {name: each.factor for name, each in spread.items()}
        self._misfit = misfit(sensor, model)
        self._shows_depth = is_measured(model)
        if self.reads_images and self._misfit:
            raise SettingError(f"tactile is {tactile}; {self._misfit}")
        if model is not None and (self.reads_images or (self._may_choose and not self._misfit)):
            nothing = np.zeros((ROWS, COLUMNS, 3), np.float32)
            self._reading(model, nothing)  # opens the network now, not in a robot's loop

    @property
    def reads_images(self) -> bool:
        """True if a touch model reads the images."""
        return self.tactile == "learnt" and self._own is None

    def choose(self, image: Image | None, background: Background | None) -> None:
        """Choose the source where it is auto: the touch model, if there is one that reads such images, or none.

        They have its size, are of one tip, and have colours, which the user's own model may not need. The untouched gel
        tells of colours, as the first images of a camera may be grey or white.
        """
        if not self._may_choose:
            return
        if image is None:
            self.tactile = "none"
            self.reason = "there are no images"
        elif self._model is None or self._misfit:
            self.tactile = "none"
            self.reason = self._misfit
        elif background is None:
            return
        elif self.needs_colours and is_grey(background.mean):
            self.tactile = "none"
            self.reason = GREY
        else:
            self.tactile = "learnt"
            self.reason = f"images fit the touch model of the {self._model.settings.sensor}"
            self._may_choose = False

    def read(self, frame: Frame, background: Background | None, light: Light | None = None) -> Sequence[Measurement]:
        """Return the measurements of a frame of contact; `background` is the untouched gel at present.

        Images are compared with the untouched gel in their own light, which is fitted unless the contact detector has
        done so. Raises EstimationError if a touch model has no image to read.
        """
        if self._own is not None:
            return self._own.measure(frame)
        if self.tactile == "oracle":
            return _true_turn(frame)
        if self._model is None or not self.reads_images:
            return ()
        if frame.image is None or background is None:
            raise EstimationError(f"frame at {frame.time:.3f} s has no image, and learnt touch needs one")
        if self._background is not background:  # which is another object once it has changed
            self._background = background
            self._mean = reduced(background.mean)
        difference = difference_in_light(frame.image, self._mean, light)
        reading = self._reading(self._model, difference)
        if self._shows_depth:
            self.sunk = sunk_with(self.sunk, difference, reading["direction"][0])
        return self._measurements(reading)

    def _reading(self, model: TouchModel, difference: Difference) -> Reading:
        """Return the reading of a difference (ROWS, COLUMNS, 3) from the untouched gel."""
        reading = model.read(difference)
        if "place" in reading:
            reading["place"] = place_of_push(reading["place"], model, difference, self._sensor, self._spread_of_middles)
        return reading

    def _measurements(self, reading: Reading) -> list[Measurement]:
        """Return the measurements in a reading of the touch model, corrected by the calibration."""
        offset = self._correction.offset / self._angle_factor
        scale = self._correction.scale / self._angle_factor
        variances = {name: reading[name][1] * factor for name, factor in self._variance_factors.items()}
        measurements: list[Measurement] = []
        if "direction" in reading:
            angle = (reading["direction"][0] - offset) / scale
            variance = variances["direction"] / scale**2 + added_variance(self.sunk)
            measurements.append(ContactDirection(angle, variance))
        if "place" in reading:
            measurements.append(ContactPlace(reading["place"][0] - self._place_offset, variances["place"]))
        if "turn" in reading:
            measurements.append(Turn(reading["turn"][0] / scale, variances["turn"] / scale**2))
        if "corner" in reading:
            angle, _, slope, log_odds = reading["corner"]
            if log_odds > LEAST_CORNER_LOG_ODDS:
                measurements.append(ContactCorner(angle, variances["corner"], slope))
        return measurements

    def end_contact(self) -> None:
        """Forget this contact: the next frame begins another."""
        self.sunk = 0.0
        if self._own is not None:
            self._own.end_contact()


def angle_factor(model: TouchModel | None, sensor: SensorProfile) -> float:
    """Return the factor on the angles that a model reads: the share of the pad's width that an image shows.

    The model takes every image to show the whole width. The factor is 1 for models trained on presses, which read
    angles as they are, and for flat pads, whose edges images show.
    """
    if sensor.flat_width or (model is not None and "turn" not in model.settings.spread):
        return 1.0
    return sensor.shown


def misfit(sensor: SensorProfile, model: TouchModel | None) -> str:
    """Return the reason why the images of a sensor cannot be read by a model, or by none, or ""."""
    if len(sensor.tips) > 1:
        return f"the sensor has {len(sensor.tips)} tips, and the touch model reads images of one"
    if not sensor.image_height:
        return f"sensor {sensor.name!r} has no images"
    if model is None:
        return no_shipped_model(sensor.name)
    made_for = model.settings
    if (sensor.image_height, sensor.image_width) != (made_for.image_height, made_for.image_width):
        return (
            f"sensor {sensor.name!r} has images of {sensor.image_height} x {sensor.image_width} px, and the touch "
            f"model is of {made_for.sensor!r}, with {made_for.image_height} x {made_for.image_width} px"
        )
    return ""


def _true_turn(frame: Frame) -> Sequence[Measurement]:
    """Return the true yaw of the sensor in the object frame; a frame without ground truth has none."""
    if frame.object_pose is None or not np.isfinite(frame.object_pose).all():
        return ()
    yaw = se2.between(np.asarray(frame.object_pose), frame.sensor_pose)[2]
    sigma = 1e-3  # [rad]
    return (Turn(float(yaw), sigma**2),)
