"""A small push with images, and its run, for tests of live sessions and views."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from palpate import Frame, Recording, Rectangle, Run, SensorProfile, Tracker, track

CAMERA = SensorProfile(name="small", radius=0.01, half_width=0.006, image_height=40, image_width=30)
FRAMES, FIRST, LAST = 50, 20, 39
"""Frames, and the first and last of contact."""
LEARNT = (0.3, 0.05)
"""Friction as known at the end."""


def without_display(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in this folder, on a Linux without a display, with lines of 120 columns."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def png(image: Any) -> bytes:
    """Return a grey image as PNG."""
    return cv2.imencode(".png", image.clip(0, 255).astype(np.uint8))[1].tobytes()


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
    encoded = tuple(map(png, images))
    time = np.arange(FRAMES) / 30.0
    return Recording(time, sensor, Rectangle(0.1, 0.06), CAMERA, truth, touching, image=encoded, codec="png")


@cache
def tracked_push() -> Run:
    """Its run, with a second answer in frame 30, and friction learnt in the last frame of contact."""
    push = imaged_push()
    run, known = track(push), None
    assert run.online.covariance is not None and push.object_pose is not None
    tracker = Tracker(push.shape, push.sensor, push.object_pose[0])
    known = tracker.update(Frame(0.0, push.sensor_pose[0], push[0].image)).answers[0]
    pose, covariance = run.online.pose[30], run.online.covariance[30]
    best = replace(known, pose=pose, covariance=covariance, weight=0.7)
    other = replace(known, pose=pose + np.array([0.01, 0.0, 0.1]), covariance=2.0 * covariance, weight=0.3)
    answers: Any = tuple((best, other) if index == 30 else () for index in range(FRAMES))
    friction = run.friction.copy()
    friction[LAST:] = LEARNT
    return replace(run, answers=answers, friction=friction)
