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
from palpate.checks import FARTHEST, METRES, is_near
from palpate.errors import FileError, SettingError, ShapeError, one_line
from palpate.files import column_name, existing_file, in_file, numbers_of, read_json, read_text, table_rows, unpacked
from palpate.geometry.shapes import SHAPES, Polygon, Rectangle, Shape, scaled, shape_from_dict, wrong_width
from palpate.types.choices import Unit

logger = logging.getLogger(__name__)

TOLERANCE = 2e-5
"""[m] Largest deviation of an outline from a drawn curve, or from the many corners of a table."""
ASK = "give the unit of its numbers, as unit='mm' (--shape-unit mm)"
PIXELS = 96.0
"""Pixels of an inch, as CSS has it."""
SVG_UNITS = {"mm": 1e-3, "cm": 1e-2, "in": METRES["in"], "pt": METRES["in"] / 72, "pc": METRES["in"] / 6, "q": 2.5e-4}


def load_shape(source: str | Path, unit: Unit | None = None) -> Shape:
    """Return the outline of an object from a name such as "disc", two lengths such as "0.09x0.06", or a file.

    Files are tables (.csv, .txt: a corner x y a line), JSON ({"vertices": [[x, y], ...]} or as palpate writes shapes),
    SVG and DXF (`pip install palpate[outlines]`). `unit` is that of the numbers, by default metres, or the drawing's
    own. Points keep their places in the object frame; an SVG, whose origin is a corner of the page, is put about its
    centroid, y up.

    Raises SettingError for a name that is not known, FileError for a file without an outline or in another unit.
    """
    name, path = str(source), Path(str(source))
    if unit not in (None, *get_args(Unit)):
        raise SettingError(f"unit is {unit!r}; allowed are {', '.join(METRES)}")
    if (known := name.lower().replace("_", "-")) in SHAPES:
        if unit is not None:
            raise SettingError(f"unit is {unit!r}, but {name} is an object of a known size")
        return SHAPES[known]
    scale = None if unit is None else METRES[unit]
    sides = numbers_of(name.lower().split("x")) or []
    if len(sides) != 2 and not (path.exists() or "/" in name or path.suffix[1:2].isalpha()):
        raise SettingError(
            f"shape is {name!r}; allowed are {', '.join(SHAPES)}, two lengths such as 0.09x0.06 [m], or a file of "
            "an outline"
        )
    readers = {".svg": _read_svg, ".svgz": _read_svg, ".dxf": _read_dxf, ".json": _read_json}
    readers |= dict.fromkeys(("", ".csv", ".txt", ".tsv", ".dat", ".gz"), _read_table)
    with in_file(path):
        if len(sides) == 2 and not path.exists():
            shape: Shape = Rectangle(sides[0] * (scale or 1.0), sides[1] * (scale or 1.0))
        else:
            if (read := readers.get(path.suffix.lower())) is None:
                raise FileError(f"is no outline; allowed are files named {', '.join(filter(None, readers))}")
            shape = read(existing_file(path), scale)
        if wrong := wrong_width(shape, unit):
            raise ShapeError(wrong + " unit= (--shape-unit) names it" * wrong.endswith("?"))
    if shape.extent > 0.5:
        words = "%s: the outline is %.3g m wide, much for an object that a fingertip pushes; is its unit right?"
        logger.warning(words + " unit= (--shape-unit) names it", name, shape.extent)
    return shape


