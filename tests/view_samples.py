"""A small push with images, tracked, for tests of what is shown."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.pipeline.run_folder import new_run, write_files
from palpate.pipeline.track import Run, track
from palpate.types.estimate import Answer
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile
from palpate.viewer.scene import Scene

CAMERA = SensorProfile(name="small", radius=0.01, half_width=0.006, image_height=40, image_width=30)
FRAMES, FIRST, LAST = 50, 20, 39
"""Frames, and the first and last of contact."""
LEARNT = (0.3, 0.05)
"""What is known of friction at the end."""


def without_display(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in this folder, on a Linux without a display, with lines of 120 columns."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def imaged_push() -> Recording:
    """A rectangle that is pushed along x in frames FIRST to LAST; its truth is not known in frames 3 and 4."""
    touching = np.zeros(FRAMES, np.bool_)
    touching[FIRST : LAST + 1] = True
    moved = 0.002 * np.cumsum(touching)
    truth: Any = np.column_stack([0.3 + moved, 0.05 + 0.0 * moved, 0.0 * moved])
    away = np.where(touching, 0.0, -0.02)
    sensor: Any = se2.compose(truth, np.column_stack([away - 0.05, 0.0 * away, 0.0 * away]))
    truth[3:5] = np.nan
    rng = np.random.default_rng(1)
    images = rng.normal(90.0, 1.0, (FRAMES, 40, 30, 3))
    images[touching, 10:30, 8:22] += 60.0
    encoded = tuple(encode_image(image.clip(0, 255).astype(np.uint8), "png") for image in images)
    time = np.arange(FRAMES) / 30.0
    return Recording(time, sensor, Rectangle(0.1, 0.06), CAMERA, truth, touching, image=encoded, codec="png")


@cache
def tracked_push() -> Run:
    """Its run, with a second answer in frame 30, and friction learnt in the last frame of contact."""
    run = track(imaged_push())
    known = run.online
    assert known.covariance is not None
    best = Answer(known.pose[30], known.covariance[30], 0.7)
    other = Answer(known.pose[30] + (0.01, 0.0, 0.1), 2.0 * known.covariance[30], 0.3)
    answers: Any = tuple((best, other) if index == 30 else () for index in range(FRAMES))
    friction = run.friction.copy()
    friction[LAST:] = LEARNT
    return replace(run, answers=answers, friction=friction)


def write_run(run: Run, folder: Path, force: bool = False) -> None:
    """Write the folder of a run."""
    with new_run(folder, force) as part:
        write_files(run, part)


def scene_of(run: Run, name: str) -> Scene:
    """What there is to see of a run."""
    return Scene(name, run.recording, run.truth, run.online, run.answers, run.friction, run.calibration)
