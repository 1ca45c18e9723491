"""The tags: which is where, how large they are, and where their corners are in a picture.

A tag's frame has its origin in the middle, x to the right and y up as it is printed.
"""

from collections.abc import Container
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
    place: tuple[float, float] = (0.0, 0.0)
    """Its middle on its sheet (x, y) [m]."""

    @property
    def corners(self) -> Array:
        """Its corners (4, 2) [m] on its sheet, clockwise from the upper left."""
        return np.array(self.place) + 0.5 * self.size * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])


OBJECT, SENSOR = Tag(0, 0.06), Tag(1, 0.03)
"""On the object, its middle and axes those of the object; on the sensor, anywhere."""
TABLE = tuple(
    Tag(10 + number, 0.05, place)
    for number, place in enumerate(((-0.1, 0.06), (0.1, 0.06), (-0.1, -0.06), (0.1, -0.06)))
)
"""On the sheet that lies on the table."""
SQUARES, SQUARE, MARKER = (7, 5), 0.035, 0.026
"""The board that the camera is calibrated with: its squares along x and y, their side and that of its markers [m]."""


def corners_in(image: Gray, wanted: Container[int] | None = None) -> dict[int, Array]:
    """The corners (4, 2) [px] of each tag in a grey picture, by its id; of the wanted ones only, if some are named.

    Tags are looked for quickly, and then closely where they are: a close look at all of the picture takes long.
    """
    found = {}
    for number, rough in _detected(image, closely=False).items():
        if wanted is not None and number not in wanted:
            continue
        margin = 0.25 * np.ptp(rough, axis=0)
        low = np.maximum(rough.min(axis=0) - margin, 0.0).astype(int)
        high = (rough.max(axis=0) + margin).astype(int) + 1
        close = _detected(np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), closely=True)
        if number in close:
            found[number] = close[number] + low
    return found


def tag_image(number: int, pixels: int) -> Gray:
    """A tag (pixels, pixels), black and white."""
    import cv2

    return np.asarray(cv2.aruco.generateImageMarker(_family(), number, pixels), np.uint8)


@cache
def board() -> Any:
    """The board, as OpenCV has it; its markers are of another family."""
    import cv2

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE, MARKER, family)


@cache
def _family() -> Any:
    import cv2

    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def _detected(image: Gray, closely: bool) -> dict[int, Array]:
    found, numbers, _ = _detector(closely).detectMarkers(image)
    if numbers is None:
        return {}
    return {int(number): np.asarray(each[0], np.float64) for number, each in zip(numbers.ravel(), found, strict=True)}


@cache
def _detector(closely: bool) -> Any:
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshConstant = 15  # by default noise on an even table has edges
    if closely:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    return cv2.aruco.ArucoDetector(_family(), settings)