def _read_table(path: Path, scale: float | None) -> Shape:
    """Return the outline through points x y, one a line, in a unit of `scale` [m]."""
    rows = table_rows(re.sub("(?m)[#%].*|^sep=.$", "", read_text(path)), path)
    if rows and all(numbers_of([word]) is None for word in rows[0][1]):
        names = [column_name(word) for word in rows.pop(0)[1]]
        matches = [(re.fullmatch(r"([xy])(?:_(mm|cm|m|in))?", name), index) for index, name in enumerate(names)]
        axes = sorted((match[1], index, match[2]) for match, index in matches if match)
        units = {METRES[named] if named else scale for *_, named in axes}
        if [axis for axis, *_ in axes] != ["x", "y"] or len(units) != 1 or (scale and units != {scale}):
            raise ShapeError(f"has the columns {', '.join(names)}; expected x and y, or x_mm and y_mm, in one unit")
        rows = [(line, [row[index] for _, index, _ in axes if index < len(row)]) for line, row in rows]
        (scale,) = units
    if not rows:
        raise ShapeError("is no table of numbers x y: it holds none")
    for number, words in rows:
        if len(words) != 2 or numbers_of(words) is None:
            raise ShapeError(f"is no table of numbers x y: line {number} is {','.join(words)!r}")
    points = np.array([words for _, words in rows], np.float64) * (scale or 1.0)
    return _of_few_corners(path, Polygon(points))


def _read_json(path: Path, scale: float | None) -> Shape:
    """Return the outline in {"vertices": [[x, y], ...]}, or a shape as palpate writes it."""
    shape = shape_from_dict({"type": "polygon", **read_json(path)})
    shape = shape if scale is None else scaled(shape, scale)
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
        data = re.sub(rb"(?s)<(mask|marker|foreignObject)\b[^>]*?(/>|>.*?</\1>)", b"", data)  # are not drawn themselves
        clips = re.compile(rb"(?s)<clipPath\b.*?</clipPath>")  # hold where they are used, not where they stand
        data = re.sub(
            rb"<svg\b[^>]*>", lambda start: start[0] + b"".join(clips.findall(data)), clips.sub(b"", data), count=1
        )
        data = re.sub(rb"url\(\s*(['\"]|&quot;)(#.*?)\1\s*\)", rb"url(\2)", data)
        data = data.replace(b"<symbol", b"<defs><g").replace(b"</symbol>", b"</g></defs>")  # drawn where they are used
        page = svgelements.SVG.parse(io.BytesIO(data), ppi=PIXELS)
        lines = list(_seen_lines(page, page))
        size = abs(svgelements.Matrix(page.viewbox_transform or "").a) or 1.0
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no SVG that can be read ({one_line(error)})") from error
    if scale is None:
        scale = _svg_unit(page)
    outline = _outline_of_lines(path, [line * (scale / size, -scale / size) for line in lines])
    return Polygon(outline.corners - outline.centroid)


def _seen_lines(group: Any, page: Any, area: Any = None) -> Iterator[Array]:
    """Yield the lines (n, 2) that a group of an SVG shows, around what is filled, in the area that clips leave."""
    import shapely
    from svgelements import Group, Matrix, Path, Shape

    for part in group:
        inner, clip, values = area, getattr(part, "clip_path", None), part.values
        if clip is not None:
            place = Matrix(values.get("transform", ""))
            if clip.unit_type == "objectBoundingBox":
                inside = [part] if isinstance(part, Shape) else part.select()
                boxes = [Path(each) * ~place for each in inside if isinstance(each, Shape)]
                left, top, right, bottom = Group.union_bbox(boxes) or (0.0, 0.0, 0.0, 0.0)
                place = Matrix(right - left, 0.0, 0.0, bottom - top, left, top) * place
            place = ~Matrix(page.viewbox_transform) * place
            shapes = [Path(each) * place for each in Group.select(clip) if isinstance(each, Shape)]
            inner = _area(line for each in shapes for line in _svg_lines(each))
            inner = inner if area is None else shapely.intersection(area, inner)
        if isinstance(part, list):
            yield from _seen_lines(part, page, inner)
        if not isinstance(part, Shape):
            continue
        opacity = numbers_of([str(values.get("opacity", 1)).strip(" %")])
        is_filled = part.fill.value is not None and part.fill.opacity and part.fill.hex != "#ffffff"  # as the page is
        edge = part.stroke
        has_line = edge.value is not None and edge.opacity and part.stroke_width and edge.hex != "#ffffff"
        if not (is_filled or has_line) or opacity == [0.0] or values.get("visibility") in ("hidden", "collapse"):
            continue
        lines = [np.vstack([line, line[:1]]) if is_filled else line for line in _svg_lines(part)]
        if inner is not None:
            drawn = _area(lines) if is_filled else shapely.MultiLineString([line for line in lines if len(line) > 1])
            left: Any = shapely.get_parts(shapely.intersection(drawn, inner))
            lines = [shapely.get_coordinates(getattr(each, "exterior", each)) for each in left]
        yield from lines


