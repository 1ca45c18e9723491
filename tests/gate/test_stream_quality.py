"""What is said of streams that are worse than they should be, at 30 frames a second and 0.1 mm."""

import numpy as np
import pytest

from palpate.gate.quality import StreamQuality

RATE, DEVIATION = 30.0, 1e-4
LIGHT = np.ones(3)


def reasons(times, poses):
    quality, said = StreamQuality(RATE, DEVIATION), []
    for time, pose in zip(times, poses, strict=True):
        quality.see(time, pose, LIGHT, False)
        said.append(quality.reason)
    return said


def way(times, sigma=0.0):
    """Poses (N, 3) that go at 0.1 m/s, brake and tremble."""
    times = np.asarray(times)
    poses = np.stack([0.1 * times, 0.05 * times**2, times], axis=1)
    poses[:, :2] += np.random.default_rng(1).normal(size=(len(times), 2)) * sigma
    return poses


def test_a_stream_as_it_should_be_has_no_reason():
    times = np.arange(300) / RATE
    assert set(reasons(times, way(times))) == {""}
    assert set(reasons(times, way(times, DEVIATION))) == {""}


def test_stamps_that_jitter_and_a_gap_are_no_lower_rate():
    times = np.arange(300) / RATE + np.random.default_rng(2).uniform(-5e-3, 5e-3, 300)
    assert set(reasons(times, way(times, DEVIATION))) == {""}
    times = np.append(np.arange(50), np.arange(80, 120)) / RATE
    assert set(reasons(times, way(times, DEVIATION))) == {""}


@pytest.mark.parametrize(("every", "rate"), [(2, "15"), (3, "10"), (6, "5")])
def test_frames_that_come_seldom_are_told_after_half_a_second(every, rate):
    times = np.arange(0, 90, every) / RATE
    said = reasons(times, way(times))
    few = 15 // min(every, 3)  # a gap counts as three intervals at most
    assert set(said[:few]) == {""}
    assert set(said[few + 2 :]) == {f"frames come {rate} times a second and not 30 times; the pose is known less well"}


@pytest.mark.parametrize(
    ("rate", "said"),
    [
        (60.0, ""),
        (85.0, ""),
        (122.0, "frames come 122 times a second; the pose is known better from one in 2 of them"),
        (150.0, "frames come 150 times a second; the pose is known better from one in 3 of them"),
        (250.0, "frames come 250 times a second; the pose is known better from one in 5 of them"),
    ],
)
def test_frames_that_come_more_often_than_serves_are_told_after_all_else(rate, said):
    times = np.arange(60) / rate
    quality = StreamQuality(rate, DEVIATION)
    for frame, (time, pose) in enumerate(zip(times, way(times), strict=True)):
        quality.see(time, pose, LIGHT, False)
        assert quality.too_often == (said if frame >= 15 else "")
        assert quality.reason == ""
    quality.see(times[-1] + 1.0 / rate, np.zeros(3), 0.5 * LIGHT, False)
    assert quality.reason.startswith("red, green and blue light are at 50")


def test_stamps_in_milliseconds_are_asked_about_and_a_slow_sensor_is_slow():
    times = np.arange(20.0)
    said = reasons(1e3 * times / RATE, way(times))
    assert said[-1] == "frames come 0.03 times a second and not 30 times; are these milliseconds?"
    said = reasons(times, way(times))
    assert said[-1] == "frames come 1 times a second and not 30 times; the pose is known less well"


def test_frames_of_which_half_are_lost_are_seldom_and_hardly_ever_where_it_is_a_fifth():
    times = np.arange(600) / RATE
    rng = np.random.default_rng(3)
    most, half = times[rng.uniform(size=600) > 0.2], times[rng.uniform(size=600) > 0.5]
    assert np.mean([bool(each) for each in reasons(most, way(most, DEVIATION))]) < 0.1
    assert np.mean([each.startswith("frames come") for each in reasons(half, way(half))[8:]]) > 0.8


@pytest.mark.parametrize("every", [1, 4])
def test_a_place_that_trembles_is_told_by_how_much(every):
    times = np.delete(np.arange(600), np.arange(0, 600, 7 * every)) / RATE  # the parabola holds at any stamps
    said = [each for each in reasons(times, way(times, 5e-4)) if each]
    assert len(said) > 0.9 * (len(times) - 18)
    millimetres = [float(each.split(" mm")[0].split()[-1]) for each in said]
    assert np.median(millimetres) == pytest.approx(0.5, rel=0.1)
    assert all("where 0.1 mm are taken for granted" in each for each in said)


def test_another_light_is_told_while_it_is_another():
    quality = StreamQuality(RATE, DEVIATION)
    said = []
    for frame, blue in enumerate((1.0, 0.8, 0.74, 1.24, 1.26, 1.0)):
        quality.see(frame / RATE, np.zeros(3), np.array([1.0, 1.1, blue]), False)
        said.append(quality.reason)
    assert [bool(each) for each in said] == [False, False, True, False, True, False]
    assert said[2] == "red, green and blue light are at 100, 110 and 74 % of what they were"


@pytest.mark.parametrize(("angle", "way"), [(0, ""), (60, ""), (80, "+y"), (-80, "-y"), (100, "+y"), (180, "-x")])
@pytest.mark.parametrize("yaw", [0.0, 3.0])
def test_a_sensor_that_touches_and_goes_along_another_axis_than_x_is_told(angle, way, yaw, caplog):
    """A millimetre a frame, at an angle [deg] to x of a sensor of any yaw."""
    quality, step = StreamQuality(RATE, DEVIATION), np.radians(angle) + yaw
    said = []
    for frame in range(60):
        place = 1e-3 * frame * np.array([np.cos(step), np.sin(step)])
        quality.see(frame / RATE, np.array([*place, yaw]), LIGHT, frame >= 10)
        said.append(quality.reason)
    assert set(said[:30]) == {""}  # 20 mm in touch
    expected = f"the sensor goes along {way} of its own frame while it touches" if way else ""
    assert all(each.split(";")[0] == expected for each in said[32:])
    assert [record.getMessage().split(": ")[1] for record in caplog.records] == [said[-1]] * bool(way)
