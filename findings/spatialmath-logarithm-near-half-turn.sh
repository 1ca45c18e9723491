#!/bin/sh
# spatialmath-python 1.1.18: the rotation vector of a hand that looks straight down is off by up to degrees.
#
# A flange that looks down is half a turn about x from the world's axes, and a pose kept as 32-bit floats, as data sets
# and messages keep it, misses that by some 1e-7 rad. The logarithm of the library (`trlog`, `SO3.log`, `SE3.log`)
# divides by the sine of an angle that it takes from the trace, and close to half a turn neither has digits left; its
# own test for half a turn ends earlier, at 3e-8 rad. Nothing warns, and the exponential of the result is another pose.
# Right would be the angle that turns the matrix back into itself: scipy finds it to the last digit.
# Seen: half a turn less 1e-7 rad is off by 1.9 degrees, and as `UnitQuaternion.angvec` by 12 degrees. Of 500 poses that
# look down, rounded to 32 bits, the worst is off by degrees; scipy is right for all of them.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "spatialmath-python==1.1.18" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
import math

import numpy as np
from scipy.spatial.transform import Rotation
from spatialmath import SE3, SO3, UnitQuaternion

near = Rotation.from_rotvec([math.pi - 1e-7, 0.0, 0.0]).as_matrix()
angle = np.linalg.norm(SE3.Rt(near, [0.0, 0.0, 0.0]).log(twist=True))
as_quaternion = UnitQuaternion(SO3(near)).angvec()[0]
peer = Rotation.from_matrix(near).magnitude()

# Half a turn about axes near x, with the noise of a controller, as a data set of 32-bit floats has it.
chance = np.random.default_rng(0)
worst = 0.0
worst_peer = 0.0
for _ in range(500):
    noisy = np.array([1.0, 0.0, 0.0, 0.0]) + 3e-8 * chance.standard_normal(4)
    rotation = Rotation.from_quat(noisy.astype(np.float32).astype(np.float64))
    matrix = rotation.as_matrix()
    there = SO3(matrix).log(twist=True)
    back = Rotation.from_rotvec(there)
    worst = max(worst, math.degrees((rotation.inv() * back).magnitude()))
    back = Rotation.from_rotvec(Rotation.from_matrix(matrix).as_rotvec())
    worst_peer = max(worst_peer, math.degrees((rotation.inv() * back).magnitude()))
print("spatialmath-python", importlib.metadata.version("spatialmath-python"))
print("SE3.log: %.3f degrees off" % math.degrees(abs(angle - math.pi + 1e-7)))
print("UnitQuaternion.angvec: %.3f degrees off" % math.degrees(abs(as_quaternion - math.pi + 1e-7)))
print("scipy: %.1e degrees off" % math.degrees(abs(peer - math.pi + 1e-7)))
print("500 poses that look down: worst %.2f degrees, scipy %.1e degrees" % (worst, worst_peer))
assert abs(peer - math.pi + 1e-7) < 1e-9 and worst_peer < 1e-4, "the reference has changed"
assert math.degrees(abs(angle - math.pi)) > 1.0, "behaviour has changed: SE3.log is right near half a turn"
assert math.degrees(abs(as_quaternion - math.pi)) > 5.0, "behaviour has changed: angvec is right near half a turn"
assert worst > 0.5, "behaviour has changed: poses that look down have the right logarithm"
PYTHON
