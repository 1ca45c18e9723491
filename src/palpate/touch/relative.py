"""Relative sensor poses from touch, between the current frame and earlier ones of a contact (paper Sec. IV-A)."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.types.frame import Frame
from palpate.types.measurements import FARTHEST_BACK, Measurement, RelativePoses, Turn

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

_TRUE = 1e-3  # [rad] standard deviation of the yaw that motion capture tells
BACK = np.arange(10, FARTHEST_BACK + 1)
"""How many frames ago the compared frames were, as in the published system."""


@runtime_checkable
class Touch(Protocol):
    """What reads the frames of a contact, one after the other."""

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """Return what the frame says, by itself and relative to earlier ones of this contact."""
        ...

    def end_contact(self) -> None:
        """Forget this contact: the next frame begins another."""
        ...


class NoTouch:
    """Measures nothing: pushing and geometry alone."""

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """See Touch."""
        return ()

    def end_contact(self) -> None:
        """See Touch."""


class ConstantTouch:
    """Says that the sensor has not turned on the object, whatever the image.

    This is the paper's constant model: over pairs in both orders, the mean of the turns is zero.
    """

    def __init__(self, sigmas: tuple[float, float, float]) -> None:
        self._covariance = np.diag(np.square(sigmas))
        self._age = -1

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """See Touch."""
        self._age += 1
        back = compared_frames(self._age)
        return _relative_poses(back, np.zeros((len(back), 3)), self._covariance)

    def end_contact(self) -> None:
        """See Touch."""
        self._age = -1


class OracleTouch:
    """Measures the true turn of the sensor on the object, up to an offset of the contact, from ground truth."""

    def __init__(self, sigmas: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Take nothing that counts any more."""

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """See Touch. A frame without ground truth has no measurement."""
        if frame.object_pose is None or not np.isfinite(frame.object_pose).all():
            return ()
        yaw = se2.between(np.asarray(frame.object_pose), frame.sensor_pose)[2]
        return (Turn(float(yaw), _TRUE**2),)

    def end_contact(self) -> None:
        """See Touch."""


def compared_frames(age: int) -> Indices:
    """How many frames ago the frames are with which one of this age is compared; the first of a contact has age 0.

    A young frame is compared with the first as well, on which the object's first pose rests: without that nothing tells
    its yaw until the contact is BACK[0] frames old.
    """
    back = BACK[age >= BACK]
    return np.append(back, age) if 0 < age <= BACK[-1] and age not in back[-1:] else back


def _relative_poses(back: Indices, pose: Array, covariance: Array) -> Sequence[Measurement]:
    if not len(back):
        return ()
    return (RelativePoses(back, pose, np.broadcast_to(covariance, (len(back), 3, 3))),)
