"""Markers: dark dots on a gel's skin, which move with it, of any grid and size, and with some missing.

They are found in the untouched gel, once, which tells how wide they are; then anew in each image, wherever they have
moved to, and filled with the gel around them. So contact, place and direction are those of a gel without dots.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Flags
from palpate.config import CONTACT_DETECTION
from palpate.errors import SettingError
from palpate.touch.cells import NEIGHBOURS, third_of_cell
from palpate.touch.neighbours import closed, largest_near, spots_of

AnyImage = TypeVar("AnyImage", NDArray[np.uint8], NDArray[np.float32])

_GREY = np.array([0.299, 0.587, 0.114], np.float32)
"""Share of each colour in the brightness that people see (ITU-R BT.601)."""


@dataclass(frozen=True)
class MarkerSettings:
    """Limits that separate markers from other dark spots."""

    levels: float = 12.5
    """Levels [grey levels] by which markers are darker than the gel around them; with 8 real gels without any have
    some."""
    times: tuple[float, ...] = (1.0, 1.6, 2.4)
    """Widths that no marker has, tried from the smallest, as multiples of 0.8 mm on a GelSight Mini."""
    more: float = 1.3
    """Times as many pixels of markers with which a greater width is taken: with the smaller one some are cut off."""
    fewest: int = 6
    """Fewest markers: fewer dark spots are dirt."""
    of_dark: float = 0.5
    """Least share of all dark pixels that are of markers: what is darker than its surroundings without markers has
    every size and form."""
    filled: float = 0.4
    """Least share of the square around a marker that it fills, which shades and scratches do not."""
    in_place: float = 0.4
    """Least share of a gel's markers that a touched image shows in place; other grids have as much as markers cover."""


_LIMITS = MarkerSettings()


@dataclass(frozen=True)
class Markers:
    """Size of a gel's markers."""

    width: int
    """Width that none has [px]."""
    share: float
    """Share of the untouched image that is masked, 0 to 1."""


def find_markers(untouched: NDArray[Any]) -> Markers | None:
    """Return the markers that an image (height, width, 3) of an untouched gel shows; None if there are none."""
    found: Markers | None = None
    most = 0
    for times in _LIMITS.times:
        width = max(round(times * NEIGHBOURS * third_of_cell(*untouched.shape[:2])), 1)
        dark, _ = _dark_spots(untouched, width)
        area = _area_of_dots(dark, width)
        if area > CONTACT_DETECTION.start * dark.size and area > _LIMITS.more * most:
            found = Markers(width, float(np.count_nonzero(_with_edges(dark))) / dark.size)
            most = area
    return found


def without_markers(image: AnyImage, markers: Markers | None) -> AnyImage:
    """Return an image (height, width, 3) in which markers look like the gel around them."""
    if markers is None:
        return image
    dark, filled = _dark_spots(image, markers.width)
    unmarked: Any = np.where(_with_edges(dark)[..., None], filled, image)
    return unmarked


def check_markers(image: NDArray[Any], untouched: NDArray[Any], markers: Markers | None) -> None:
    """Raise SettingError if an image (height, width, 3) has other markers than the untouched gel, or one of both none.

    A touch moves markers by less than their width, but for a few.
    """
    if markers is None:
        if find_markers(image):
            raise SettingError("image: shows dots, and the untouched gel none: is it of another unit?")
        return
    of_gel, _ = _dark_spots(untouched, markers.width)
    of_image, _ = _dark_spots(image, markers.width)
    in_place = np.count_nonzero(of_gel & of_image) / np.count_nonzero(of_gel)
    if in_place < _LIMITS.in_place:
        raise SettingError(
            f"image: shows {in_place:.0%} of the dots of the untouched gel where they are there, expected are "
            f"{_LIMITS.in_place:.0%} or more: is it of another unit?"
        )


def _dark_spots(image: NDArray[Any], width: int) -> tuple[Flags, Any]:
    """Return a mask (height, width) of dark spots of less than a width [px], and the image with them filled."""
    filled = closed(image, width)
    darker = (filled - image) @ _GREY
    return darker > _LIMITS.levels, filled


def _area_of_dots(dark: Flags, width: int) -> int:
    """Return the count of pixels of dots in a mask of dark spots; 0 if there are too few of them."""
    spots = spots_of(dark)
    borders = np.concatenate([spots.spot_of[0], spots.spot_of[-1], spots.spot_of[:, 0], spots.spot_of[:, -1]])
    are_whole = ~np.isin(np.arange(len(spots.area)), borders)
    area = spots.area[1:]  # the first is what is not dark
    extent = spots.extent[1:]
    least = _edge(dark)
    are_small = ((extent >= least) & (extent < width)).all(axis=1)
    are_dots = are_whole[1:] & are_small & (area > _LIMITS.filled * extent.prod(axis=1))
    of_dots = int(area[are_dots].sum())
    return of_dots if np.count_nonzero(are_dots) >= _LIMITS.fewest and of_dots > _LIMITS.of_dark * area.sum() else 0


def _with_edges(dark: Flags) -> Flags:
    """Return a mask with the soft edges of its spots."""
    edge = _edge(dark)
    return largest_near(dark, edge)


def _edge(image: NDArray[Any]) -> int:
    """Return the width of a marker's edge in an image of this size [px]."""
    return max(round(third_of_cell(*image.shape[:2])), 1)
