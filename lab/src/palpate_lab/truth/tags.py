"""The printed tags: their numbers, sizes and places, their corners in a picture, and the sheets to print.

A tag's frame has its origin in the middle, x to the right and y up as it is printed.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Array, Image
from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.geometry.shapes import Shape
from palpate.pipeline.figures import own_style


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
SQUARES = (7, 5)
"""Squares of the calibration board along x and y."""
SQUARE_SIDE = 0.035
"""Side of a square of the calibration board [m]."""


def find_tags(image: Image) -> dict[int, Array]:
    """Return the corners (4, 2) [px] of each tag in a grey picture, by its id.

    A quick search finds the tags, an exact one around each of them refines the corners.
    """
    tags = {}
    for number, rough in _detected(image, exact=False).items():
        margin = 0.25 * np.ptp(rough, axis=0)
        low = np.maximum(rough.min(axis=0) - margin, 0.0).astype(int)
        high = (rough.max(axis=0) + margin).astype(int) + 1
        refined = _detected(np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), exact=True)
        if number in refined:
            tags[number] = refined[number] + low
    return tags


@cache
def board() -> Any:
    """Return the calibration board of OpenCV; its markers of 26 mm are of another family."""
    import cv2

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE_SIDE, 0.026, family)


def _family() -> Any:
    import cv2

    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def _detected(image: Image, exact: bool) -> dict[int, Array]:
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshConstant = 15  # at the default, noise on a plain table has edges
    if exact:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    found, numbers, _ = cv2.aruco.ArucoDetector(_family(), settings).detectMarkers(image)
    if numbers is None:
        return {}
    return {int(number): np.asarray(each[0], np.float64) for number, each in zip(numbers.ravel(), found, strict=True)}


@own_style()
def write_sheets(path: Path, name: str, shape: Shape, paper: str = "a4", overwrite: bool = False) -> None:
    """Write a PDF of four pages for an object. Raises SettingError if its outline is larger than the paper."""
    from matplotlib.backends.backend_pdf import PdfPages

    papers = {"a4": (0.297, 0.21), "a3": (0.42, 0.297)}  # [m], broad side first
    size = np.array(papers[paper])
    margin = 0.008  # [m] that printers leave white
    outline = shape.outline()
    extent = np.ptp(outline, axis=0)
    if (extent > size - 2 * margin).any():
        width, height = 1e3 * extent
        raise SettingError(f"{name} is {width:.0f} x {height:.0f} mm, larger than {paper}; --paper a3 is larger")
    middle = outline.min(axis=0) + 0.5 * extent
    half = 0.5 * SQUARE_SIDE * np.array(SQUARES)
    with whole_file(path, overwrite) as part, PdfPages(part, metadata={"CreationDate": None}) as pdf:
        pdf.savefig(_page(size, "Table: lay it flat and fix it, all four tags in view", TABLE)[0])
        figure, axes = _page(size, f"Object {name}: cut along the outline, glue it on top", (OBJECT,), -middle)
        axes.plot(*(np.vstack([outline, outline[:1]]) - middle).T, "k-", linewidth=0.5)
        pdf.savefig(figure)
        pdf.savefig(_page(size, "Sensor: fix the tag on top, parallel to the table", (SENSOR,))[0])
        squares = f"squares of {SQUARE_SIDE * 1e3:.0f} mm"
        figure, axes = _page(size, f"Board for palpate truth-camera: glue it on something flat; {squares}")
        _draw(axes, board().generateImage((SQUARES[0] * 245, SQUARES[1] * 245), None, 0, 1), -half, half)
        pdf.savefig(figure)


def _page(size: Array, title: str, tags: Iterable[Tag] = (), shift: Array | tuple[float, float] = (0, 0)) -> Any:
    """Return figure and axes of a page, in metres from its middle, with tags and a line of 100 mm to measure."""
    from matplotlib.figure import Figure

    left, low = -0.5 * size
    figure = Figure((float(size[0]) / 0.0254, float(size[1]) / 0.0254))  # [inch]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.axis("off")
    axes.set(xlim=(left, -left), ylim=(low, -low), autoscale_on=False)
    axes.text(left + 0.012, -low - 0.012, title, fontsize=9, va="top")
    axes.plot((-0.05, 0.05), (low + 0.012, low + 0.012), "k-", linewidth=1.0)
    axes.text(0.055, low + 0.012, "100 mm, if printed at 100 %", fontsize=7, va="center")
    for tag in tags:
        corners = tag.corners + shift
        image = _family().generateImageMarker(tag.number, 8)  # a pixel for each square
        _draw(axes, image, corners.min(axis=0), corners.max(axis=0))
    return figure, axes


def _draw(axes: Any, image: Any, low: Array, high: Array) -> None:
    """Draw a picture between two corners (2,) [m]."""
    extent = (low[0], high[0], low[1], high[1])
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