def _area(lines: Iterable[Array]) -> Any:
    """Return the area within closed lines (n, 2)."""
    import shapely

    return shapely.union_all([shapely.make_valid(shapely.Polygon(line)) for line in lines if len(line) > 2])


def _svg_unit(page: Any) -> float:
    """Return the size of a number in an SVG [m], by width or height of its page. Raises ShapeError if neither says."""
    sizes = []
    if page.viewbox is not None and str(page.viewbox.preserve_aspect_ratio).startswith("none"):
        raise ShapeError("the drawing is stretched to its page (preserveAspectRatio is none): save it unstretched")
    for side in ("width", "height"):
        given = re.fullmatch(r"\s*([-+.\d]+(?:e[-+]?\d+)?)\s*([a-z]+)\s*", str(page.values.get(side)).lower())
        if given and given[2] in SVG_UNITS and numbers_of([given[1]]):
            inner = getattr(page.viewbox, side, None)  # without a viewBox numbers are pixels
            sizes.append(float(given[1]) * SVG_UNITS[given[2]] / inner if inner else METRES["in"] / PIXELS)
    if not sizes:
        raise ShapeError(f"the drawing has no size, its width is {page.values.get('width', 'not given')!r}: {ASK}")
    return min(sizes)


def _svg_lines(shape: Any) -> list[Array]:
    """Return points (n, 2) along each unbroken line of a shape."""
    from svgelements import Close, Line, Move, Path

    path, lines = Path(shape), list[Array]()
    path.reify()
    for part in map(Path, path.as_subpaths()):
        drawn = (each for each in part if not isinstance(each, Move) and None not in (each.start, each.end))
        points = [each.npoint(np.linspace(0.0, 1.0, 2 if isinstance(each, Line | Close) else 65)) for each in drawn]
        lines.append(np.array(points and np.vstack(points), np.float64).reshape(-1, 2))
    return lines


def _read_dxf(path: Path, scale: float | None) -> Polygon:
    """Return the outline in the model space of a DXF; `scale` [m] is one unit, by default that of its header."""
    _check_drawing(path, "ezdxf")
    from ezdxf.filemanagement import readfile
    from ezdxf.path import make_path
    from ezdxf.units import METER_FACTOR

    lines = []
    try:
        drawing = readfile(path)
        metres = scale or 1.0 / (dict(enumerate(METER_FACTOR)).get(drawing.units) or np.inf)
        if not metres:
            raise ShapeError(f"the drawing has no unit that is known ($INSUNITS is {drawing.units}): {ASK}")
        for entity in _seen_entities(drawing.modelspace(), drawing.layers):
            try:
                drawn = make_path(entity)
            except TypeError:  # a text, a dimension and the like
                continue
            _check_lines([np.array([(each.x, each.y) for each in drawn.control_vertices()]) * metres])
            found = _inside_of_spline(entity) or drawn.flattening(0.5 * TOLERANCE / metres)
            points = np.array([(point.x, point.y) for point in found]) * metres
            lines.append(np.vstack([points, points[:1]]) if drawn.is_closed else points)
    except ShapeError:
        raise
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no DXF that can be read ({one_line(error)})") from error
    return _outline_of_lines(path, lines)


