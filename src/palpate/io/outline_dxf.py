"""Lines of a DXF as a CAD program shows them, read by ezdxf."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.arrays import Array
from palpate.checks import FARTHEST, are_in_range
from palpate.errors import FileError, ShapeError, one_line
from palpate.io.contours import Drawing, Line

EDGES = {"LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"}
"""Kinds of entities that draw edges. Not among them are frames of images and of windows, and arrow heads."""
NOTES = {"TEXT", "MTEXT", "DIMENSION", "LEADER", "MULTILEADER", "TOLERANCE", "ATTDEF", "ACAD_TABLE"}
"""Kinds of entities that explain a drawing."""
BODIES = {"REGION", "3DSOLID", "BODY", "SURFACE", "EXTRUDEDSURFACE", "LOFTEDSURFACE", "PLANESURFACE", "REVOLVEDSURFACE"}
BODIES |= {"SWEPTSURFACE", "MESH", "3DFACE"}
"""Kinds of entities that may be the part itself, and that are no lines."""
_DASHED = re.compile("center|phantom|hidden|dash|dot|divide|border", re.IGNORECASE)
"""Names of line types that a drawing uses and does not define."""


class _Seen(NamedTuple):
    """An entity that is shown."""

    entity: Any
    layer: str
    line_type: str


def read_dxf(path: Path, scale: float | None, unit_advice: str, tolerance: float) -> Drawing:
    """Return the lines in the model space of a DXF; `scale` [m] is one unit, by default that of its header.

    Curves are followed within the tolerance [m]. Raises FileError and ShapeError.
    """
    from ezdxf.filemanagement import readfile

    drawing = Drawing()
    try:
        document = readfile(path)
        metres = _unit(document.units, unit_advice) if scale is None else scale
        for seen in _seen_entities(document.modelspace(), document.layers):
            _add(drawing, document, seen, metres, tolerance)
    except ShapeError:
        raise
    except Exception as error:  # damaged bytes can raise anything in the library
        raise FileError(f"is no DXF that can be read ({one_line(error)})") from error
    return drawing


def _add(drawing: Drawing, document: Any, seen: _Seen, metres: float, tolerance: float) -> None:
    """Add an entity to a drawing, as a line, as a note, or as one that is not read."""
    from ezdxf.path import make_path

    entity = seen.entity
    kind = entity.dxftype()
    if kind in NOTES:
        for name in ("insert", "defpoint"):
            if entity.dxf.is_supported(name) and entity.dxf.hasattr(name):
                x, y, *_ = entity.dxf.get(name)
                drawing.notes.append((x * metres, y * metres))
        return
    if kind in BODIES:
        drawing.bodies[kind] += 1
    if kind not in EDGES:
        drawing.unread[kind] += 1
        return
    try:
        drawn = make_path(entity)
    except TypeError:  # a mesh
        drawing.unread["mesh"] += 1
        drawing.bodies["mesh"] += 1
        return
    control = np.array([tuple(corner) for corner in drawn.control_vertices()]).reshape(-1, 3) * metres
    if not are_in_range(control).all():
        raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")
    vertices = _inside_of_spline(entity) or drawn.flattening(0.5 * tolerance / metres)
    points: Array = np.array([tuple(vertex) for vertex in vertices]).reshape(-1, 3) * metres
    if drawn.is_closed:
        points = np.vstack([points, points[:1]])
    extent = np.ptp(points, axis=0)
    if len(points) < 2 or not extent.any() or _width(entity) * metres > 0.5 * extent.max():  # the last is a filled dot
        return
    other = _other_than_edge(document, seen)
    drawing.lines.append(Line(points[:, :2], seen.layer, other=other, rise=float(np.ptp(points[:, 2]))))


def _width(entity: Any) -> float:
    """Return the width with which a polyline of a DXF is drawn; 0 of other entities."""
    return entity.dxf.get("const_width", 0.0) if entity.dxftype() == "LWPOLYLINE" else 0.0


def _unit(number: int, advice: str) -> float:
    """Return the length of a unit of a DXF [m]. Raises ShapeError if its number stands for none."""
    from ezdxf.units import METER_FACTOR

    per_metre = dict(enumerate(METER_FACTOR)).get(number)
    if not per_metre:
        raise ShapeError(f"the drawing has no unit that is known ($INSUNITS is {number}): {advice}")
    return 1.0 / per_metre


def _inside_of_spline(entity: Any) -> list[Any]:
    """Return points along a periodic spline of a DXF, which ezdxf draws beyond its ends too; none of other entities."""
    curve = entity.construction_tool() if entity.dxftype() == "SPLINE" else None
    if curve is None or curve.is_clamped:
        return []
    knots = curve.knots()[curve.degree : -curve.degree]
    return list(curve.points(np.linspace(knots[0], knots[-1], 64 * len(knots))))


def _other_than_edge(document: Any, seen: _Seen) -> str:
    """Return the kind of a line if its type or its layer says that it is no visible edge, else ""."""
    layer = document.layers.get(seen.layer) if document.layers.has_entry(seen.layer) else None
    if seen.layer.lower() == "defpoints" or (layer is not None and not layer.dxf.get("plot", 1)):
        return "on a layer that is not plotted"
    name = seen.line_type
    if name.lower() == "bylayer":
        name = "Continuous" if layer is None else layer.dxf.linetype
    if not document.linetypes.has_entry(name):
        return f"dashed ({name})" if _DASHED.search(name) else ""
    pattern = document.linetypes.get(name).simplified_line_pattern()
    return f"dashed ({name})" if len(pattern) > 1 else ""


def _seen_entities(
    entities: Iterable[Any], layers: Any, outer: str = "0", outer_type: str = "Continuous"
) -> Iterator[_Seen]:
    """Yield the entities that a CAD program shows, those in blocks where the blocks are inserted.

    Entities on layers that are off or frozen are not shown. Those on layer 0 of a block are on the layer `outer` of the
    block. If that is off, entities of the block on other layers are still shown. `outer_type` is the block's line type.
    """
    for entity in entities:
        name = outer if entity.dxf.layer == "0" else entity.dxf.layer
        line_type = entity.dxf.get("linetype", "BYLAYER")
        if line_type.lower() == "byblock":
            line_type = outer_type
        layer = layers.get(name) if layers.has_entry(name) else None
        is_off = layer is not None and layer.is_off() and entity.dxftype() != "INSERT"
        if entity.dxf.get("invisible", 0) or is_off or (layer and layer.is_frozen()):
            continue
        if entity.dxftype() == "INSERT":
            if entity.mcount > 1000:
                raise ShapeError(f"inserts a block {entity.mcount} times; allowed is one outline")
            if line_type.lower() == "bylayer" and layer is not None:
                line_type = layer.dxf.linetype
            for block in entity.multi_insert():
                yield from _seen_entities(block.virtual_entities(), layers, name, line_type)
        else:
            yield _Seen(entity, name, line_type)
