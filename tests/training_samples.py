"""Recordings to learn from, made by hand."""

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from planar import compose
from recording_samples import encoded

from palpate import DIGIT, Disc, Recording, Rectangle, Shape, write_recording

SENSOR = dataclasses.replace(DIGIT, name="small", image_height=64, image_width=128, pixel_pitch=1.4375e-4)
"""Of this pixel pitch, directions are what a model reads."""
RECTANGLE, DISC = Rectangle(0.10, 0.06), Disc(0.04)
UNTOUCHED, TOUCHED = 10, 64  # frames before a contact of `pushes`, and in it


def on_left_side(y: Any, theta: Any) -> Any:
    """Poses (N, 3) of the sensor in the frame of RECTANGLE that touch its left side at (-0.05, y)."""
    y, theta = np.broadcast_arrays(np.atleast_1d(y).astype(float), theta)
    # The tip's centre lies its radius off the side, and behind the apex by as much, along the sensor's x.
    return np.stack([-0.05 + DIGIT.radius * (np.cos(theta) - 1), y + DIGIT.radius * np.sin(theta), theta], axis=1)


def on_disc(angle: Any, theta: Any) -> Any:
    """Poses (N, 3) of the sensor in the frame of DISC that touch it in the direction `angle` from its middle."""
    angle, theta = np.broadcast_arrays(np.atleast_1d(angle).astype(float), theta)
    center = (DISC.radius + DIGIT.radius) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    apex = center + DIGIT.radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    return np.column_stack([apex, theta])


def recording(g: Any, contact: Any, shape: Shape = RECTANGLE, where: Any = None, **changes: Any) -> Recording:
    """A recording of poses of the sensor in the object frame (N, 3), while the object turns in the world.

    `where` (N,) is where along the columns, from -1 to 1, the image of a touched frame is bright.
    """
    count = len(g)
    pose = np.column_stack([np.linspace(1.0, 1.1, count), np.full(count, -2.0), np.linspace(2.9, 3.4, count)])
    contact = np.asarray(contact, dtype=bool)
    where = np.zeros(count) if where is None else where
    seen = [at if touched else None for at, touched in zip(where, contact, strict=True)]
    fields = {
        "time": np.arange(count) / 30,
        "sensor_pose": compose(pose, g),
        "shape": shape,
        "sensor": SENSOR,
        "object_pose": pose,
        "contact": contact,
        "image": [image(at, frame) for frame, at in enumerate(seen)],
    }
    return Recording(**(fields | changes))


def image(at: float | None = None, seed: int = 0) -> bytes:
    """A PNG of SENSOR's size: a noisy grey gel, brighter around `at`, -1 to 1 along the columns."""
    height, width = SENSOR.image_height, SENSOR.image_width
    levels = _noise(seed % 7) + np.array([90.0, 100.0, 110.0])
    if at is not None:
        column, row = np.arange(width) - 0.5 * width * (1.0 + 0.8 * at), np.arange(height) - 0.5 * height
        levels = levels + 60.0 * np.exp(-(np.add.outer(row**2, column**2)) / (2.0 * 8.0**2))[..., None]
    return encoded(np.clip(levels, 0, 255).astype(np.uint8))


@cache
def _noise(seed: int) -> Any:
    return np.random.default_rng(seed).normal(0.0, 1.0, (SENSOR.image_height, SENSOR.image_width, 3))


def pushes(shape: Shape, contacts: int, seed: int = 0) -> Recording:
    """A recording with contacts in which the sensor turns by up to 0.5 rad; the bright spot tells by how much."""
    rng = np.random.default_rng(seed)
    parts, touched, seen = [], [], []
    for _ in range(contacts):
        turn = 0.5 * np.sin(rng.uniform(0.0, 6.0) + np.linspace(0.0, rng.uniform(2.0, 5.0), TOUCHED))
        if isinstance(shape, Disc):
            angle = rng.uniform(-3.0, 3.0)
            g, direction = on_disc(angle, angle + np.pi + turn), -turn
        else:
            g, direction = on_left_side(rng.uniform(-0.028, 0.028), turn), -turn
        lifted = compose(g[0], [-0.01, 0.0, 0.0])
        parts += [np.tile(lifted, (UNTOUCHED, 1)), g]
        touched += [np.zeros(UNTOUCHED, bool), np.ones(TOUCHED, bool)]
        seen += [np.zeros(UNTOUCHED), direction]
    return recording(np.concatenate(parts), np.concatenate(touched), shape, np.concatenate(seen) / 0.6)


def write_pushes(folder: Path) -> Path:
    """Write four recordings of three contacts each, which are 720 frames, and one without images; return `folder`."""
    for seed in range(4):
        write_recording(pushes((DISC, RECTANGLE)[seed % 2], 3, seed), folder / f"push-{seed}.mcap")
    write_recording(dataclasses.replace(pushes(DISC, 1), image=None), folder / "bare.mcap")
    return folder
