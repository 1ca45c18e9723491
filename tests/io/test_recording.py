"""Recordings: frames, and fields that are refused."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from recording_samples import UNSTATED, encoded, pushed, tiny_images, tiny_recording

from palpate import DIGIT, POINT, Disc, FileError, Frame, Recording, SettingError


def test_frames_come_out_as_they_went_in():
    made = tiny_recording()
    frames: list[Any] = list(made)
    assert len(frames) == len(made) == 5
    assert isinstance(frames[0], Frame)
    np.testing.assert_array_equal([frame.image for frame in frames], tiny_images(5))
    assert frames[1].object_pose is None
    assert frames[2].object_pose is not None
    np.testing.assert_array_equal(frames[2].object_pose, made.object_pose[2])
    assert [frame.contact for frame in frames] == [False, False, True, True, True]
    assert made[-1].time == made.time[4]
    with pytest.raises(IndexError):
        made[5]
    bare = Recording(np.array([0.0]), np.zeros((1, 3)), Disc(0.05), POINT)[0]
    assert (bare.image, bare.contact, bare.object_pose) == (None, None, None)


def test_colours_keep_their_order():
    image = np.zeros((12, 8, 3), np.uint8)
    image[..., 0] = 200
    made = tiny_recording(1, image=(encoded(image),), object_pose=None)
    np.testing.assert_array_equal(made[0].image, image)
    # OpenCV reads the same bytes as blue, green, red: the 200 has to be in its last channel.
    raw = cv2.imdecode(np.frombuffer(made.image[0], np.uint8), cv2.IMREAD_COLOR)
    assert raw is not None and raw[0, 0].tolist() == [0, 0, 200]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.zeros((0,))}, "time: found no times"),
        ({"time": np.zeros((5, 1))}, r"time: found shape \(5, 1\), expected \(N,\)"),
        ({"time": np.array([0, 1, 1, 2, 3.0])}, "time: frame 2 repeats 1 s after 1 s"),
        ({"time": np.array([0, 1, 0.5, 2, 3])}, "time: frame 2 runs backwards at 0.5 s after 1 s"),
        ({"time": np.array([0, 1, np.nan, 2, 3])}, "time: frame 2 is nan"),
        ({"time": np.array(list("abcde"))}, "time: found text, expected numbers"),
        ({"sensor_pose": np.zeros((4, 3))}, r"sensor_pose: found shape \(4, 3\), expected \(5, 3\)"),
        ({"sensor_pose": [[0, 0, 0], [1]]}, "sensor_pose: rows have different lengths"),
        ({"sensor_pose": np.full((5, 3), np.inf)}, r"sensor_pose: frame 0 is \[inf, inf, inf\]"),
        ({"object_pose": np.tile([0, np.nan, 0], (5, 1))}, r"frame 0 is \[0.0, nan, 0.0\], allowed is three"),
        ({"contact": np.zeros(5)}, "contact: found values of type float64, expected booleans"),
        ({"image": tiny_images(5)}, r"image 0 is of type ndarray.*Recording.from_arrays encodes"),
        ({"image": ("x.png",) * 5}, "image 0 is of type str, expected encoded bytes"),
        ({"image": (b"",) * 4}, "image: found 4 images for 5 times"),
        ({"first_pose": np.zeros((5, 3))}, r"first_pose: found shape \(5, 3\), expected \(3,\)"),
        ({"first_pose": [0.0, np.nan, 0.0]}, r"first_pose: found \[0.0, nan, 0.0\], allowed are -1e\+06 to 1e\+06"),
        ({"first_pose_sigma": [0.1, 0.0, 0.1]}, r"first_pose_sigma: found \[0.1, 0.0, 0.1\], allowed are 1e-09 to"),
        ({"set_up_sigma": [0.0, -1e-3, 0.0]}, r"set_up_sigma: found \[0.0, -0.001, 0.0\], allowed are 0 to"),
        ({"first_pose": None}, "first_pose_sigma: .* without a first_pose"),
        ({"extra": {"pose": np.ones((4, 3))}}, r"extra/pose: found shape \(4, 3\), expected \(5, 3\)"),
        ({"extra": {"words": np.array(list("abcde"))}}, "extra/words: found text, expected numbers or booleans"),
        ({"shape": "rectangle"}, "shape: found 'rectangle', expected an outline"),
        ({"sensor": POINT}, "image: found images, but the sensor 'point' has none"),
    ],
)
def test_fields_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(FileError, match=message):
        tiny_recording(**changes)


def test_the_first_pose_is_stated_or_that_of_ground_truth():
    truth = pushed().object_pose.copy()
    truth[0] = np.nan
    derived: Any = replace(pushed(), object_pose=truth, **UNSTATED)
    assert derived.first_pose.tolist() == truth[1].tolist()
    assert derived.first_pose_sigma.tolist() == [5e-4, 5e-4, 5e-3]
    stated: Any = replace(derived, first_pose=(0.1, 0.0, 0.3), first_pose_sigma=None)
    assert stated.first_pose.tolist() == [0.1, 0.0, 0.3] and stated.first_pose_sigma is None


def test_a_sensor_may_be_named():
    recording = pushed()
    assert replace(recording, sensor="digit").sensor == DIGIT
    with pytest.raises(SettingError, match="sensor is 'finger'; allowed are digit"):
        replace(recording, sensor="finger")
