"""Input gate: implausible times and poses are refused, frozen poses detected, weak streams named; at 30 Hz."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from palpate import DIGIT, POINT, Estimate, Frame, FrameError, Rectangle, Tracker, TrackerSettings

RATE = 30.0
BOX = Rectangle(0.1, 0.1)
SMALL_DIGIT = replace(DIGIT, image_height=80, image_width=60)


def at(frame: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """Sensor pose that pushes the box along x by 1 mm a frame, with an offset."""
    return np.array([-0.05 + 1e-3 * frame + x, y, yaw])


def new_tracker(sensor=POINT) -> Tracker:
    return Tracker(BOX, sensor, (0.0, 0.0, 0.0), TrackerSettings(tactile="none", hypotheses=1))


def pushed(frames: int, contact: bool = True) -> Tracker:
    tracker = new_tracker()
    for frame in range(frames):
        tracker.update(Frame(frame / RATE, at(frame), contact=contact))
    return tracker


def step(tracker: Tracker, frame: float, pose: np.ndarray, contact: bool = True) -> Estimate:
    return tracker.update(Frame(frame / RATE, pose, contact=contact))


def test_a_time_that_jumps_is_refused_and_a_clock_that_was_set_is_accepted():
    tracker = pushed(10)
    jump = Frame(1000.333, at(10), contact=True)
    with pytest.raises(FrameError, match=r"frame at 1000\.333 s comes 1e\+03 s after the last one, more than 60 s"):
        tracker.update(jump)
    step(tracker, 10, at(10))
    with pytest.raises(FrameError, match="times must increase"):
        step(tracker, 10, at(10))
    with pytest.raises(FrameError):
        tracker.update(jump)
    assert tracker.update(Frame(1000.366, at(11), contact=True)).time == 1000.366


@pytest.mark.parametrize(("unit", "word"), [(1e6, "microseconds"), (1e9, "nanoseconds")])
def test_times_in_another_unit_are_never_accepted(unit, word):
    tracker = new_tracker()
    tracker.update(Frame(2.0 * unit, at(0), contact=False))
    for frame in range(1, 5):
        with pytest.raises(FrameError, match=f"are these {word}"):
            tracker.update(Frame((2.0 + frame / RATE) * unit, at(0), contact=False))


@pytest.mark.parametrize("offset", [0.02, 1.0])
def test_one_pose_that_jumps_in_a_contact_changes_nothing(offset):
    tracker, expected = pushed(20), pushed(20)
    with pytest.raises(FrameError, match="m and 0 degrees from where"):
        step(tracker, 20, at(20, y=offset))
    found, wanted = (step(each, 21, at(21)) for each in (tracker, expected))
    np.testing.assert_array_equal(found.pose, wanted.pose)
    np.testing.assert_array_equal(found.covariance, wanted.covariance)


def test_three_poses_that_agree_are_accepted():
    tracker = pushed(20)
    for frame in (20, 21):
        with pytest.raises(FrameError, match="faster than any arm; 3 in a row that agree are believed"):
            step(tracker, frame, at(frame, y=0.3))
    for frame in (22, 23):
        assert step(tracker, frame, at(frame, y=0.3)).time == frame / RATE


def test_a_sensor_may_be_anywhere_between_contacts():
    assert not step(pushed(20, contact=False), 20, at(-300), contact=False).contact


def test_acceleration_and_missing_frames_are_no_jump():
    step(pushed(20), 20, at(20, y=0.012))  # 10.8 m/s^2
    step(pushed(20), 28, at(19))  # stopped 9 mm before where it might be
    tracker = new_tracker()
    for frame in range(20):  # turns across half a turn
        step(tracker, frame, at(frame, yaw=np.pi - 0.19 + 0.02 * frame - 2 * np.pi * (frame > 9)))


@pytest.mark.parametrize(
    ("pose", "question"),
    [(at(0, x=500.0), "are these millimetres"), (at(5, yaw=1.0), r"0\.001 m and 57 degrees .*; is theta in degrees\?")],
)
def test_the_unit_of_a_jump_is_asked_for(pose, question):
    with pytest.raises(FrameError, match=question):
        step(pushed(5), 5, pose)


def test_a_pose_that_stops_changing_at_full_speed_is_frozen():
    tracker = pushed(20)
    found = [step(tracker, frame, at(19)) for frame in range(20, 40)]
    assert found[1].status != "faulty"  # 2 mm do no harm
    assert found[-1].status == "faulty"
    assert "frozen" in found[-1].reason and "20 mm" in found[-1].reason
    assert found[-1].covariance[0, 0] > found[0].covariance[0, 0] + 1e-4
    with pytest.raises(FrameError):  # 21 mm in one frame, possible in two
        step(tracker, 40, at(40))
    assert step(tracker, 41, at(41)).status != "faulty"


def test_a_release_while_the_pose_is_frozen_leaves_the_motion_unknown():
    frozen, moving = pushed(20), pushed(40)
    for frame in range(20, 40):
        step(frozen, frame, at(19))
    found, wanted = (step(each, 40, each.frame.sensor_pose, contact=False) for each in (frozen, moving))
    assert found.covariance[0, 0] > wanted.covariance[0, 0] + 1e-4
    # The pose is still frozen in the next contact, until it changes.
    assert step(frozen, 42, at(19)).status == "faulty"


@pytest.mark.parametrize(
    "places",
    [
        # goes on half a millimetre from where it stood: later repeats mean nothing
        [*[19] * 2, *np.arange(19.5, 40), *[40] * 20],
        # slows down before it stands
        [*(19 + np.cumsum(np.arange(9, 0, -1) / 10)), *[23.5] * 30],
    ],
)
def test_a_robot_that_stands_is_not_frozen(places):
    tracker = pushed(20)
    found = [step(tracker, 20 + index, at(place)) for index, place in enumerate(places)]
    assert all(estimate.status != "faulty" for estimate in found)


def test_without_images_a_robot_that_once_stood_at_an_exact_pose_is_not_frozen_when_it_waits():
    """Robots stop at once at pushing speeds, and nothing but touch tells one that waits from a frozen stream."""
    tracker = new_tracker()
    for frame in range(20):
        step(tracker, frame, at(-20), contact=False)
    for frame in range(20, 60):
        step(tracker, frame, at(frame - 40), contact=frame >= 40)
    found = [step(tracker, frame, at(19)) for frame in range(60, 75)]
    assert "faulty" not in {estimate.status for estimate in found}


def test_a_robot_that_stops_at_once_and_goes_on_from_there_is_not_frozen_later():
    tracker = pushed(20)
    assert [step(tracker, frame, at(19)).status for frame in range(20, 40)][-1] == "faulty"
    found = [step(tracker, frame, at(frame - 20)) for frame in range(40, 60)]
    found += [step(tracker, frame, at(39)) for frame in range(60, 80)]
    assert "faulty" not in {estimate.status for estimate in found}


# Images: a gel of three colours, with noise, and a square imprint.
def image(rng: np.random.Generator, touched: bool = False, light: float = 1.0, place: int = 20) -> np.ndarray:
    levels = np.full((80, 60, 3), (90.0, 110.0, 130.0)) * light
    if touched:
        levels[30:50, place : place + 20] += 40.0
    return np.clip(levels + rng.normal(size=levels.shape), 0, 255).astype(np.uint8)


def seen(tracker: Tracker, frame: int, pose: np.ndarray, rng: np.random.Generator, **how) -> Estimate:
    return tracker.update(Frame(frame / RATE, pose, image=image(rng, **how)))


def touching(rng: np.random.Generator, way: float = 0.0) -> tuple[Tracker, list[Estimate]]:
    """Return a tracker that saw an untouched gel, then 30 mm of contact at an angle to x [rad]."""
    tracker = new_tracker(SMALL_DIGIT)
    for frame in range(30):
        seen(tracker, frame, at(frame - 30), rng)
    direction = 1e-3 * np.array([np.cos(way), np.sin(way), 0.0])
    return tracker, [seen(tracker, 30 + k, at(0) + k * direction, rng, touched=True) for k in range(30)]


def test_a_sensor_that_draws_back_is_not_in_contact_whatever_its_image_shows():
    rng = np.random.default_rng(1)
    tracker, found = touching(rng)
    assert found[-1].contact
    back = [seen(tracker, 60 + k, at(28 - k), rng, touched=True).contact for k in range(8)]
    assert back == [True] * 4 + [False] * 4


def pushing(
    rng: np.random.Generator, places: Sequence[float], imprints: Sequence[int], stands: int = 0
) -> list[Estimate]:
    """Estimates of a contact with the sensor at these places [frames of motion] and the imprint at these columns.

    Before it the robot stands at one exact pose for some frames, and comes near.
    """
    tracker = new_tracker(SMALL_DIGIT)
    approach = [-30.0] * stands + [*range(-30, 0)]
    for frame, place in enumerate(approach):
        seen(tracker, frame, at(place), rng)
    start = len(approach)
    return [
        seen(tracker, start + k, at(place), rng, touched=True, place=imprint)
        for k, (place, imprint) in enumerate(zip(places, imprints, strict=True))
    ]


def test_a_robot_that_waits_in_contact_is_not_frozen():
    rng = np.random.default_rng(3)
    places = [*range(25), *[24] * 60, *range(25, 50), *[49] * 30]
    # The imprint moves with the sensor, and settles within three frames.
    imprints = [min(place // 2, 20) for place in places]
    imprints[25:28] = [13, 13, 12]
    found = pushing(rng, places, imprints)
    assert "faulty" not in {estimate.status for estimate in found}


def test_a_pose_that_stands_while_the_touch_goes_on_changing_is_frozen():
    rng = np.random.default_rng(4)
    # The robot has waited before, slows down, and its pose freezes at a creep while the imprint goes on.
    slower = [25.6, 26.2, 26.6, 27.0, 27.2]
    places = [*range(25), *[24] * 30, *slower, *[27.2] * 40]
    imprints = [*(k // 2 for k in range(25)), *[12] * 35, *(12 + k // 3 for k in range(1, 41))]
    found = pushing(rng, places, imprints, stands=20)
    assert "faulty" not in {estimate.status for estimate in found[:60]}
    assert found[80].status == "faulty" and "frozen" in found[80].reason
    assert {estimate.status for estimate in found[80:]} == {"faulty"}


@pytest.mark.parametrize("times", [2, 3])
def test_a_stream_that_repeats_each_pose_is_not_frozen(times):
    rng = np.random.default_rng(5)
    places = [float(k // times * times) for k in range(40)]
    found = pushing(rng, places, [k // 2 for k in range(40)])
    assert "faulty" not in {estimate.status for estimate in found}


@pytest.mark.parametrize(("degrees", "axis"), [(60, ""), (80, "+y"), (-80, "-y")])
def test_pushing_sideways_is_named(degrees, axis):
    _, found = touching(np.random.default_rng(2), np.radians(degrees))
    sentence = f"the sensor moves along {axis} of its own frame in contact"
    assert (sentence in found[-1].reason) == bool(axis)
    assert not any("of its own frame" in estimate.reason for estimate in found[:15])


def reasons(times: np.ndarray, noise: float = 0.0) -> list[str]:
    """Return the reasons at these times [s] for a sensor that moves freely, its position with noise [m]."""
    rng, tracker = np.random.default_rng(4), new_tracker()
    poses = np.stack([-0.3 - 0.1 * times % 0.1, 0.05 * np.sin(times), times % 1.0], axis=1)
    poses[:, :2] += noise * rng.normal(size=(len(times), 2))
    return [tracker.update(Frame(t, pose, contact=False)).reason for t, pose in zip(times, poses, strict=True)]


def test_a_good_stream_has_no_weakness():
    rng = np.random.default_rng(5)
    times = np.arange(100) / RATE
    assert set(reasons(times, 1e-4)) == {""}
    assert set(reasons(times + rng.uniform(-5e-3, 5e-3, 100))) == {""}  # times that jitter
    assert set(reasons(np.append(times[:50], times[50:] + 1.0))) == {""}  # one gap


@pytest.mark.parametrize(
    ("rate", "sentence"),
    [
        (1.0, "frames come 1 times a second and not 30 times; the pose is known less well"),
        (15.0, "frames come 15 times a second and not 30 times; the pose is known less well"),
        (50.0, ""),
        (60.0, "frames come 60 times a second and not 30 times: the estimate is too sure; keep one in 2"),
    ],
)
def test_a_rate_that_is_too_low_or_too_high_is_named(rate, sentence):
    assert reasons(np.arange(40) / rate)[-1] == sentence


def test_times_in_milliseconds_are_asked_about():
    assert reasons(1e3 * np.arange(20) / RATE)[-1].endswith("and not 30 times; are these milliseconds?")
