"""Background: statistics of the untouched gel, from its images, with which an image is compared."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.cells import Levels, cell_width, cells_of, share_unlike

Image = NDArray[np.uint8]
AnyImage = TypeVar("AnyImage", NDArray[np.uint8], NDArray[np.float32])

SPARSE = 8  # every eighth pixel is looked at for colours and for whether two images are the same
UNLIKE = np.float32(8.0)  # [grey levels] between cells of images that do not show one gel at rest
_FLAT = 4.0  # [grey levels] between darkest and brightest value of an image without content
_DARK = 5.0  # [grey levels] mean of an image before light and camera are on
_CORRELATED = 2  # pixels across that share their noise: cameras and JPEG keep one colour for 2 x 2
_PRIOR_IMAGES = 10  # weight of the mean noise of all cells, as that of one is known from few images
_MOVED = 0.01  # share of values unlike, from which something moves on the gel
_SECONDS, _FEWEST = 0.5, 8  # [s] and least number of first images that are taken as untouched

# Markers: dots on some gels, darker than the gel around them. Sizes in pixels, 13 are 0.8 mm on a GelSight Mini.
_MARKER, _SMALLEST_MARKER, _FEWEST_MARKERS, _MARKER_EDGE = 13, 3, 20, 3
_DARKER = 12.0  # [grey levels]


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    deviation: Levels
    """Standard deviation over time, (height, width, 3) [grey levels]."""
    noise: Levels = field(default_factory=lambda: np.empty((0, 0, 3), np.float32))
    """Standard deviation of the cells, (rows, columns, 3) [grey levels]. By default pixels have independent noise; some
    cameras have stripes, which cells share."""

    def __post_init__(self) -> None:
        if not self.noise.size:
            part = min(_CORRELATED / cell_width(*self.deviation.shape[:2]), 1.0)
            object.__setattr__(self, "noise", cells_of(self.deviation) * np.float32(part))


class UntouchedImages:
    """Running statistics of untouched images."""

    def __init__(self) -> None:
        self.count = 0
        self._sums = [np.zeros(())] * 4  # of pixels and their squares, of cells and their squares

    def add(self, image: Image) -> None:
        """Add an image (height, width, 3)."""
        levels = image.astype(np.float32)
        pixels, cells = levels.astype(np.float64), cells_of(levels).astype(np.float64)
        added = pixels, pixels**2, cells, cells**2
        self._sums = [total + more for total, more in zip(self._sums, added, strict=True)]
        self.count += 1

    def background(self) -> Background:
        """Return the statistics; raises SettingError on fewer than 2 images."""
        if (count := self.count) < 2:
            raise SettingError(f"a background needs 2 or more untouched images, found {count}")
        pixels, squares, cells, cell_squares = self._sums
        mean = pixels / count
        variance = np.maximum(squares - count * mean**2, 0.0) / (count - 1)
        noise = np.maximum(cell_squares - count * (cells / count) ** 2, 0.0) / (count - 1)
        noise = ((count - 1) * noise + _PRIOR_IMAGES * noise.mean()) / (count - 1 + _PRIOR_IMAGES)
        deviation, noise = np.sqrt(variance), np.sqrt(noise)
        return Background(mean.astype(np.float32), deviation.astype(np.float32), noise.astype(np.float32))


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of two or more untouched images (height, width, 3), read one after the other."""
    seen = UntouchedImages()
    for image in images:
        seen.add(image)
    return seen.background()


def background_of_stills(images: Sequence[Image]) -> Background:
    """Return the background of one or more untouched images; that of a single one has no noise."""
    if len(images) > 1:
        return background_of(images)
    check_image(images[0], *images[0].shape[:2])
    return Background(images[0].astype(np.float32), np.zeros(images[0].shape, np.float32))


def first_frames(rate: float) -> int:
    """Return the number of first images that are taken as untouched, at a rate [Hz]."""
    return max(round(_SECONDS * rate), _FEWEST)


