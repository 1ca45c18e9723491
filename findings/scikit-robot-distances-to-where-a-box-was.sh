#!/bin/sh
# scikit-robot 0.4.7 with trimesh 5.2.0: distances to a box that was moved or scaled are those to the box before that.
#
# A distance field tells how far a fingertip is from an object. Of a box, cylinder or sphere by `trimesh.creation`,
# `trimesh2sdf` takes the size that trimesh noted in the mesh's metadata as it was made. These notes stay as the mesh
# is moved, turned, or scaled from millimetres to metres, so that its corners are in one place and its distances are to
# another, and nothing warns. `trimesh.proximity.signed_distance` of the same mesh takes its corners and is right.
# Seen: a tip on the face of a box that was moved by 50 mm is said to be 50 mm off it, and one 10 mm beside a box that
# was drawn in millimetres and scaled to metres to be 20 m inside.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "scikit-robot==0.4.7" "trimesh==5.2.0" "rtree==1.4.1" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import numpy as np
import trimesh
from skrobot.sdf import trimesh2sdf


def distances(mesh, tip):
    """Return the distance of a tip from a mesh, positive outside, by scikit-robot and by trimesh [mm]."""
    by_corners = -trimesh.proximity.signed_distance(mesh, [tip])[0]
    return 1e3 * trimesh2sdf(mesh)(np.array([tip]))[0], 1e3 * by_corners


still = trimesh.creation.box([0.09, 0.06, 0.04])
moved = still.copy()
moved.apply_translation([0.05, 0.0, 0.0])
scaled = trimesh.creation.box([90.0, 60.0, 40.0])
scaled.apply_scale(1e-3)
assert np.allclose(moved.bounds, [[0.005, -0.03, -0.02], [0.095, 0.03, 0.02]])
assert np.allclose(scaled.bounds, still.bounds)
print("scikit-robot", importlib.metadata.version("scikit-robot"), "trimesh", trimesh.__version__)
found = {
    "as it was made": distances(still, [0.055, 0.0, 0.0]),
    "moved by 50 mm": distances(moved, [0.095, 0.0, 0.0]),
    "scaled to metres": distances(scaled, [0.055, 0.0, 0.0]),
}
for name, (told, true) in found.items():
    print("box %s: the tip is %.1f mm off it by scikit-robot, %.1f mm by its corners" % (name, told, true))
assert np.allclose(found["as it was made"], 10.0, atol=1e-6), "the reference has changed: as it was made"
assert abs(found["moved by 50 mm"][1]) < 1e-6 and abs(found["scaled to metres"][1] - 10.0) < 1e-6, "the reference"
assert abs(found["moved by 50 mm"][0] - 50.0) < 1e-6, "behaviour has changed: a box that was moved"
assert found["scaled to metres"][0] < -1000.0, "behaviour has changed: a box that was scaled"
PYTHON
