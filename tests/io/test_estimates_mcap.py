"""Estimates as MCAP: other programs read their messages."""

from typing import Any

import numpy as np
import pytest
from bag_samples import decoded_by_another
from planar import compose
from recording_samples import trajectory
from scipy.spatial.transform import Rotation

from palpate.io.estimates import write_estimates_mcap
from palpate.types.estimate import Answer
from palpate.types.space import flat, out_of_plane, plane_across, spatial_covariance


def stamp(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def same_pose(message: Any, position: Any, rotation: Any) -> None:
    point, turn = message.position, message.orientation
    assert [point.x, point.y, point.z] == pytest.approx(position.tolist())
    assert abs(np.dot([turn.x, turn.y, turn.z, turn.w], rotation)) == pytest.approx(1.0)


def test_others_read_our_estimates(tmp_path):
    made = trajectory(status=("tracking", "ambiguous", "indeterminate", *["resting"] * 47))
    plane = plane_across("table", np.array([0.1, -0.2, 1.0]), np.array([[0.0, 0.0, 0.3]]))
    write_estimates_mcap(made, tmp_path / "a.mcap", plane, ((),) * len(made))
    position, rotation = out_of_plane(plane, made.pose)
    found = decoded_by_another(tmp_path / "a.mcap")
    poses = found["/palpate/object_pose"]
    both = found["/palpate/object_pose_with_covariance"]
    diagnostics = found["/palpate/diagnostics"]
    wanted = spatial_covariance(plane, made.pose, made.covariance)
    for index in range(len(made)):
        (_, message), (_, with_covariance) = poses[index], both[index]
        assert message.header.frame_id == with_covariance.header.frame_id == "table"
        same_pose(message.pose, position[index], rotation[index])
        same_pose(with_covariance.pose.pose, position[index], rotation[index])
        assert np.array_equal(np.reshape(with_covariance.pose.covariance, (6, 6)), wanted[index])
    levels = [message.status[0].level for _, message in diagnostics]
    as_numbers = [int.from_bytes(level, "little") if isinstance(level, bytes) else level for level in levels[:4]]
    assert as_numbers == [0, 1, 2, 0]
    assert diagnostics[1][1].status[0].message == "ambiguous"
    values = {value.key: value.value for value in diagnostics[0][1].status[0].values}
    assert values["contact"] == str(bool(made.contact[0])).lower()
    assert values["sigma yaw [deg]"] == f"{np.degrees(np.sqrt(made.covariance[0, 2, 2])):.2f}"


def test_others_read_all_answers(tmp_path):
    """In a slanting plane: three at the second time; at the others the estimate is the only one."""
    made = trajectory(3, status=("tracking", "ambiguous", "resting"))
    rng = np.random.default_rng(2)
    poses, roots = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3)) / 100.0
    others = [Answer(pose, root @ root.T, weight) for pose, root, weight in zip(poses, roots, (0.3, 0.1), strict=True)]
    several = (Answer(made.pose[1], made.covariance[1], 0.6), *others)
    plane = plane_across("table", np.array([0.1, -0.2, 1.0]), np.array([[0.0, 0.0, 0.3]]))
    write_estimates_mcap(made, tmp_path / "a.mcap", plane=plane, answers=((), several, ()))
    wanted = [made.pose[:1], np.array([one.pose for one in several]), made.pose[2:]]
    found = decoded_by_another(tmp_path / "a.mcap")
    for index, ((_, array), (_, diagnosis)) in enumerate(
        zip(found["/palpate/object_pose_answers"], found["/palpate/diagnostics"], strict=True)
    ):
        assert stamp(array) == stamp(diagnosis) == pytest.approx(made.time[index], abs=1e-9)
        assert array.header.frame_id == "table"
        position, rotation = out_of_plane(plane, wanted[index])
        for n, pose in enumerate(array.poses):
            same_pose(pose, position[n], rotation[n])
        values = {value.key: value.value for value in diagnosis.status[0].values}
        weights = [float(word) for word in values["answer weights"].split()]
        assert weights == ([0.6, 0.3, 0.1] if index == 1 else [1.0])
        assert len(array.poses) == len(weights)
        sigmas = [float(word) for word in values["answer sigmas x [mm]"].split()]
        stated = [one.covariance for one in several] if index == 1 else made.covariance[index : index + 1]
        assert sigmas == pytest.approx([1e3 * np.sqrt(one[0, 0]) for one in stated], abs=5e-3)


def test_covariance_is_turned_to_the_axes_of_the_header():
    """Against the poses themselves, each moved a little along each axis of the object."""
    made = trajectory(6)
    for plane in (flat(), plane_across("map", np.array([1.0, 0.4, -0.5]), np.zeros((1, 3)))):
        position, rotation = out_of_plane(plane, made.pose)
        step = 1e-6
        derivative = np.empty((6, 6, 3))
        for axis in range(3):
            moved, turned = out_of_plane(plane, compose(made.pose, step * np.eye(3)[axis]))
            derivative[:, :3, axis] = (moved - position) / step
            turn = Rotation.from_quat(turned) * Rotation.from_quat(rotation).inv()
            derivative[:, 3:, axis] = turn.as_rotvec() / step
        wanted = derivative @ made.covariance @ derivative.transpose(0, 2, 1)
        assert spatial_covariance(plane, made.pose, made.covariance) == pytest.approx(wanted, abs=1e-4)
    level = spatial_covariance(flat(), np.array([[0.0, 0.0, np.pi / 2]]), np.diag([1.0, 4.0, 9.0])[None])
    assert level[0] == pytest.approx(np.diag([4.0, 1.0, 0.0, 0.0, 0.0, 9.0]))
