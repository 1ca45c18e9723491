"""Background: the untouched gel as its images show it, with which an image is compared."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Image, Levels
from palpate.config import CONTACT_DETECTION
from palpate.errors import SettingError
from palpate.touch.cells import (
    cells_of,
    change_in_light,
    compare,
    is_dark,
    is_flat,
    is_grey,
    light_in,
    move_towards,
)

logger = logging.getLogger(__name__)

MOVED_LEVELS = 8.0
"""Change of a cell [grey levels] that images of one gel at rest do not have; 12 would miss the start of contacts."""


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    noise: Levels
    """Standard deviation of the cells over time, in the light of each image, (rows, columns, 3) [grey levels]."""

    def follow(self, image: Image, part: float) -> "Background":
        """Move the mean towards an image (height, width, 3) by the fraction `part`, in place.

        Return the background as another object, which tells readers that it has changed.
        """
        move_towards(self.mean, image, part)
        return replace(self)

    def copy(self) -> "Background":
        """Return a background that does not change with this one."""
        return replace(self, mean=self.mean.copy())


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of untouched images (height, width, 3), read one at a time; one image gives zero noise."""
    count = 0
    first_cells = None
    sum_of_images = np.zeros(())
    sum_of_changes = np.zeros(())
    sum_of_squares = np.zeros(())
    for image in images:
        cells = cells_of(image)
        if first_cells is None:
            first_cells = cells
        change = change_in_light(cells, first_cells, light_in(cells, first_cells)).astype(np.float64)
        count += 1
        sum_of_images = sum_of_images + image
        sum_of_changes = sum_of_changes + change
        sum_of_squares = sum_of_squares + change**2
    if not count:
        raise SettingError("a background needs an untouched image, found none")
    degrees_of_freedom = max(count - 1, 1)
    mean_change = sum_of_changes / count
    variance = np.maximum(sum_of_squares - count * mean_change**2, 0.0) / degrees_of_freedom
    # A few images say little about the noise of a single cell, so the mean of all cells counts like ten more images.
    prior = 10
    variance = (degrees_of_freedom * variance + prior * variance.mean()) / (degrees_of_freedom + prior)
    mean = sum_of_images / count
    return Background(mean.astype(np.float32), np.sqrt(variance).astype(np.float32))


def first_frames(rate: float) -> int:
    """Return the number of first images that are taken as untouched at a rate [Hz]: half a second, 8 or more."""
    return max(round(0.5 * rate), 8)


class SteadyImages:
    """Collector of the first half second of images that are alike and show a gel: neither black nor of one level."""

    def __init__(self, rate: float) -> None:
        self._needed = first_frames(rate)
        self._count = 0  # images since the last background
        self.seen: list[Image] = []
        """The steady images so far; if the list is cleared, collecting starts again with the next image."""

    @property
    def trouble(self) -> str:
        """Sentence that says that two seconds of images had no steady half second; "" if all is well."""
        if self._count <= 4 * self._needed:
            return ""
        return f"no half second of {self._count} images shows the gel steadily lit, so it is not known untouched"

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
        warn_if_bordered(self.seen[:1])
        background = background_of(self.seen)
        self.seen = []
        self._count = 0
        return background


def is_moved(image: Image, other: Image) -> bool:
    """Return true if something moves between two images or they show two gels; a change of light does not count."""
    changed, _ = compare(cells_of(image), cells_of(other), np.float32(MOVED_LEVELS))
    return changed > CONTACT_DETECTION.start


def _are_alike(image: Image, other: Image) -> bool:
    """Return true if nothing moves between two images, and the camera and its light have settled."""
    if is_grey(image) != is_grey(other):
        return False
    cells_before = cells_of(other)
    change = np.abs(cells_of(image) - cells_before).mean(axis=(0, 1))
    flicker = 2.0 + 0.2 * cells_before.mean(axis=(0, 1))  # [grey levels] that settled lamps may change, per channel
    return bool((change < flicker).all()) and not is_moved(image, other)


def warn_if_squeezed(images: Iterable[Image], name: str = "the first images") -> None:
    """Warn of images that lay on their side and were scaled into the upright shape.

    Scaling an image up along its longer side removes the finest noise in that direction.
    """
    ratios = []
    for image in images:
        if min(image.shape[:2]) <= 64:
            continue
        grey = image.mean(axis=2, dtype=np.float32)
        if grey.shape[0] <= grey.shape[1]:
            grey = grey.T
        noise_along = np.median(np.abs(np.diff(grey, 4, axis=0)))
        noise_across = np.median(np.abs(np.diff(grey, 4, axis=1)))
        least = 0.16  # [grey levels^2], so that images without noise have a ratio of 1
        ratios.append((noise_along**2 + least) / (noise_across**2 + least))
    # The ratio is above 0.7 in real and drawn images, and mostly below 0.5 in squeezed ones.
    if ratios and np.median(ratios) < 0.5:
        logger.warning("%s seem to have been scaled to their size while they lay on their side: turn them", name)


def warn_if_grey(images: Iterable[Image], name: str = "the first images") -> None:
    """Warn of images whose channels are all alike."""
    alike = [bool((image == image[..., :1]).all()) for image in images if np.ptp(image)]
    if alike and np.mean(alike) > 0.5:
        logger.warning("%s are grey: red, green and blue are alike; touch is read from the colours of the gel", name)


def warn_if_bordered(images: Iterable[Image], name: str = "the first images") -> None:
    """Warn of images that show the dark housing around the gel, as a GelSight Mini's camera sees it, on all sides."""
    shares: list[float] = []
    for image in images:
        if min(image.shape[:2]) <= 64:
            continue
        grey = image.mean(axis=2, dtype=np.float32)
        rows, columns = grey.shape
        rim = max(min(rows, columns) // 25, 1)
        sides = (grey[:rim], grey[-rim:], grey[:, :rim], grey[:, -rim:])
        middle = np.median(grey[rows // 3 : 2 * rows // 3, columns // 3 : 2 * columns // 3])
        shares.append(max(float(np.median(side)) for side in sides) / max(float(middle), 1.0))
    # 0.5 and more in images of a gel alone, whose light falls off towards its borders.
    if shares and np.median(shares) < 0.35:
        logger.warning(
            "%s have a dark border on all sides: do they show the housing around the gel? Crop to the gel, 15 %% at "
            "each side of a GelSight Mini's, before they are scaled",
            name,
        )
