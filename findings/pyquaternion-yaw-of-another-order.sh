#!/bin/sh
# pyquaternion 0.9.9: `yaw_pitch_roll` is of the other order of axes, so that a hand that looks down yaws the wrong way.
#
# Its documentation calls the angles "intrinsic Tait-Bryan angles following the z-y'-x'' convention", which is yaw about
# the vertical first: R = Rz(yaw) Ry(pitch) Rx(roll), as in ROS. In the same text stands R = Rx Ry Rz, which is what it
# computes: yaw comes last, about an axis that pitch and roll have tilted. Both agree for an upright pose alone.
# Known as KieranWynn/pyquaternion#72, open since 2021.
# Seen: of a flange that looks straight down (roll 180 degrees) and yaws by 30 degrees the yaw is -30; of yaw 30, pitch
# 20, roll 10 it is 28.5, with pitch 22.2 and roll -1.1.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "pyquaternion==0.9.9" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import numpy as np
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation


def angles(turn):
    """Return yaw, pitch and roll [deg] as the library has them."""
    x, y, z, w = turn.as_quat()
    return np.degrees(Quaternion(w, x, y, z).yaw_pitch_roll)


print("pyquaternion", importlib.metadata.version("pyquaternion"))
found = {}
for given in ([30.0, 0.0, 0.0], [30.0, 20.0, 10.0], [30.0, 0.0, 180.0]):  # yaw, pitch, roll
    turn = Rotation.from_euler("ZYX", given, degrees=True)
    assert np.allclose(np.abs(turn.as_euler("ZYX", degrees=True)), np.abs(given)), "the reference has changed"
    found[tuple(given)] = angles(turn)
    print("yaw, pitch, roll", given, "->", angles(turn).round(1))
assert np.allclose(found[30.0, 0.0, 0.0], [30.0, 0.0, 0.0]), "the reference has changed"
assert abs(found[30.0, 0.0, 180.0][0] + 30.0) < 1e-6, "behaviour has changed: the yaw of a hand that looks down"
assert np.allclose(found[30.0, 20.0, 10.0], [28.45, 22.24, -1.12], atol=0.01), "behaviour has changed"
PYTHON
