"""Camera view: drivers deliver images rotated, mirrored or with exchanged channels."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.cells import Levels, area_means
from palpate.types.sensor import DIGIT, SensorProfile

Level = TypeVar("Level", np.uint8, np.float32)

_BETTER = 3.0
"""Ratio of misfits from which another view is right. For images in the right view it is at most 0.7, in contact and in
another light, and for those of other units below 3 but for one in 300; in a wrong view 97 in 100 are above."""
_ROUNDING = 1.0  # [grey levels] by which a symmetric gel may fit better in another view


@dataclass(frozen=True)
class CameraView:
    """Steps that turn a camera's images into those of the sensor's profile."""

    quarter_turns: int = 0
    """Rotation, done first, in counter-clockwise quarter turns, 0 to 3."""
    mirrored: bool = False
    """Exchange left and right, done second."""
    channels: tuple[int, int, int] = (0, 1, 2)
    """The camera's channels that are red, green and blue."""

    @property
    def keeps_left_and_right(self) -> bool:
        """The right side of a camera's image is the right side of the profile's."""
        return (self.quarter_turns, self.mirrored) in ((0, False), (2, True))

    def of(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return a camera's image (height, width, 3), or its cells, in the profile's view."""
        if self == AS_IT_IS:
            return image
        turned = np.rot90(image, self.quarter_turns)
        return np.ascontiguousarray((turned[:, ::-1] if self.mirrored else turned)[..., self.channels])

    def __str__(self) -> str:
        turned = f"turned by {90 * self.quarter_turns} degrees" if self.quarter_turns else ""
        order = "".join("RGB"[channel] for channel in self.channels)
        channels = "" if order == "RGB" else f"channels {order}"
        return ", ".join(filter(None, (turned, "mirrored" * self.mirrored, channels))) or "as they come"


AS_IT_IS = CameraView()


def views(image: NDArray[Any], height: int, width: int) -> Iterator[CameraView]:
    """Yield the views in which an image has this size, the simplest first."""
    for red, green, blue in permutations(range(3)):
        for mirrored in (False, True):
            for quarter_turns in range(4):
                size = image.shape[:2] if quarter_turns % 2 == 0 else image.shape[1::-1]
                if size == (height, width):
                    yield CameraView(quarter_turns, mirrored, (red, green, blue))


def check_view(cells: Levels, untouched: Levels, name: str) -> None:
    """Raise SettingError if cells (rows, columns, 3) fit those of the untouched gel, called `name`, far better rotated.

    Most of the gel looks untouched whatever touches it, so medians over the image tell.
    """

    def misfit(view: CameraView) -> float:
        seen = view.of(cells)
        light = np.median(seen / np.maximum(untouched, 1.0), axis=(0, 1))
        return float(np.median(np.abs(seen - light * untouched)))

    off = {view: misfit(view) for view in views(cells, *untouched.shape[:2])}
    best = min(off, key=off.__getitem__)
    if off[AS_IT_IS] > _BETTER * (off[best] + _ROUNDING):
        raise SettingError(
            f"image: lies otherwise than {name}: it fits {best}, {off[best]:.1f} grey levels off in the median and not "
            f"{off[AS_IT_IS]:.1f}"
        )


_USUAL = {DIGIT.name: (0, 2, 1)}
"""Channels from left to right, by profile: as on 16 of 17 published DIGITs."""


def unusual_colours(untouched: NDArray[np.uint8], sensor: SensorProfile) -> str:
    """Return a question if the lights of an untouched gel are not where those of most units are, otherwise "".

    Units differ, so this refuses nothing. Each light makes one side of the gel glow: the side of a channel is the
    growth of its share from the middle to the right.
    """
    usual = _USUAL.get(sensor.name)
    if usual is None:
        return ""
    cells = area_means(untouched, 32, 24).astype(np.float64) + 10.0  # in the dark colours are noise
    share = cells / cells.sum(axis=2, keepdims=True)
    share /= share.mean(axis=(0, 1))
    x = (2.0 * np.arange(24)[:, None] + 1.0) / 24 - 1.0
    side = (share * x).mean(axis=(0, 1)) / (x**2).mean()
    span = float(np.ptp(side))
    # Nothing to say of a gel that hardly has colours, or if two channels differ by less than a tenth of the span.
    if span < 0.1 or max(side[usual[0]] - side.min(), side.max() - side[usual[-1]]) < 0.1 * span:
        return ""
    names = ("red", "green", "blue")
    found, wanted = (
        f"{names[order[0]]} at the left and {names[order[-1]]} at the right" for order in (np.argsort(side), usual)
    )
    return (
        f"the gel is {found}, and most units are {wanted}: are channels exchanged, or images rotated or mirrored? "
        "`palpate calibrate --presses` tells"
    )
