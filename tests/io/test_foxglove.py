"""Recordings of the Foxglove SDK are read like bags."""

import numpy as np
import pytest
from bag_samples import image_times, touch_images, true_pose
from foxglove_samples import write_foxglove
from planar import compose, wrap

from palpate import BagChoices, Disc, read_bag


def same_push(recording, wanted):
    assert recording.time.tolist() == (image_times() / 1e9).tolist()
    assert np.abs(recording.sensor_pose[:, :2] - wanted[:, :2]).max() < 1e-9
    assert np.abs(wrap(recording.sensor_pose[:, 2] - wanted[:, 2])).max() < 1e-9
    for frame, pixels in zip(recording, touch_images(), strict=True):
        assert (frame.image == pixels).all()


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_images_and_poses_of_foxglove(tmp_path, encoding, raw):
    path = write_foxglove(tmp_path / "push.mcap", encoding, raw=raw)
    same_push(read_bag(path, Disc(0.05)).recording, true_pose(image_times()))


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_transforms_of_foxglove_and_one_that_is_sent_once(tmp_path, encoding):
    path = write_foxglove(tmp_path / "push.mcap", encoding, poses="transforms")
    mount = np.array([0.01, 0.0, 0.0])
    recording = read_bag(path, Disc(0.05), BagChoices(sensor_poses="world:digit")).recording
    same_push(recording, compose(true_pose(image_times()), mount))


def test_messages_without_timestamps_have_their_times_of_recording(tmp_path):
    path = write_foxglove(tmp_path / "push.mcap", stamped=False)
    same_push(read_bag(path, Disc(0.05)).recording, true_pose(image_times()))


def test_info_proposes_the_command_that_reads_it(tmp_path, run_palpate):
    path = write_foxglove(tmp_path / "push.mcap")
    code, out, _ = run_palpate("info", path)
    assert code == 0
    assert f"palpate track {path} --shape" in out
    code, out, _ = run_palpate("convert", path, tmp_path / "out.mcap", "--shape", "0.09x0.06")
    assert code == 0
    assert (tmp_path / "out.mcap").exists()


def test_other_topics_are_named(tmp_path, fails):
    path = write_foxglove(tmp_path / "push.mcap", "json")
    words = fails("track", path, "--shape", "disc", "--images", "/other")
    assert "/digit/image" in words
