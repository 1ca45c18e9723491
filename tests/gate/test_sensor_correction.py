"""A sensor whose images are late, and which is mounted beside its stated place: frames and estimates are corrected."""

from typing import Any

import numpy as np
import pytest

from palpate import Estimate, Frame
from palpate.input.sensor_correction import SensorCorrection, moved_on
from palpate.touch.calibration import SetUp
from palpate.types.estimate import Answer

RATE, SPEED, DELAY, SIDEWAYS = 30.0, 0.06, 0.05, 0.002  # [Hz], [m/s] along x, [s], [m]
LATE = SetUp(sideways=(SIDEWAYS, 1e-4), delay=(DELAY, 0.01), depth=(3e-4, 4e-4), outline_scale=(0.0, 0.007))


def at(index: int, yaw: float = 0.0) -> Frame:
    return Frame(index / RATE, np.array([SPEED * index / RATE, 0.0, yaw]), contact=True)


def followed(frames: int) -> SensorCorrection:
    """Return a correction that has taken some frames."""
    correction = SensorCorrection(LATE)
    for index in range(frames):
        correction.accept(correction.corrected(at(index)))
    return correction


def test_a_frame_has_the_pose_of_the_time_of_its_image():
    found = followed(10).corrected(at(10))
    np.testing.assert_allclose(found.frame.sensor_pose, [SPEED * (10 / RATE - DELAY), -SIDEWAYS, 0.0], atol=1e-12)
    assert found.frame.time == 10 / RATE
    assert found.motion_since_image is not None
    np.testing.assert_allclose(found.motion_since_image, [SPEED * DELAY, 0.0, 0.0], atol=1e-12)


def test_the_first_frame_has_only_its_own_pose():
    found = SensorCorrection(LATE).corrected(at(0))
    np.testing.assert_allclose(found.frame.sensor_pose, [0.0, -SIDEWAYS, 0.0])
    assert found.motion_since_image is None


def test_a_frame_that_was_not_used_is_not_remembered():
    correction, expected = followed(10), followed(10)
    correction.corrected(Frame(10 / RATE, np.array([9.0, 9.0, 9.0]), contact=True))
    found, wanted = (each.corrected(at(11)).frame.sensor_pose for each in (correction, expected))
    np.testing.assert_array_equal(found, wanted)
    correction.reset()
    assert correction.corrected(at(11)).motion_since_image is None


@pytest.mark.parametrize("contact", [True, False])
def test_the_object_goes_with_the_sensor_in_contact_and_rests_without(contact):
    correction = followed(10)
    pose: Any = np.array([0.3, 0.1, 0.2])
    estimate = Estimate(10 / RATE, pose, np.eye(3), contact, "tracking", answers=(Answer(pose, np.eye(3), 1.0),))
    found = moved_on(estimate, correction.corrected(at(10)).motion_since_image)
    expected = pose + np.array([SPEED * DELAY * contact, 0.0, 0.0])
    np.testing.assert_allclose(found.pose, expected, atol=1e-12)
    np.testing.assert_allclose(found.answers[0].pose, expected, atol=1e-12)


def test_without_a_set_up_frames_stay_as_they_are():
    correction = SensorCorrection(None)
    frame = at(3)
    found = correction.corrected(frame)
    assert found.frame is frame and found.motion_since_image is None
