"""The untouched gel: what an image is compared with."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError

Image = NDArray[np.uint8]
Levels = NDArray[np.float32]

_SWAPPED = 4.0  # times better that blue for red must fit: untouched values differ by noise, swapped ones by tens


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    deviation: Levels
    """Standard deviation over time, (height, width, 3) [grey levels]."""


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of two or more untouched images (height, width, 3), read one after the other."""
    total, squares, count = np.zeros(()), np.zeros(()), 0
    for image in images:
        levels = image.astype(np.float64)
        total = total + levels
        squares = squares + levels**2
        count += 1
    if count < 2:
        raise SettingError(f"a background needs 2 or more untouched images, found {count}")
    mean = total / count
    variance = np.maximum(squares - count * mean**2, 0.0) / (count - 1)
    return Background(mean.astype(np.float32), np.sqrt(variance).astype(np.float32))


def check_image(image: Image, height: int, width: int) -> None:
    """SettingError unless the image is uint8 (height, width, 3)."""
    expected = f"uint8 ({height}, {width}, 3): rows, columns, red green blue"
    if not isinstance(image, np.ndarray):
        raise SettingError(f"image: found {type(image).__name__}, expected an array {expected}")
    if image.dtype != np.uint8 or image.shape != (height, width, 3):
        hint = {(width, height, 3): "turned by a quarter", (3, height, width): "channels first"}.get(image.shape)
        found = f"{image.dtype} {image.shape}" + (f", {hint}" if hint and height != width else "")
        raise SettingError(f"image: found {found}; expected {expected}")


def check_channel_order(image: Image, background: Background) -> None:
    """SettingError if the image fits the background only with red and blue swapped.

    Most of the gel looks as it did untouched, whatever touches it; so the medians over the image tell. A gel that is
    lit in greys looks the same in both orders and passes.
    """
    levels = image.astype(np.float32)
    given = np.median(np.abs(levels - background.mean))
    swapped = np.median(np.abs(levels[..., ::-1] - background.mean))
    if given > _SWAPPED * (swapped + 1.0):
        raise SettingError(
            f"image: found BGR, expected RGB: it is {given:.0f} grey levels off the untouched gel in the median, "
            f"and {swapped:.0f} with red and blue swapped"
        )
