"""What a tracker can be told to take from touch."""

from collections.abc import Callable
from typing import get_args

import numpy as np

from palpate.config import Tactile, TactileChoice
from palpate.errors import SettingError
from palpate.geometry.se2 import Sigmas
from palpate.touch.background import Background, Image, is_dark, is_grey
from palpate.touch.calibration import UNCORRECTED, DirectionCorrection
from palpate.touch.difference import COLUMNS, ROWS
from palpate.touch.learnt import DifferenceInput, ImageTouch, linear_touch, pair_touch
from palpate.touch.model import TouchModel, shipped_model
from palpate.touch.relative import ConstantTouch, NoTouch, OracleTouch, Touch
from palpate.types.sensor import SensorProfile

TELL_DIRECTION = ("learnt", "learnt-direction")
"""Those that tell where the tip is touched."""

TELL_TURN = ("learnt", "learnt-turn")
"""Those that tell how the sensor has turned, up to an offset of the contact."""

GREY = "images are grey, and the touch model reads colours"
"""Why a model that comes along does not read images."""


def chosen(image: Image | None, sensor: SensorProfile, model: TouchModel | None = None) -> tuple[Tactile, str]:
    """Return what touch is to say of a stream that begins with this image, or with none, and why in words.

    It is learnt where the model reads such images: of its size, of a sensor with one tip, and in colours unless it is a
    model of the user's own.
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
    """Return whether an image is grey, and the model not one of the user's own: those that come along read colours."""
    return model is None and not is_dark(image) and is_grey(image)


def expected(tactile: TactileChoice, sensor: SensorProfile, model: TouchModel | None = None) -> Tactile:
    """Return what touch is to be ready for before any image has come."""
    if tactile != "auto":
        return tactile
    size = sensor.image_height, sensor.image_width
    return chosen(np.zeros((*size, 3), np.uint8) if size[0] else None, sensor, model)[0]


def make_touch(
    tactile: Tactile,
    sensor: SensorProfile,
    oracle: Sigmas,
    constant: Sigmas,
    model: TouchModel | None,
    background: Callable[[], Background],
    correction: DirectionCorrection = UNCORRECTED,
    linear: float | None = None,
) -> Touch:
    """Return what measures in a mode.

    oracle and constant are standard deviations [m, m, rad] of a relative pose in these two modes. Learnt ones use the
    model, by default the one that comes with palpate, and compare images with what background tells at the moment;
    correction is of a unit's directions and turns; linear is the standard deviation of a turn [rad] by learnt-linear,
    by default the model's. Raises SettingError on another mode, and on a model of other images than the sensor's.
    """
    if tactile == "none":
        return NoTouch()
    if tactile == "constant":
        return ConstantTouch(constant)
    if tactile == "oracle":
        return OracleTouch(oracle)
    if tactile not in get_args(Tactile):
        raise SettingError(f"tactile is {tactile!r}; allowed are {', '.join(get_args(Tactile))}")
    if len(sensor.tips) > 1:
        raise SettingError(f"tactile is {tactile}, which reads images of one tip; sensor {sensor.name!r} has several")
    model, network_input = model or shipped_model(sensor.name), DifferenceInput(background)
    made_for = model.settings
    if (sensor.image_height, sensor.image_width) != (made_for.image_height, made_for.image_width):
        raise SettingError(
            f"sensor {sensor.name!r} has images of {sensor.image_height} x {sensor.image_width} px; the touch model "
            f"is of {made_for.sensor!r}, with {made_for.image_height} x {made_for.image_width} px"
        )
    if "turn" not in made_for.spread and tactile not in TELL_DIRECTION:
        raise SettingError(f"tactile is {tactile}; {model.folder} was learnt from presses, which tell directions alone")
    nothing = np.zeros((ROWS, COLUMNS, 3), np.float32)  # opens the network now, not in a robot's loop
    if tactile == "learnt-linear":
        model.keypoint(nothing)
        return linear_touch(model, network_input, correction, linear)
    model.look(nothing)
    if tactile == "learnt-pairs":
        return pair_touch(model, network_input, correction)
    return ImageTouch(model, network_input, correction, direction=tactile in TELL_DIRECTION, turn=tactile in TELL_TURN)
