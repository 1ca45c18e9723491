"""How an object is found of which nothing is known: python benchmarks/unknown_start.py FOLDER_OF_RECORDINGS

Each recording with images and ground truth is tracked from a first pose within 60 mm of the true one, at any yaw, both
drawn from its name. After its third contact, or its last, the error is that to the nearest pose at which the outline
looks the same within 5 mm; it is found within 5 mm and 3 degrees, and honest where the truth is in the 95 % region or
the status is `ambiguous`. Beside it stands what is found where the first pose is told as it is: no search finds more.
The reported one: `palpate simulate` of 40 pushes, 10 each of rectangle, ellipse, triangle and t, seed 63601.
"""

import json
import sys
import zlib
from pathlib import Path
from statistics import fmean, median

import numpy as np

from palpate import Tracker, load_recording
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.pipeline.metrics import inside_95, nees

FAR, SIGMA = 0.06, (0.03, 0.03, 1.8)  # [m] of the first pose, and what is said of it [m, m, rad]
TOLD = (5e-4, 5e-4, 5e-3)  # [m, m, rad] of a first pose that is told as it is
SAME = 5e-3  # [m]
FOUND_MM, FOUND_DEG = 5.0, 3.0
CONTACTS = 3


def turned_about(point: np.ndarray, angle: float) -> np.ndarray:
    """The pose (3,) that turns an object about a point of its own (2,)."""
    return np.array([*(point - se2.transform([0.0, 0.0, angle], point)), angle])


def symmetries(shape: Shape) -> list[np.ndarray]:
    """Poses (3,) in the object frame at which the outline looks the same."""
    outline, centroid = shape.outline(200), shape.centroid
    for fold in (6, 4, 3, 2):
        turns = [turned_about(centroid, 2.0 * np.pi * k / fold) for k in range(fold)]
        if np.abs(shape.signed_distance(se2.transform(turns[1], outline))).max() < SAME:
            return turns
    return [np.zeros(3)]


def judged(file: Path, told: bool = False) -> tuple[float, float, bool]:
    """Error [mm], [deg] after the contacts, and whether the estimate is honest; `told` the true first pose or not."""
    recording = load_recording(file)
    assert recording.object_pose is not None
    rng = np.random.default_rng(zlib.crc32(file.stem.encode()))
    off, yaw = rng.normal(size=2), rng.uniform(-np.pi, np.pi)
    off *= FAR * np.sqrt(rng.uniform()) / np.hypot(*off)
    first = se2.compose(recording.object_pose[0], turned_about(recording.shape.centroid, yaw))
    first[:2] += off
    if told:
        first = recording.object_pose[0]
    tracker = Tracker(recording.shape, recording.sensor, first, first_pose_sigma=TOLD if told else SIGMA)
    contacts = 0
    before = last = None
    for frame, truth in zip(recording, recording.object_pose, strict=True):
        estimate = tracker.update(frame)
        if before is not None and before.contact and not estimate.contact:
            last, contacts = (before, truth), contacts + 1
            if contacts == CONTACTS:
                break
        before = estimate
    if last is None:
        raise SystemExit(f"{file}: no contact ends")
    estimate, truth = last
    same = np.array([se2.compose(truth, turn) for turn in symmetries(recording.shape)])
    millimetres = 1e3 * np.hypot(*(estimate.pose - same)[:, :2].T)
    degrees = np.abs(np.degrees(se2.wrap(estimate.pose[2] - same[:, 2])))
    nearest = int(np.argmin(millimetres + degrees))
    is_inside = inside_95(
        nees(np.tile(estimate.pose, (len(same), 1)), np.tile(estimate.covariance, (len(same), 1, 1)), same)
    )
    return float(millimetres[nearest]), float(degrees[nearest]), bool(is_inside.any()) or estimate.status == "ambiguous"


def is_found(millimetres: float, degrees: float) -> bool:
    """Whether an estimate that is so far off is right."""
    return bool(millimetres < FOUND_MM and degrees < FOUND_DEG)


def main() -> None:
    """Judge all recordings of a folder, and print shares and a row for each as JSON."""
    rows = []
    for file in sorted(Path(sys.argv[1]).glob("*.h5")):
        millimetres, degrees, is_honest = judged(file)
        errors = {"recording": file.stem, "mm": millimetres, "deg": degrees}
        found, if_told = is_found(millimetres, degrees), is_found(*judged(file, told=True)[:2])
        rows.append({**errors, "found": found, "found_if_told": if_told, "honest": is_honest})
    shares = {
        "found_share": fmean(row["found"] for row in rows),
        "found_if_told_share": fmean(row["found_if_told"] for row in rows),
        "honest_share": fmean(row["honest"] for row in rows),
        "median_mm": median(row["mm"] for row in rows),
    }
    print(json.dumps({"recordings": len(rows), **shares, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
