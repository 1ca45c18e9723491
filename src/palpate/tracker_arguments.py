"""Arguments of a tracker: checked, and brought into the form in which its parts take them."""

import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.checks import SPAN, TURNS
from palpate.config import ANYWHERE_SIGMA, UNLIKELY, NoiseSettings, TrackerSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import check_outline
from palpate.touch.calibration import UNCORRECTED, Calibration
from palpate.touch.pipeline import Touch
from palpate.touch.touch_model import TouchModel
from palpate.types.measurements import finite_numbers

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class FirstPose:
    """Pose of the object at the first frame."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""

    def warn_if_far_from(self, sensor_pose: Array) -> None:
        """Warn if the sensor is far from it at the first frame, or if the sensor's yaw is in degrees."""
        if abs(sensor_pose[2]) > TURNS:
            logger.warning("sensor pose has theta %.4g rad: are these degrees?", sensor_pose[2])
        distance = float(np.hypot(*(sensor_pose - self.pose)[:2]))
        deviation = float(np.sqrt(np.diagonal(self.covariance)[:2].max()))
        if distance > SPAN + UNLIKELY * deviation:
            logger.warning("first pose is %.3g m from the sensor: is one of both in millimetres?", distance)


def check_arguments(shape: Any, settings: Any, model: Any, calibration: Any, touch: Any) -> None:
    """Raise SettingError or ShapeError unless all are of the right kind and unit; all but the first may be None."""
    check_outline(shape)
    for name, found, kind, maker in (
        ("settings", settings, TrackerSettings, "palpate.TrackerSettings(...)"),
        ("model", model, TouchModel, "a palpate.TouchModel(folder)"),
        ("calibration", calibration, Calibration, "a Calibration, which palpate.load_calibration reads from a file"),
        ("touch", touch, Touch, "an object with methods measure(frame) and end_contact()"),
    ):
        # A class has the methods of its objects.
        if found is not None and (isinstance(found, type) or not isinstance(found, kind)):
            raise SettingError(f"{name} is {str(found) if isinstance(found, Path) else found!r}; it must be {maker}")


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


def noise_of_unit(
    noise: NoiseSettings, calibration: Calibration | None, pitch_sigma: float, set_up_sigma: ArrayLike | None = None
) -> NoiseSettings:
    """Return the noise settings of a sensor unit: its calibration and the accuracy of its set-up replace the defaults.

    `pitch_sigma` is the deviation of the pixel pitch of units without a calibration, as a share of it.
    """
    correction = calibration.direction if calibration else UNCORRECTED
    set_up = calibration.set_up if calibration else None
    scale, scale_sigma = noise.priors.direction_scale
    priors = replace(noise.priors, direction_scale=(scale, math.hypot(scale_sigma, pitch_sigma)))
    if correction.offset_sigma is not None:
        priors = replace(priors, direction_bias=(0.0, correction.offset_sigma))
    if correction.scale_sigma is not None:
        priors = replace(priors, direction_scale=(0.0, correction.scale_sigma / correction.scale))
    if set_up is not None:
        priors = replace(priors, depth=set_up.depth, outline_scale=set_up.outline_scale)
        # The rest of the mounting is in the depth and in the errors of directions.
        _, sideways_sigma = set_up.sideways
        set_up_sigma = (sideways_sigma, sideways_sigma, 0.0)
    pose = noise.sensor_pose
    if set_up_sigma is not None:
        pose = replace(pose, calibration=set_up_sigma)  # pyright: ignore[reportArgumentType]  checked by the settings
    return replace(noise, priors=priors, sensor_pose=pose)


def noise_of_hand(noise: NoiseSettings, set_up_sigma: ArrayLike | None, fingers: int) -> NoiseSettings:
    """Return the noise settings of a hand of so many fingers, each with the stated accuracy of its set-up.

    Each finger has a mounting of its own, so that the mean of their constant offsets is smaller than one of them.
    """
    of_one = noise_of_unit(noise, None, 0.0, set_up_sigma)
    x, y, yaw = (sigma / math.sqrt(fingers) for sigma in of_one.sensor_pose.calibration)
    return replace(of_one, sensor_pose=replace(of_one.sensor_pose, calibration=(x, y, yaw)))
