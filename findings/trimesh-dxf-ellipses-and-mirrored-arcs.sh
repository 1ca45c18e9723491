#!/bin/sh
# trimesh 5.2.0: of a DXF, ellipses are missing without a word and mirrored arcs stand on the wrong side.
#
# By the DXF reference (Object Coordinate Systems) an arc whose extrusion points down, as programs write one that was
# turned over or drawn from below, has its x axis reversed: a centre of 10 is at x = -10. `load_path` takes the numbers
# for those of the world. An ELLIPSE is left out, which only the log level DEBUG tells: of ellipses alone the path is
# empty.
# Seen: a plate 50 mm long with round ends is at -45..40 instead of -5..45 and not closed; an ellipse leaves nothing.
# ezdxf 1.4.5 reads both as they are meant.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "trimesh==5.2.0" "ezdxf==1.4.5" "numpy==2.4.6" \
    "networkx==3.6.1" "scipy==1.17.1" "shapely==2.2.0"
"$folder/venv/bin/python" - <<'PYTHON'
import io

import ezdxf
import trimesh
from ezdxf import bbox


def read(document):
    """Return the path that trimesh makes of a drawing."""
    text = io.StringIO()
    document.write(text)
    return trimesh.load_path(io.BytesIO(text.getvalue().encode()), file_type="dxf")


def drawing():
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4  # millimetres
    return document, document.modelspace()


plate, space = drawing()
space.add_line((0, -5), (40, -5))
space.add_line((0, 5), (40, 5))
space.add_arc((0, 0), 5, 90, 270)
space.add_arc((-40, 0), 5, 90, 270, dxfattribs={"extrusion": (0, 0, -1)})  # the right end, mirrored
meant = bbox.extents(space)
found = read(plate)
ellipse, space = drawing()
space.add_ellipse((0, 0), (40, 0), 0.5)
left = len(read(ellipse).entities)
print("trimesh", trimesh.__version__, "ezdxf", ezdxf.__version__)
print("plate: x from %.0f to %.0f, closed %s; ezdxf: x from %.0f to %.0f"
      % (*found.bounds[:, 0], found.is_closed, meant.extmin.x, meant.extmax.x))
print(f"ellipse: {left} entities")
assert abs(meant.extmin.x + 5.0) < 0.01 and abs(meant.extmax.x - 45.0) < 0.01, "the reference has changed"
assert not found.is_closed and found.bounds[0, 0] < -40.0, "behaviour has changed: mirrored arcs"
assert left == 0, "behaviour has changed: ellipses"
PYTHON
