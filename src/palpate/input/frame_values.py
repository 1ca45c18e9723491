"""Values of a frame: each is checked by itself, and the error names the one that cannot be used."""

from typing import Any

import numpy as np

from palpate.arrays import Array, changed
from palpate.checks import FARTHEST
from palpate.errors import FileError, FrameError, PalpateError
from palpate.models.pushing.own_measurements import check_own
from palpate.types.measurements import (
    Frame,
    Measurement,
    OwnMeasurement,
    TouchMeasurement,
    finite_number,
    finite_numbers,
)
from palpate.types.space import gel_pose

BY_FINGER = ("images", "contacts", "finger_poses", "image_times")
"""Values of a frame by finger."""


def check_one_sensor(frame: Any) -> None:
    """Raise FrameError on a frame with values by finger, which a tracker of one sensor cannot use."""
    for field in BY_FINGER:
        if isinstance(frame, Frame) and getattr(frame, field):
            raise FrameError(
                f"frame at {frame.time} s has {field} by finger, and this tracker has one sensor; allowed are image "
                "and contact, or a tracker of a hand: Tracker(shape, palpate.Hand(fingers, mounts), first_pose)"
            )


def with_checked_values(frame: Any, measurements: Any, tips: int) -> Frame:
    """Return a copy of a frame, so that a driver may reuse its arrays, with further measurements added.

    `tips` is the sensor's number of tips. Raises FrameError on a value that is not allowed.
    """
    if not isinstance(frame, Frame):
        raise FrameError(f"found {type(frame).__name__} in place of a frame; allowed is palpate.Frame(time, ...)")
    time = None if isinstance(frame.time, bool) else finite_number(frame.time)
    if time is None:
        raise FrameError(f"frame has time {frame.time!r}; it must be a finite number [s]")
    when = f"frame at {time:.3f} s"
    sensor_pose = planar(when, frame.sensor_pose)
    if sensor_pose is None or max(map(abs, sensor_pose.tolist())) > FARTHEST:
        allowed = f"three finite numbers x [m], y [m], theta [rad], up to {FARTHEST:g}"
        raise FrameError(f"{when} has sensor pose {frame.sensor_pose}; it must be {allowed}")
    # NaN where a camera loses the object, which is no pose.
    object_pose = None if frame.object_pose is None else planar(when, frame.object_pose)
    _check_contact(when, frame)
    check_image(when, frame.image)
    own = checked_measurements(time, frame.measurements, tips)
    added = checked_measurements(time, measurements, tips)
    return changed(
        frame,
        time=time,
        sensor_pose=sensor_pose,
        contact=None if frame.contact is None else bool(frame.contact),
        object_pose=object_pose,
        measurements=(*own, *added),
    )


def checked_measurements(time: float, measurements: Any, tips: int) -> tuple[Measurement, ...]:
    """Return the measurements of a frame as a tuple; raises FrameError on one that is not allowed."""
    if isinstance(measurements, tuple) and not measurements:
        return ()
    when = f"frame at {time:.3f} s"
    try:
        several = (measurements,) if isinstance(measurements, Measurement) else tuple(measurements)
    except TypeError:
        found = type(measurements).__name__
        raise FrameError(f"{when} has measurements of type {found}; they must be a list of measurements") from None
    for measurement in several:
        _check_measurement(when, measurement, tips)
    return several


def _check_measurement(when: str, measurement: Any, tips: int) -> None:
    """Raise FrameError unless a measurement is one of palpate, or the user's own, that fits a sensor's tips."""
    kind = type(measurement).__name__
    if not isinstance(measurement, Measurement):
        raise FrameError(f"{when} has a measurement of type {kind}; allowed are palpate's, as ObjectPose")
    if tips > 1 and isinstance(measurement, TouchMeasurement):
        raise FrameError(f"{when} has a measurement {kind}, which is of one tip, and the sensor has {tips}")
    if isinstance(measurement, OwnMeasurement):
        try:
            check_own(measurement)
        except PalpateError as error:
            raise FrameError(f"{when}: {error}") from error


def _check_contact(when: str, frame: Frame) -> None:
    """Raise FrameError unless a contact flag or an image says if the frame is in contact."""
    if frame.contact is None and frame.image is None:
        raise FrameError(f"{when} has neither an image nor a contact flag; the tracker needs one of them")
    if not isinstance(frame.contact, bool | np.bool_ | None):
        raise FrameError(f"{when} has contact {frame.contact!r}; it must be True, False or None")


def check_image(when: str, image: Any) -> None:
    """Raise FrameError unless an image is an array of pixels, or None."""
    is_array = isinstance(image, np.ndarray)
    if image is None or (is_array and image.dtype == np.uint8 and image.ndim == 3):
        return
    found = f"{image.dtype} {image.shape}" if is_array else f"type {type(image).__name__}"
    allowed = "an array of uint8 (height, width, 3): rows, columns, red green blue; decode encoded images first"
    raise FrameError(f"{when} has an image of {found}; it must be {allowed}")


def planar(when: str, pose: Any) -> Array | None:
    """Return a pose in the plane, or one in space (7,) or (4, 4) as one; None if it is neither."""
    found = finite_numbers(pose, (3,))
    if found is not None or all(finite_numbers(pose, shape) is None for shape in ((7,), (4, 4))):
        return found
    try:
        return gel_pose(pose)
    except FileError as error:
        raise FrameError(f"{when}: {error}") from error