def _inside_of_spline(entity: Any) -> list[Any]:
    """Return points along a periodic spline of a DXF, which ezdxf draws beyond its ends too; none of other entities."""
    curve = entity.construction_tool() if entity.dxftype() == "SPLINE" else None
    if curve is None or curve.is_clamped:
        return []
    knots = curve.knots()[curve.degree : -curve.degree]
    return list(curve.points(np.linspace(knots[0], knots[-1], 64 * len(knots))))


def _seen_entities(entities: Iterable[Any], layers: Any, outer: str = "0") -> Iterator[Any]:
    """Yield what a CAD program shows: not on layers that are off or frozen, and what is in blocks in its place.

    What lies on layer 0 in a block is on the block's layer, `outer`. A block on a layer that is off shows its others.
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
        raise FileError(f"drawings are read by {library}, which is not installed: pip install palpate[outlines]")
    if (size := path.stat().st_size) > 5_000_000:  # the libraries take a thousand times the memory
        raise FileError(f"is a drawing of {size / 1e6:.0f} MB, allowed are 5; a single outline needs far less")


def _check_lines(lines: Sequence[Array]) -> None:
    if not all(is_near(line).all() for line in lines):
        raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")


def _outline_of_lines(path: Path, lines: Sequence[Array]) -> Polygon:
    """Return the outline of the area that lines (n, 2) [m] enclose, each closed or several end to end.

    Ends within 0.01 mm meet, and lines on one another count once. Outlines within it are holes, left out with a
    warning. Raises ShapeError unless there is one area.
    """
    import shapely
    from scipy.spatial import KDTree

    _check_lines(lines)
    lines = [line for line in lines if len(line) > 1]
    if not lines:
        raise ShapeError("holds no closed outline: there are no lines in it")
    ends = np.array([line[[0, -1]] for line in lines]).reshape(-1, 2)
    ends = ends[[min(near) for near in KDTree(ends).query_ball_point(ends, 1e-5)]]
    joined = [np.vstack([a, line[1:-1], b]) for line, a, b in zip(lines, ends[::2], ends[1::2], strict=True)]
    drawn: Any = shapely.union_all([shapely.LineString(line) for line in joined], grid_size=1e-6)
    parts = [part for part in shapely.get_parts(drawn).tolist() if not part.is_empty]
    faces: Any = shapely.get_parts(shapely.polygonize(parts))
    if not len(faces):
        ends = np.array([shapely.get_coordinates(part)[[0, -1]] for part in parts]).reshape(-1, 2)
        places, counts = np.unique(ends, axis=0, return_counts=True)
        loose = ", ".join(f"({x:.2f}, {y:.2f})" for x, y in 1e3 * places[counts == 1][:4])
        raise ShapeError(f"holds no closed outline: lines {f'end alone at {loose} mm' if loose else 'enclose no area'}")
    area = shapely.union_all([shapely.Polygon(face.exterior) for face in faces])
    if not isinstance(area, shapely.Polygon):
        raise ShapeError(f"holds {len(shapely.get_parts(area))} outlines side by side; allowed is one, and holes in it")
    if holes := sum(len(face.interiors) for face in faces):
        logger.warning("%s: %d outlines within the largest are holes, which are left out", path, holes)
    return _simplified(shapely.get_coordinates(area.exterior))


def _of_few_corners(path: Path, outline: Polygon) -> Polygon:
    """Return the outline, simplified if it has more corners than a round object of 10 cm needs."""
    found = outline if len(outline.vertices) <= 256 else _simplified(np.array(outline.vertices))
    if len(found.vertices) > 256:
        logger.warning("%s: the outline has %d corners; smooth it if it is a scan", path, len(found.vertices))
    return found


def _simplified(corners: Array) -> Polygon:
    """Return the outline through corners (N, 2) [m] without those that it passes within the tolerance."""
    import shapely

    return Polygon(shapely.get_coordinates(shapely.LinearRing(corners).simplify(TOLERANCE)))
