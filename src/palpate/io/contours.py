"""The outline of an object among the lines of a drawing: the one closed contour that is around all others.

A contour is closed by itself, as a circle or a closed polyline is, or made of lines that meet end to end. So centre
lines, leaders and dimensions, which cross an outline or end at it, are no part of one. Shapely does the geometry.
"""

import logging
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Flags
from palpate.checks import FARTHEST, are_in_range
from palpate.errors import ShapeError

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Limits:
    """Limits of what is found here."""

    meeting: float = 1e-5
    """[m] Largest distance of ends that meet."""
    flat: float = 0.01
    """Largest rise of a line out of the x y plane, as a share of its length: beyond it lengths are wrong."""
    sheet_side: float = 0.18
    """[m] Least length of the longer side of a frame round a sheet of paper, that of A5."""
    sheet_ratio: tuple[float, float] = (1.2, 1.6)
    """Ratio of the sides of such a frame."""
    small: float = 0.02
    """Share of the area of a frame below which a round outline in it is a hole in an object rather than the object."""

    arrow: float = 0.08
    """Extent of the largest outline, as a share, below which a closed line may be an arrow head."""


_LIMITS = _Limits()


@dataclass(frozen=True, eq=False)
class Line:
    """One unbroken line of a drawing."""

    points: Array
    """(n, 2) [m]"""
    layer: str = ""
    """Name of its layer; "" if it is on none."""
    names: tuple[str, ...] = ()
    """Other names that choose the line, as its layer does."""
    other: str = ""
    """What it is if it is no visible edge of a part, such as a dashed line; "" for an edge."""
    fill: str = ""
    """Colour of the area that it fills; "" if it is a line only."""
    rise: float = 0.0
    """Extent along z, out of the drawing's plane [m]."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """Content of a drawing."""

    lines: list[Line] = field(default_factory=list)
    notes: list[tuple[float, float]] = field(default_factory=list)
    """Places of texts and dimensions [m]."""
    unread: Counter[str] = field(default_factory=Counter)
    """Numbers of other things by their kind, such as hatches."""
    bodies: Counter[str] = field(default_factory=Counter)
    """Numbers of those among them that may be the object, such as regions."""


@dataclass(frozen=True, eq=False)
class Contour:
    """An area within closed lines."""

    area: Any
    """Polygon of shapely without holes."""
    lines: tuple[Line, ...]
    """The lines that it is made of."""
    parts: int = 1
    """Number of areas into which its lines divide it."""

    @property
    def layer(self) -> str:
        """The layer of most of its lines."""
        return Counter(line.layer for line in self.lines).most_common(1)[0][0]

    @property
    def fill(self) -> str:
        """The colour that fills it; "" if none does."""
        return self.lines[0].fill

    @property
    def corners(self) -> Array:
        """Corners (N, 2) [m]."""
        import shapely

        return shapely.get_coordinates(self.area.exterior)

    def __str__(self) -> str:
        return f"{size_words(self.corners)}{f' on layer {self.layer}' if self.layer else ''}"


def size_words(corners: Array) -> str:
    """Return the extents of corners (N, 2) [m] along x and y in words."""
    width, height = 1e3 * np.ptp(corners, axis=0)
    return f"{width:.4g} x {height:.4g} mm"


def outline_in(path: Path, drawing: Drawing, layer: str | None = None) -> Contour:
    """Return the contour that is around all others in a drawing, on a layer if one is named.

    Contours within it are holes, of which a warning tells. Raises ShapeError unless there is one such contour, and
    where it may be the frame of a sheet.
    """
    lines = _lines_of(drawing, layer)
    contours = _contours([line for line in lines if not line.other])
    if layer and not contours:
        contours = _contours(lines)  # what is asked for may be dashed
    if not contours:
        raise ShapeError(f"holds no closed outline: {_why_none(lines, drawing)}")
    heads = _arrow_heads(contours, lines)
    contours = _joined_areas([contour for contour in contours if contour not in heads])
    outer = [contour for contour in contours if not _around(contour, contours)]
    if len(outer) > 1 and len({outline.lines for outline in outer}) == 1:
        raise ShapeError(f"the outline crosses itself and so has {len(outer)} areas, {_listed(outer)}: draw one alone")
    if len(outer) > 1:
        raise ShapeError(f"holds {len(outer)} outlines side by side, {_listed(outer)}; {_choice(layer)}")
    (outline,) = outer
    holes = [contour for contour in contours if contour is not outline]
    if drawing.bodies and layer is None:
        words = _unread_words(drawing.bodies)
        raise ShapeError(
            f"holds beside the outline of {outline} what may be the object: {words}, or name the layer of the outline "
            "by shape_layer (--shape-layer)"
        )
    _check_frame(outline, holes, heads, drawing.notes, layer)
    _check_flat(outline)
    outer_heads = [head for head in heads if not outline.area.covers(head.area)]
    if outer_heads:
        words = "%s: %d small outlines at the ends of lines are taken as arrow heads: %s"
        logger.warning(words, path, len(outer_heads), _listed(outer_heads))
    if outline.parts > 1:
        logger.warning(
            "%s: lines divide the outline into %d areas, and it is taken round all of them: if some are no part of the "
            "object, such as a dimension, delete their lines",
            path,
            outline.parts,
        )
    if holes:
        words = "%s: %d outlines within the largest are holes, which are left out: %s"
        logger.warning(words, path, len(holes), _listed(holes))
    return outline


def _lines_of(drawing: Drawing, layer: str | None) -> list[Line]:
    """Return the lines of a drawing, or those of a layer. Raises ShapeError if there are none, or one is too far."""
    lines = [line for line in drawing.lines if len(line.points) > 1]
    if layer is not None:
        lines = [line for line in lines if layer.casefold() in map(str.casefold, (line.layer, *line.names))]
        if not lines:
            layers = sorted({line.layer for line in drawing.lines if line.layer})
            words = f"shows no line on layer {layer!r}; it shows lines on {', '.join(layers) or 'no layer'}"
            raise ShapeError("; ".join([words, *([_unread_words(drawing.unread)] if drawing.unread else [])]))
    if not all(are_in_range(line.points).all() for line in lines):
        raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")
    return lines


def _why_none(lines: Sequence[Line], drawing: Drawing) -> str:
    """Return words on why lines close no contour."""
    edges = [line for line in lines if not line.other]
    others = Counter(line.other for line in lines if line.other)
    if any(_is_upright(line) for line in lines):
        return _tilt_words(max(line.rise for line in lines))
    words = f"lines {_loose_ends(edges)}" if edges else "there are no lines in it"
    if others:
        words += f"; left out are lines that are {' or '.join(others)}"
    if drawing.unread and not edges:
        words += f"; {_unread_words(drawing.unread)}"
    return words


def _unread_words(unread: Counter[str]) -> str:
    """Return words on things of a drawing that are not read, by their kind."""
    return f"{' and '.join(unread)} cannot be read: explode it to lines in the program that drew it"


def _is_upright(line: Line) -> bool:
    """Return true for a line that rises out of the plane of x and y."""
    length = float(np.linalg.norm(np.ptp(line.points, axis=0)))
    return line.rise > max(_LIMITS.flat * length, _LIMITS.meeting)


def _tilt_words(rise: float) -> str:
    return (
        f"it does not lie flat in x and y, z goes up by {rise * 1e3:.4g} mm in a line: turn it into the x y plane, as "
        "seen from above"
    )


def _check_flat(outline: Contour) -> None:
    """Raise ShapeError if an outline lies in a tilted plane, in which lengths are others than in x and y."""
    tilted = [line for line in outline.lines if _is_upright(line)]
    if tilted:
        raise ShapeError(f"the outline is in a tilted plane: {_tilt_words(max(line.rise for line in tilted))}")


def _contours(lines: Sequence[Line]) -> list[Contour]:
    """Return the closed contours of lines, each once."""
    closed: list[Line] = []
    rest: list[Line] = []
    for line in lines:
        is_closed = len(line.points) > 2 and np.hypot(*(line.points[0] - line.points[-1])) <= _LIMITS.meeting
        (closed if is_closed else rest).append(line)
    found = [contour for line in closed for contour in _areas((line,), [line.points])]
    for ring in _rings(rest):
        found += _areas(tuple(line for line, _ in ring), [points for _, points in ring])
    different: list[Contour] = []
    for contour in sorted(found, key=lambda contour: -contour.area.area):
        if not any(_are_same(contour, other) for other in different):
            different.append(contour)
    return different


def _are_same(one: Contour, other: Contour) -> bool:
    """Return true for contours that are drawn on one another."""
    margin = _LIMITS.meeting * other.area.length
    if abs(one.area.area - other.area.area) > margin or not one.area.intersects(other.area):
        return False
    return one.area.symmetric_difference(other.area).area <= margin


def _areas(lines: tuple[Line, ...], points: Iterable[Array]) -> list[Contour]:
    """Return the contours of lines that belong together, given by their points (n, 2): one or, at a bridge, several."""
    import shapely

    drawn: Any = shapely.union_all([shapely.LineString(line) for line in points], grid_size=1e-6)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(drawn).tolist())).tolist()
    whole: Any = shapely.union_all([shapely.Polygon(face.exterior) for face in faces])
    found = []
    for area in shapely.get_parts(whole).tolist():
        if not area.is_empty:
            within = [face for face in faces if area.contains(face.representative_point())]
            holes = sum(len(face.interiors) for face in within)
            found.append(Contour(shapely.Polygon(area.exterior), lines, max(len(within) - holes, 1)))
    return found


def _rings(lines: Sequence[Line]) -> list[list[tuple[Line, Array]]]:
    """Return groups of lines that meet end to end and leave no end alone, each with points (n, 2) that meet exactly.

    A line that is drawn twice counts once.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not lines:
        return []
    ends, nodes = _ends_and_nodes(lines)
    is_kept = _are_first(lines, nodes)
    while True:
        counts = np.bincount(nodes[is_kept].ravel(), minlength=len(ends))
        is_loose = is_kept & (counts[nodes] < 2).any(axis=1)
        if not is_loose.any():
            break
        is_kept &= ~is_loose
    kept = np.flatnonzero(is_kept)
    starts = nodes[kept, 0]
    stops = nodes[kept, 1]
    graph = coo_array((np.ones(len(kept)), (starts, stops)), shape=(len(ends), len(ends)))
    _, groups = connected_components(graph, directed=False)
    rings: dict[int, list[tuple[Line, Array]]] = {}
    for index, start, stop in zip(kept.tolist(), starts.tolist(), stops.tolist(), strict=True):
        points = np.vstack([ends[start], lines[index].points[1:-1], ends[stop]])
        rings.setdefault(int(groups[start]), []).append((lines[index], points))
    return list(rings.values())


