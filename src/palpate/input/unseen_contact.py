"""A contact that no image shows any more, as its side has slid onto the pad's hard rim.

An object that nothing touches rests, so a contact ends where the sensor moves back out of it, or where something else
takes the object away. A touch that fades at the rim while the sensor still moves into the object goes on.
"""

from collections.abc import Sequence

from palpate.config import CONTACT_DETECTION
from palpate.types.measurements import ContactDirection, Measurement

_AT_RIM = 0.35
"""[rad] Direction from which a side may slide onto the rim."""
_SURE = 0.3
"""[rad] Standard deviation up to which a direction is sure."""
_FAINT_SHARE = 2.0 * CONTACT_DETECTION.start
"""Share of an image's values that a touch shows when it fades; one that something takes away shows more."""
_WITHDRAWN = 5e-4
"""[m] Motion out of the object that ends a contact: the indentation of a gel."""


class UnseenContact:
    """Decides in each frame of one contact whether it goes on although the image does not show it."""

    def __init__(self) -> None:
        self._direction = 0.0  # the last sure one of this contact [rad]
        self._share = 1.0  # of the last image that showed it
        self._withdrawn = 0.0  # motion out of the object since its farthest point [m]

    def see(self, measurements: Sequence[Measurement], share: float) -> None:
        """Take what touch measures in a frame of contact, and the share of its image that shows it."""
        for measurement in measurements:
            if isinstance(measurement, ContactDirection) and measurement.variance < _SURE**2:
                self._direction = abs(measurement.angle)
        self._share = share
        self._withdrawn = 0.0

    def goes_on(self, withdrawal: float) -> bool:
        """Return True if a contact goes on that the next image does not show.

        `withdrawal` is the motion of the sensor out of the object since the last frame, negative into it [m].
        """
        self._withdrawn = max(self._withdrawn + withdrawal, 0.0)
        fades_at_rim = self._direction > _AT_RIM and self._share < _FAINT_SHARE
        return fades_at_rim and self._withdrawn < _WITHDRAWN
