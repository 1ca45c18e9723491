"""Checks of a tracker's arguments: kinds, units and the first pose."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import SPAN, TURNS
from palpate.config import NoiseSettings, TrackerSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import Shape, check_outline
from palpate.touch.calibration import Calibration, DirectionCorrection
from palpate.touch.pipeline import Touch
from palpate.touch.touch_model import TouchModel
from palpate.types.measurements import finite_numbers

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

ANYWHERE, ANYWHERE_SIGMA = (0.0, 0.0, 0.0), (1.0, 1.0, 2.0)
"""First pose of an object that may be anywhere, and its standard deviations [m, m, rad]."""


def check_arguments(shape: Any, settings: Any, model: Any, calibration: Any, touch: Any) -> None:
    """Raise SettingError or ShapeError unless all are of the right kind and unit; all but the first may be None."""
    if not isinstance(shape, Shape):
        raise SettingError(f"shape is {shape!r}; it must be an outline, which palpate.load_shape reads from a file")
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
    pressure = settings.pressure if settings is not None else ""
    if not isinstance(pressure, str) and pressure > shape.extent:
        raise SettingError(
            f"pressure is {pressure:g} m, and the object is {shape.extent:.3g} m wide; a friction radius is less: "
            "is it in millimetres?"
        )


def first_pose_of(pose: ArrayLike | None, sigma: ArrayLike | None, settings: TrackerSettings) -> tuple[Array, Array]:
    """Return the first pose (3,) and its covariance (3, 3); raises SettingError on what is none.

    `sigma` are standard deviations (3,) or a covariance (3, 3). Warns of degrees and millimetres.
    """
    first = finite_numbers(ANYWHERE if pose is None else pose, (3,))
    if first is None:
        allowed = "three finite numbers x [m], y [m], theta [rad], or None"
        raise SettingError(f"first pose is {pose!r}; it must be {allowed}")
    if abs(first[2]) > TURNS:
        turns = abs(first[2]) / (2.0 * np.pi)
        logger.warning("first pose has theta %.4g rad, %.1f turns: are these degrees?", first[2], turns)
    if sigma is None:
        sigma = ANYWHERE_SIGMA if pose is None else settings.noise.first_pose.deviation
    covariance, deviation = finite_numbers(sigma, (3, 3)), finite_numbers(sigma, (3,))
    if covariance is not None and _is_positive(covariance):
        deviation = np.sqrt(np.diagonal(covariance))
    elif deviation is not None and (deviation > 0.0).all():
        covariance = np.diag(np.square(deviation))
    else:
        allowed = "three numbers above 0: x [m], y [m], theta [rad], or a covariance (3, 3)"
        raise SettingError(f"first pose sigma is {np.asarray(sigma).tolist()}; it must be {allowed}")
    if (deviation[:2] > ANYWHERE_SIGMA[:2]).any():
        logger.warning("first pose sigma has %.4g and %.4g m: are these millimetres?", *deviation[:2])
    if deviation[2] > np.pi:
        logger.warning("first pose sigma has theta %.4g rad, any yaw at all: are these degrees?", deviation[2])
    return first, covariance


def _is_positive(covariance: Array) -> bool:
    return np.allclose(covariance, covariance.T) and bool((np.linalg.eigvalsh(covariance) > 0.0).all())


def check_distance(first: tuple[Array, Array], sensor_pose: Array) -> None:
    """Warn if the first pose is farther from the first sensor pose (3,) than any push goes."""
    pose, covariance = first
    apart = float(np.hypot(*(sensor_pose - pose)[:2]))
    if apart > SPAN + 3.0 * float(np.sqrt(np.diagonal(covariance)[:2].max())):
        logger.warning("first pose is %.3g m from the sensor: is one of both in millimetres?", apart)


def with_correction(noise: NoiseSettings, correction: DirectionCorrection) -> NoiseSettings:
    """Return the settings with the uncertainty that a calibration leaves in corrected directions."""
    priors = noise.priors
    if correction.offset_sigma is not None:
        priors = replace(priors, direction_bias=(0.0, correction.offset_sigma))
    if correction.scale_sigma is not None:
        priors = replace(priors, direction_scale=(0.0, correction.scale_sigma / correction.scale))
    return replace(noise, priors=priors)
