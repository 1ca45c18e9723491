"""Lines of an SVG as a browser shows them, read by svgelements."""

import io
import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.checks import METRES
from palpate.errors import FileError, ShapeError, one_line
from palpate.files import numbers_of, unpacked
from palpate.io.contours import Drawing, Line

logger = logging.getLogger(__name__)

_PIXEL = METRES["in"] / 96
"""Length of a pixel [m], as defined by CSS."""
UNITS = {"mm": 1e-3, "cm": 1e-2, "in": METRES["in"], "pt": METRES["in"] / 72, "pc": METRES["in"] / 6, "q": 2.5e-4}
"""Lengths of the units of an SVG [m]."""
_STYLE = re.compile(rb"(?s)<style\b[^>]*>.*?</style>")
_RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
"""Selectors and properties of a rule of a style sheet."""
_SELECTOR = re.compile(r"\*|[\w-]+|[\w-]*\.[\w-]+|#[\w-]+")
"""Selectors that svgelements knows: all, a kind, a class, a kind of a class, an id."""
_SEEN = re.compile(r"\b(?<!-)(display|visibility|fill|stroke|opacity|transform|clip)[\w-]*\s*:")
"""Properties that decide what is seen, and where."""
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"


def read_svg(path: Path, scale: float | None, unit_advice: str) -> Drawing:
    """Return the lines of an SVG, y up; `scale` [m] is one unit of the drawing.

    Without it the size is that of the page, if width and height have a unit. A warning tells of parts that are masked.
    Raises FileError and ShapeError.
    """
    import svgelements

    try:
        data = unpacked(path)
        if re.search(rb"<symbol\b[^>]*\bviewBox", data):
            raise ShapeError("a symbol has a viewBox, which scales it and is not read: unlink its uses")
        if re.search(rb"\bmask\s*[:=]|\btransform-origin\s*[:=]", data):
            logger.warning("%s: masks and origins of transforms are not applied", path)
        _check_styles(b"".join(_STYLE.findall(data)).decode(errors="replace"))
        page = svgelements.SVG.parse(io.BytesIO(_readable_svg(data)), reify=False, ppi=METRES["in"] / _PIXEL)
        drawing = Drawing()
        _add_seen(drawing, page, page)
        size = abs(svgelements.Matrix(page.viewbox_transform or "").a) or 1.0
    except ShapeError:
        raise
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no SVG that can be read ({one_line(error)})") from error
    metres = (_unit(page, unit_advice) if scale is None else scale) / size
    lines = [replace(line, points=line.points * (metres, -metres)) for line in drawing.lines]
    notes = [(x * metres, -y * metres) for x, y in drawing.notes]
    return Drawing(lines, notes, drawing.unread)


def _check_styles(sheets: str) -> None:
    """Raise ShapeError where style sheets decide what is seen of elements that svgelements cannot find."""
    for selectors, properties in _RULE.findall(re.sub(r"(?s)/\*.*?\*/|<!\[CDATA\[|\]\]>|<[^>]*>", "", sheets)):
        for selector in map(str.strip, selectors.split(",")):
            is_moment = re.search(":(hover|focus|active|:)", selector)
            if not _SELECTOR.fullmatch(selector) and not is_moment and _SEEN.search(properties):
                raise ShapeError(
                    f"its style sheet has the selector {selector!r}, and allowed are a kind, a class or an id: save it "
                    "as plain SVG, in which elements have their own styles"
                )
    if "@media" in sheets:
        raise ShapeError("its style sheet has @media, so that it looks different elsewhere: save it as plain SVG")


def _readable_svg(data: bytes) -> bytes:
    """Return an SVG changed such that svgelements reads from it what a browser shows."""
    # Masks, markers and foreign objects are not drawn where they are defined.
    data = re.sub(rb"(?s)<(mask|marker|foreignObject)\b[^>]*?(/>|>.*?</\1>)", b"", data)
    # Clip paths and styles are known only after their definition, so all of them go to the start.
    first = b""
    for definition in (_STYLE, re.compile(rb"(?s)<clipPath\b.*?</clipPath>")):
        first += b"".join(definition.findall(data))
        data = definition.sub(b"", data)
    first = re.sub(rb"\}", b";}", first)  # rules of one element are put together as they are
    data = re.sub(rb"<svg\b[^>]*>", lambda start: start[0] + first, data, count=1)
    # Rectangles without x and y inherit those of a nested page, which is at its place already.
    for side in (b"x", b"y"):
        data = re.sub(rb"<rect\b(?![^>]*\s%s\s*=)" % side, b'<rect %s="0"' % side, data)
    # References in quotes are not understood.
    data = re.sub(rb"url\(\s*(['\"]|&quot;)(#.*?)\1\s*\)", rb"url(\2)", data)
    # Symbols are drawn only where they are used.
    return data.replace(b"<symbol", b"<defs><g").replace(b"</symbol>", b"</g></defs>")


