"""A small push with images for tests of live sessions and views."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import encoded

from palpate import Hand, Recording, Rectangle, SensorProfile

CAMERA = SensorProfile(name="small", radius=0.01, half_width=0.006, image_height=40, image_width=30)
FRAMES, FIRST, LAST = 50, 20, 39
"""Frames, and the first and last of contact."""


def without_display(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in this folder, on a Linux without a display, with lines of 120 columns."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def imaged_push() -> Recording:
    """A rectangle that is pushed along x in frames FIRST to LAST; its truth is unknown in frames 3 and 4."""
    touching = np.zeros(FRAMES, np.bool_)
    touching[FIRST : LAST + 1] = True
    moved = 0.002 * np.cumsum(touching)
    truth: Any = np.column_stack([0.3 + moved, 0.05 + 0.0 * moved, 0.0 * moved])
    sensor: Any = truth - np.column_stack([np.where(touching, 0.05, 0.07), 0.0 * moved, 0.0 * moved])
    truth[3:5] = np.nan
    images = np.random.default_rng(1).normal(90.0, 1.0, (FRAMES, 40, 30, 3))
    images[touching, 10:30, 8:22] += 60.0
    coded = tuple(encoded(image.clip(0, 255).astype(np.uint8)) for image in images)
    time = np.arange(FRAMES) / 30.0
    return Recording(time, sensor, Rectangle(0.1, 0.06), CAMERA, truth, touching, image=coded)


def imaged_push_of_hand() -> Recording:
    """The same push by a hand of two such sensors, which both touch and see other noise; it begins at 0 s."""
    one = imaged_push()
    assert one.image is not None
    hand = Hand({"left": CAMERA, "right": CAMERA}, {"left": (0.0, 0.012, 0.0), "right": (0.0, -0.012, 0.0)})
    other = [encoded(np.ascontiguousarray(np.flip(np.asarray(frame.image), 1))) for frame in one]
    images = {"left": one.image, "right": other}
    return Recording(one.time, one.sensor_pose, one.shape, hand.whole, one.object_pose, hand=hand, images=images)
