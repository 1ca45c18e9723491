#!/bin/sh
# ahrs 0.4.0: of a rotation matrix, roll, pitch and yaw and the logarithm are those of the rotation back.
#
# `DCM.to_rpy` and `to_angles`, "roll-pitch-yaw angles from DCM", read the transposed matrix, as those do who turn axes
# in place of vectors; but `DCM(z=angle)`, `DCM(q=...)` and `Quaternion.to_DCM` make matrices that turn vectors. So the
# yaw of a hand about the vertical has the other sign, and tilted ones other angles too. `Quaternion.to_angles` of the
# same rotation is right. `DCM(rpy=...)` takes its three numbers as yaw, pitch and roll, as a note at the class says,
# `Quaternion(rpy=...)` as roll, pitch and yaw. `DCM.log` is documented as "the inverse of the exponential map", and is
# that of the transposed matrix. (Mayitzin/ahrs#122 shows scipy's beside it; it was closed when the angle was right.)
# Seen: of yaw 30, pitch 20, roll 10 degrees `DCM.to_rpy` makes yaw -28.5, pitch -22.2, roll 1.1, and of yaw 30 alone
# -30; a DCM made of three angles returns three others; the exponential of the logarithm is the transposed matrix.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "ahrs==0.4.0" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import numpy as np
from ahrs import DCM, Quaternion
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

RIGHT = np.array([10.0, 20.0, 30.0])  # [deg] roll, pitch, yaw
turn = Rotation.from_euler("ZYX", RIGHT[::-1], degrees=True)
x, y, z, w = turn.as_quat()
matrix = DCM(q=[w, x, y, z])
assert np.allclose(matrix, turn.as_matrix()), "the reference has changed: the matrix is another"

print("ahrs", importlib.metadata.version("ahrs"))
by_quaternion = np.degrees(Quaternion([w, x, y, z]).to_angles())
by_matrix = np.degrees(matrix.to_rpy())
yaw_alone = np.degrees(DCM(z=np.radians(30.0)).to_rpy())[2]
back = np.degrees(DCM(rpy=np.radians(RIGHT)).to_rpy())
print("Quaternion.to_angles", by_quaternion.round(1))
print("DCM.to_rpy          ", by_matrix.round(1), "of yaw 30 alone: yaw", yaw_alone.round(1))
print("DCM(rpy=10, 20, 30).to_rpy()", back.round(1))
again = expm(matrix.log)
off = abs(again - matrix).max()
print(f"exp(log) is off by {off:.2f}, and from the transposed matrix by {abs(again - matrix.T).max():.0e}")
assert np.allclose(by_quaternion, RIGHT), "the reference has changed"
assert np.allclose(yaw_alone, -30.0) and abs(by_matrix[2] + 28.45) < 0.1, "behaviour has changed: DCM.to_rpy"
assert abs(back - RIGHT).max() > 30.0, "behaviour has changed: the angles of DCM(rpy=...) come back"
assert np.allclose(again, matrix.T), "behaviour has changed: DCM.log"
PYTHON
