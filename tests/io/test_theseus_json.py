"""Theseus pushes, from files made by hand."""

import json

import numpy as np
import planar as se2
import pytest
from recording_samples import load

from palpate import POINT, Disc, FileError
from palpate import io as formats

FIELDS = ("contact_episode", "contact_flag", "ee_poses_2d", "obj_poses_2d")


def theseus(nested, width):
    """Two episodes of 3 frames, cut out of longer runs: each has a world of its own."""
    truth = [[[0.0, 0.1, 0.0], [0.0, 0.2, 0.0], [0.0, 0.3, 0.0]], [[5.0, 0, 0], [5.1, 0, 0], [5.2, 0, 0]]]
    hand = [[[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.2, 0.0]], [[4.9, 0, 1], [5.0, 0, 1], [5.1, 0, 1]]]
    flag = [[1, 1, 1], [1, 1, 0]]
    episode = [[3, 3, 3], [7, 7, 7]]
    if width:
        flag, episode = ([[[x] for x in part] for part in field] for field in (flag, episode))
    fields = {"contact_episode": episode, "contact_flag": flag, "ee_poses_2d": hand, "obj_poses_2d": truth}
    if not nested:
        fields = {key: value[0] + value[1] for key, value in fields.items()}
    return fields | {"params": {"obj_radius": 0.1}, "img_feats": []}


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("width", [0, 1])
def test_theseus_is_read(tmp_path, nested, width):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(theseus(nested, width)))
    assert formats.detect_format(path) == "theseus-json"
    found = load(path)
    assert found.shape == Disc(0.1)
    assert found.sensor == POINT
    # The second episode is moved by (-5, 0.3), from where its object begins to where the last one ended.
    np.testing.assert_allclose(found.object_pose[3:], [[0, 0.3, 0], [0.1, 0.3, 0], [0.2, 0.3, 0]], atol=1e-12)
    np.testing.assert_allclose(found.sensor_pose[0], [0, 0, np.pi / 2])
    np.testing.assert_allclose(found.sensor_pose[4], [0.0, 0.3, 1 + np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(np.diff(found.time), [1 / 30, 1 / 30, 1, 1 / 30, 1 / 30])
    assert found.contact.tolist() == [True] * 5 + [False]
    assert found.episode.tolist() == [0, 0, 0, 1, 1, -1]
    # Our x axis points along the push, from the contact point to the disc.
    np.testing.assert_allclose(se2.gaps(found)[0], 0, atol=1e-12)


def test_theseus_episodes_may_be_empty(tmp_path):
    path = tmp_path / "a.json"
    data = theseus(nested=True, width=0)
    path.write_text(json.dumps(data))
    whole = load(path)
    for key in FIELDS:
        data[key] = [data[key][0], [], data[key][1], [], []]
    path.write_text(json.dumps(data))
    found = load(path)
    np.testing.assert_array_equal(found.object_pose, whole.object_pose)
    np.testing.assert_array_equal(found.time, whole.time)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda d: d.pop("contact_flag"), "lacks contact_flag"),
        (lambda d: d.update(params={"block_size_x": 1}), "block_size_x and block_size_y; found block_size_x"),
        (lambda d: d.pop("params"), "params has no shape: expected obj_radius.*found nothing"),
        (lambda d: d.update(params={"obj_radius": "big"}), "params.obj_radius: found text, expected numbers"),
        (lambda d: d.update({key: [] for key in FIELDS}), "lengths differ: found numbers of obj_poses_2d 0"),
        (lambda d: d.update(ee_poses_2d=[[0, 0, 0]]), "found numbers of obj_poses_2d 18, ee_poses_2d 3, contact_"),
        (lambda d: d.update(ee_poses_2d=[[0, 0]] * 6), "ee_poses_2d 12, .*; expected three a frame of poses"),
        (lambda d: d.update(ee_poses_2d={"a": 1}), "ee_poses_2d: found "),
        (lambda d: d["obj_poses_2d"].__setitem__(2, [0, 0, float("nan")]), "obj_poses_2d: frame 2 is"),
    ],
)
def test_theseus_bad_content(tmp_path, edit, message):
    path = tmp_path / "a.json"
    data = theseus(False, 0)
    edit(data)
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match=message):
        load(path)
