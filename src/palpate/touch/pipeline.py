"""Touch measurements: an image of a contact in, measurements out."""

from collections.abc import Sequence
from typing import Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.config import Tactile, TactileChoice
from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.touch.background import Background, Image, is_dark, is_grey
from palpate.touch.calibration import Calibration, correction_of
from palpate.touch.camera_view import unusual_colours
from palpate.touch.touch_model import COLUMNS, ROWS, TouchModel, difference_in_light, reduced, shipped_model
from palpate.types.measurements import ContactDirection, ContactPlace, Frame, Measurement, Turn
from palpate.types.sensor import SensorProfile

MEASURE_DIRECTION = ("learnt", "learnt-direction")
MEASURE_TURN = ("learnt", "learnt-turn")
GREY = "images are grey, and the touch model reads colours"

_TRUE_YAW = 1e-3  # [rad] standard deviation of the yaw from ground truth


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
        """Take the source of measurements; `model` is by default the one that comes with palpate.

        Raises SettingError if the model does not fit the sensor or measures no turns.
        """
        self.tactile: TactileChoice = tactile
        """Source of the measurements; of auto, the one chosen by the first image."""
        self.reason = ""
        """Reason for that choice; empty if there was none."""
        self.question = ""
        """Question on the first image, if its colours are unusual."""
        self._sensor, self._own_model, self._own = sensor, model, own
        self._correction = correction_of(calibration)
        self._is_view_known = calibration is not None and calibration.is_view_known
        self._mean: NDArray[np.float32] | None = None  # of the untouched gel when the contact began
        black = np.zeros((sensor.image_height, sensor.image_width, 3), np.uint8) if sensor.image_height else None
        expected = choose(black, sensor, model)[0] if tactile == "auto" else tactile
        self._model = self._checked_model(expected) if own is None and expected.startswith("learnt") else None

    @property
    def reads_images(self) -> bool:
        """True if a touch model reads the images."""
        return self.tactile.startswith("learnt") and self._own is None

    @property
    def needs_colours(self) -> bool:
        """True if the touch model is one that comes with palpate: these read colours."""
        return self._own_model is None

    def begin(self, image: Image | None) -> None:
        """Choose the source by the first image if that is open, and ask about unusual colours."""
        if self.tactile == "auto" and self._own is None:
            self.tactile, self.reason = choose(image, self._sensor, self._own_model)
        if self.reads_images and image is not None and self._own_model is None and not self._is_view_known:
            self.question = unusual_colours(image, self._sensor)

    def read(self, frame: Frame, background: Background | None) -> Sequence[Measurement]:
        """Return the measurements of a frame of contact; `background` is the untouched gel as known now.

        During a contact the images are compared with the gel as it was known at its begin, in their own light.
        """
        if self._own is not None:
            return self._own.measure(frame)
        if self.tactile == "oracle":
            return _true_turn(frame)
        if not self.reads_images:
            return ()
        assert self._model is not None
        if frame.image is None or background is None:
            raise EstimationError(f"frame at {frame.time:.3f} s has no image, and learnt touch needs one")
        if self._mean is None:
            self._mean = reduced(background.mean)
        reading, spread = self._model.read(difference_in_light(frame.image, self._mean)), self._model.settings.spread
        correction = self._correction
        found: list[Measurement] = []
        if self.tactile in MEASURE_DIRECTION:
            angle, variance = reading.direction
            variance = correction.variance(variance * spread["direction"].factor)
            found.append(ContactDirection(correction.true(angle), variance))
            if reading.place is not None:
                place, variance = reading.place
                found.append(ContactPlace(place, variance * spread["place"].factor))
        if self.tactile in MEASURE_TURN and reading.turn is not None:
            angle, variance = reading.turn
            found.append(Turn(correction.turn(angle), correction.variance(variance * spread["turn"].factor)))
        return found

    def end_contact(self) -> None:
        """Forget this contact: the next frame begins another."""
        self._mean = None
        if self._own is not None:
            self._own.end_contact()

    def _checked_model(self, tactile: TactileChoice) -> TouchModel:
        """Return the model, its network opened now and not in a robot's loop."""
        sensor = self._sensor
        if tactile not in get_args(Tactile):
            raise SettingError(f"tactile is {tactile!r}; allowed are {', '.join(get_args(Tactile))}")
        if len(sensor.tips) > 1:
            raise SettingError(
                f"tactile is {tactile}, which reads images of one tip; sensor {sensor.name!r} has several"
            )
        model = self._own_model or shipped_model(sensor.name)
        made_for = model.settings
        if (sensor.image_height, sensor.image_width) != (made_for.image_height, made_for.image_width):
            raise SettingError(
                f"sensor {sensor.name!r} has images of {sensor.image_height} x {sensor.image_width} px; the touch "
                f"model is of {made_for.sensor!r}, with {made_for.image_height} x {made_for.image_width} px"
            )
        if "turn" not in made_for.spread and tactile not in MEASURE_DIRECTION:
            found = f"{model.folder} was trained on presses, which show directions alone"
            raise SettingError(f"tactile is {tactile}; {found}")
        model.read(np.zeros((ROWS, COLUMNS, 3), np.float32))
        return model


def choose(image: Image | None, sensor: SensorProfile, model: TouchModel | None) -> tuple[Tactile, str]:
    """Return the source of measurements for a stream that begins with this image, and the reason.

    It is learnt if the model reads such images: of its size, of one tip, and in colours unless it is the user's own.
    """
    if image is None:
        return "none", "there are no images"
    if len(sensor.tips) > 1:
        return "none", f"the sensor has {len(sensor.tips)} tips, and the touch model reads images of one"
    made_for = (model or shipped_model(sensor.name)).settings
    if (sensor.image_height, sensor.image_width) != (made_for.image_height, made_for.image_width):
        found = f"{sensor.name!r} has images of {sensor.image_height} x {sensor.image_width} px"
        return "none", f"{found}, and the touch model reads {made_for.image_height} x {made_for.image_width} px"
    if lacks_colours(image, model):
        return "none", GREY
    return "learnt", f"images fit the touch model of the {made_for.sensor}"


def lacks_colours(image: Image, model: TouchModel | None) -> bool:
    """Return true if an image is grey, and the model is one that comes with palpate."""
    return model is None and not is_dark(image) and is_grey(image)


def _true_turn(frame: Frame) -> Sequence[Measurement]:
    """Return the true yaw of the sensor in the object frame; a frame without ground truth has none."""
    if frame.object_pose is None or not np.isfinite(frame.object_pose).all():
        return ()
    yaw = se2.between(np.asarray(frame.object_pose), frame.sensor_pose)[2]
    return (Turn(float(yaw), _TRUE_YAW**2),)
