"""Poses in space: between messages, along chains of frames, and in a plane."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import FileError
from palpate.formats.bags.frames import chain, compose_chain, single_chain
from palpate.formats.bags.messages import Pose
from palpate.formats.bags.motion import always, at_times, poses_in_time
from palpate.formats.bags.plane import into_plane, out_of_plane, plane_across, plane_through
from palpate.geometry import se2


def pose(numbers, frame="world", stamp=0):
    return Pose(frame, "", stamp, tuple(numbers))


def turned(yaw, x=0.0):
    return pose([x, 0.0, 0.0, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])


def matrices(placed):
    found = np.tile(np.eye(4), (len(placed.position), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(placed.rotation).as_matrix()
    found[:, :3, 3] = placed.position
    return found


def yaws(placed):
    return Rotation.from_quat(placed.rotation).as_euler("zyx")[:, 0]


def test_yaw_turns_through_pi_the_short_way():
    poses = poses_in_time("/a", [turned(3.0, 1.0), turned(-3.0, 2.0)], [0, 100_000_000])
    placed = at_times(poses, np.array([0, 25_000_000, 50_000_000, 100_000_000]))
    turn = 2 * np.pi - 6.0
    assert placed.known.all()
    assert placed.position[:, 0] == pytest.approx([1.0, 1.25, 1.5, 2.0])
    assert se2.wrap(yaws(placed) - 3.0 - turn * np.array([0, 0.25, 0.5, 1])) == pytest.approx(0.0, abs=1e-12)


def test_a_quaternion_and_its_negative_are_one_rotation():
    poses = poses_in_time("/a", [turned(0.2), pose(-np.array(turned(0.4).numbers))], [0, 10])
    assert yaws(at_times(poses, np.array([5]))) == pytest.approx([0.3])


def test_poses_are_sorted_and_the_last_of_one_time_counts():
    poses = poses_in_time("/a", [turned(0.0, x) for x in (2.0, 0.0, 1.0, 5.0)], [20, 0, 10, 10])
    assert poses.time.tolist() == [0, 10, 20]
    assert poses.position[:, 0].tolist() == [0.0, 5.0, 2.0]


def test_before_after_and_in_long_gaps_nothing_is_known():
    second = 1_000_000_000
    times = [0, second, 2 * second, 2 * second + 10]
    poses = poses_in_time("/a", [turned(0.0, x) for x in (0.0, 0.0, 1.0, 1.1)], times)
    asked = np.array([-1, 0, second // 2, second, second + 5, 2 * second, 2 * second + 10, 2 * second + 11])
    # Nothing moved in the first second, so that gap hides nothing.
    assert at_times(poses, asked).known.tolist() == [False, True, True, True, False, True, True, False]
    alone = poses_in_time("/a", [turned(0.0)], [5])
    assert at_times(alone, np.array([4, 5, 6])).known.tolist() == [False, True, False]
    assert always(alone, 2).known.all()


@pytest.mark.parametrize(
    ("numbers", "word"),
    [([0, 0, np.nan, 0, 0, 0, 1], "nan"), ([0, 0, 0, 0, 0, 0, 0], "length 1"), ([0, 0, 0, 0, 0, 1, 1], "length 1")],
)
def test_poses_that_are_none(numbers, word):
    with pytest.raises(FileError, match=rf"/a: pose 1 at 2\.0+ s .*{word}"):
        poses_in_time("/a", [turned(0.0), pose(numbers)], [0, 2_000_000_000])
    with pytest.raises(FileError, match="/a: poses are given in several frames, 'world' and 'map'"):
        poses_in_time("/a", [turned(0.0), pose([0, 0, 0, 0, 0, 0, 1], "map")], [0, 1])


PARENTS = {"base": "world", "wrist": "base", "tool": "wrist", "digit": "tool", "camera": "base", "tag": "lost"}


@pytest.mark.parametrize(("parent", "child"), [("world", "digit"), ("camera", "digit"), ("digit", "base")])
def test_chains_compose_as_matrices_do(parent, child):
    rng = np.random.default_rng(5)
    placed = {}
    for name in PARENTS:
        quaternion = Rotation.from_rotvec(rng.normal(size=3)).as_quat()
        placed[name] = always(poses_in_time(name, [pose([*rng.normal(size=3), *quaternion])], [0]), 2)

    def world_T(name):
        return world_T(PARENTS[name]) @ matrices(placed[name]) if name != "world" else np.eye(4)

    found = compose_chain(*chain(PARENTS, parent, child), lambda name: placed[name])
    assert matrices(found) == pytest.approx(np.linalg.inv(world_T(parent)) @ world_T(child), abs=1e-12)


def test_a_hole_in_a_chain_is_said():
    with pytest.raises(FileError, match=r"'world' to 'tag': world ends at 'world', tag < lost at 'lost'"):
        chain(PARENTS, "world", "tag")
    with pytest.raises(FileError, match="no transform knows frame 'gel'; known are base, camera, digit, lost"):
        chain(PARENTS, "world", "gel")
    with pytest.raises(FileError, match="run in a circle: a < b < a"):
        chain({"a": "b", "b": "a"}, "a", "b")
    assert single_chain({"b": "a", "c": "b"}) == ("a", "c")
    assert single_chain(PARENTS) is None


def test_a_level_plane_keeps_x_and_y():
    rng = np.random.default_rng(1)
    poses = rng.normal(size=(20, 3))
    position = np.column_stack([poses[:, :2], np.full(20, 0.3)])
    plane = plane_across("world", np.array([0.0, 0.0, 2.0]), position)
    assert plane.tilt == 0.0
    found, height, angle = into_plane(plane, position, Rotation.from_euler("z", poses[:, 2:]).as_quat())
    assert found[:, :2] == pytest.approx(poses[:, :2], abs=1e-12)
    assert se2.wrap(found[:, 2] - poses[:, 2]) == pytest.approx(0.0, abs=1e-12)
    assert (height, angle) == (pytest.approx(0.3), pytest.approx(0.0, abs=1e-12))


def test_a_tilted_plane_is_fitted_and_yaw_is_about_its_normal():
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(-0.2, 0.2, (50, 2)), rng.uniform(-3, 3, 50)])
    tilt = Rotation.from_euler("y", 0.2)
    plane = plane_across("world", tilt.apply([0.0, 0.0, 1.0]), np.zeros((1, 3)))
    # The plane's x axis is the frame's, laid down into it.
    assert plane.axes == pytest.approx(tilt.as_matrix(), abs=1e-12)
    position, rotation = out_of_plane(plane, poses)
    assert position == pytest.approx(tilt.apply(np.column_stack([poses[:, :2], np.zeros(50)])), abs=1e-12)
    fitted = plane_through("world", position + tilt.apply([0.0, 0.0, 0.05]))
    assert fitted.axes == pytest.approx(plane.axes, abs=1e-9)
    assert (fitted.height, fitted.tilt) == (pytest.approx(0.05), pytest.approx(0.2))
    found, height, angle = into_plane(fitted, position, rotation)
    assert found[:, :2] == pytest.approx(poses[:, :2], abs=1e-9)
    assert se2.wrap(found[:, 2] - poses[:, 2]) == pytest.approx(0.0, abs=1e-9)
    assert (height, angle) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-9))


def test_a_line_and_a_normal_of_zero_tell_no_plane():
    line = np.linspace(0, 1, 20)[:, None] * np.array([1.0, 2.0, 0.5])
    with pytest.raises(FileError, match=r"moves along a line, 0\.0 mm across, .*--plane X Y Z"):
        plane_through("world", line)
    with pytest.raises(FileError, match="not all 0"):
        plane_across("world", np.zeros(3), line)
