"""Outlines of objects from a name, two lengths or a file: a table of points, JSON, SVG or DXF.

Drawings are read by `outline_svg` and `outline_dxf`; `contours` finds the one outline among their lines.
"""

import logging
import re
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np

from palpate.arrays import Array
from palpate.checks import METRES
from palpate.errors import FileError, SettingError, ShapeError
from palpate.files import column_name, existing_file, in_file, numbers_of, read_json, read_text, table_rows
from palpate.geometry.named_shapes import SHAPES
from palpate.geometry.shapes import Polygon, Rectangle, Shape, scaled, shape_from_dict, wrong_width
from palpate.hints import install_command
from palpate.io.contours import outline_in, size_words
from palpate.io.outline_dxf import read_dxf
from palpate.io.outline_svg import read_svg
from palpate.types.choices import Unit

logger = logging.getLogger(__name__)

TOLERANCE = 2e-5
"""[m] Largest deviation of an outline from a drawn curve, or from the corners of a table that has many."""
ASK = "give the unit of its numbers, as unit='mm' (--shape-unit mm)"
HINTS = {
    **dict.fromkeys(
        (".stl", ".step", ".stp", ".igs", ".iges", ".obj", ".3mf", ".ply", ".off", ".dae", ".glb", ".gltf"),
        "save its outline from above",
    ),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"), "trace it, as Inkscape does, and save that"),
    **dict.fromkeys((".dwg", ".pdf", ".eps", ".ai", ".sldprt", ".f3d", ".fcstd"), "save it"),
}
"""What makes a drawing, in DXF or SVG, of files of other suffixes."""
DRAWINGS = {".svg": "svgelements", ".svgz": "svgelements", ".dxf": "ezdxf"}
"""The library that reads the drawings of a suffix."""


def load_shape(source: str | Path, unit: Unit | None = None, layer: str | None = None) -> Shape:
    """Return the outline of an object from a name such as "disc", two lengths, "0.09x0.06" or "90mmx60mm", or a file.

    Files are tables (.csv, .txt: a corner x y a line), JSON ({"vertices": [[x, y], ...]} or as palpate writes shapes),
    SVG and DXF (`pip install 'palpate[outlines]'`). `unit` is that of the numbers, by default metres, or the drawing's
    own. `layer` names the layer of a DXF that the outline is on or, of an SVG, a layer, a group or an element. Points
    keep their places in the object frame; an SVG, whose origin is a corner of the page, is put about its centroid,
    y up. The size of what a file holds is logged, as information.

    Raises SettingError for a name that is not known, FileError for a file without an outline or in another unit.
    """
    name = str(source)
    path = Path(name)
    if unit not in (None, *get_args(Unit)):
        raise SettingError(f"unit is {unit!r}; allowed are {', '.join(METRES)}")
    known_name = name.lower().replace("_", "-")
    if known_name in SHAPES:
        if unit is not None:
            raise SettingError(f"unit is {unit!r}, but {name} is an object of a known size")
        return SHAPES[known_name]
    scale = None if unit is None else METRES[unit]
    sides, scale = _sides_of(name.lower(), scale)
    if len(sides) != 2 and not ((name and path.exists()) or "/" in name or path.suffix[1:2].isalpha()):
        raise SettingError(
            f"shape is {name!r}; allowed are {', '.join(SHAPES)}, two lengths such as 0.09x0.06 [m] or 90mmx60mm, or a "
            "file of an outline"
        )
    if layer is not None and path.suffix.lower() not in DRAWINGS:
        raise SettingError(f"layer is {layer!r}, but {name} is no drawing (.svg, .dxf), which alone has layers")
    with in_file(path):
        if len(sides) == 2 and not path.exists():
            metres = 1.0 if scale is None else scale
            shape: Shape = Rectangle(sides[0] * metres, sides[1] * metres)
        else:
            shape, found = _read_file(path, scale, layer)
            logger.info("%s: outline %s", name, _words_of(shape, found))
        wrong = wrong_width(shape, unit)
        if wrong.endswith("?"):
            wrong += " unit= (--shape-unit) names it"
        if wrong:
            raise ShapeError(wrong)
    if shape.extent > 0.5:
        words = "%s: the outline is %.3g m wide, much for an object that a fingertip pushes; is its unit right?"
        logger.warning(words + " unit= (--shape-unit) names it", name, shape.extent)
    return shape


def _sides_of(name: str, scale: float | None) -> tuple[list[float], float | None]:
    """Return two lengths as in 0.09x0.06 or 90mmx60mm, none in other names, and the length of their unit [m]."""
    match = re.fullmatch(r"([\d.]+)(mm|cm|in|m)x([\d.]+)\2", name.replace(" ", ""))
    if match is None:
        sides = numbers_of(name.split("x")) or []
        return sides, scale
    return numbers_of((match[1], match[3])) or [], METRES[match[2]]


def _words_of(shape: Shape, layer: str) -> str:
    """Return the size of an outline, the layer that it was on, if any, and its number of corners in words."""
    words = [size_words(shape.outline())]
    if layer:
        words.append(f"layer {layer}")
    if isinstance(shape, Polygon):
        words.append(f"{len(shape.vertices)} corners")
    return ", ".join(words)


