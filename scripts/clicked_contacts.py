"""Contacts with objects at rest, clicked on drawn outlines by hand: an outline that is learnt at known poses.

They are in ../shared/data/gpis_outlines. A tip of 5 mm touches each of them head on, and goes away before the next.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from _common import DATA
from scipy.io import loadmat

import palpate
from palpate import ContactDirection, Frame
from palpate.arrays import Array

FOLDERS = {"butter": "butter", "ellip2": "ellip", "rect1": "rect"}
PROBE = palpate.SensorProfile("probe", radius=0.005)
FIRST_SIGMA = (1e-4, 1e-4, 1e-3)
"""Of the pose, which is known [m, m, rad]."""
DIRECTION = 0.1
"""Deviation of a clicked direction [rad]: they are 2 to 14 degrees off."""
PRESSED = 3e-4
"""Indentation of the tip [m], as much as both estimators take for granted."""
APART = 0.5
"""Time from contact to contact [s]."""
Learn = Callable[[list[Frame]], palpate.Outline]
Score = Callable[[palpate.Outline, palpate.Shape], dict[str, float]]


def judged(learners: dict[str, Learn], score: Score) -> list[dict[str, Any]]:
    """Return the scores of each learner on each file; none where the data are absent."""
    found: list[dict[str, Any]] = []
    for path in sorted((DATA / "gpis_outlines/contacts").glob("*.txt")):
        name = path.stem.split("-")[1]
        shape = drawn(DATA / "gpis_outlines/shapes" / FOLDERS[name] / f"{name}.mat")
        contacts = np.loadtxt(path, delimiter=",")
        frames = touching(contacts)
        scores = {key: score(learn(frames), shape) for key, learn in learners.items()}
        found.append({"name": path.stem, "contacts": len(contacts), **scores})
    return found


def drawn(path: Path) -> palpate.Polygon:
    """Return an outline; points of the butterfly go back here and there, so that it crosses itself by micrometres."""
    points = loadmat(path)[f"{path.stem}_shape"]
    whole = shapely.Polygon(points).buffer(0.0)
    assert isinstance(whole, shapely.Polygon)
    return palpate.Polygon(np.asarray(whole.exterior.coords)[:-1])


def touching(contacts: Array) -> list[Frame]:
    """Return frames of contacts (C, 4): points [m] and outward directions; the tip is away between them."""
    frames: list[Frame] = []
    for k, (x, y, nx, ny) in enumerate(contacts):
        outward = np.array((nx, ny)) / np.hypot(nx, ny)
        yaw = np.arctan2(-ny, -nx)
        measured = (ContactDirection(0.0, DIRECTION**2),)
        apex, away = (np.array((*((x, y) + height * outward), yaw)) for height in (-PRESSED, 0.03))
        frames.append(Frame(APART * k, apex, contact=True, measurements=measured))
        frames.append(Frame(APART * (k + 0.5), away, contact=False))
    return frames
