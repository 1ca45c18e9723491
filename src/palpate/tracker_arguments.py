"""Arguments of a tracker: checked, and brought into the form in which its parts take them."""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.checks import SPAN, TURNS
from palpate.config import ANYWHERE_SIGMA, UNLIKELY, NoiseSettings, Priors, TrackerSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import check_outline
from palpate.touch.calibration import UNCORRECTED, Calibration, calibrated
from palpate.touch.reader import Touch
from palpate.touch.touch_model import TouchModel
from palpate.types.hand import Hand, check_names
from palpate.types.measurements import finite_numbers
from palpate.types.outline import Sketch, Unknown
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class FirstPose:
    """Pose of the object at the first frame."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""

    def warn_if_far_from(self, sensor_pose: Array, makes_frame: bool) -> None:
        """Warn if the sensor is far from it at the first frame, or if the sensor's yaw is in degrees.

        `makes_frame` says that the first contact makes the object frame, wherever it is, if this pose is unknown.
        """
        if abs(sensor_pose[2]) > TURNS:
            logger.warning("sensor pose has theta %.4g rad: are these degrees?", sensor_pose[2])
        distance = float(np.hypot(*(sensor_pose - self.pose)[:2]))
        deviation = float(np.sqrt(np.diagonal(self.covariance)[:2].max()))
        is_anywhere = makes_frame and deviation >= ANYWHERE_SIGMA[0]
        if distance > SPAN + UNLIKELY * deviation and not is_anywhere:
            logger.warning("first pose is %.3g m from the sensor: is one of both in millimetres?", distance)


@dataclass(frozen=True, eq=False)
class Unit:
    """A sensor unit: its kind, and what belongs to this unit alone."""

    sensor: SensorProfile
    """Profile of its kind."""
    model: TouchModel | None = None
    """Touch model; None is the one that palpate has for its kind."""
    calibration: Calibration | None = None
    """Calibration, if there is one."""
    touch: Touch | None = None
    """An object of the user's own that measures in place of the touch model."""

    @property
    def pitch_sigma(self) -> float:
        """Deviation of the pixel pitch, as a share of it; 0 where touch is given."""
        return 0.0 if self.touch else calibrated(self.sensor, self.calibration).pixel_pitch_sigma


def check_shape_and_settings(shape: Any, settings: Any) -> None:
    """Raise ShapeError or SettingError unless both are of the right kind and unit; settings may be None."""
    if not isinstance(shape, Unknown | Sketch):  # which have checked themselves
        check_outline(shape)
    _check_kind("settings", settings, TrackerSettings, "palpate.TrackerSettings(...)")


def unit_of(sensor: SensorProfile, model: Any, calibration: Any, touch: Any) -> Unit:
    """Return a sensor unit; all but the profile may be None. Raises SettingError on values of another kind."""
    _check_kind("model", model, TouchModel, "a palpate.TouchModel(folder)")
    from_file = "a Calibration, which palpate.load_calibration reads from a file"
    _check_kind("calibration", calibration, Calibration, from_file)
    _check_kind("touch", touch, Touch, "an object with methods measure(frame) and end_contact()")
    return Unit(sensor, model, calibration, touch)


def _check_kind(name: str, found: Any, kind: type, allowed: str) -> None:
    """Raise SettingError unless a value is None or of this kind."""
    # A class has the methods of its objects.
    if found is not None and (isinstance(found, type) or not isinstance(found, kind)):
        raise SettingError(f"{name} is {str(found) if isinstance(found, Path) else found!r}; it must be {allowed}")


def hand_of(sensor: Any, mounts: Mapping[str, ArrayLike] | None) -> Hand | None:
    """Return the hand that a tracker's arguments describe; None for one sensor. Raises SettingError on bad values."""
    if isinstance(sensor, Hand):
        if mounts is not None:
            raise SettingError("mounts are given beside a palpate.Hand, which has its own; allowed is one of both")
        return _several(sensor)
    if isinstance(sensor, Mapping):
        return _several(Hand(sensor, {} if mounts is None else mounts))  # pyright: ignore[reportArgumentType]  checked by it
    if mounts is not None:
        raise SettingError("mounts are of the fingers of a hand, and the sensor is one; allowed are sensors by name")
    return None


def _several(hand: Hand) -> Hand:
    """Return a hand of several fingers; raises SettingError on one of a single finger."""
    if len(hand.fingers) == 1:
        name = next(iter(hand.fingers))
        raise SettingError(
            f"hand has one finger, {name!r}; allowed are two or more, or the sensor itself in place of a hand"
        )
    return hand


def units_of(hand: Hand, model: Any, calibration: Any, touch: Any) -> dict[str, Unit]:
    """Return the sensor unit of each finger; raises SettingError on values of another kind or finger.

    All are dictionaries by finger, which may leave some out, or None; one model may be that of all fingers.
    """
    models = dict.fromkeys(hand.fingers, model) if isinstance(model, TouchModel) else _by_finger("model", model, hand)
    calibrations = _by_finger("calibration", calibration, hand)
    own = _by_finger("touch", touch, hand)
    units = {}
    for name, sensor in hand.fingers.items():
        try:
            units[name] = unit_of(sensor, models.get(name), calibrations.get(name), own.get(name))
        except SettingError as error:
            raise SettingError(f"finger {name!r}: {error}") from error
    return units