def _are_first(lines: Sequence[Line], nodes: NDArray[np.intp]) -> Flags:
    """Return flags (N,) of lines that are drawn for the first time, from their ends' nodes (N, 2)."""
    import shapely

    drawn: dict[tuple[int, int], list[Any]] = {}
    first = np.ones(len(lines), np.bool_)
    for index, (line, (start, stop)) in enumerate(zip(lines, nodes.tolist(), strict=True)):
        others = drawn.setdefault((min(start, stop), max(start, stop)), [])
        shape = shapely.LineString(line.points)
        if start == stop or any(shape.hausdorff_distance(other) <= 2.0 * _LIMITS.meeting for other in others):
            first[index] = False
        others.append(shape)
    return first


def _arrow_heads(contours: Sequence[Contour], lines: Sequence[Line]) -> list[Contour]:
    """Return small contours at which a line of another contour or of none ends: arrow heads, also dots and boxes."""
    import shapely

    largest = _LIMITS.arrow * max(_extent(contour) for contour in contours)
    heads = []
    for contour in contours:
        if _extent(contour) > largest:
            continue
        ends = [line.points[[0, -1]] for line in lines if line not in contour.lines]
        is_near = [shapely.MultiPoint(points).distance(contour.area) <= _LIMITS.meeting for points in ends]
        if any(is_near):
            heads.append(contour)
    return heads


