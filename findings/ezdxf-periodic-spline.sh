#!/bin/sh
# ezdxf 1.4.5: a closed spline whose knots are evenly spaced is drawn beyond its ends.
#
# Some CAD programs write a rounded outline as a periodic spline: its first control points stand again at the end, and
# the curve is defined between the knots of its degree and those counted from the end. Drawn there it closes. The
# library's points begin at the first control point, run over the whole span of knots, and do not come back.
# Seen: of a circle of 10 mm by 12 control points the points are 94 mm long and end 19 mm from where they began; the
# curve between its own knots is 60 mm long and closes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "ezdxf==1.4.5" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PYTHON'
import io
import math

import ezdxf
import numpy as np

angles = 2.0 * math.pi * np.arange(12) / 12
points = [(10.0 * math.cos(angle), 10.0 * math.sin(angle)) for angle in angles]
document = ezdxf.new("R2010")
spline = document.modelspace().add_spline(dxfattribs={"flags": 1 | 2 | 8, "degree": 3})
spline.control_points = points + points[:3]
spline.knots = range(len(points) + 7)
text = io.StringIO()
document.write(text)
text.seek(0)
read = ezdxf.read(text).modelspace()[0]


def length_and_gap(points):
    line = np.array([tuple(point)[:2] for point in points])
    return np.hypot(*np.diff(line, axis=0).T).sum(), np.hypot(*(line[-1] - line[0]))


drawn = length_and_gap(read.flattening(0.01))
curve = read.construction_tool()
own_knots = curve.knots()[3:-3]
inside = length_and_gap(curve.points(np.linspace(own_knots[0], own_knots[-1], 500)))
print("ezdxf", ezdxf.__version__)
print("flattening: %.1f mm long, %.1f mm from end to start" % drawn)
print("between its own knots: %.1f mm long, %.1f mm from end to start" % inside)
assert read.closed
assert drawn[0] > 90.0 and drawn[1] > 15.0, "behaviour has changed: flattening stays inside the knots"
assert 55.0 < inside[0] < 65.0 and inside[1] < 1e-6, "behaviour has changed: the curve does not close"
PYTHON