def _by_finger(what: str, given: Any, hand: Hand) -> Mapping[str, Any]:
    """Return values by finger; raises SettingError unless they are a dictionary by the names of fingers, or None."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise SettingError(f"{what} is of no finger; allowed is a dictionary by {', '.join(hand.fingers)}")
    check_names(what, given, hand.fingers)
    return given


def first_pose_of(pose: ArrayLike | None, sigma: ArrayLike | None, settings: TrackerSettings) -> FirstPose:
    """Return the first pose, and warn of degrees and millimetres.

    A pose of None is anywhere. `sigma` are standard deviations (3,) or a covariance (3, 3). Raises SettingError on
    other values.
    """
    first = finite_numbers(np.zeros(3) if pose is None else pose, (3,))
    if first is None:
        allowed = "three finite numbers x [m], y [m], theta [rad], or None"
        raise SettingError(f"first pose is {pose!r}; it must be {allowed}")
    if abs(first[2]) > TURNS:
        turns = abs(first[2]) / (2.0 * np.pi)
        logger.warning("first pose has theta %.4g rad, %.1f turns: are these degrees?", first[2], turns)
    if sigma is None:
        sigma = ANYWHERE_SIGMA if pose is None else settings.noise.first_pose.deviation
    return FirstPose(first, _covariance_of_first_pose(sigma))


def _covariance_of_first_pose(sigma: ArrayLike) -> Array:
    """Return the covariance (3, 3) of a first pose, given as it is or by standard deviations (3,)."""
    deviation = finite_numbers(sigma, (3,))
    # A negative deviation makes a negative variance, which is refused.
    covariance = finite_numbers(sigma, (3, 3)) if deviation is None else np.diag(deviation * np.abs(deviation))
    is_symmetric = covariance is not None and np.allclose(covariance, covariance.T)
    if covariance is None or not is_symmetric or np.linalg.eigvalsh(covariance).min() <= 0.0:
        allowed = "three numbers above 0: x [m], y [m], theta [rad], or a covariance (3, 3)"
        raise SettingError(f"first pose sigma is {np.asarray(sigma).tolist()}; it must be {allowed}")
    deviation = np.sqrt(np.diagonal(covariance))
    if (deviation[:2] > ANYWHERE_SIGMA[:2]).any():
        logger.warning("first pose sigma has %.4g and %.4g m: are these millimetres?", *deviation[:2])
    if deviation[2] > np.pi:
        logger.warning("first pose sigma has theta %.4g rad, any yaw at all: are these degrees?", deviation[2])
    return covariance


def noise_of_unit(noise: NoiseSettings, unit: Unit, set_up_sigma: ArrayLike | None = None) -> NoiseSettings:
    """Return the noise settings of a sensor unit: its calibration and the accuracy of its set-up replace defaults."""
    correction = unit.calibration.direction if unit.calibration else UNCORRECTED
    set_up = unit.calibration.set_up if unit.calibration else None
    scale, scale_sigma = noise.priors.direction_scale
    priors = replace(noise.priors, direction_scale=(scale, math.hypot(scale_sigma, unit.pitch_sigma)))
    if correction.offset_sigma is not None:
        priors = replace(priors, direction_bias=(0.0, correction.offset_sigma))
    if correction.scale_sigma is not None:
        priors = replace(priors, direction_scale=(0.0, correction.scale_sigma / correction.scale))
    if set_up is not None:
        priors = replace(priors, depth=set_up.depth, outline_scale=set_up.outline_scale)
        # The rest of the mounting is in the depth and in the errors of directions.
        _, sideways_sigma = set_up.sideways
        set_up_sigma = (sideways_sigma, sideways_sigma, 0.0)
    return _with_set_up(replace(noise, priors=priors), set_up_sigma)


def _with_set_up(noise: NoiseSettings, sigma: ArrayLike | None) -> NoiseSettings:
    """Return the noise settings with the accuracy of the set-up, where it is stated."""
    if sigma is None:
        return noise
    pose = replace(noise.sensor_pose, calibration=sigma)  # pyright: ignore[reportArgumentType]  checked by the settings
    return replace(noise, sensor_pose=pose)


def noise_of_hand(noise: NoiseSettings, set_up_sigma: ArrayLike | None, fingers: int) -> NoiseSettings:
    """Return the noise settings of a hand of so many fingers, each with the stated accuracy of its set-up.

    Each finger has a mounting of its own, so that the mean of their constant offsets is smaller than one of them.
    """
    of_one = _with_set_up(noise, set_up_sigma)
    x, y, yaw = (sigma / math.sqrt(fingers) for sigma in of_one.sensor_pose.calibration)
    return replace(of_one, sensor_pose=replace(of_one.sensor_pose, calibration=(x, y, yaw)))


def priors_of_finger(noise: NoiseSettings, unit: Unit, set_up_sigma: ArrayLike | None, fingers: int) -> Priors:
    """Return the prior of the variables that one of so many fingers has for itself.

    What the offsets of all fingers have in common cannot be measured. What one differs from it can, as two fingers see
    one object: it is in the indentation along the finger, and in the bias of its directions.
    """
    priors = noise_of_unit(noise, unit).priors
    if unit.calibration is not None and unit.calibration.set_up is not None:
        return priors  # which has the finger's own mounting
    share = math.sqrt(1.0 - 1.0 / fingers)
    along, _, yaw = _with_set_up(noise, set_up_sigma).sensor_pose.calibration
    depth, depth_sigma = priors.depth
    bias, bias_sigma = priors.direction_bias
    return replace(
        priors,
        depth=(depth, math.hypot(depth_sigma, share * along)),
        direction_bias=(bias, math.hypot(bias_sigma, share * yaw)),
    )
