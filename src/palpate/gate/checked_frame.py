"""Frames of a stream as the tracker takes them, and one kind of error for those that it cannot."""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np

from palpate.errors import FrameError, PalpateError
from palpate.graph.factors.measured import check_own
from palpate.limits import FARTHEST
from palpate.types.frame import Frame
from palpate.types.measurements import (
    ContactDirection,
    ContactPlace,
    Measurement,
    OwnMeasurement,
    RelativePoses,
    Turn,
    finite_numbers,
)

_FARTHEST = np.array([1e4, 1e4, FARTHEST])
"""[m, m, rad] of a sensor's pose at most."""


def checked_frame(frame: Frame, measurements: Sequence[Measurement], after: float, tips: int) -> Frame:
    """Return a frame with poses of its own, so that a sensor may reuse its buffers, and all that is measured at it.

    It must come after a time [s], and be of a sensor with so many tips. Raises FrameError where it cannot be used.
    """
    if not isinstance(frame, Frame):
        raise FrameError(f"found {type(frame).__name__} in place of a frame; allowed is palpate.Frame(time, ...)")
    is_number = isinstance(frame.time, Real) and not isinstance(frame.time, bool)
    if not is_number or finite_numbers(frame.time, ()) is None:
        raise FrameError(f"frame has time {frame.time!r}; it must be a finite number [s]")
    when = f"frame at {frame.time:.3f} s"
    if frame.time <= after:
        raise FrameError(f"{when} follows one at {after:.3f} s; times must increase")
    if frame.contact is None and frame.image is None:
        raise FrameError(f"{when} has neither an image nor a contact flag; the tracker needs one of them")
    if frame.contact is not None and not isinstance(frame.contact, bool | np.bool_):
        raise FrameError(f"{when} has contact {frame.contact!r}; it must be True, False or None")
    pose = finite_numbers(frame.sensor_pose, (3,))
    if pose is None or (np.abs(pose) > _FARTHEST).any():
        raise FrameError(
            f"{when} has sensor pose {frame.sensor_pose}; it must be three finite numbers x [m], y [m], theta [rad], x "
            f"and y up to {_FARTHEST[0]:g}, theta up to {_FARTHEST[2]:g}"
        )
    if frame.image is not None:
        _check_image(when, frame.image)
    truth = None
    if frame.object_pose is not None:
        truth = finite_numbers(frame.object_pose, (3,))
        if truth is None and not _is_unknown(frame.object_pose):
            raise FrameError(f"{when} has object pose {frame.object_pose}; it must be three finite numbers or NaN")
    return replace(
        frame,
        time=float(frame.time),
        sensor_pose=pose,
        contact=None if frame.contact is None else bool(frame.contact),
        object_pose=truth,
        measurements=(
            *checked_measurements(frame.time, frame.measurements, tips),
            *checked_measurements(frame.time, measurements, tips),
        ),
    )


def _check_image(when: str, image: Any) -> None:
    wanted = "an array of uint8 (height, width, 3): rows, columns, red green blue"
    if not isinstance(image, np.ndarray):
        encoded = "; encoded images are to be decoded first" if isinstance(image, bytes | bytearray) else ""
        raise FrameError(f"{when} has an image of type {type(image).__name__}; it must be {wanted}{encoded}")
    if image.dtype != np.uint8 or image.ndim != 3:
        raise FrameError(f"{when} has an image of {image.dtype} {image.shape}; it must be {wanted}")


def _is_unknown(pose: Any) -> bool:
    """Whether a pose is three numbers of which some are NaN, as where motion capture lost the object."""
    try:
        return np.shape(pose) == (3,) and bool(np.isnan(np.asarray(pose, np.float64)).any())
    except (TypeError, ValueError):
        return False


def checked_measurements(time: float, measurements: Any, tips: int) -> tuple[Measurement, ...]:
    """Return what is measured at a time [s]: one measurement, or all of a list.

    Raises FrameError where something is no measurement, is not what it should be, or is not of a sensor with so many
    tips.
    """
    when = f"frame at {time:.3f} s"
    if isinstance(measurements, Measurement):
        measurements = (measurements,)
    try:
        several = tuple(measurements)
    except TypeError:
        found = type(measurements).__name__
        raise FrameError(f"{when} has measurements of type {found}; they must be a list of measurements") from None
    for one in several:
        _check_measurement(when, one, tips)
    return several


def _check_measurement(when: str, measurement: Any, tips: int) -> None:
    kind = type(measurement).__name__
    if not isinstance(measurement, Measurement):
        raise FrameError(f"{when} has a measurement of type {kind}; allowed are palpate's measurements, as ObjectPose")
    if tips > 1 and isinstance(measurement, ContactDirection | ContactPlace | Turn):
        raise FrameError(f"{when} has a measurement {kind}, which is of one tip, and the sensor has {tips}")
    if isinstance(measurement, RelativePoses) and not (np.linalg.eigvalsh(measurement.covariance) > 0.0).all():
        raise FrameError(f"{when} has a measurement RelativePoses whose covariance is not positive definite")
    if isinstance(measurement, OwnMeasurement):
        try:
            check_own(measurement)
        except PalpateError as error:
            raise FrameError(f"{when}: {error}") from error
