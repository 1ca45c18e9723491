"""The untouched gel: what an image is compared with."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.light import Levels, cell_width, cells_of

Image = NDArray[np.uint8]

_FLAT = 4.0  # [grey levels] between the darkest and the brightest value of an image that shows nothing, or of a grey
SPARSE = 8  # pixels, of which one is looked at for that, for colours and for whether an image is the same
_ALIKE = 2  # pixels across that share their noise: cameras and JPEG keep one colour for 2 x 2
_COMMON = 10  # images that what all cells have in common of noise counts for, since that of one is known from few


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    deviation: Levels
    """Standard deviation over time, (height, width, 3) [grey levels]."""
    noise: Levels = field(default_factory=lambda: np.empty((0, 0, 3), np.float32))
    """The same of the cells, (rows, columns, 3) [grey levels]; see `touch.light`. By default as if pixels had noise of
    their own; some cameras have stripes, which cells share."""

    def __post_init__(self) -> None:
        if not self.noise.size:
            part = min(_ALIKE / cell_width(*self.deviation.shape[:2]), 1.0)
            object.__setattr__(self, "noise", cells_of(self.deviation) * np.float32(part))


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of two or more untouched images (height, width, 3), read one after the other."""
    seen = UntouchedImages()
    for image in images:
        seen.add(image)
    return seen.background()


class UntouchedImages:
    """Statistics of untouched images that come one after the other; the images themselves are not kept."""

    def __init__(self) -> None:
        self._pixels, self._cells = _Statistics(), _Statistics()

    @property
    def count(self) -> int:
        """How many there were."""
        return self._pixels.count

    def add(self, image: Image) -> None:
        """Take the next image (height, width, 3)."""
        levels = image.astype(np.float32)
        self._pixels.add(levels)
        self._cells.add(cells_of(levels))

    def background(self) -> Background:
        """Return the statistics of all of them. Raises SettingError on fewer than 2."""
        pixels, cells = self._pixels, self._cells
        if pixels.count < 2:
            raise SettingError(f"a background needs 2 or more untouched images, found {pixels.count}")
        own = cells.count - 1
        noise = (own * cells.variance + _COMMON * cells.variance.mean()) / (own + _COMMON)
        mean, deviation, noise = pixels.mean, np.sqrt(pixels.variance), np.sqrt(noise)
        return Background(mean.astype(np.float32), deviation.astype(np.float32), noise.astype(np.float32))


class _Statistics:
    """Mean and variance of arrays that come one after the other."""

    def __init__(self) -> None:
        self._total, self._squares, self.count = np.zeros(()), np.zeros(()), 0

    def add(self, values: Levels) -> None:
        exact = values.astype(np.float64)
        self._total = self._total + exact
        self._squares = self._squares + exact**2
        self.count += 1

    @property
    def mean(self) -> NDArray[np.float64]:
        return self._total / self.count

    @property
    def variance(self) -> NDArray[np.float64]:
        return np.maximum(self._squares - self.count * self.mean**2, 0.0) / (self.count - 1)


def check_image(image: Image, height: int, width: int) -> None:
    """SettingError unless the image is uint8 (height, width, 3)."""
    expected = f"uint8 ({height}, {width}, 3): rows, columns, red green blue"
    if not isinstance(image, np.ndarray):
        raise SettingError(f"image: found {type(image).__name__}, expected an array {expected}")
    if image.dtype != np.uint8 or image.shape != (height, width, 3):
        hint = {(width, height, 3): "turned by a quarter", (3, height, width): "channels first"}.get(image.shape)
        found = f"{image.dtype} {image.shape}" + (f", {hint}" if hint and height != width else "")
        raise SettingError(f"image: found {found}; expected {expected}")


def is_flat(image: Image | Levels) -> bool:
    """Return whether an image is all of one level, as black and saturated ones are."""
    return float(np.ptp(image[::SPARSE, ::SPARSE])) < _FLAT


def is_grey(image: Image | Levels) -> bool:
    """Return whether all channels of an image (height, width, 3) are alike, as those of a black one are."""
    if image.ndim != 3:
        return False
    sparse = image[::SPARSE, ::SPARSE]
    return bool((sparse == sparse[..., :1]).all())


def check_colours(image: Image, background: Background) -> None:
    """SettingError if the image is grey and the background in colours; of black and saturated ones nobody can say."""
    colours = float(np.ptp(background.mean[::SPARSE, ::SPARSE], axis=-1).mean())
    if colours > _FLAT and is_grey(image) and not is_flat(image):
        raise SettingError("image: found grey, expected colours as the untouched gel has")
