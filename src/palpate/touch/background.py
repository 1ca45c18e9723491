"""Background: the untouched gel as its images show it, with which an image is compared."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Image, Levels
from palpate.config import CONTACT_DETECTION
from palpate.errors import SettingError
from palpate.touch.cells import NEIGHBOURS, cells_of, change_in_light, compare, is_dark, is_flat, is_grey, third_of_cell

logger = logging.getLogger(__name__)

MOVED_LEVELS = 8.0
"""Change of a cell [grey levels] that images of one gel at rest do not have; 12 would miss the start of contacts."""
MARKER_LEVELS = 12.0
"""Levels [grey levels] by which markers are darker than the gel around them; with 8 real gels without any have some."""

AnyImage = TypeVar("AnyImage", NDArray[np.uint8], NDArray[np.float32])


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    noise: Levels
    """Standard deviation of the cells over time, in the light of each image, (rows, columns, 3) [grey levels]."""

    def followed(self, image: Image, part: float) -> "Background":
        """Return the background with a mean in which an image has the weight `part`, and the past the rest."""
        return replace(self, mean=self.mean + np.float32(part) * (image.astype(np.float32) - self.mean))


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of untouched images (height, width, 3), read one after the other; of one, without noise."""
    count, first, total, changes, squares = 0, None, np.zeros(()), np.zeros(()), np.zeros(())
    for image in images:
        cells = cells_of(image)
        first = cells if first is None else first
        change = change_in_light(cells, first).astype(np.float64)
        count, total, changes, squares = count + 1, total + image, changes + change, squares + change**2
    if not count:
        raise SettingError("a background needs an untouched image, found none")
    freedom = max(count - 1, 1)
    noise = np.maximum(squares - count * (changes / count) ** 2, 0.0) / freedom
    prior = 10  # images; weight of the mean noise of all cells, as that of one is known from few images
    noise = (freedom * noise + prior * noise.mean()) / (freedom + prior)
    return Background((total / count).astype(np.float32), np.sqrt(noise).astype(np.float32))


def first_frames(rate: float) -> int:
    """Return the number of first images that are taken as untouched, at a rate [Hz]: half a second, at least 8."""
    return max(round(0.5 * rate), 8)


class SteadyImages:
    """Background of the first half second of images that are alike and show a gel: not black, nor one level."""

    def __init__(self, rate: float) -> None:
        self._needed = first_frames(rate)
        self._count = 0
        self.seen: list[Image] = []
        """Images so far; emptied, it starts again with the next image."""

    @property
    def trouble(self) -> str:
        """Sentence on two seconds of images without a steady half second; "" if all is well."""
        found = f"no half second of {self._count} images shows the gel steadily lit, so it is not known untouched"
        return found if self._count > 4 * self._needed else ""

    def add(self, image: Image) -> Background | None:
        """Add an image (height, width, 3); return the background once there are enough, then start again."""
        self._count += 1
        if is_dark(image) or is_flat(image):
            return None
        if self.seen and not _are_alike(image, self.seen[0]):
            self.seen = []  # something moves, or the light is still coming on
        self.seen.append(image.copy())  # a driver may reuse its array
        if len(self.seen) < self._needed:
            return None
        warn_if_squeezed(self.seen[:1])
        found, self.seen, self._count = background_of(self.seen), [], 0
        return found


def is_moved(image: Image, other: Image) -> bool:
    """Return true if something moves between two images, in whatever light, or they are of two gels."""
    changed = compare(cells_of(image), cells_of(other), np.float32(MOVED_LEVELS))
    return changed > CONTACT_DETECTION.start


def _are_alike(image: Image, other: Image) -> bool:
    """Return true if nothing moves between two images, and the camera and its light have settled."""
    before = cells_of(other)
    is_lit = np.abs(cells_of(image) - before).mean(axis=(0, 1)) < 2.0 + 0.2 * before.mean(axis=(0, 1))  # lamps flicker
    return is_grey(image) == is_grey(other) and bool(is_lit.all()) and not is_moved(image, other)


def warn_if_squeezed(images: Iterable[Image], name: str = "the first images") -> None:
    """Warn of images that lay on their side and were scaled into the upright shape.

    What was scaled up along the longer side has lost the finest noise along it.
    """
    ratios = []
    for image in (each for each in images if min(each.shape[:2]) > 64):
        grey = image.mean(axis=2, dtype=np.float32)
        grey = grey if grey.shape[0] > grey.shape[1] else grey.T
        along, across = (np.median(np.abs(np.diff(grey, 4, axis=axis))) for axis in (0, 1))
        least = 0.16  # of noise well below a grey level, as in images without any
        ratios.append((along**2 + least) / (across**2 + least))
    # Above 0.7 in real and drawn images, and mostly below 0.5 once squeezed.
    if ratios and np.median(ratios) < 0.5:
        logger.warning("%s seem to have been scaled to their size while they lay on their side: turn them", name)


def has_markers(image: AnyImage) -> bool:
    """Return true if an image (height, width, 3) of an untouched gel shows a grid of markers: enough for a touch."""
    import cv2

    dark, _ = _dark_dots(image)
    _, _, stats, _ = cv2.connectedComponentsWithStats(dark)
    extent, (edge, size) = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]], _edge_and_size(image)
    dots = ((extent >= edge) & (extent < size)).all(axis=1)
    return stats[1:][dots, cv2.CC_STAT_AREA].sum() > CONTACT_DETECTION.start * dark.size


def without_markers(image: AnyImage) -> AnyImage:
    """Return an image (height, width, 3) in which markers look like the gel around them."""
    import cv2

    (dark, filled), (edge, _) = _dark_dots(image), _edge_and_size(image)
    hidden = cv2.dilate(dark, np.ones((edge, edge), np.uint8))
    unmarked: Any = cv2.copyTo(filled, hidden, image.copy())
    return unmarked


def _dark_dots(image: NDArray[Any]) -> tuple[NDArray[np.uint8], Any]:
    """Return a mask (height, width) of small dark dots, and the image with these filled by a grey closing."""
    import cv2

    _, size = _edge_and_size(image)
    filled = cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
    darker = cv2.cvtColor(cv2.subtract(filled, image), cv2.COLOR_RGB2GRAY)
    return (darker > MARKER_LEVELS).astype(np.uint8), filled


def _edge_and_size(image: NDArray[Any]) -> tuple[int, int]:
    """Return the width of the edge of markers, and that which none has [px]: 0.8 mm on a GelSight Mini."""
    third = third_of_cell(*image.shape[:2])
    return max(round(third), 1), max(round(NEIGHBOURS * third), 1)
