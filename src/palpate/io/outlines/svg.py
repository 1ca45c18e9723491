"""Outlines drawn as SVG, by the library svgelements."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, ShapeError
from palpate.files import existing_file
from palpate.geometry.shapes import Polygon
from palpate.io.outlines.lines import check_drawing, need, outline_of_lines
from palpate.printable import one_line

INCH = 0.0254
"""[m]"""
PIXELS = 96.0
"""Of an inch, as CSS has it."""
CURVE = np.linspace(0.0, 1.0, 65)
"""Where a curve is sampled."""

_PHYSICAL = re.compile(r"[\d.]+\s*(mm|cm|in|pt|pc|q)\s*", re.IGNORECASE)


def read_svg(path: Path, scale: float | None) -> Polygon:
    """The outline that an SVG shows, about its centroid and y up.

    Its size is that of the page, if width and height have a unit; or `scale` [m] is what one unit of the drawing means.
    """
    need("svgelements")
    import svgelements

    check_drawing(path)
    try:
        page = svgelements.SVG.parse(str(existing_file(path)), ppi=PIXELS)
        lines = [_points(part) for element in page.elements() for part in _parts(element)]
    except Exception as error:  # damaged bytes can make anything of what the library reads
        raise FileError(f"{path}: is no SVG that can be read ({one_line(error)})") from error
    if scale is not None:
        metres = scale / abs(svgelements.Matrix(page.viewbox_transform or "").a)
    elif _PHYSICAL.fullmatch(str(page.values.get("width", ""))):
        metres = INCH / PIXELS
    else:
        raise ShapeError(
            f"the drawing does not say how large it is, its width is {page.values.get('width', 'not given')!r}: give "
            "the unit of its numbers, as unit='mm' (--shape-unit mm)"
        )
    outline = outline_of_lines(str(path), [line * (metres, -metres) for line in lines])
    return Polygon(outline.corners - outline.centroid)


def _parts(element: Any) -> list[Any]:
    """The unbroken lines of an element, with all of its transforms; none of text and the like."""
    import svgelements

    if not isinstance(element, svgelements.Shape):
        return []
    whole = svgelements.Path(element)
    whole.reify()
    return [svgelements.Path(part) for part in whole.as_subpaths()]


def _points(part: Any) -> NDArray[np.float64]:
    """Points (n, 2) along an unbroken line."""
    import svgelements

    points = []
    for segment in part:
        if isinstance(segment, svgelements.Move) or segment.start is None or segment.end is None:
            continue
        straight = isinstance(segment, svgelements.Line | svgelements.Close)
        points += [segment.point(place) for place in (CURVE[[0, -1]] if straight else CURVE)]
    return np.array([(float(point.x), float(point.y)) for point in points]).reshape(-1, 2)
