"""Outlines as numbers: a table of points, or JSON."""

import logging
from pathlib import Path

import numpy as np

from palpate.errors import PalpateError, ShapeError
from palpate.files import read_json, read_text
from palpate.geometry.shapes import Polygon, Shape, scaled, shape_from_dict
from palpate.io.outlines.lines import simplified
from palpate.io.outlines.scan import is_scan, shape_of_scan

logger = logging.getLogger(__name__)

MANY = 256
"""Corners that are taken as they are; a round object of 10 cm needs no more."""


def read_table(path: Path, scale: float | None) -> Shape:
    """The outline through the points x y of a table, one a line, `scale` [m] their unit; or of a scan.

    Blanks, commas, semicolons or tabs part the numbers; a first line of words is passed over.
    """
    text = read_text(path).replace(",", " ").replace(";", " ")
    lines = enumerate(text.splitlines(), start=1)
    rows = [(number, words) for number, line in lines if (words := line.split("#")[0].split())]
    if rows and not any(map(_is_number, rows[0][1])):
        rows = rows[1:]
    if not rows:
        raise ShapeError("is no table of numbers x y: it holds none")
    for number, words in rows:
        if not all(map(_is_number, words)):
            raise ShapeError(f"is no table of numbers x y: line {number} is {' '.join(words)!r}")
        if len(words) != 2:
            count = f"{len(words)} number{'' if len(words) == 1 else 's'}"
            raise ShapeError(f"line {number} has {count}, expected x y")
    points = np.array([words for _, words in rows], np.float64) * (scale or 1.0)
    if not is_scan(points):
        return _of_few_corners(Polygon(points))
    found = shape_of_scan(points)
    logger.warning(
        "%s: its %d points are taken as a scan: an outline of %d corners, off which they are by %.2f mm, one standard "
        "deviation",
        path,
        len(points),
        len(found.shape.vertices),
        found.noise * 1e3,
    )
    return found.shape


def read_json_shape(path: Path, scale: float | None) -> Shape:
    """The outline that JSON holds: {"vertices": [[x, y], ...]}, or a shape as palpate writes it."""
    data = read_json(path)
    try:
        shape = shape_from_dict({"type": "polygon", **data})
    except PalpateError as error:
        raise ShapeError(str(error)) from error
    shape = shape if scale is None else scaled(shape, scale)
    return _of_few_corners(shape) if isinstance(shape, Polygon) else shape


def _of_few_corners(outline: Polygon) -> Polygon:
    """The outline as it is given, or without most of its corners where these are many, as those of a curve."""
    return outline if len(outline.vertices) <= MANY else simplified(np.array(outline.vertices))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
