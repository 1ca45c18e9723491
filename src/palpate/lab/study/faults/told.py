"""Faults of what a tracker is told: where the object is at first, and its outline."""

from dataclasses import replace

import numpy as np

from palpate.geometry import se2
from palpate.geometry.shapes import scaled
from palpate.lab.study.faults.stream import Stream


def first_pose_off(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Put the first pose off by a length [m] in any direction and an angle [deg]; the tracker is not told."""
    angle = rng.uniform(-np.pi, np.pi)
    off = (length * np.cos(angle), length * np.sin(angle), np.radians(degrees) * rng.choice([-1.0, 1.0]))
    return replace(stream, first_pose=se2.compose(stream.first_pose, off)).from_contact()


def outline_off(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Let the told outline be larger than the object by this share of every length."""
    return replace(stream, shape=scaled(stream.shape, 1.0 + share)).from_contact()
