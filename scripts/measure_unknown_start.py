"""Count the objects that are found from a first pose that is hardly known: docs/study/unknown_start.json.

    palpate simulate FOLDER --count 10 --shape rectangle --shape ellipse --shape triangle --shape t --seed 20261215
    python scripts/measure_unknown_start.py FOLDER

Tracking begins within 60 mm of the true pose, at any yaw, both drawn from the recording's name. An object is found if
the estimate at the end of the third contact, or of the last one, is within 5 mm and 3 degrees of a pose at which the
outline looks the same to 5 mm; the answer is honest if the truth is in the 95 % region or the status is `ambiguous`.
"""

import sys
import zlib
from pathlib import Path
from statistics import fmean

import numpy as np
from _common import for_each, write

import palpate
from palpate.geometry import se2
from palpate.pipeline.metrics import inside_95, nees
from palpate_lab.study.recordings import find_recordings

REACH = 0.06
"""Largest offset of the first pose [m]."""
SIGMA = (0.03, 0.03, 1.8)
"""Standard deviations of the first pose as they are stated [m, m, rad]."""
KNOWN = (5e-4, 5e-4, 5e-3)
"""Standard deviations of a first pose that is given [m, m, rad]."""


def main(folder: Path) -> None:
    """Judge all recordings and write the shares."""
    rows = for_each(judged, find_recordings(folder).values())
    shares = {f"{name}_share": fmean(row[name] for row in rows) for name in ("found", "honest", "found_if_told")}
    write("unknown_start", {"recordings": len(rows), **shares})


def judged(file: Path) -> dict[str, bool]:
    """Return the verdict on a recording from an unknown start, and from the true first pose."""
    recording = palpate.load_recording(file)
    assert recording.object_pose is not None
    found, honest = tracked(recording, drawn_first_pose(recording, file.stem), SIGMA)
    return {"found": found, "honest": honest, "found_if_told": tracked(recording, recording.object_pose[0], KNOWN)[0]}


def drawn_first_pose(recording: palpate.Recording, name: str) -> np.ndarray:
    """Return a first pose within REACH of the true one, at any yaw, that the recording's name determines."""
    assert recording.object_pose is not None
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    offset = rng.normal(size=2)
    yaw = rng.uniform(-np.pi, np.pi)
    offset *= REACH * np.sqrt(rng.uniform()) / np.hypot(*offset)
    first = se2.compose(recording.object_pose[0], turn_about(recording.shape.centroid, yaw))
    first[:2] += offset
    return first


def tracked(recording: palpate.Recording, first: np.ndarray, sigma: tuple[float, float, float]) -> tuple[bool, bool]:
    """Return if the object is found after three contacts, and if the answer is honest."""
    tracker = palpate.Tracker(recording.shape, recording.hand or recording.sensor, first, first_pose_sigma=sigma)
    ends: list[tuple[palpate.Estimate, np.ndarray]] = []
    before = None
    for frame in recording:
        estimate = tracker.update(frame)
        if before is not None and before.contact and not estimate.contact:
            ends.append((before, np.asarray(frame.object_pose)))
            if len(ends) == 3:
                break
        before = estimate
    estimate, truth = ends[-1]
    same = np.array([se2.compose(truth, turn) for turn in symmetries(recording.shape)])
    mm = 1e3 * np.hypot(*(estimate.pose - same)[:, :2].T)
    deg = np.abs(np.degrees(se2.wrap(estimate.pose[2] - same[:, 2])))
    best = int(np.argmin(mm + deg))
    pose = np.tile(estimate.pose, (len(same), 1))
    covariance = np.tile(estimate.covariance, (len(same), 1, 1))
    inside = inside_95(nees(pose, covariance, same))
    return bool(mm[best] < 5.0 and deg[best] < 3.0), bool(inside.any()) or estimate.status == "ambiguous"


def symmetries(shape: palpate.Shape) -> list[np.ndarray]:
    """Return the poses (3,) in the object frame at which the outline looks the same to 5 mm."""
    for fold in (6, 4, 3, 2):
        turns = [turn_about(shape.centroid, 2.0 * np.pi * k / fold) for k in range(fold)]
        if np.abs(shape.signed_distance(se2.transform(turns[1], shape.outline(200)))).max() < 5e-3:
            return turns
    return [np.zeros(3)]


def turn_about(point: np.ndarray, angle: float) -> np.ndarray:
    """Return the pose (3,) that turns an object about a point of its own (2,)."""
    return np.array([*(point - se2.transform([0.0, 0.0, angle], point)), angle])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
