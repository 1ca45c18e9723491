"""Markers: black dots on a gel, which some have to show how its skin moves. Touch is read as if they were not there.

They are small and darker than the gel around them in any light, so a grey closing, which fills what is dark and smaller
than its kernel, finds them and says what they hide.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

AnyImage = TypeVar("AnyImage", NDArray[np.uint8], NDArray[np.float32])

_KERNEL = 13  # pixels across, of a GelSight Mini 0.8 mm: more than any marker
_DARKER = 12.0  # [grey levels]
_BORDER = 3  # pixels across, by which a dot's border reaches farther than it is seen
_FEWEST, _SMALLEST = 20, 3  # dots that are a grid of markers and not dust, and pixels across one


def has_markers(image: AnyImage) -> bool:
    """Return whether an image (height, width, 3) of an untouched gel shows markers."""
    import cv2

    dark, _ = _dark(image)
    _, _, stats, _ = cv2.connectedComponentsWithStats(dark)
    extent = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    return int(((extent >= _SMALLEST) & (extent < _KERNEL)).all(axis=1).sum()) >= _FEWEST


def without_markers(image: AnyImage) -> AnyImage:
    """Return an image (height, width, 3) in which markers look as the gel around them."""
    import cv2

    dark, filled = _dark(image)
    hidden = cv2.dilate(dark, np.ones((_BORDER, _BORDER), np.uint8))
    unmarked: Any = cv2.copyTo(filled, hidden, image.copy())
    return unmarked


def _dark(image: NDArray[Any]) -> tuple[NDArray[np.uint8], Any]:
    """Where an image is darker than around, (height, width), 1 there; and the image without that."""
    import cv2

    filled = cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((_KERNEL, _KERNEL), np.uint8))
    darker = cv2.cvtColor(cv2.subtract(filled, image), cv2.COLOR_RGB2GRAY)
    return (darker > _DARKER).astype(np.uint8), filled
