"""Recordings and trajectories that several tests use."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from planar import compose

import palpate
from palpate import POINT, Disc, Recording, Rectangle, SensorProfile, Shape, Trajectory

UNSTATED: Any = {"first_pose": None, "first_pose_sigma": None}
"""What a copy of a recording needs in order not to keep its first pose."""
BLIND: Any = {"object_pose": None, **UNSTATED}
TINY_CAMERA = SensorProfile(name="tiny", radius=0.01, image_height=12, image_width=8)


def runs(flags: Any) -> list[list[int]]:
    """Return the first index and end of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return edges.reshape(-1, 2).tolist()


def encoded(image: Any, codec: str = "png") -> bytes:
    """Return an RGB image as bytes, by OpenCV at its default quality of 95."""
    return cv2.imencode(f".{codec}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()


def pushed(n: int = 40, shape: Shape | None = None) -> Any:
    """Return a recording with contact in frames 5 to 19 and 32 to 39, between which the object rests."""
    contact = np.zeros(n, np.bool_)
    contact[5:20] = contact[32:] = True
    moved = np.cumsum(contact) * 0.002
    pose: Any = np.column_stack([moved, 0.5 * moved, 3.0 + moved])
    sensor = compose(pose, np.array([[-0.1, 0.0, 0.2]]))
    return Recording(np.arange(n) / 30, sensor, shape or Rectangle(0.2, 0.1), POINT, pose.astype(np.float64), contact)


def seen(recording: Any) -> Any:
    """Return the recording with images of 48 x 32 px: grey, with noise, and brighter in a corner where it touches."""
    images = 100.0 + np.random.default_rng(0).normal(0.0, 2.0, (len(recording), 48, 32, 3))
    images[recording.contact, :20, :20] += 60.0
    coded = tuple(encoded(np.rint(image).astype(np.uint8)) for image in images)
    return replace(recording, sensor=replace(POINT, image_height=48, image_width=32), image=coded)


def trajectory(n: int = 50, **changes: Any) -> Any:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(n, 3, 3))
    pose = rng.normal(size=(n, 3))
    pose[:, 2] = rng.uniform(-np.pi, np.pi, n)
    fields: dict[str, Any] = {
        "time": np.cumsum(rng.uniform(0.01, 0.1, n)),
        "pose": pose,
        "covariance": root @ root.transpose(0, 2, 1),
        "contact": rng.random(n) > 0.5,
        "status": tuple(rng.choice(["ok", 'lost, "quite"', "a\nb"], n)),
        "reason": ("",) * n,
    }
    return Trajectory(**(fields | changes))


def tiny_images(n: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).integers(0, 256, (n, 12, 8, 3), np.uint8)


def tiny_recording(n: int = 5, **changes: Any) -> Any:
    """Return n random frames with images, and an object pose that is not known in the second."""
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(n, 3))
    truth[1:2] = np.nan
    fields = {
        "time": np.arange(n) / 30.0,
        "sensor_pose": rng.normal(size=(n, 3)),
        "shape": Disc(0.05),
        "sensor": TINY_CAMERA,
        "object_pose": truth,
        "contact": np.arange(n) > 1,
        "image": tuple(encoded(image) for image in tiny_images(n)),
        "source": "a test, with ünicode",
        "first_pose": np.array([0.1, -0.2, 3.0]),
        "first_pose_sigma": np.array([0.01, 0.02, 0.3]),
    }
    return Recording(**(fields | changes))


def load(path: Any) -> Any:
    """Return the recording in a file; untyped, since its optional fields are known to be there."""
    return palpate.load_recording(path)