class SteadyImages:
    """Background of the first half second of images that are alike and not black."""

    def __init__(self, rate: float) -> None:
        self._needed = first_frames(rate)
        self.forget()

    def forget(self) -> None:
        """Start again with the next image."""
        self._seen, self._first = UntouchedImages(), np.empty(0, np.float32)

    @property
    def is_empty(self) -> bool:
        """The next image is the first."""
        return not self._seen.count

    def add(self, image: Image) -> Background | None:
        """Add an image (height, width, 3); return the background once there are enough, then start again."""
        if is_dark(image):
            return None
        cells = cells_of(image)
        if self.is_empty or share_unlike(cells, self._first, UNLIKE) > _MOVED:
            # Something moves, or the light is still coming on.
            self._seen, self._first = UntouchedImages(), cells
        self._seen.add(image)
        if self._seen.count < self._needed:
            return None
        found = self._seen.background()
        self.forget()
        return found


def check_image(image: Image, height: int, width: int) -> None:
    """Raise SettingError unless an image is uint8 (height, width, 3)."""
    expected = f"uint8 ({height}, {width}, 3): rows, columns, red green blue"
    if not isinstance(image, np.ndarray):
        raise SettingError(f"image: found {type(image).__name__}, expected an array {expected}")
    if image.dtype != np.uint8 or image.shape != (height, width, 3):
        hint = {(width, height, 3): "turned by a quarter", (3, height, width): "channels first"}.get(image.shape)
        found = f"{image.dtype} {image.shape}" + (f", {hint}" if hint and height != width else "")
        raise SettingError(f"image: found {found}; expected {expected}")


def is_dark(image: Image | Levels) -> bool:
    """Return true if light or camera are not on yet."""
    return float(image.mean()) < _DARK


def is_flat(image: Image | Levels) -> bool:
    """Return true if an image has one level, as black and saturated ones have."""
    return float(np.ptp(image[::SPARSE, ::SPARSE])) < _FLAT


def is_grey(image: Image | Levels) -> bool:
    """Return true if all channels of an image (height, width, 3) are equal, also in a black one."""
    if image.ndim != 3:
        return False
    sparse = image[::SPARSE, ::SPARSE]
    return bool((sparse == sparse[..., :1]).all())


def check_colours(image: Image, background: Background) -> None:
    """Raise SettingError on a grey image, not black or saturated, if the background has colours."""
    colours = float(np.ptp(background.mean[::SPARSE, ::SPARSE], axis=-1).mean())
    if colours > _FLAT and is_grey(image) and not is_flat(image):
        raise SettingError("image: found grey, expected colours as the untouched gel has")


def has_markers(image: AnyImage) -> bool:
    """Return true if an image (height, width, 3) of an untouched gel shows a grid of markers."""
    import cv2

    dark, _ = _dark_dots(image)
    _, _, stats, _ = cv2.connectedComponentsWithStats(dark)
    extent = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    return int(((extent >= _SMALLEST_MARKER) & (extent < _MARKER)).all(axis=1).sum()) >= _FEWEST_MARKERS


def without_markers(image: AnyImage) -> AnyImage:
    """Return an image (height, width, 3) in which markers look like the gel around them."""
    import cv2

    dark, filled = _dark_dots(image)
    hidden = cv2.dilate(dark, np.ones((_MARKER_EDGE, _MARKER_EDGE), np.uint8))
    unmarked: Any = cv2.copyTo(filled, hidden, image.copy())
    return unmarked


def _dark_dots(image: NDArray[Any]) -> tuple[NDArray[np.uint8], Any]:
    """Return a mask (height, width) of small dark dots, and the image with these filled by a grey closing."""
    import cv2

    filled = cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((_MARKER, _MARKER), np.uint8))
    darker = cv2.cvtColor(cv2.subtract(filled, image), cv2.COLOR_RGB2GRAY)
    return (darker > _DARKER).astype(np.uint8), filled
