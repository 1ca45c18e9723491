"""Estimates as MCAP: other programs read their messages."""

from typing import Any

import numpy as np
import pytest
from bag_samples import decoded_by_another
from planar import compose
from recording_samples import trajectory
from scipy.spatial.transform import Rotation

from palpate.io.estimates import write_estimates_mcap
from palpate.types.space import flat, out_of_plane, plane_across, spatial_covariance


def same_pose(message: Any, position: Any, rotation: Any) -> None:
    point, turn = message.position, message.orientation
    assert [point.x, point.y, point.z] == pytest.approx(position.tolist())
    assert abs(np.dot([turn.x, turn.y, turn.z, turn.w], rotation)) == pytest.approx(1.0)


def test_others_read_our_estimates(tmp_path):
    made = trajectory(status=("tracking", "ambiguous", "indeterminate", *["resting"] * 47))
    plane = plane_across("table", np.array([0.1, -0.2, 1.0]), np.array([[0.0, 0.0, 0.3]]))
    write_estimates_mcap(made, tmp_path / "a.mcap", plane)
    found = decoded_by_another(tmp_path / "a.mcap")
    poses = found["/palpate/object_pose"]
    both = found["/palpate/object_pose_with_covariance"]
    diagnostics = found["/palpate/diagnostics"]
    for index in range(len(made)):
        (_, message), (_, with_covariance) = poses[index], both[index]
        assert message.header.frame_id == with_covariance.header.frame_id == "table"
        same_pose(message.pose, *out_of_plane(plane, made.pose[index]))
        same_pose(with_covariance.pose.pose, *out_of_plane(plane, made.pose[index]))
        wanted = spatial_covariance(plane, made.pose[index], made.covariance[index])
        assert np.array_equal(np.reshape(with_covariance.pose.covariance, (6, 6)), wanted)
    levels = [message.status[0].level for _, message in diagnostics]
    as_numbers = [int.from_bytes(level, "little") if isinstance(level, bytes) else level for level in levels[:4]]
    assert as_numbers == [0, 1, 2, 0]
    assert diagnostics[1][1].status[0].message == "ambiguous"
    values = {value.key: value.value for value in diagnostics[0][1].status[0].values}
    assert values["contact"] == str(bool(made.contact[0])).lower()


def test_covariance_is_turned_to_the_axes_of_the_header():
    """Against the poses themselves, each moved a little along each axis of the object."""
    made, step = trajectory(6), 1e-6
    for plane in (flat(), plane_across("map", np.array([1.0, 0.4, -0.5]), np.zeros((1, 3)))):
        for pose, covariance in zip(made.pose, made.covariance, strict=True):
            position, rotation = out_of_plane(plane, pose)
            derivative = np.empty((6, 3))
            for axis in range(3):
                moved, turned = out_of_plane(plane, compose(pose, step * np.eye(3)[axis]))
                derivative[:3, axis] = (moved - position) / step
                turn = Rotation.from_quat(turned) * Rotation.from_quat(rotation).inv()
                derivative[3:, axis] = turn.as_rotvec() / step
            wanted = derivative @ covariance @ derivative.T
            assert spatial_covariance(plane, pose, covariance) == pytest.approx(wanted, abs=1e-4)
    level = spatial_covariance(flat(), np.array([0.0, 0.0, np.pi / 2]), np.diag([1.0, 4.0, 9.0]))
    assert level == pytest.approx(np.diag([4.0, 1.0, 0.0, 0.0, 0.0, 9.0]))
