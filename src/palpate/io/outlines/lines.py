"""The one outline among the lines of a drawing."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST, is_near
from palpate.errors import FileError, ShapeError
from palpate.files import existing_file
from palpate.geometry.shapes import Polygon

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

FINE = 2e-5
"""[m] by which an outline may be off a curve that is drawn, or off many corners that are given."""
MEET = 1e-6
"""Of the drawing's width: how far apart ends of lines may be that meet."""


def need(library: str) -> None:
    """Raise FileError, which says what to install, unless a library that reads drawings is there."""
    from importlib.util import find_spec

    if find_spec(library) is None:
        raise FileError(f"drawings are read by {library}, which is not installed: pip install palpate[outlines]")


def check_drawing(path: Path) -> None:
    """Raise FileError where a drawing is too large for the libraries, which take a thousand times its size."""
    if (size := existing_file(path).stat().st_size) > 5_000_000:
        raise FileError(f"{path}: is a drawing of {size / 1e6:.0f} MB, allowed are 5; a single outline needs far less")


def outline_of_lines(what: str, lines: Sequence[Array]) -> Polygon:
    """Return the outline that lines (n, 2) [m] form, each closed or several end to end.

    What lies within it is a hole, left out with a warning that names `what`. Raises ShapeError where there is no closed
    outline or there are several side by side.
    """
    import shapely

    if not all(is_near(line).all() for line in lines):
        raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")
    lines = [line for line in lines if len(line) > 1]
    if not lines:
        raise ShapeError("holds no lines that can be read")
    grid = MEET * float(np.ptp(np.concatenate(lines), axis=0).max())
    if not grid:
        raise ShapeError("holds no closed outline: all of its lines are one point")
    strings = [shapely.LineString(np.round(line / grid) * grid) for line in lines]
    closed = shapely.polygonize(strings).geoms
    rings = [shapely.Polygon(shapely.get_coordinates(shapely.get_exterior_ring(area))) for area in closed]
    rings.sort(key=lambda ring: -ring.area)
    if not rings:
        raise ShapeError(f"holds no closed outline: its {len(lines)} lines do not meet end to end")
    beside = sum(not rings[0].contains(ring.representative_point()) for ring in rings[1:])
    if beside:
        raise ShapeError(f"holds {beside + 1} outlines side by side; allowed is one, and holes in it")
    if len(rings) > 1:
        logger.warning("%s: %d outlines within the largest are holes, which touch does not feel", what, len(rings) - 1)
    return simplified(shapely.get_coordinates(rings[0].exterior))


def simplified(corners: Array) -> Polygon:
    """Return the outline through corners (N, 2) [m] without those that it passes within `FINE`.

    Each takes its time wherever distances are asked for.
    """
    import shapely

    return Polygon(shapely.get_coordinates(shapely.LinearRing(corners).simplify(FINE)))
