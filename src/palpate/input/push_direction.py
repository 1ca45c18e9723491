"""Direction in which a sensor pushes, in its own frame: along its x axis, or the frame that was given is turned."""

import cmath
import math

from palpate.arrays import Array
from palpate.config import LARGEST_ERROR

SIDEWAYS_PUSH = 1.22
"""[rad] 70 degrees from the sensor's x axis, from which a push is sideways."""


def axis_words(angle: float) -> str:
    """Return a sentence on a sensor that moves at an angle [rad] from its x axis while it touches."""
    axis = ("+x", "+y", "-x", "-y")[round(angle / (0.5 * math.pi)) % 4]
    question = "is its frame turned (sensor_T_gel), or is w the first of each quaternion?"
    return (
        f"the sensor moves along {axis} of its own frame in contact; its x axis must point along the push: {question}"
    )


class PushDirection:
    """Adds up the motion of a sensor while its images show a touch.

    Contact without an image does not count, as a tip may be round and its frame lie anyhow.
    """

    def __init__(self) -> None:
        self._touched_at: Array | None = None  # pose at the last frame, if it showed a touch
        self._pushed = 0j  # [m] in the sensor frame, in all contacts

    def see(self, sensor_pose: Array, sees_touch: bool) -> None:
        """Take a sensor pose (3,) and whether the image shows a touch."""
        if sees_touch and self._touched_at is not None:
            x, y, yaw = sensor_pose.tolist()
            x_before, y_before, _ = self._touched_at.tolist()
            self._pushed += complex(x - x_before, y - y_before) * cmath.rect(1.0, -yaw)
        self._touched_at = sensor_pose if sees_touch else None

    @property
    def angle(self) -> float:
        """Angle of the motion from the sensor's x axis [rad]; 0 while it is short."""
        # A shorter motion may be an error of the stated poses.
        is_long = abs(self._pushed) * math.cos(SIDEWAYS_PUSH) >= LARGEST_ERROR[0]
        return cmath.phase(self._pushed) if is_long else 0.0

    @property
    def weakness(self) -> str:
        """Sentence on a push that is sideways; empty if it is not."""
        return axis_words(self.angle) if abs(self.angle) >= SIDEWAYS_PUSH else ""
