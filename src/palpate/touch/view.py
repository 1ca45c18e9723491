"""How a camera's images lie: drivers deliver them turned, mirrored and with exchanged channels."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Level = TypeVar("Level", np.uint8, np.float32)


@dataclass(frozen=True)
class CameraView:
    """What is to be done to a camera's images so that they lie as those of the sensor's profile do."""

    quarter_turns: int = 0
    """By how many quarters they are turned first, counter-clockwise, 0 to 3."""
    mirrored: bool = False
    """Whether left and right are exchanged then."""
    channels: tuple[int, int, int] = (0, 1, 2)
    """Which of the camera's channels are red, green and blue."""

    @property
    def keeps_left_and_right(self) -> bool:
        """Whether what lies to the right in a camera's image lies to the right in the profile's."""
        return (self.quarter_turns, self.mirrored) in ((0, False), (2, True))

    def of(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return an image (height, width, 3) of the camera, or its cells, as one of the profile."""
        if self == AS_IT_IS:
            return image
        turned = np.rot90(image, self.quarter_turns)
        return np.ascontiguousarray((turned[:, ::-1] if self.mirrored else turned)[..., self.channels])

    def __str__(self) -> str:
        """In words."""
        turned = f"turned by {90 * self.quarter_turns} degrees" if self.quarter_turns else ""
        mirrored = "mirrored" if self.mirrored else ""
        order = "".join("RGB"[channel] for channel in self.channels)
        channels = "" if order == "RGB" else f"channels {order}"
        return ", ".join(filter(None, (turned, mirrored, channels))) or "as they come"


AS_IT_IS = CameraView()


def views(image: NDArray[Any], height: int, width: int) -> Iterator[CameraView]:
    """Yield the views in which an image has this size, the simplest first."""
    for red, green, blue in permutations(range(3)):
        for mirrored in (False, True):
            for quarter_turns in range(4):
                size = image.shape[:2] if quarter_turns % 2 == 0 else image.shape[1::-1]
                if size == (height, width):
                    yield CameraView(quarter_turns, mirrored, (red, green, blue))
