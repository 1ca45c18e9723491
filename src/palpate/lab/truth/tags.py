"""The printed tags: their numbers, sizes and places, and their corners in a picture.

A tag's frame has its origin in the middle, x to the right and y up as it is printed.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]


@dataclass(frozen=True)
class Tag:
    """An AprilTag of the family 36h11."""

    number: int
    """Its id."""
    size: float
    """Side of its black square [m]."""
    owner: str
    """The thing that it is fixed to."""
    place: tuple[float, float] = (0.0, 0.0)
    """Its middle on its sheet (x, y) [m]."""

    @property
    def corners(self) -> Array:
        """Its corners (4, 2) [m] on its sheet, clockwise from the upper left."""
        return np.array(self.place) + 0.5 * self.size * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])


OBJECT = Tag(0, 0.06, "object")
"""On the object, with its origin and axes."""
SENSOR = Tag(1, 0.03, "sensor")
"""Anywhere on the sensor."""
TABLE = tuple(
    Tag(10 + 2 * row + k, 0.05, "table", (x, y))
    for row, y in enumerate((0.06, -0.06))
    for k, x in enumerate((-0.1, 0.1))
)
"""On the sheet that lies on the table."""
SQUARES, SQUARE = (7, 5), 0.035
"""Squares of the calibration board along x and y, and their side [m]."""


def find_tags(image: Gray) -> dict[int, Array]:
    """Return the corners (4, 2) [px] of each tag in a grey picture, by its id.

    A quick search finds the tags, an exact one around each of them refines the corners.
    """
    found = {}
    for number, rough in _detected(image, exact=False).items():
        margin = 0.25 * np.ptp(rough, axis=0)
        low = np.maximum(rough.min(axis=0) - margin, 0.0).astype(int)
        high = (rough.max(axis=0) + margin).astype(int) + 1
        refined = _detected(np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), exact=True)
        if number in refined:
            found[number] = refined[number] + low
    return found


def tag_image(number: int, pixels: int) -> Gray:
    """Return the picture of a tag (pixels, pixels), black and white."""
    import cv2

    return np.asarray(cv2.aruco.generateImageMarker(_family(), number, pixels), np.uint8)


@cache
def board() -> Any:
    """Return the calibration board of OpenCV; its markers of 26 mm are of another family."""
    import cv2

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE, 0.026, family)


@cache
def _family() -> Any:
    import cv2

    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def _detected(image: Gray, exact: bool) -> dict[int, Array]:
    found, numbers, _ = _detector(exact).detectMarkers(image)
    if numbers is None:
        return {}
    return {int(number): np.asarray(each[0], np.float64) for number, each in zip(numbers.ravel(), found, strict=True)}


@cache
def _detector(exact: bool) -> Any:
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshConstant = 15  # at the default, noise on a plain table has edges
    if exact:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    return cv2.aruco.ArucoDetector(_family(), settings)