def _extent(contour: Contour) -> float:
    """Return the longer side of the box around a contour [m]."""
    return float(np.ptp(contour.corners, axis=0).max())


def _joined_areas(contours: list[Contour]) -> list[Contour]:
    """Return contours of which those that overlap and are filled alike are joined, as they are seen.

    Raises ShapeError where others cross.
    """
    import shapely

    joined: list[Contour] = []
    for contour in contours:
        rest: list[Contour] = []
        for other in joined:
            if not _cross(contour.area, other.area):
                rest.append(other)
                continue
            if not contour.fill or contour.fill != other.fill:
                raise ShapeError(
                    f"closed lines cross, {other} and {contour}: draw the outline as one closed line, or name its "
                    "layer by shape_layer (--shape-layer)"
                )
            both: Any = shapely.union_all([contour.area, other.area])
            contour = Contour(shapely.Polygon(both.exterior), contour.lines + other.lines)
        joined = [*rest, contour]
    return joined


def _cross(one: Any, other: Any) -> bool:
    """Return true for areas that share a part of both, by more than errors of drawing."""
    if not one.intersects(other):
        return False
    shared = one.intersection(other).area
    margin = 2.0 * _LIMITS.meeting * min(one.length, other.length)
    return margin < shared < min(one.area, other.area) - margin


