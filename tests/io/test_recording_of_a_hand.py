"""Recordings of a hand: what belongs to each finger, its checks, and the file that holds it without loss."""

from dataclasses import replace

import numpy as np
import pytest
from bag_samples import decoded_by_another
from recording_samples import encoded

from palpate import DIGIT, POINT, Disc, FileError, Hand, Recording, load_recording, write_recording

HAND = Hand({"left": DIGIT, "right": DIGIT}, {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, 0.1)})
RNG = np.random.default_rng(65)
PICTURES = [encoded(RNG.integers(0, 255, (320, 240, 3), np.uint8), "png") for _ in range(4)]


@pytest.fixture(scope="module")
def recording():
    time = 1e9 + np.arange(4) / 30.0
    left = np.array([False, False, True, True])
    right = np.array([False, True, True, False])
    return Recording(
        time,
        RNG.normal(size=(4, 3)),
        Disc(0.05),
        HAND.whole,
        object_pose=RNG.normal(size=(4, 3)),
        hand=HAND,
        images={"right": [PICTURES[0], b"", b"", PICTURES[1]], "left": PICTURES},
        contacts={"right": right, "left": left},
        finger_poses={"left": RNG.normal(size=(4, 3))},
        image_times={"right": time - 0.0123456789},
        extra={"left/depth": RNG.normal(size=4)},
    )


def test_a_frame_holds_what_is_known_of_each_finger(recording):
    frame = recording[1]
    assert frame.image is None and frame.contact is None
    assert frame.contacts == {"left": False, "right": True}
    assert list(frame.images) == ["left"] and frame.images["left"].shape == (320, 240, 3)
    assert list(recording[3].images) == ["left", "right"]
    np.testing.assert_array_equal(frame.finger_poses["left"], recording.finger_poses["left"][1])
    assert frame.image_times == {"right": recording.image_times["right"][1]}
    assert recording.sensor == HAND.whole and recording.contact.tolist() == [False, True, True, True]
    assert recording.until(2).images["left"] == tuple(PICTURES[:2])


def test_the_file_holds_all_of_it_to_the_last_bit(recording, tmp_path):
    write_recording(recording, tmp_path / "hand.mcap")
    read = load_recording(tmp_path / "hand.mcap")
    assert (read.hand, read.images, read.sensor) == (recording.hand, recording.images, recording.sensor)
    for field in ("contacts", "finger_poses", "image_times", "extra"):
        for name, values in getattr(recording, field).items():
            np.testing.assert_array_equal(getattr(read, field)[name], values)
    write_recording(replace(read, file=None), tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == (tmp_path / "hand.mcap").read_bytes()


def test_other_tools_see_the_images_and_poses_of_each_finger(recording, tmp_path):
    write_recording(recording, tmp_path / "hand.mcap")
    messages = decoded_by_another(tmp_path / "hand.mcap")
    counts = {topic: len(each) for topic, each in messages.items()}
    assert counts["/fingers/left/image/compressed"] == 4 and counts["/fingers/right/image/compressed"] == 2
    assert counts["/fingers/left/pose"] == counts["/fingers/right/contact"] == counts["/sensor/pose"] == 4


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"images": {"left": PICTURES}}, "images: found none of finger 'right'"),
        ({"images": {"left": PICTURES, "right": PICTURES[:3]}}, "finger 'right': found 3 images for 4"),
        (
            {"images": {"left": PICTURES, "right": PICTURES, "middle": PICTURES}},
            "images: .*'middle'.*left",
        ),
        ({"contacts": {"left": np.zeros(3, bool)}}, "contacts of finger 'left'"),
        ({"contacts": [True]}, "contacts: found list"),
        ({"finger_poses": {"left": np.full((4, 3), np.nan)}}, "finger_poses of finger 'left': frame 0"),
        ({"image_times": {"left": [0.0, 1.0, np.nan, 2.0]}}, "image_times of finger 'left': frame 2"),
        ({"image": PICTURES}, "image: found images of one sensor for a hand"),
        ({"hand": None, "sensor": POINT}, "images: found values by finger without a hand"),
        ({"hand": Hand({"left": DIGIT, "right": POINT}, HAND.mounts)}, "finger 'right': found images, but"),
    ],
)
def test_fields_that_do_not_fit_are_named(recording, change, named):
    with pytest.raises(FileError, match=named):
        replace(recording, **change)


def test_a_damaged_image_is_named_with_its_finger(recording):
    broken = replace(recording, images={"left": PICTURES, "right": [*PICTURES[:3], PICTURES[3][:90]]})
    with pytest.raises(FileError, match=r"finger 'right' of frame 3"):
        broken[3]
