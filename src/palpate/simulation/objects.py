"""The objects that are simulated: those of the paper, five more that no model is trained on, and outlines in files."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, PalpateError, SettingError, ShapeError
from palpate.files import read_json, read_text
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle, Shape, shape_from_dict

Array = NDArray[np.float64]

_EXTENT = (0.05, 0.5)  # [m] larger than a gel, and no larger than what a sensor goes round in a few seconds


def _butterfly() -> Polygon:
    """Two wings and a waist, into which a gel of radius 21 mm fits: its radius of curvature is 46 mm."""
    angle = np.arange(96) * (2.0 * np.pi / 96)
    radius = 0.085 + 0.03 * np.cos(2.0 * angle)
    return Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))))


def _rounded_square(size: float, radius: float) -> Polygon:
    quarter = np.linspace(0.0, 0.5 * np.pi, 13)
    angle = (quarter + 0.5 * np.pi * np.arange(4)[:, None]).ravel()
    center = np.repeat(np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (0.5 * size - radius), len(quarter), axis=0)
    return Polygon(center + radius * np.column_stack((np.cos(angle), np.sin(angle))))


PAPER = ("disc", "rectangle", "ellipse")
"""The paper's objects."""

SHAPES: dict[str, Shape] = {
    "disc": Disc(0.088),
    "rectangle": Rectangle(0.2363, 0.1579),
    "ellipse": Ellipse(0.1638, 0.2428),
    "triangle": Polygon([(-0.1, -0.06), (0.1, -0.06), (0.0, 0.12)]),
    "hexagon": Polygon(Disc(0.1).outline(6)),
    "t": Polygon(
        [(-0.1, 0.0), (-0.03, 0.0), (-0.03, -0.14), (0.03, -0.14), (0.03, 0.0), (0.1, 0.0), (0.1, 0.06), (-0.1, 0.06)]
    ),
    "butterfly": _butterfly(),
    "rounded-square": _rounded_square(0.17, 0.03),
}
"""Objects by name; all but the paper's are kept for testing."""


def find_shape(name: str) -> tuple[str, Shape]:
    """Return name and shape of an object: one of `SHAPES`, or a polygon in a file, whose name is the file's stem.

    The file holds a corner x y [m] a line, parted by blanks or a comma, or it is JSON: {"vertices": [[x, y], ...]}.
    Raises SettingError on a name that is neither, FileError on a file that holds no such polygon.
    """
    if name in SHAPES:
        return name, SHAPES[name]
    path = Path(name)
    if not path.is_file():
        raise SettingError(f"shape is {name!r}; allowed are {', '.join(SHAPES)}, or a file of a polygon's vertices")
    json = read_json(path) if path.suffix == ".json" else None
    text = "" if json else read_text(path)
    try:
        shape = shape_from_dict({"type": "polygon", **json}) if json else Polygon(_table(text))
    except PalpateError as error:
        raise FileError(f"{path}: {error}") from error
    extent = float(np.ptp(shape.outline(), axis=0).max())
    if not _EXTENT[0] <= extent <= _EXTENT[1]:
        raise FileError(f"{path}: the outline is {extent:g} m wide, allowed is {_EXTENT[0]} to {_EXTENT[1]} m")
    return path.stem, shape


def _table(text: str) -> Array:
    try:
        return np.loadtxt(io.StringIO(text.replace(",", " ")), ndmin=2)
    except ValueError as error:
        raise ShapeError(f"is no table of numbers x y [m] ({error})") from error