def _around(contour: Contour, contours: Sequence[Contour]) -> list[Contour]:
    """Return the larger contours that hold one; those that cross are known not to be there."""
    inner = contour.area.representative_point()
    return [
        other
        for other in contours
        if other is not contour and other.area.area > contour.area.area and other.area.contains(inner)
    ]


def _check_frame(
    outline: Contour,
    holes: Sequence[Contour],
    heads: Sequence[Contour],
    notes: Sequence[tuple[float, float]],
    layer: str | None,
) -> None:
    """Raise ShapeError if an outline may be the frame of a sheet, and the object one of the outlines in it."""
    with_holes = [hole for hole in holes if len(_around(hole, holes)) == 0 and _holds_any(hole, holes)]
    if with_holes:
        raise ShapeError(
            f"the outline of {outline} is around {_listed(with_holes)}, with holes in it; {_choice(layer)}"
        )
    if not _is_rectangle(outline.area):
        return
    sides = np.sort(np.ptp(outline.corners, axis=0))
    is_sheet = (
        sides[1] >= _LIMITS.sheet_side and _LIMITS.sheet_ratio[0] <= sides[1] / sides[0] <= _LIMITS.sheet_ratio[1]
    )
    parts = [hole for hole in holes if not _is_round(hole.area) or hole.area.area > _LIMITS.small * outline.area.area]
    if not parts and is_sheet:
        parts = [head for head in heads if outline.area.covers(head.area)]  # a small part, which a leader points at
    if not parts:
        return
    is_divided = outline.parts > 1 or any(
        hole.area.distance(outline.area.exterior) <= _LIMITS.meeting for hole in parts
    )
    is_on_another = any(hole.layer != outline.layer and not _is_round(hole.area) for hole in parts)
    if is_sheet or is_divided or is_on_another or _holds_all(outline.area, notes):
        raise ShapeError(
            f"the outline of {outline} may be a frame around {_listed(parts)}; {_choice(layer)}: delete the frame or, "
            "if it is the object, the outlines in it"
        )


def _holds_any(contour: Contour, others: Sequence[Contour]) -> bool:
    return any(contour in _around(other, others) for other in others)


def _holds_all(area: Any, places: Sequence[tuple[float, float]]) -> bool:
    """Return true if there are places, and all are within an area, as all notes are within the frame of a sheet."""
    import shapely

    return bool(places) and bool(shapely.contains_xy(area, places).all())


def _is_rectangle(area: Any) -> bool:
    """Return true for a rectangle along x and y, also with rounded corners."""
    box = area.envelope.area
    return bool(box) and area.area > 0.99 * box


def _is_round(area: Any) -> bool:
    """Return true for a circle."""
    return 4.0 * np.pi * area.area / area.length**2 > 0.99


def _listed(contours: Sequence[Contour]) -> str:
    """Return the sizes and layers of the first of some contours, the largest first."""
    ordered = sorted(contours, key=lambda contour: -contour.area.area)
    more = f" and {len(ordered) - 4} more" if len(ordered) > 4 else ""
    return ", ".join(map(str, ordered[:4])) + more


def _choice(layer: str | None) -> str:
    """Return words on how to choose among outlines."""
    if layer is not None:
        return "allowed is one, and holes in it"
    return "allowed is one, and holes in it: shape_layer (--shape-layer) names the layer of the object"


def _loose_ends(lines: Sequence[Line]) -> str:
    """Return words on the ends of lines that meet no other end, those first that are closest to another such end."""
    from scipy.spatial import KDTree

    ends, nodes = _ends_and_nodes(lines)
    counts = np.bincount(nodes[_are_first(lines, nodes)].ravel(), minlength=len(ends))
    loose = ends[counts == 1]
    if len(loose) < 2:
        return "enclose no area"
    distances = KDTree(loose).query(loose, 2)[0][:, 1]
    order = np.lexsort((loose[:, 1], loose[:, 0], np.round(distances, 6)))
    places = ", ".join(f"({x:.2f}, {y:.2f})" for x, y in 1e3 * loose[order[:4]])
    return f"end alone at {places} mm, and those of an outline meet end to end"


def _ends_and_nodes(lines: Sequence[Line]) -> tuple[Array, NDArray[np.intp]]:
    """Return the ends of lines (2 N, 2) [m], and of each line the numbers of its ends (N, 2), one where they meet."""
    from scipy.spatial import KDTree

    ends = np.array([line.points[[0, -1]] for line in lines]).reshape(-1, 2)
    places = np.array([min(near) for near in KDTree(ends).query_ball_point(ends, _LIMITS.meeting)])
    return ends, places.reshape(-1, 2)
