import threading
import time
from typing import Any

import numpy as np
import pytest
from live_samples import GEL, SIZE, FakeTracker, poses_at, sources, state

from palpate.errors import FrameError
from palpate.live.session import POSE_STALL, track_live
from palpate.live.sources import Clock, Sources, TouchImage


def run(given: Sources, tracker: Any, **more: Any) -> tuple[Any, list[str]]:
    counts, said = state()
    track_live(tracker, given, counts, threading.Event(), **more)
    return counts, said


def test_while_a_step_runs_only_the_newest_image_waits():
    clock, four_are_there = Clock(0.0), threading.Event()

    def images(stop):
        yield TouchImage(0.00, GEL)
        assert begun.wait(5.0)
        for when in (0.01, 0.02, 0.03, 0.04):
            yield TouchImage(when, GEL)
        four_are_there.set()
        yield TouchImage(0.05, GEL)

    begun = threading.Event()

    def slow_once(frame):
        begun.set()
        if frame.time == 0.0:
            assert four_are_there.wait(5.0)
            time.sleep(0.1)

    tracker = FakeTracker(slow_once)
    counts, _ = run(Sources(images, poses_at(clock, np.arange(-1, 20) / 10), clock, SIZE), tracker)
    assert [frame.time for frame in tracker.frames] == [0.0, 0.05]
    assert (counts.images, counts.tracked, counts.dropped, counts.without_pose) == (6, 2, 4, 0)


def test_a_slow_step_at_60_hz_drops_what_it_must_and_counts_it():
    times = 0.05 + np.arange(90) / 60
    tracker = FakeTracker(lambda frame: time.sleep(0.04))
    counts, _ = run(sources(times, times - 0.002), tracker)
    assert counts.images == 90
    assert counts.tracked + counts.dropped + counts.without_pose == 90
    assert counts.tracked == len(tracker.frames) and 15 <= counts.tracked <= 42
    assert counts.rate == pytest.approx(60.0)
    assert 40.0 <= counts.latency_ms()["p50"] <= 100.0
    taken = [frame.time for frame in tracker.frames]
    assert np.all(np.diff(taken) > 0.0) and set(taken) <= set(times)
    assert [frame.sensor_pose[0] for frame in tracker.frames] == pytest.approx(taken, abs=0.02)


def test_a_stall_is_said_within_a_fifth_of_a_second_and_estimates_carry_their_age():
    clock = Clock(0.0)
    heard: list[tuple[float, str]] = []
    counts, _ = state()
    counts.say = lambda text: heard.append((clock.now(), text))
    pose_times = [*np.arange(0, 30) / 100, *np.arange(90, 130) / 100]
    tracker = FakeTracker()
    recorded: list[Any] = []

    class Recorder:
        def image(self, image):
            pass

        def pose(self, pose):
            pass

        def estimate(self, last):
            recorded.append((last.estimate.time, last.place.how, last.place.age))

    given = sources(0.1 + np.arange(36) / 30, pose_times, clock)
    track_live(tracker, given, counts, threading.Event(), Recorder())  # pyright: ignore[reportArgumentType]
    (stalled, first), (_, second) = heard
    assert "the sensor's poses have stalled" in first and "sensor poses come, after 0.6" in second
    assert POSE_STALL <= stalled - 0.29 <= 0.2 + 0.05  # a busy machine may take a little longer
    held = [(when, age) for when, how, age in recorded if how == "held"]
    assert held and all(age == pytest.approx(when - 0.29) for when, age in held)
    unplaced = sum(0.49 < when < 0.9 for when in 0.1 + np.arange(36) / 30)
    assert abs(counts.without_pose - unplaced) <= 1  # a busy machine may take one more for stalled
    assert counts.images == counts.tracked + counts.without_pose + counts.dropped


def test_a_session_without_poses_says_so():
    counts, said = run(sources(np.arange(10) / 30, []), FakeTracker())
    assert (counts.tracked, counts.without_pose + counts.dropped) == (0, 10)
    assert len(said) == 1 and "no sensor pose has come for 0." in said[0]


def test_what_is_refused_is_counted_and_said_once():
    counts, said = run(sources([0.1, 0.2], [0.0, np.nan, np.nan, np.nan, 0.15, 0.1]), FakeTracker())
    assert (counts.poses, counts.refused) == (2, 4)
    (refused,) = [text for text in said if "refused" in text]  # a busy machine may also tell of stalls
    assert "refused, 1 so far: nonsense" in refused


def test_a_frame_that_the_tracker_refuses_is_left_out():
    def refusing(frame):
        if frame.time > 0.3:
            raise FrameError("frame leaps")

    counts, said = run(sources(np.arange(18) / 30, np.arange(60) / 100), FakeTracker(refusing))
    assert counts.tracked > 0 and counts.left_out > 0
    assert counts.images == counts.tracked + counts.dropped + counts.without_pose + counts.left_out
    assert "a frame is left out, 1 so far: frame leaps" in said
    assert counts.summary()["left_out"] == counts.left_out

    def never(frame):
        raise FrameError("image of another size")

    with pytest.raises(FrameError, match="another size"):
        run(sources(np.arange(6) / 30, np.arange(60) / 100), FakeTracker(never))


def test_it_ends_after_some_seconds():
    begin = time.monotonic()
    counts, _ = run(sources(np.arange(600) / 60, np.arange(600) / 60), FakeTracker(), seconds=0.4)
    assert 0.4 <= time.monotonic() - begin < 2.0
    assert 15 <= counts.images <= 40
    assert counts.images == counts.tracked + counts.dropped + counts.without_pose


def test_errors_of_sources_and_trackers_come_through():
    def raising(stop):
        yield TouchImage(0.0, GEL)
        raise OSError("unplugged for good")

    clock = Clock(0.0)
    with pytest.raises(OSError, match="for good"):
        run(Sources(raising, poses_at(clock, np.arange(100) / 100), clock, SIZE), FakeTracker())

    def failing(frame):
        raise ValueError("no estimate")

    with pytest.raises(ValueError, match="no estimate"):
        run(sources(np.arange(60) / 60, np.arange(60) / 60), FakeTracker(failing))
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("palpate-read")]
