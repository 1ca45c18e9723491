"""Outlines drawn as DXF, by the library ezdxf."""

from pathlib import Path

import numpy as np

from palpate.checks import FARTHEST, is_near
from palpate.errors import FileError, ShapeError
from palpate.geometry.shapes import Polygon
from palpate.io.outlines.lines import FINE, check_drawing, need, outline_of_lines
from palpate.printable import one_line

UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 13: 1e-6, 14: 0.1}
"""[m] that each number of $INSUNITS means: inches, feet, millimetres, centimetres, metres, micrometres, decimetres."""


def read_dxf(path: Path, scale: float | None) -> Polygon:
    """The outline in the model space of a DXF, where the drawing has it.

    `scale` [m] is what one unit means, by default as the drawing's header says.
    """
    need("ezdxf")
    from ezdxf.filemanagement import readfile
    from ezdxf.path import make_path

    check_drawing(path)
    try:
        drawing = readfile(path)
    except Exception as error:  # damaged bytes can make anything of what the library reads
        raise FileError(f"{path}: is no DXF that can be read ({one_line(error)})") from error
    metres = scale or UNITS.get(drawing.units)
    if metres is None:
        raise ShapeError(
            "the drawing does not say its unit ($INSUNITS): give that of its numbers, as unit='mm' (--shape-unit mm)"
        )
    lines = []
    for entity in drawing.modelspace():
        try:
            drawn = make_path(entity)
            corners = np.array([(each.x, each.y) for each in drawn.control_vertices()])
        except TypeError:  # a text, a dimension and the like
            continue
        except Exception as error:  # as above
            raise FileError(f"{path}: is no DXF that can be read ({one_line(error)})") from error
        if not is_near(corners * metres).all():
            raise ShapeError(f"has a line to a place farther than {FARTHEST:g} m")
        points = np.array([(point.x, point.y) for point in drawn.flattening(0.5 * FINE / metres)]) * metres
        lines.append(np.vstack([points, points[:1]]) if drawn.is_closed else points)
    return outline_of_lines(str(path), lines)
