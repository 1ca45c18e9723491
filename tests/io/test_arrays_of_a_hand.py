"""`Recording.from_arrays` of a hand: images of fingers at times of their own, and what cannot be their images."""

import numpy as np
import pytest
from recording_samples import encoded

from palpate import DIGIT, POINT, Disc, FileError, Hand, PalpateError, Recording

HAND = Hand({"left": DIGIT, "right": DIGIT}, {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, 0.0)})
TIME = np.arange(12) / 30.0
POSES = np.column_stack([0.01 * TIME, -0.02 * TIME, 0.1 * TIME])
PICTURES = [encoded(np.full((320, 240, 3), 10 * level, np.uint8), "png") for level in range(12)]
GIVEN = {
    "image_time": {"left": TIME, "right": TIME[::3] - 0.004},
    "images": {"left": PICTURES, "right": PICTURES[::3]},
    "pose_time": TIME - 0.01,
    "poses": POSES,
    "shape": Disc(0.05),
    "sensor": HAND,
    "object_poses": POSES + 0.1,
}


def made(**changes):
    return Recording.from_arrays(**{**GIVEN, **changes})


def test_each_image_is_in_the_frame_of_its_time_and_keeps_its_own():
    recording = made()
    assert recording.hand == HAND and recording.images is not None and recording.image_times is not None
    assert len(recording) == 11  # at the last image no pose is known
    assert list(recording.images["left"]) == PICTURES[:11]
    right = [PICTURES[index] if index % 3 == 0 else b"" for index in range(11)]
    assert list(recording.images["right"]) == right
    assert list(recording.image_times) == ["right"]
    np.testing.assert_allclose(recording.image_times["right"][::3], TIME[:11:3] - 0.004, atol=1e-9)
    np.testing.assert_allclose(recording.sensor_pose[:, 0], 0.01 * (TIME[:11] + 0.01), atol=1e-9)


def test_contact_flags_of_fingers_without_images():
    hand = Hand({"left": POINT, "right": POINT}, HAND.mounts)
    flags = {"left": TIME > 0.1, "right": TIME > 0.2}
    recording = made(image_time=TIME, images=None, sensor=hand, contact=flags)
    assert recording.images is None and recording.contacts is not None
    np.testing.assert_array_equal(recording.contacts["right"], flags["right"][:11])
    np.testing.assert_array_equal(recording.contact, flags["left"][:11])


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"images": {"left": PICTURES}}, "finger 'right' has no images"),
        ({"image_time": {"left": TIME}}, "finger 'right' has no images"),
        ({"images": {**GIVEN["images"], "middle": PICTURES}}, "images.*'middle'.*left, right"),
        ({"images": PICTURES}, "images: found list, expected a dictionary by name of finger"),
        ({"images": {"left": PICTURES, "right": PICTURES}}, "finger 'right': found 12 images for 4"),
        ({"image_time": {"left": TIME, "right": TIME[::3] + 1e6}}, "finger 'right'.*one clock"),
        ({"sensor": "digit"}, "images: found values by finger for one sensor"),
        ({"contact": [True]}, "contact: found list"),
    ],
)
def test_what_does_not_fit_is_named(changes, named):
    with pytest.raises(FileError, match=named):
        made(**changes)


def test_images_of_another_size_name_the_finger():
    with pytest.raises(PalpateError, match="finger 'right'"):
        made(images={"left": PICTURES, "right": [np.zeros((64, 50, 3), np.uint8)] * 4})
