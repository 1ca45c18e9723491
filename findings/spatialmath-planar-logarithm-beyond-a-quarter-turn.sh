#!/bin/sh
# spatialmath-python 1.1.18: logarithms of planar poses turned by more than a quarter turn are off by half a turn.
#
# Errors of planar poses, their covariances and steps of a pose graph are logarithms of SE(2): the twist whose
# exponential is the pose. `trlog2`, and with it `SE2.log` and `Twist2(pose)`, take the angle as atan(sin / cos) in
# place of atan2(sin, cos), so that it is off by half a turn wherever the cosine is negative. `SE2.xyt` of the same
# pose is right, and so is the exponential, which does not lead back: nothing warns.
# Seen: a pose at 120 degrees has the logarithm of one at -60 degrees, one at 170 degrees that of one at -10; up to 90
# degrees the exponential of the logarithm is the pose. gtsam 4.3.0 is right for all of them.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "spatialmath-python==1.1.18" "gtsam==4.3.0" "numpy==2.4.6" "scipy==1.17.1" "matplotlib==3.11.2"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
import math

import gtsam
import numpy as np
from spatialmath import SE2, Twist2


def error(angle):
    """Return the turn of the logarithm, and how far its exponential, and that of gtsam's, is from the pose [deg]."""
    x, y, theta = 0.3, -0.2, math.radians(angle)
    pose = SE2(x, y, theta)
    assert np.allclose(pose.xyt(), [x, y, theta])
    twist = pose.log(twist=True)
    assert np.allclose(twist, Twist2(pose).S)
    back = SE2.Exp(twist)
    peer = gtsam.Pose2.Expmap(gtsam.Pose2.Logmap(gtsam.Pose2(x, y, theta)))
    off = math.degrees(abs((pose.inv() * back).theta()))
    return math.degrees(twist[2]), off, math.degrees(abs(peer.theta() - theta)) % 360.0


print("spatialmath-python", importlib.metadata.version("spatialmath-python"))
found = {angle: error(angle) for angle in (30, 89, 91, 120, 170, -120)}
for angle, (turn, off, peer) in found.items():
    print("pose at %4d degrees: logarithm turns by %7.2f, its exponential is %6.2f degrees off" % (angle, turn, off))
assert max(peer for _, _, peer in found.values()) < 1e-6, "the reference has changed"
assert found[30][1] < 1e-6 and found[89][1] < 1e-6, "behaviour has changed: small turns"
for angle in (91, 120, 170, -120):
    assert abs(found[angle][1] - 180.0) < 1e-6, "behaviour has changed: logarithms of large turns"
PYTHON
