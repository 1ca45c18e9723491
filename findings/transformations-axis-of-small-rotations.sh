#!/bin/sh
# transformations 2026.1.18: a rotation of less than 0.008 degrees comes out about another axis and by another angle.
#
# Between two frames of a robot that reports at 1 kHz the hand turns by some hundredths of a degree or less, and sums of
# such steps are its angular speed. `rotation_from_matrix` takes for the axis the last eigenvector whose eigenvalue is
# within 1e-8 of one in its real part. Below 1.4e-4 rad all three are, and the last may be any; the angle is then
# divided by a component of it that may be next to nothing. Nothing warns, and `rotation_matrix` of the result is
# another rotation. tf of ROS 1 embeds the module (known there as ros/geometry#168), and `mat2axangle` of transforms3d
# has the same rule, with a tolerance that puts the limit at 1.4e-5 rad. scipy is right.
# (Pinned is the newest version for Python 3.11.)
# Seen: of 300 rotations by 1e-4 rad about axes of all directions, one in ten is off by more than 3 times its own size,
# and the worst by thousands of times.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "transformations==2026.1.18" "transforms3d==0.4.2" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import numpy as np
import transformations
from scipy.spatial.transform import Rotation
from transforms3d.axangles import mat2axangle

chance = np.random.default_rng(1)


def by_transformations(matrix):
    whole = np.eye(4)
    whole[:3, :3] = matrix
    angle, axis, _ = transformations.rotation_from_matrix(whole)
    return angle * axis


def by_transforms3d(matrix):
    axis, angle = mat2axangle(matrix)
    return angle * np.asarray(axis)


def by_scipy(matrix):
    return Rotation.from_matrix(matrix).as_rotvec()


def relative_errors(read, size):
    """Return the errors of rotation vectors of one size, in parts of it, in rising order."""
    errors = []
    for axis in axes:
        turned = size * axis
        matrix = Rotation.from_rotvec(turned).as_matrix()
        errors.append(np.linalg.norm(read(matrix) - turned) / size)
    return np.sort(errors)


axes = chance.standard_normal((300, 3))
axes /= np.linalg.norm(axes, axis=1, keepdims=True)
print(*(f"{name} {importlib.metadata.version(name)}" for name in ("transformations", "transforms3d")))
found = {}
for size in (1e-3, 1e-4, 1e-5):
    for read in (by_transformations, by_transforms3d, by_scipy):
        errors = relative_errors(read, size)
        found[read.__name__, size] = errors
        print(f"{size:.0e} rad {read.__name__}: one in ten off by {errors[270]:.1e} of it, worst {errors[-1]:.1e}")
assert all(found["by_scipy", size][-1] < 1e-6 for size in (1e-3, 1e-4, 1e-5)), "the reference has changed"
assert found["by_transformations", 1e-3][-1] < 1e-6, "behaviour has changed: larger rotations"
assert found["by_transformations", 1e-4][270] > 1.0, "behaviour has changed: small rotations"
assert found["by_transforms3d", 1e-4][-1] < 1e-6, "behaviour has changed: larger rotations of transforms3d"
assert found["by_transforms3d", 1e-5][-1] > 10.0, "behaviour has changed: small rotations of transforms3d"
PYTHON
