"""The loop of a live session between sources and a tracker that tests steer."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from view_samples import CAMERA

from palpate import Estimate, FrameError
from palpate.live.session import LiveSession
from palpate.live.sources import Clock, Sources, TimedPose, TouchImage, clock_from

GEL = np.full((CAMERA.image_height, CAMERA.image_width, 3), 90, np.uint8)


class FakeTracker:
    """Does `step` with each frame, and estimates the same pose."""

    tactile, tactile_reason = "none", ""

    def __init__(self, step: Callable[[Any], None] = lambda frame: None) -> None:
        self.frames: list[Any] = []
        self._step = step

    def update(self, frame: Any) -> Estimate:
        self.frames.append(frame)
        self._step(frame)
        return Estimate(frame.time, np.zeros(3), np.eye(3), False, "resting")


def images_at(now: Clock, times: Any) -> Any:
    def images(stop: threading.Event) -> Iterator[TouchImage]:
        for when in times:
            if stop.wait(max(0.0, when - now())):
                return
            yield TouchImage(when, GEL)

    return images


def poses_at(now: Clock, times: Any) -> Any:
    """A source of poses whose x is the time."""

    def poses(stop: threading.Event) -> Iterator[TimedPose]:
        for when in times:
            if stop.wait(max(0.0, when - now())):
                return
            yield TimedPose(when, np.array([when, 0.0, 0.0]))

    return poses


def run(tracker: Any, images: Any, poses: Any, listen: Any = None) -> tuple[LiveSession, list[str]]:
    """The session of sources, or of times [s] at which images and poses arrive; and what the user is told."""
    notes: list[str] = []
    now = clock_from(0.0)
    images = images if callable(images) else images_at(now, images)
    session = LiveSession(tracker, Sources(images, poses_at(now, poses), now, CAMERA), notes.append)
    session.run(threading.Event(), listen)
    counts = session.counts
    ends = ("tracked", "dropped", "without_pose", "left_out")
    assert counts["images"] == sum(counts[name] for name in ends) and counts["tracked"] == sum(
        session.statuses.values()
    )
    return session, notes


def test_while_a_step_runs_only_the_newest_image_waits():
    four_are_there, begun = threading.Event(), threading.Event()

    def images(stop):
        yield TouchImage(0.00, GEL)
        assert begun.wait(5.0)
        for when in (0.01, 0.02, 0.03, 0.04):
            yield TouchImage(when, GEL)
        yield TouchImage(0.05, GEL)
        four_are_there.set()

    def slow_once(frame):
        begun.set()
        assert four_are_there.wait(5.0)

    tracker = FakeTracker(slow_once)
    tracker.tactile_reason = "images are grey"
    session, notes = run(tracker, images, np.arange(-1, 20) / 10)
    assert [frame.time for frame in tracker.frames] == [0.0, 0.05]
    assert (session.counts["tracked"], session.counts["dropped"]) == (2, 4)
    assert notes == ["tactile none: images are grey"]


def test_a_slow_step_at_60_hz_drops_what_it_must_and_listeners_get_all():
    times, heard = 0.05 + np.arange(60) / 60, list[Any]()
    took: list[float] = []  # [s] a step; a busy machine sleeps longer

    def step(frame):
        begin = time.monotonic()
        time.sleep(0.04)
        took.append(time.monotonic() - begin)

    tracker = FakeTracker(step)
    session, _ = run(tracker, times, times - 0.002, heard.append)
    assert session.counts["images"] == 60 and session.counts["tracked"] <= 29 and sum(took) > 0.4
    found = session.summary()
    assert found["rate_hz"] == pytest.approx(60.0)
    assert 40.0 <= found["latency_ms"]["p50"] <= 2.5e3 * np.median(took)
    assert (found["status"], found["reason"]) == ("resting", "")
    taken = [frame.time for frame in tracker.frames]
    assert np.all(np.diff(taken) > 0.0) and set(taken) <= set(times)
    assert [frame.sensor_pose[0] for frame in tracker.frames] == pytest.approx(taken, abs=0.02)
    assert [item.time for item in heard if isinstance(item, TouchImage)] == pytest.approx(times)
    assert [item.time for item in heard if isinstance(item, TimedPose)] == pytest.approx(times - 0.002)


def test_a_stall_is_noted_and_motion_is_extrapolated():
    tracker = FakeTracker()
    pose_times = [*np.arange(0, 30) / 100, *np.arange(90, 130) / 100]
    session, notes = run(tracker, 0.1 + np.arange(36) / 30, pose_times)
    note, *_ = notes
    assert "an image is without a sensor pose: the last one before it is 0.1" in note
    during = [frame for frame in tracker.frames if 0.35 < frame.time < 0.44]
    assert during and all(frame.sensor_pose[0] == pytest.approx(frame.time) for frame in during)
    assert abs(session.counts["without_pose"] - 14) <= 2  # a busy machine may take more for stalled


def test_a_frame_that_the_tracker_refuses_or_that_does_not_decode_is_left_out():
    def refusing(frame):
        if frame.time > 0.3:
            raise FrameError("frame leaps")

    session, notes = run(FakeTracker(refusing), np.arange(18) / 30, np.arange(60) / 100)
    assert session.counts["tracked"] > 0 and session.counts["left_out"] > 0
    assert "a frame is left out: frame leaps; further ones are counted" in notes

    def damaged(stop):
        for index in range(4):
            time.sleep(0.1)
            yield TouchImage(0.1 * index, b"no image" if index in (0, 2) else GEL)

    session, notes = run(FakeTracker(), damaged, np.arange(-1, 60) / 100)
    assert (session.counts["tracked"], session.counts["left_out"]) == (2, 2)
    assert "a frame is left out: its 8 bytes do not decode as JPEG or PNG; further ones are counted" in notes


def failing(error: Exception) -> FakeTracker:
    def fail(frame):
        raise error

    return FakeTracker(fail)


def test_errors_of_sources_and_trackers_come_through():
    def raising(stop):
        yield TouchImage(0.0, GEL)
        raise OSError("unplugged for good")

    times, before = np.arange(60) / 60, threading.active_count()
    for tracker, images, message in (
        (FakeTracker(), raising, "for good"),
        (failing(ValueError("no estimate")), times, "no estimate"),
        (failing(FrameError("image of another size")), times, "another size"),  # at the first frame
    ):
        with pytest.raises((OSError, ValueError, FrameError), match=message):
            run(tracker, images, times)
    assert threading.active_count() == before
