"""Explore simulated objects of an unknown outline, beside the known one: docs/study/unknown_outline.json.

    python scripts/measure_unknown_outline.py [SECONDS]

Five outlines are pushed in turn, each recording 40 s of contacts from several sides, until SECONDS (300 by default)
are over or all COUNT recordings are done. Touch gives the true contact direction with the errors of an image. The
first contact puts the object frame where it truly is, so that errors are those of the motion since. One core.
"""

import sys
import time
from statistics import fmean, median
from typing import Any

import numpy as np
from _common import write

import palpate
from palpate import ContactDirection
from palpate.geometry import se2
from palpate.geometry.shapes import SHAPES
from palpate.pipeline.learnt_outline import in_frame_of_truth, outline_scores
from palpate_lab.parallel import quiet
from palpate_lab.simulate.paths import kinds
from palpate_lab.simulate.recordings import Simulation

SEED = 20261601
COUNT = 60
OBJECTS = ("triangle", "t", "butterfly", "hexagon", "rounded-square")
SIZE = (0.1, 0.3)
SIGMA = 0.035  # [rad] of a direction
BIAS = 0.01  # [rad] of all directions of a recording
LASTING = 0.9  # share of a direction's error that the next frame has, too
IN_95 = 7.815  # of chi squared with three degrees of freedom


def main(seconds: float) -> None:
    """Track as many recordings as fit, and write scores of each and of all together."""
    end = time.monotonic() + seconds
    found: list[dict[str, Any]] = []
    for number in range(COUNT):
        if time.monotonic() > end:
            break
        with quiet():
            found.append(tracked(number))
        print(found[-1], flush=True)
        write("unknown_outline", {"seed": SEED, "planned": COUNT, **summarised(found), "runs": found})


def tracked(number: int) -> dict[str, Any]:
    """Return the scores of one recording."""
    name = OBJECTS[number % len(OBJECTS)]
    shape = SHAPES[name]
    recording = Simulation(shape, kinds(shape)[0], SEED + number, seconds=40.0, images=False).run()
    unknown = estimated(recording, palpate.Unknown(SIZE), None, number)
    known = estimated(recording, shape, recording.truth[0], number)
    outline = unknown[-1].outline
    assert outline is not None
    off = np.abs(shape.signed_distance(outline.points))
    in_band = off <= 1.96 * outline.deviation
    return {
        "object": name,
        "unknown": pose_scores(unknown, recording),
        "known": pose_scores(known, recording),
        "outline_touched_in_95": float(in_band[outline.touched].mean()),
        **outline_scores(outline, recording),
    }


def estimated(
    recording: palpate.Recording, shape: Any, first: np.ndarray | None, number: int
) -> list[palpate.Estimate]:
    """Return the estimates with true directions, in the object frame of the truth."""
    rng = np.random.default_rng([SEED, number])
    bias = BIAS * rng.normal()
    error = 0.0
    tracker = palpate.Tracker(shape, recording.sensor, first, palpate.TrackerSettings("none"))
    estimates = []
    for frame, truth in zip(recording, recording.truth, strict=True):
        measured = []
        if frame.contact:
            error = LASTING * error + np.sqrt(1.0 - LASTING**2) * 0.7 * SIGMA * rng.normal()
            measured = [ContactDirection(true_direction(recording, frame, truth) + bias + error, SIGMA**2)]
        else:
            error = 0.0
        estimates.append(tracker.update(frame, measured))
    return in_frame_of_truth(estimates, recording.truth) if first is None else estimates


def true_direction(recording: palpate.Recording, frame: palpate.Frame, truth: np.ndarray) -> float:
    """Return the direction of the inward normal nearest to the tip, in the sensor frame [rad]."""
    in_object = se2.between(truth, frame.sensor_pose)
    tip = se2.transform(in_object, recording.sensor.center)
    steps = 1e-5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    right, left, up, down = recording.shape.signed_distance(tip + steps)
    return float(se2.wrap(np.arctan2(down - up, left - right) - in_object[2]))


def pose_scores(estimates: list[palpate.Estimate], recording: palpate.Recording) -> dict[str, float]:
    """Return errors and coverage of the poses since the first contact, and how often which status stood."""
    first = next(k for k, one in enumerate(estimates) if one.contact)
    kept = estimates[first:]
    truth = recording.truth[first:]
    pose = np.array([one.pose for one in kept])
    center = recording.shape.centroid
    apart = se2.transform(pose, center) - se2.transform(truth, center)
    off = se2.log(se2.between(pose, truth))
    covariance = np.array([one.covariance for one in kept])
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    far = np.hypot(*apart.T) > 0.01
    sure = np.array([one.status in ("tracking", "resting") for one in kept])
    return {
        "rms_mm": 1e3 * float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))),
        "rms_deg": float(np.degrees(np.sqrt(np.mean(se2.wrap(pose[:, 2] - truth[:, 2]) ** 2)))),
        "in_95": float(np.mean(squared <= IN_95)),
        "sure_share": float(np.mean(sure)),
        "silently_wrong_share": float(np.mean(sure & far)),
    }


def summarised(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the scores of all recordings together."""
    poses = {
        which: {f"{key}_median": median(one[which][key] for one in found) for key in ("rms_mm", "rms_deg")}
        | {"rms_mm_worst": max(one[which]["rms_mm"] for one in found)}
        | {key: fmean(one[which][key] for one in found) for key in ("in_95", "sure_share", "silently_wrong_share")}
        for which in ("known", "unknown")
    }
    ratios = [one["unknown"]["rms_mm"] / one["known"]["rms_mm"] for one in found]
    outline = {
        "recordings": len(found),
        "ratio_median": median(ratios),
        "touched_rms_mm_median": median(one["outline_rms_mm"] for one in found),
        "all_rms_mm_median": median(one["outline_all_rms_mm"] for one in found),
        "touched_in_95": fmean(one["outline_touched_in_95"] for one in found),
        "band_in_95": fmean(one["outline_in_95"] for one in found),
        "touched_share": fmean(one["outline_touched_share"] for one in found),
    }
    return {"recordings": len(found), "pose": poses, "outline": {"all": outline}}


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 300.0)
