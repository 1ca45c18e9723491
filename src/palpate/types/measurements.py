"""One instant of a sensor, and measurements of object and sensor at it: by touch, a camera, or a source of your own."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Image
from palpate.checks import TURNS, as_array
from palpate.errors import EstimationError, FileError


class Measurement:
    """Base of all measurements of one frame; each type has its factor in `palpate.models.pushing`.

    Those of palpate raise EstimationError on numbers that cannot be used.
    """


class TouchMeasurement(Measurement):
    """Base of measurements by touch on one tip: one number with its variance; arrays of one number are taken."""

    def __post_init__(self) -> None:
        for name, given in tuple(vars(self).items()):
            value = finite_number(given)
            allowed = _allowed_of_touch(name, value)
            if allowed:
                raise EstimationError(f"{type(self).__name__} has {name} {given!r}; {allowed}")
            object.__setattr__(self, name, value)


def _allowed_of_touch(name: str, value: float | None) -> str:
    """Return what is allowed for a number of a measurement by touch, in words; empty if it is that."""
    if value is None or (name == "variance" and not value > 0.0):
        return "its numbers must be finite, the variance above 0"
    if name == "angle" and abs(value) > TURNS:
        return "it must be in radians, up to two turns: are these degrees?"
    if name == "place" and abs(value) > 1.0:
        return "it must be in metres: are these millimetres?"
    return ""


@dataclass(frozen=True)
class ContactDirection(TouchMeasurement):
    """Direction of contact on a round tip: that of the outline's inward normal at the contact point.

    It is absolute and does not drift: it determines the yaw on a straight edge, and the place along a round one.
    """

    angle: float
    """Angle of the contact about the tip's centre of curvature in the sensor frame [rad]: 0 at the apex (+x), positive
    towards +y."""
    variance: float
    """[rad^2]"""


@dataclass(frozen=True)
class ContactPlace(TouchMeasurement):
    """Place of contact along y on a flat pad: the middle of the loaded part."""

    place: float
    """y in the sensor frame [m]."""
    variance: float
    """[m^2]"""


@dataclass(frozen=True)
class Turn(TouchMeasurement):
    """Yaw of the sensor in the object frame, up to an offset that is unknown and the same for the whole contact."""

    angle: float
    """The yaw less the offset [rad]."""
    variance: float
    """[rad^2]"""


@dataclass(frozen=True)
class ContactCorner(TouchMeasurement):
    """Angle from the inward bisector of the corner that is touched to the contact's inward normal.

    It says where in the corner's cone of normals the contact is. Together with the contact direction it determines the
    yaw at a corner.
    """

    angle: float
    """Angle at a right-angled corner [rad], counter-clockwise; all angles of one contact may have a common error."""
    variance: float
    """[rad^2], without the common error"""
    slope: float = 0.0
    """Change of the angle with half the angle between the normals of the corner's sides; 1 or -1 where one of the sides
    is touched beside the corner."""


@dataclass(frozen=True)
class ObjectPose(Measurement):
    """The object's pose as another source measured it: a camera, a tag, a person."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    time: float | None = None
    """Time of the measurement [s], at most a window before its frame; None for the frame's own time."""

    def __post_init__(self) -> None:
        check_time("ObjectPose", self.time)
        pose = finite_numbers(self.pose, (3,))
        if pose is None or abs(pose[2]) > TURNS:
            question = "" if pose is None else " up to two turns: are these degrees?"
            allowed = f"three finite numbers x [m], y [m], theta [rad]{question}"
            raise EstimationError(f"object pose is {' '.join(str(self.pose).split())}; it must be {allowed}")
        covariance = finite_numbers(self.covariance, (3, 3))
        if covariance is None or not _is_covariance(covariance):
            allowed = "a symmetric and positive definite (3, 3), deviations above 1 nm"
            stated = " ".join(str(self.covariance).split())
            raise EstimationError(f"object pose has covariance {stated}; it must be {allowed}")
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "covariance", covariance)


