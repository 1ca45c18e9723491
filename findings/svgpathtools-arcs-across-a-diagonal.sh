#!/bin/sh
# svgpathtools 1.8.0: arcs of a path bulge to the wrong side once it is mirrored across a diagonal.
#
# Programs that turn a part by a quarter and turn it over write such a matrix, which exchanges x and y.
# `Document.paths()` returns paths, and by its documentation "any transform attributes are applied before". By SVG 2 an
# arc under a transform is the image of all its points. The library reverses the direction of an arc where the product
# of the first and the fourth number of the matrix is negative, in place of the determinant: here both are 0, and each
# round end goes inwards. Mirrors along x or y alone are right since mathandy/svgpathtools#200; svgelements is right.
# Seen: a plate 60 mm long and 40 mm wide with a half disc at one end has 1772 mm2 in place of 3028.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "svgpathtools==1.8.0" "svgelements==1.9.6" "numpy==2.4.6" "scipy==1.17.1" "svgwrite==1.4.3"
cd "$folder"
venv/bin/python - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import numpy as np
import svgelements
from svgpathtools import Document

PLATE = "M0,0 H60 A20,20 0 0 1 60,40 H0 Z"
RIGHT = 60.0 * 40.0 + np.pi * 20.0**2 / 2.0  # mm2
SHARES = np.linspace(0.0, 1.0, 400)


def area(x, y):
    return abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0


def areas(transform):
    """Return the area [mm2] of the plate under a transform by svgpathtools, and by svgelements."""
    Path("a.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg"><path d="{PLATE}" transform="{transform}"/></svg>'
    )
    (path,) = Document("a.svg").paths()
    points = np.array([segment.point(share) for segment in path for share in SHARES])
    (peer,) = [each for each in svgelements.SVG.parse("a.svg").elements() if isinstance(each, svgelements.Path)]
    segments = [each for each in peer if not isinstance(each, svgelements.Move)]
    places = np.array([tuple(segment.point(share)) for segment in segments for share in SHARES])
    return area(points.real, points.imag), area(*places.T)


print("svgpathtools", importlib.metadata.version("svgpathtools"))
found = {}
for transform in ("scale(1)", "scale(-1 1)", "matrix(0 1 1 0 0 0)"):
    found[transform], peer = areas(transform)
    print(f"{transform}: {found[transform]:.0f} mm2, svgelements {peer:.0f}, right {RIGHT:.0f}")
    assert abs(peer / RIGHT - 1.0) < 1e-3, "the reference has changed"
assert abs(found["scale(-1 1)"] / RIGHT - 1.0) < 1e-3, "behaviour has changed: a mirror along x"
assert found["matrix(0 1 1 0 0 0)"] < 0.7 * RIGHT, "behaviour has changed: a mirror across a diagonal is right"
PYTHON
