"""Outlines of objects from a name, two lengths or a file: a table of points, JSON, SVG or DXF.

The libraries svgelements and ezdxf read the drawings, shapely finds the one closed outline among their lines.
"""

import io
import logging
import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import numpy as np

from palpate.arrays import Array
from palpate.checks import FARTHEST, METRES, are_in_range
from palpate.errors import FileError, SettingError, ShapeError, one_line
from palpate.files import column_name, existing_file, in_file, numbers_of, read_json, read_text, table_rows, unpacked
from palpate.geometry.shapes import SHAPES, Polygon, Rectangle, Shape, scaled, shape_from_dict, wrong_width
from palpate.hints import install_command
from palpate.types.choices import Unit

logger = logging.getLogger(__name__)

TOLERANCE = 2e-5
"""[m] Largest deviation of an outline from a drawn curve, or from the corners of a table that has many."""
ASK = "give the unit of its numbers, as unit='mm' (--shape-unit mm)"
PIXELS = 96.0
"""Pixels in an inch, as defined by CSS."""
SVG_UNITS = {"mm": 1e-3, "cm": 1e-2, "in": METRES["in"], "pt": METRES["in"] / 72, "pc": METRES["in"] / 6, "q": 2.5e-4}


def load_shape(source: str | Path, unit: Unit | None = None) -> Shape:
    """Return the outline of an object from a name such as "disc", two lengths such as "0.09x0.06", or a file.

    Files are tables (.csv, .txt: a corner x y a line), JSON ({"vertices": [[x, y], ...]} or as palpate writes shapes),
    SVG and DXF (`pip install 'palpate[outlines]'`). `unit` is that of the numbers, by default metres, or the drawing's
    own. Points keep their places in the object frame; an SVG, whose origin is a corner of the page, is put about its
    centroid, y up.

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
    sides = numbers_of(name.lower().split("x")) or []
    if len(sides) != 2 and not (path.exists() or "/" in name or path.suffix[1:2].isalpha()):
        raise SettingError(
            f"shape is {name!r}; allowed are {', '.join(SHAPES)}, two lengths such as 0.09x0.06 [m], or a file of "
            "an outline"
        )
    with in_file(path):
        if len(sides) == 2 and not path.exists():
            metres = 1.0 if scale is None else scale
            shape: Shape = Rectangle(sides[0] * metres, sides[1] * metres)
        else:
            shape = _read_file(path, scale)
        wrong = wrong_width(shape, unit)
        if wrong.endswith("?"):
            wrong += " unit= (--shape-unit) names it"
        if wrong:
            raise ShapeError(wrong)
    if shape.extent > 0.5:
        words = "%s: the outline is %.3g m wide, much for an object that a fingertip pushes; is its unit right?"
        logger.warning(words + " unit= (--shape-unit) names it", name, shape.extent)
    return shape


def _read_file(path: Path, scale: float | None) -> Shape:
    """Return the outline in a file, by the kind that its suffix names, in a unit of `scale` [m]."""
    readers = {
        ".svg": _read_svg,
        ".svgz": _read_svg,
        ".dxf": _read_dxf,
        ".json": _read_json,
        ".csv": _read_table,
        ".txt": _read_table,
        ".tsv": _read_table,
        ".dat": _read_table,
        ".gz": _read_table,
    }
    suffix = path.suffix.lower()
    if suffix and suffix not in readers:
        raise FileError(f"is no outline; allowed are files named {', '.join(readers)}")
    read = readers.get(suffix, _read_table)
    return read(existing_file(path), scale)


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


def _read_svg(path: Path, scale: float | None) -> Polygon:
    """Return the outline of an SVG about its centroid, y up; `scale` [m] is one unit of the drawing.

    Without it the size is that of the page, if width and height have a unit. A warning tells of parts that are masked.
    """
    _check_drawing(path, "svgelements")
    import svgelements

    try:
        data = unpacked(path)
        if re.search(rb"\bmask\s*[:=]|<symbol\b[^>]*\bviewBox", data):
            logger.warning("%s: masks, and scales of symbols, are not applied", path)
        page = svgelements.SVG.parse(io.BytesIO(_readable_svg(data)), ppi=PIXELS)
        lines = list(_seen_lines(page, page))
        size = abs(svgelements.Matrix(page.viewbox_transform or "").a) or 1.0
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no SVG that can be read ({one_line(error)})") from error
    if scale is None:
        scale = _svg_unit(page)
    outline = _outline_of_lines(path, [line * (scale / size, -scale / size) for line in lines])
    return Polygon(outline.corners - outline.centroid)


def _readable_svg(data: bytes) -> bytes:
    """Return an SVG changed such that svgelements reads from it what a browser shows."""
    # Masks, markers and foreign objects are not drawn where they are defined.
    data = re.sub(rb"(?s)<(mask|marker|foreignObject)\b[^>]*?(/>|>.*?</\1>)", b"", data)
    # Clip paths are known only after their definition, so all of them go to the start.
    clip_path = re.compile(rb"(?s)<clipPath\b.*?</clipPath>")
    clip_paths = b"".join(clip_path.findall(data))
    data = clip_path.sub(b"", data)
    data = re.sub(rb"<svg\b[^>]*>", lambda start: start[0] + clip_paths, data, count=1)
    # References in quotes are not understood.
    data = re.sub(rb"url\(\s*(['\"]|&quot;)(#.*?)\1\s*\)", rb"url(\2)", data)
    # Symbols are drawn only where they are used.
    return data.replace(b"<symbol", b"<defs><g").replace(b"</symbol>", b"</g></defs>")


def _seen_lines(group: Any, page: Any, area: Any = None) -> Iterator[Array]:
    """Yield the lines (n, 2) that a group of an SVG shows, around what is filled, in the area that clips leave."""
    import shapely
    from svgelements import Shape

    for part in group:
        inner = area
        if getattr(part, "clip_path", None) is not None:
            clip = _clip_area(part, page)
            inner = clip if area is None else shapely.intersection(area, clip)
        if isinstance(part, list):
            yield from _seen_lines(part, page, inner)
        if not isinstance(part, Shape):
            continue
        is_filled = _is_painted(part.fill)
        has_line = _is_painted(part.stroke) and part.stroke_width
        if _is_hidden(part) or not (is_filled or has_line):
            continue
        lines = _svg_lines(part)
        if is_filled:
            lines = [np.vstack([line, line[:1]]) for line in lines]
        if inner is not None:
            drawn = _area(lines) if is_filled else shapely.MultiLineString([line for line in lines if len(line) > 1])
            remaining: Any = shapely.get_parts(shapely.intersection(drawn, inner))
            lines = [shapely.get_coordinates(getattr(piece, "exterior", piece)) for piece in remaining]
        yield from lines


def _is_painted(colour: Any) -> bool:
    """Return true if a fill or a stroke shows on a white page."""
    return bool(colour.value is not None and colour.opacity and colour.hex != "#ffffff")


def _is_hidden(part: Any) -> bool:
    """Return true if a part of an SVG is invisible or has an opacity of 0."""
    opacity = numbers_of([str(part.values.get("opacity", 1)).strip(" %")])
    return opacity == [0.0] or part.values.get("visibility") in ("hidden", "collapse")


def _clip_area(part: Any, page: Any) -> Any:
    """Return the area within the clip path of a part of an SVG."""
    from svgelements import Group, Matrix, Path, Shape

    clip = part.clip_path
    placement = Matrix(part.values.get("transform", ""))
    if clip.unit_type == "objectBoundingBox":
        inside = [part] if isinstance(part, Shape) else part.select()
        paths = [Path(shape) * ~placement for shape in inside if isinstance(shape, Shape)]
        left, top, right, bottom = Group.union_bbox(paths) or (0.0, 0.0, 0.0, 0.0)
        placement = Matrix(right - left, 0.0, 0.0, bottom - top, left, top) * placement
    placement = ~Matrix(page.viewbox_transform) * placement
    shapes = [Path(shape) * placement for shape in Group.select(clip) if isinstance(shape, Shape)]
    return _area(line for shape in shapes for line in _svg_lines(shape))


def _area(lines: Iterable[Array]) -> Any:
    """Return the area within closed lines (n, 2)."""
    import shapely

    return shapely.union_all([shapely.make_valid(shapely.Polygon(line)) for line in lines if len(line) > 2])


def _svg_unit(page: Any) -> float:
    """Return the length of a unit of an SVG [m], by width or height of its page.

    Raises ShapeError if neither has a unit, or if the drawing is stretched.
    """
    sizes: list[float] = []
    if page.viewbox is not None and str(page.viewbox.preserve_aspect_ratio).startswith("none"):
        raise ShapeError("the drawing is stretched to its page (preserveAspectRatio is none): save it unstretched")
    for side in ("width", "height"):
        given = re.fullmatch(r"\s*([-+.\d]+(?:e[-+]?\d+)?)\s*([a-z]+)\s*", str(page.values.get(side)).lower())
        if given and given[2] in SVG_UNITS and numbers_of([given[1]]):
            numbers = getattr(page.viewbox, side, None)
            if numbers:
                sizes.append(float(given[1]) * SVG_UNITS[given[2]] / numbers)
            else:  # without a viewBox numbers are pixels
                sizes.append(METRES["in"] / PIXELS)
    if not sizes:
        raise ShapeError(f"the drawing has no size, its width is {page.values.get('width', 'not given')!r}: {ASK}")
    return min(sizes)


def _svg_lines(shape: Any) -> list[Array]:
    """Return points (n, 2) along each unbroken line of a shape."""
    from svgelements import Close, Line, Move, Path

    path = Path(shape)
    path.reify()
    lines: list[Array] = []
    for subpath in map(Path, path.as_subpaths()):
        points: list[Any] = []
        for segment in subpath:
            if isinstance(segment, Move) or None in (segment.start, segment.end):
                continue
            count = 2 if isinstance(segment, Line | Close) else 65
            points.append(segment.npoint(np.linspace(0.0, 1.0, count)))
        lines.append(np.array(np.vstack(points) if points else [], np.float64).reshape(-1, 2))
    return lines


def _read_dxf(path: Path, scale: float | None) -> Polygon:
    """Return the outline in the model space of a DXF; `scale` [m] is one unit, by default that of its header."""
    _check_drawing(path, "ezdxf")
    from ezdxf.filemanagement import readfile
    from ezdxf.path import make_path

    lines: list[Array] = []
    try:
        drawing = readfile(path)
        metres = _dxf_unit(drawing.units) if scale is None else scale
        for entity in _seen_entities(drawing.modelspace(), drawing.layers):
            try:
                drawn = make_path(entity)
            except TypeError:  # a text, a dimension and the like
                continue
            _check_lines([np.array([(corner.x, corner.y) for corner in drawn.control_vertices()]) * metres])
            vertices = _inside_of_spline(entity) or drawn.flattening(0.5 * TOLERANCE / metres)
            points = np.array([(vertex.x, vertex.y) for vertex in vertices]) * metres
            lines.append(np.vstack([points, points[:1]]) if drawn.is_closed else points)
    except ShapeError:
        raise
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no DXF that can be read ({one_line(error)})") from error
    return _outline_of_lines(path, lines)


def _dxf_unit(number: int) -> float:
    """Return the length of a unit of a DXF [m]. Raises ShapeError if its number stands for none."""
    from ezdxf.units import METER_FACTOR

    per_metre = dict(enumerate(METER_FACTOR)).get(number)
    if not per_metre:
        raise ShapeError(f"the drawing has no unit that is known ($INSUNITS is {number}): {ASK}")
    return 1.0 / per_metre


def _inside_of_spline(entity: Any) -> list[Any]:
    """Return points along a periodic spline of a DXF, which ezdxf draws beyond its ends too; none of other entities."""
    curve = entity.construction_tool() if entity.dxftype() == "SPLINE" else None
    if curve is None or curve.is_clamped:
        return []
    knots = curve.knots()[curve.degree : -curve.degree]
    return list(curve.points(np.linspace(knots[0], knots[-1], 64 * len(knots))))


def _seen_entities(entities: Iterable[Any], layers: Any, outer: str = "0") -> Iterator[Any]:
    """Yield the entities that a CAD program shows, those in blocks where the blocks are inserted.

    Entities on layers that are off or frozen are not shown. Those on layer 0 of a block are on the layer `outer` of the
    block. If that is off, entities of the block on other layers are still shown.
    """
    for entity in entities:
        name = outer if entity.dxf.layer == "0" else entity.dxf.layer
        layer = layers.get(name) if layers.has_entry(name) else None
        is_off = layer is not None and layer.is_off() and entity.dxftype() != "INSERT"
        if entity.dxf.get("invisible", 0) or is_off or (layer and layer.is_frozen()):
            continue
        if entity.dxftype() == "INSERT":
            if entity.mcount > 1000:
                raise ShapeError(f"inserts a block {entity.mcount} times; allowed is one outline")
            for block in entity.multi_insert():
                yield from _seen_entities(block.virtual_entities(), layers, name)
        else:
            yield entity


def _check_drawing(path: Path, library: str) -> None:
    """Raise FileError unless the library is installed and the file small enough for it."""
    if find_spec(library) is None:
        raise FileError(f"drawings are read by {library}, which is not installed: {install_command('outlines')}")
    size = path.stat().st_size
    if size > 5_000_000:  # the libraries take a thousand times the memory
        raise FileError(f"is a drawing of {size / 1e6:.0f} MB, allowed are 5; a single outline needs far less")


def _check_lines(lines: Sequence[Array]) -> None:
    """Raise ShapeError if lines (n, 2) [m] go too far for any outline."""
    if not all(are_in_range(line).all() for line in lines):
        raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")


def _outline_of_lines(path: Path, lines: Sequence[Array]) -> Polygon:
    """Return the outline of the area that lines (n, 2) [m] enclose, each closed or several end to end.

    Ends within 0.01 mm meet, and lines on one another count once. Outlines within the outline are holes, left out with
    a warning. Raises ShapeError unless there is one area.
    """
    import shapely

    _check_lines(lines)
    lines = [line for line in lines if len(line) > 1]
    if not lines:
        raise ShapeError("holds no closed outline: there are no lines in it")
    drawn: Any = shapely.union_all([shapely.LineString(line) for line in _joined(lines)], grid_size=1e-6)
    parts = [part for part in shapely.get_parts(drawn).tolist() if not part.is_empty]
    faces: Any = shapely.get_parts(shapely.polygonize(parts))
    if not len(faces):
        raise ShapeError(f"holds no closed outline: lines {_loose_ends(parts)}")
    area = shapely.union_all([shapely.Polygon(face.exterior) for face in faces])
    if not isinstance(area, shapely.Polygon):
        raise ShapeError(f"holds {len(shapely.get_parts(area))} outlines side by side; allowed is one, and holes in it")
    holes = sum(len(face.interiors) for face in faces)
    if holes:
        logger.warning("%s: %d outlines within the largest are holes, which are left out", path, holes)
    return _simplified(shapely.get_coordinates(area.exterior))


def _joined(lines: Sequence[Array]) -> list[Array]:
    """Return lines (n, 2) [m] whose ends are moved together where they are within 0.01 mm."""
    from scipy.spatial import KDTree

    ends = np.array([line[[0, -1]] for line in lines]).reshape(-1, 2)
    ends = ends[[min(near) for near in KDTree(ends).query_ball_point(ends, 1e-5)]]
    starts = ends[::2]
    stops = ends[1::2]
    return [np.vstack([start, line[1:-1], stop]) for line, start, stop in zip(lines, starts, stops, strict=True)]


def _loose_ends(parts: Sequence[Any]) -> str:
    """Return words on the ends of lines that meet no other line."""
    import shapely

    ends = np.array([shapely.get_coordinates(part)[[0, -1]] for part in parts]).reshape(-1, 2)
    places, counts = np.unique(ends, axis=0, return_counts=True)
    loose = ", ".join(f"({x:.2f}, {y:.2f})" for x, y in 1e3 * places[counts == 1][:4])
    return f"end alone at {loose} mm" if loose else "enclose no area"


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

    return Polygon(shapely.get_coordinates(shapely.LinearRing(corners).simplify(TOLERANCE)))
