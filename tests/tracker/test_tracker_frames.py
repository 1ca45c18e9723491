"""Frames that cannot be used: one kind of error, and estimates as if they had not come."""

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import pytest
from push_samples import SHAPES, frames, in_two_contacts, pushed, sensor
from tracker_samples import same, settings, small_frame

import palpate
from palpate import DIGIT, ContactDirection, Frame, FrameError, Measurement, ObjectPose, SensorProfile, Tracker

SEEN = ObjectPose(np.zeros(3), 1e-4 * np.eye(3))


class Deep(palpate.OwnMeasurement):
    on: ClassVar[tuple[str, ...]] = ("depth",)

    def linearise(self, depth: Any) -> Any:
        return (depth - 3e-4) / 1e-4, np.array([[1e4]])


class OfNothing(Deep):
    on = ("detph",)


BAD: dict[str, tuple[Any, str]] = {
    "no frame": ({"time": 1.0}, "found dict in place of a frame"),
    "time of text": ({"time": "soon"}, "frame has time 'soon'; it must be a finite number"),
    "time before": ({"time": 0.1}, "times must increase"),
    "time that is nan": ({"time": np.nan}, r"^frame has time nan; it must be a finite number \[s\]$"),
    "no pose": ({"sensor_pose": None}, "sensor pose None; it must be three finite numbers"),
    "pose of two": ({"sensor_pose": [0.0, 1.0]}, "it must be three finite numbers"),
    "pose 2000 km off": ({"sensor_pose": [0.0, 2e6, 1.0]}, r"theta \[rad\], up to 1e\+06"),
    "pose that leans": (
        {"sensor_pose": (0.0, 0.0, 0.1, 0.0, 0.6, 0.0, 0.8)},
        "x axis -73.7 degrees out of the plane",
    ),
    "neither": ({"image": None, "contact": None}, "neither an image nor a contact flag"),
    "contact of text": ({"contact": "yes"}, "contact 'yes'; it must be True, False or None"),
    "encoded image": ({"image": b"\xff\xd8\xff"}, "image of type bytes.*decode encoded images first"),
    "image of floats": ({"image": np.zeros((320, 240, 3))}, r"image of float64 \(320, 240, 3\); it must be an array"),
    "turned image": ({"image": np.zeros((240, 320, 3), np.uint8)}, "turned by a quarter"),
    "one number": ({"measurements": 7}, "measurements of type int; they must be a list"),
    "pose as measurement": ({"measurements": [np.zeros(3)]}, "measurement of type ndarray; allowed are"),
    "measurement of nothing": ({"measurements": [OfNothing()]}, "variable 'detph' is not known; known are"),
}


def test_poses_in_space_are_those_in_the_plane():
    matrix, seen = np.eye(4), []
    matrix[:2, :2], matrix[:3, 3] = [[0.8, -0.6], [0.6, 0.8]], (-0.3, 0.1, 0.25)
    half = np.sqrt([0.1, 0.9])  # sine and cosine of half the yaw
    for pose in ((-0.3, 0.1, np.arctan2(0.6, 0.8)), (-0.3, 0.1, 0.25, 0.0, 0.0, *half), matrix):
        tracker = Tracker(SHAPES["rectangle"], DIGIT, np.zeros(3))
        tracker.update(Frame(1.0, np.asarray(pose), contact=False, object_pose=np.asarray(pose)))
        seen.append((tracker.frame.sensor_pose, tracker.frame.object_pose))
    for other in seen[1:]:
        np.testing.assert_allclose(other, seen[0], atol=1e-12)


ANYWHERE = [name for name in BAD if name not in ("no frame", "time before", "turned image")]
"""Those that are bad whatever came before."""


@pytest.mark.parametrize("name", BAD)
def test_a_bad_frame_is_refused_in_one_sentence(name):
    changed, words = BAD[name]
    tracker = Tracker(SHAPES["rectangle"], DIGIT, np.zeros(3))
    good = Frame(1.0, np.array([-0.3, 0.0, 0.0]), np.full((320, 240, 3), (90, 100, 110), np.uint8))
    tracker.update(good)
    frame = changed if name == "no frame" else dataclasses.replace(good, **{"time": 1.1, **changed})
    with pytest.raises(FrameError, match=words) as found:
        tracker.update(frame)
    assert "\n" not in str(found.value)
    assert tracker.frame.time == 1.0
    with pytest.raises(FrameError):
        tracker.update(dataclasses.replace(good, time=1.1), measurements=[None])  # pyright: ignore[reportArgumentType]


class Tells:
    """A touch of one's own that tells this."""

    def __init__(self, told: Any) -> None:
        self._told = told

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        return self._told

    def end_contact(self) -> None:
        pass


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (
            [ContactDirection(0.0, 1e-4)],
            "has a measurement ContactDirection, which is of one tip, and the sensor has 2",
        ),
        (None, "has measurements of type NoneType; they must be a list of measurements"),
        ([OfNothing()], "variable 'detph' is not known; known are"),
    ],
)
def test_touch_of_ones_own_is_checked_as_measurements_are(told, words):
    two = SensorProfile("fingers", 0.004, ((0.0, 0.02), (0.0, -0.02)))
    tracker = Tracker(SHAPES["disc"], two, np.zeros(3), touch=Tells(told))
    with pytest.raises(FrameError, match=f"^frame at 1.000 s.*{words}"):
        tracker.update(small_frame(contact=True))
    assert not tracker.update(small_frame(time=2.0)).contact


@pytest.mark.parametrize("smoother", ["fixed-lag", "batch"])
def test_estimates_after_bad_frames_are_those_without_them(smoother):
    """In contact and between contacts, to the last digit."""
    o, e, contact = in_two_contacts("rectangle", 12)
    seen = frames(o, e, contact)
    how = settings("oracle", smoother)
    clean, dirty = (Tracker(SHAPES["rectangle"], sensor(), o[0], how) for _ in range(2))
    for frame in seen:
        for name in ANYWHERE:
            with pytest.raises(FrameError):
                dirty.update(dataclasses.replace(frame, **BAD[name][0]))
        with pytest.raises(FrameError):
            dirty.update(frame, 3)  # pyright: ignore[reportArgumentType]
        same([dirty.update(frame)], [clean.update(frame)])


def test_lists_are_taken_where_arrays_are():
    o, e = pushed("rectangle", 12)
    how = settings("oracle")
    seen = [ObjectPose([0.0, 0.0, 0.0], np.diag([1e-2, 1e-2, 1.0]).tolist())]  # pyright: ignore[reportArgumentType]
    sigma = list(how.noise.first_pose.deviation)
    arrays = Tracker(SHAPES["rectangle"], sensor(), o[0], how)
    lists = Tracker(SHAPES["rectangle"], sensor(), tuple(o[0]), how, first_pose_sigma=sigma)
    for frame in frames(o, e):
        assert frame.object_pose is not None
        listed: Any = {"sensor_pose": frame.sensor_pose.tolist(), "object_pose": tuple(frame.object_pose)}
        given = dataclasses.replace(frame, **listed)
        same([lists.update(given, seen)], [arrays.update(frame, seen)])