def _read_file(path: Path, scale: float | None, layer: str | None) -> tuple[Shape, str]:
    """Return the outline in a file, by its suffix, in a unit of `scale` [m], and its layer or ""."""
    readers = {
        ".json": _read_json,
        ".csv": _read_table,
        ".txt": _read_table,
        ".tsv": _read_table,
        ".dat": _read_table,
        ".gz": _read_table,
    }
    suffix = path.suffix.lower()
    if suffix in DRAWINGS:
        return _read_drawing(existing_file(path), scale, layer)
    if suffix and suffix not in readers:
        hint = f": {HINTS[suffix]} as DXF or SVG" if suffix in HINTS else ""
        raise FileError(f"is no outline; allowed are files named {', '.join([*DRAWINGS, *readers])}{hint}")
    read = readers.get(suffix, _read_table)
    return read(existing_file(path), scale), ""


def _read_drawing(path: Path, scale: float | None, layer: str | None) -> tuple[Polygon, str]:
    """Return the outline in a drawing, which `layer` may name, and the layer that it is on or ""."""
    suffix = path.suffix.lower()
    _check_drawing(path, DRAWINGS[suffix])
    if suffix == ".dxf":
        contour = outline_in(path, read_dxf(path, scale, ASK, TOLERANCE), layer)
        return _simplified(contour.corners), contour.layer
    contour = outline_in(path, read_svg(path, scale, ASK), layer)
    outline = _simplified(contour.corners)
    return Polygon(outline.corners - outline.centroid), contour.layer


def _read_table(path: Path, scale: float | None) -> Shape:
    """Return the outline through points x y, one a line, in a unit of `scale` [m]."""
    rows = table_rows(re.sub("(?m)[#%].*|^sep=.$", "", read_text(path)), path)
    if rows and all(numbers_of([word]) is None for word in rows[0][1]):
        rows, scale = _without_header(rows, scale)
    if not rows:
        raise ShapeError("is no table of numbers x y: it holds none")
    for number, words in rows:
        if len(words) != 2 or numbers_of(words) is None:
            raise ShapeError(f"is no table of numbers x y: line {number} is {','.join(words)!r}")
    points = np.array([words for _, words in rows], np.float64)
    gap = next((later for (line, _), (later, _) in pairwise(rows) if later > line + 1), None)
    if gap is not None:
        logger.warning("%s: line %d follows a blank line or a remark; all corners are taken as one outline", path, gap)
    if scale is not None:
        points = points * scale
    return _of_few_corners(path, Polygon(points))


_Rows = list[tuple[int, list[str]]]
"""Rows of a table, each with its line."""


def _without_header(rows: _Rows, scale: float | None) -> tuple[_Rows, float | None]:
    """Return the columns x and y below a header, which may name their unit, and the unit [m].

    Raises ShapeError if there are no such columns, or if they name another unit than `scale`.
    """
    _, header = rows[0]
    names = [column_name(word) for word in header]
    axes: list[tuple[str, int]] = []  # name and column
    units: set[float | None] = set()
    for column, name in enumerate(names):
        match = re.fullmatch(r"([xy])(?:_(mm|cm|m|in))?", name)
        if match:
            axes.append((match[1], column))
            units.add(METRES[match[2]] if match[2] else scale)
    axes.sort()
    if [axis for axis, _ in axes] != ["x", "y"] or len(units) != 1 or (scale and units != {scale}):
        raise ShapeError(f"has the columns {', '.join(names)}; expected x and y, or x_mm and y_mm, in one unit")
    (unit,) = units
    return [(line, [row[column] for _, column in axes if column < len(row)]) for line, row in rows[1:]], unit


def _read_json(path: Path, scale: float | None) -> Shape:
    """Return the outline in {"vertices": [[x, y], ...]}, or a shape as palpate writes it."""
    shape = shape_from_dict({"type": "polygon", **read_json(path)})
    if scale is not None:
        shape = scaled(shape, scale)
    return _of_few_corners(path, shape) if isinstance(shape, Polygon) else shape


def _check_drawing(path: Path, library: str) -> None:
    """Raise FileError unless the library is installed and the file small enough for it."""
    if find_spec(library) is None:
        raise FileError(f"drawings are read by {library}, which is not installed: {install_command('outlines')}")
    size = path.stat().st_size
    if size > 5_000_000:  # the libraries take a thousand times the memory
        raise FileError(f"is a drawing of {size / 1e6:.0f} MB, allowed are 5; a single outline needs far less")


def _of_few_corners(path: Path, outline: Polygon) -> Polygon:
    """Return the outline, simplified if it has more corners than a round object of 10 cm needs."""
    if len(outline.vertices) <= 256:
        return outline
    simplified = _simplified(np.array(outline.vertices))
    if len(simplified.vertices) > 256:
        logger.warning("%s: the outline has %d corners; smooth it if it is a scan", path, len(simplified.vertices))
    return simplified


def _simplified(corners: Array) -> Polygon:
    """Return the outline through corners (N, 2) [m] without corners that it then still passes within the tolerance."""
    import shapely

    for _ in range(2):  # the first corner always stays, and may be on a side
        ring = shapely.get_coordinates(shapely.LinearRing(corners).simplify(TOLERANCE))
        corners = np.roll(ring[:-1], -1, axis=0)
    return Polygon(corners)
