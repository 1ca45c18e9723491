"""Bags with the images of several fingers on the command line: info, convert, and what is named in one sentence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_samples import compressed_message, image_times, pose_message, pose_times, touch_images, true_pose, write_bag

import palpate

MOUNTS = ("--mounts", "left=0,20mm,0", "right=0,-20mm,90deg")
TOPICS = ("--images", "left=/left/image,right=/right/image")
CONVERT = ("convert", "push.bag", "hand.mcap", "--shape", "disc")
LATER = 5_000_000  # [ns] of the right camera


@pytest.fixture(autouse=True)
def _bag(folder):
    stamps = image_times()
    pictures = touch_images()
    left = [replace(compressed_message(*each), topic="/left/image") for each in zip(stamps, pictures, strict=True)]
    right = [
        replace(compressed_message(stamp + LATER, picture[::-1]), topic="/right/image")
        for stamp, picture in zip(stamps[::2], pictures[::2], strict=True)
    ]
    times = pose_times()
    poses = [pose_message(stamp, pose) for stamp, pose in zip(times, true_pose(times), strict=True)]
    write_bag(Path("push"), "ros1", sorted(left + right + poses, key=lambda message: message.log_time))


def test_info_proposes_a_finger_for_each_topic(succeeds):
    out = " ".join(succeeds("info", "push.bag").split())
    assert "--images left=/left/image,right=/right/image --mounts left=X,Y,YAW right=X,Y,YAW" in out


def test_a_bag_becomes_a_recording_of_the_hand(succeeds):
    succeeds(*CONVERT, *TOPICS, *MOUNTS, "--sensor", "left=digit,right=DIGIT")
    read = palpate.load_recording("hand.mcap")
    assert read.hand is not None and read.images is not None and read.image_times is not None
    assert read.hand.mounts == {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, pytest.approx(np.pi / 2))}
    np.testing.assert_allclose(read.sensor_pose, true_pose(image_times()), atol=1e-6)
    # Every other frame has a new image of the slower camera, which keeps its own time.
    assert [bool(image) for image in read.images["right"]] == [True, False] * 12
    assert all(read.images["left"])
    np.testing.assert_allclose(read.image_times["right"][::2], 1e-9 * (image_times()[::2] + LATER), atol=1e-6)
    frame = read[2]
    assert frame.images is not None
    change = np.abs(frame.images["right"].astype(int) - frame.images["left"][::-1])
    assert change.mean() < 3.0


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--images", "left=/left/image,right=/left/image", *MOUNTS), "'left' and 'right' have one, /left/image"),
        (("--images", "left=/left/image", *MOUNTS), "finger 'right' has no images"),
        (
            ("--images", "left=/left/image,rihgt=/right/image", *MOUNTS),
            "'rihgt'; the fingers of the hand are left, right",
        ),
        (("--images", "left=/left/image,right=/nowhere", *MOUNTS), "no image topic '/nowhere'"),
        ((*TOPICS, "--mounts", "left=0,0.02"), "found 'left=0,0.02'; allowed is FINGER=X,Y,YAW"),
        ((*TOPICS, "--mounts", "left=0,0.02,0"), "'right'"),
        (TOPICS, "needs both --mounts"),
        ((*TOPICS, *MOUNTS, "--sensor", "left=digit"), "'right'"),
    ],
)
def test_what_does_not_fit_is_named(fails, options, named):
    assert named in fails(*CONVERT, *options)
    assert not Path("hand.mcap").exists()
