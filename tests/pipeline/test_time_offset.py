"""The offset between the clocks of images and poses, from when contacts begin."""

from typing import Any

import numpy as np
import pytest

from palpate.config import NoiseSettings, SensorPoseSettings
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.pipeline.time_offset import TimeOffset, time_offset
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

SENSOR = SensorProfile(name="small", radius=0.02, half_width=0.01, image_height=96, image_width=72)
SHAPE = Rectangle(0.1, 0.2)
REST = np.array([0.3, -0.1, 0.5])
SPEED = 0.03
EXACT = NoiseSettings(sensor_pose=SensorPoseSettings(calibration=(0.0, 0.0, 0.0)))


def approach(late: float, speed: float = SPEED, frames: int = 90, truth: bool = False) -> Any:
    """The sensor reaches the rectangle 50 mm before its centre; what images show is stamped `late` [s]."""
    rng = np.random.default_rng(6)
    time = np.arange(frames) / 30
    along = np.column_stack([-0.1 + speed * time, np.zeros(frames), np.zeros(frames)])
    shown = -0.1 + speed * (time - late) >= -0.05
    images = rng.normal(120, 2, (frames, 96, 72, 3))
    images[shown, 30:60, 20:50] += 40
    return Recording(
        time=time,
        sensor_pose=se2.compose(REST[None], along),
        shape=SHAPE,
        sensor=SENSOR,
        object_pose=np.tile(REST, (frames, 1)) if truth else None,
        image=tuple(encode_image(image.astype(np.uint8), "png") for image in images),
        codec="png",
    )


def offset(recording: Recording, pose: Any, sigma: float = 1e-3) -> TimeOffset:
    """The object's first position is known to `sigma` [m]; ground truth has an error of 1 mm."""
    return time_offset(recording, pose, (sigma, 1e-9, 1.0), EXACT)


@pytest.mark.parametrize("late", [-0.2, 0.0, 0.15])
def test_late_images_are_found(late):
    found = offset(approach(late), REST)
    assert found.contacts == 1
    assert found.seconds == pytest.approx(-late, abs=1 / 60 + 1e-6)  # half a frame
    assert found.sigma == pytest.approx(np.hypot(np.hypot(1e-3, 3e-4) / SPEED, 1 / 30 / np.sqrt(12)), rel=1e-3)


def test_a_wrong_pose_is_within_sigma_and_a_slow_approach_tells_less():
    moved = se2.compose(REST, [0.002, 0.0, 0.0])
    found = offset(approach(0.1), moved, 2e-3)
    assert found.seconds + 0.1 == pytest.approx(0.002 / SPEED, abs=1 / 60 + 1e-6)
    assert abs(found.seconds + 0.1) < 2 * found.sigma
    slow = offset(approach(0.1, speed=0.02), REST)
    assert slow.sigma > 1.3 * offset(approach(0.1), REST).sigma


def test_ground_truth_before_a_contact_stands_for_a_first_pose():
    found = offset(approach(0.1, truth=True), None)
    assert found.seconds == offset(approach(0.1), REST).seconds


def test_where_nothing_tells():
    away = se2.compose(REST, [0.5, 0.0, 0.0])
    for recording, pose in ((approach(0.1), away), (approach(0.1), None), (approach(0.1, frames=30), REST)):
        with pytest.raises(SettingError, match="no contact shows the time offset"):
            offset(recording, pose)