@dataclass(frozen=True)
class _Place:
    """Place of a part in an SVG."""

    layer: str = ""
    """The label of the innermost layer around it, else the id of the outermost group; "" if there is neither."""
    names: tuple[str, ...] = ()
    """Labels and ids of all groups around it."""
    area: Any = None
    """The area that clips leave; None for all."""


def _add_seen(drawing: Drawing, group: Any, page: Any, place: _Place = _Place()) -> None:
    """Add what a group of an SVG shows, around what is filled."""
    import shapely
    from svgelements import Shape, Text

    for part in group:
        area = place.area
        if getattr(part, "clip_path", None) is not None:
            clip = _clip_area(part, page)
            area = clip if area is None else shapely.intersection(area, clip)
        label, id_ = _label_and_id(part)
        names = (*place.names, label, id_)
        if isinstance(part, list):
            _add_seen(drawing, part, page, _Place(label or place.layer or id_, names, area))
        elif isinstance(part, Text) and not _is_hidden(part):
            matrix: Any = part.transform
            note = matrix.point_in_matrix_space((part.x, part.y))
            drawing.notes.append((float(note[0]), float(note[1])))
        elif isinstance(part, Shape):
            drawing.lines.extend(_lines_of(part, replace(place, names=names, area=area)))


def _label_and_id(part: Any) -> tuple[str, str]:
    """Return the label that Inkscape gives a layer or an object, and the id, of a part of an SVG, each "" if none."""
    attributes = part.values.get("attributes") or {}
    return str(attributes.get(_LABEL) or ""), str(attributes.get("id") or "")


def _lines_of(part: Any, place: _Place) -> Iterator[Line]:
    """Yield the lines of a shape that is seen, around it if it is filled."""
    import shapely

    fill = part.fill.hexrgb if _is_painted(part.fill) else ""
    has_line = _is_painted(part.stroke) and part.stroke_width
    if _is_hidden(part) or not (fill or has_line):
        return
    lines = _svg_lines(part)
    if fill:
        lines = [np.vstack([line, line[:1]]) if len(line) > 2 else line for line in lines]
    if place.area is not None:
        drawn = _area(lines) if fill else shapely.MultiLineString([line for line in lines if len(line) > 1])
        remaining: Any = shapely.get_parts(shapely.intersection(drawn, place.area))
        lines = [shapely.get_coordinates(getattr(piece, "exterior", piece)) for piece in remaining]
    dashes = numbers_of(re.split(r"[\s,]+", str(part.values.get("stroke-dasharray", "none")).strip()))
    other = "dashed" if not fill and dashes and any(dashes) else ""
    for line in lines:
        yield Line(line, place.layer, place.names, other, fill)


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


def _unit(page: Any, advice: str) -> float:
    """Return the length of a unit of an SVG [m], by width or height of its page.

    Raises ShapeError if neither has a unit, or if the drawing is stretched.
    """
    sizes: list[float] = []
    if page.viewbox is not None and str(page.viewbox.preserve_aspect_ratio).startswith("none"):
        raise ShapeError("the drawing is stretched to its page (preserveAspectRatio is none): save it unstretched")
    for side in ("width", "height"):
        given = re.fullmatch(r"\s*([-+.\d]+(?:e[-+]?\d+)?)\s*([a-z]+)\s*", str(page.values.get(side)).lower())
        if given and given[2] in UNITS and numbers_of([given[1]]):
            numbers = getattr(page.viewbox, side, None)
            if numbers:
                sizes.append(float(given[1]) * UNITS[given[2]] / numbers)
            else:  # without a viewBox numbers are pixels
                sizes.append(_PIXEL)
    if not sizes:
        raise ShapeError(f"the drawing has no size, its width is {page.values.get('width', 'not given')!r}: {advice}")
    is_cut = page.viewbox is not None and str(page.viewbox.preserve_aspect_ratio).endswith("slice")
    return max(sizes) if is_cut else min(sizes)


def _svg_lines(shape: Any) -> list[Array]:
    """Return points (n, 2) along each unbroken line of a shape.

    Its transform is applied to points: see findings/svgelements-sheared-and-stretched-ellipses.sh.
    """
    from svgelements import Close, Line, Matrix, Move, Path

    path = Path(shape)
    matrix = path.transform
    path.transform = Matrix()
    linear = np.array([[matrix.a, matrix.b], [matrix.c, matrix.d]])
    lines: list[Array] = []
    for subpath in map(Path, path.as_subpaths()):
        points: list[Any] = []
        for segment in subpath:
            if isinstance(segment, Move) or None in (segment.start, segment.end):
                continue
            count = 2 if isinstance(segment, Line | Close) else 65
            points.append(segment.npoint(np.linspace(0.0, 1.0, count)))
        places = np.array(np.vstack(points) if points else [], np.float64).reshape(-1, 2)
        lines.append(places @ linear + (matrix.e, matrix.f))
    return lines
