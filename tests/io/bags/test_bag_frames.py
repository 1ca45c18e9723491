"""Poses along chains of frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import FileError
from palpate.io.bags.frames import chain, compose_chain, single_chain
from palpate.types.motion import always, poses_in_time


def matrices(placed):
    found = np.tile(np.eye(4), (len(placed.position), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(placed.rotation).as_matrix()
    found[:, :3, 3] = placed.position
    return found


PARENTS = {"base": "world", "wrist": "base", "tool": "wrist", "digit": "tool", "camera": "base", "tag": "lost"}


@pytest.mark.parametrize(("parent", "child"), [("world", "digit"), ("camera", "digit"), ("digit", "base")])
def test_chains_compose_as_matrices_do(parent, child):
    rng = np.random.default_rng(5)
    placed = {}
    for name in PARENTS:
        quaternion = Rotation.from_rotvec(rng.normal(size=3)).as_quat()
        numbers = np.array([[*rng.normal(size=3), *quaternion]])
        placed[name] = always(poses_in_time(name, "world", np.zeros(1, np.int64), numbers), 2)

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
