#!/bin/sh
# kinpy 0.6.1: a joint of a URDF without an axis turns or slides along z, where it should along x.
#
# By the specification of URDF the element <axis> of a joint may be missing and is then "1 0 0", the x axis of the
# joint's frame. The forward kinematics of kinpy take z, so that the pose of a flange, and of a sensor on it, is
# another one. The same file with <axis xyz="1 0 0"/> written out is read right, and nothing warns.
# Seen: a flange 0.2 m from a hinge at 0.4 rad is off by 32 degrees and 110 mm, one on a slide at 0.1 m by 141 mm. pin
# 4.1.0 (Pinocchio) and pytransform3d 3.17.0 agree with the file that names the axis.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "kinpy==0.6.1" "pin==4.1.0" "pytransform3d==3.17.0" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import kinpy
import numpy as np
import pinocchio
from pytransform3d.urdf import UrdfTransformManager
from scipy.spatial.transform import Rotation


def robot(kind, axis):
    """Return a URDF of a base, a joint of a kind, and a flange 0.2 m beyond it along y."""
    return f"""<robot name="arm"><link name="base"/><link name="arm"/><link name="flange"/>
<joint name="joint" type="{kind}"><parent link="base"/><child link="arm"/>
<origin xyz="0.1 0 0.3" rpy="0 0 0.5"/>{axis}<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="flange"/><origin xyz="0 0.2 0"/></joint></robot>"""


def by_kinpy(text, value):
    return kinpy.build_serial_chain_from_urdf(text, "flange").forward_kinematics([value]).matrix()


def by_pinocchio(text, value):
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array([value]))
    return data.oMf[model.getFrameId("flange")].homogeneous


def by_pytransform3d(text, value):
    manager = UrdfTransformManager()
    manager.load_urdf(text)
    manager.set_joint("joint", value)
    return manager.get_transform("flange", "base")


def distance(pose, other):
    """Return how far two poses are apart [deg, mm]."""
    turn = Rotation.from_matrix(pose[:3, :3].T @ other[:3, :3]).magnitude()
    return np.degrees(turn), 1e3 * np.linalg.norm(pose[:3, 3] - other[:3, 3])


for name in ("kinpy", "pin", "pytransform3d"):
    print(name, importlib.metadata.version(name))
for kind, value in (("revolute", 0.4), ("prismatic", 0.1)):
    named = robot(kind, '<axis xyz="1 0 0"/>')
    meant = by_pinocchio(named, value)
    off = distance(meant, by_kinpy(robot(kind, ""), value))
    print("%s joint at %g: kinpy is %.1f degrees and %.0f mm off" % (kind, value, *off))
    others = [by_kinpy(named, value), by_pinocchio(robot(kind, ""), value), by_pytransform3d(robot(kind, ""), value)]
    assert all(np.allclose(other, meant, atol=1e-9) for other in others), "the reference has changed"
    assert off[1] > 50.0, "behaviour has changed: a joint without an axis moves along x"
PYTHON
