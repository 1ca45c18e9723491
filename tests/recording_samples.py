"""Recordings and trajectories that several tests use."""

from typing import Any

import numpy as np

from palpate import formats
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle, Shape
from palpate.recording.recording import Recording
from palpate.recording.sensor import POINT
from palpate.recording.trajectory import Trajectory


def runs(flags: Any) -> list[list[int]]:
    """Return the first index and end of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return edges.reshape(-1, 2).tolist()


def pushed(n: int = 40, shape: Shape | None = None) -> Any:
    """Return a recording with contact in frames 5 to 19 and 32 to 39, between which the object rests."""
    contact = np.zeros(n, np.bool_)
    contact[5:20] = contact[32:] = True
    moved = np.cumsum(contact) * 0.002
    pose: Any = np.column_stack([moved, 0.5 * moved, 3.0 + moved])
    sensor = se2.compose(pose, np.array([[-0.1, 0.0, 0.2]]))
    return Recording(np.arange(n) / 30, sensor, shape or Rectangle(0.2, 0.1), POINT, pose.astype(np.float64), contact)


def trajectory(n: int = 50, **changes: Any) -> Any:
    """Return n random estimates."""
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
    }
    return Trajectory(**(fields | changes))


def load(path: Any) -> Any:
    """Return the recording in a file; untyped, since its optional fields are known to be there."""
    return formats.load_recording(path)