def _is_covariance(matrix: Array) -> bool:
    """Return true if a matrix (3, 3) is symmetric and positive definite."""
    # A covariance in m^2 has small numbers, so the tolerance is relative to the smallest variance.
    tolerance = 1e-6 * np.abs(np.diag(matrix)).min()
    return bool(np.allclose(matrix, matrix.T, atol=tolerance) and (np.linalg.eigvalsh(matrix) > 1e-18).all())


class OwnMeasurement(Measurement):
    """Base of measurements with residuals of their own: derive from it for a sensor that palpate has no factor for."""

    on: ClassVar[tuple[str, ...]]
    """Names of the unknowns that it depends on: "object_pose", "sensor", or others of
    `palpate.models.pushing.variables`."""
    time: float | None = None
    """Time of the measurement [s], at most a window before its frame; None for the frame's own time."""

    residual: Callable[..., ArrayLike]
    """Your method that takes the values of the unknowns `on`, in their order, and returns the residual (R,), each
    number divided by its standard deviation; R is at most 6. A pose is (x [m], y [m], theta [rad]).

    Its derivative is taken by finite differences. If the method raises or returns something else, a warning names the
    measurement, which is left out.
    """
    linearise: Callable[..., tuple[ArrayLike, ArrayLike]]
    """Your method in place of `residual`, if speed counts, that returns the residual and its Jacobian (R, C).

    A pose has three columns, for right (body-frame) perturbations x, y, theta; see `palpate.geometry.se2`. When a
    tracker gets the first measurement of a class, it compares the Jacobian with finite differences. If they differ, a
    warning names the class, and its measurements are left out.
    """


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of a recording, the input of `Tracker.update`."""

    time: float
    """[s]"""
    sensor_pose: Array
    """world_T_sensor, (3,) [m, m, rad]; or in space, (7,) with a quaternion x, y, z, w, or (4, 4). `palpate.gel_pose`
    computes it from the pose of a flange. Of a hand it is world_T_hand."""
    image: Image | None = None
    """Touch image, (height, width, 3), RGB."""
    contact: bool | None = None
    """True while the sensor touches the object; None if unknown."""
    object_pose: Array | None = None
    """world_T_object, (3,) [m, m, rad]: ground truth, used for scoring and by oracle touch only."""
    measurements: tuple[Measurement, ...] = ()
    """Measurements of this instant by other sources than touch, such as a camera's ObjectPose."""
    images: Mapping[str, Image] | None = None
    """Touch images of a hand's fingers by name, in place of `image`; a finger without a new image may be left out."""
    contacts: Mapping[str, bool] | None = None
    """Contact of a hand's fingers by name, in place of `contact`; a finger that is left out is unknown."""
    finger_poses: Mapping[str, Array] | None = None
    """world_T_finger of a hand's fingers by name, in the forms of `sensor_pose`, where fingers move in the hand: they
    take the place of the mounts of `palpate.Hand` at this instant."""
    image_times: Mapping[str, float] | None = None
    """Time of images that were taken at another time than the frame's, by finger [s]."""


def check_time(kind: str, time: object) -> None:
    """Raise EstimationError unless the time of a measurement, of a kind to be named, is a number [s] or None."""
    if time is not None and (not isinstance(time, Real) or isinstance(time, bool)):
        raise EstimationError(f"measurement {kind} is of time {time!r}; it must be a number [s], or None")


def finite_numbers(given: object, shape: tuple[int, ...]) -> Array | None:
    """Return a copy of a value as an array of a shape, or None if it is not finite numbers of that shape."""
    try:
        array = given if type(given) is np.ndarray else as_array("numbers", given)
        if array.dtype.kind not in "fiuO":  # NumPy would convert texts of digits, flags, and half of complex numbers
            return None
        numbers = np.array(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, FileError):
        return None
    # For a few numbers that is a third of the time of NumPy's functions.
    return numbers if numbers.shape == shape and all(map(math.isfinite, numbers.ravel().tolist())) else None


def finite_number(given: object) -> float | None:
    """Return a finite number, alone or in an array (1,); None for anything else."""
    if isinstance(given, float):
        return float(given) if math.isfinite(given) else None
    numbers = finite_numbers(given, ())
    if numbers is None:
        numbers = finite_numbers(given, (1,))
    return None if numbers is None else numbers.item()
