"""Explore objects of an unknown outline, beside the known one and a sketch: docs/study/unknown_outline.json.

    python scripts/measure_unknown_outline.py [COUNT]

- Five simulated outlines in turn, COUNT recordings (60 by default) of 40 s of contacts from several sides, and a
  quarter as many in which something else moves the object in six of ten contacts and three of ten pauses.
- MIT's and CMU's real motion, where ../shared/data is there: all pushes of MIT, each other one of CMU.
- Contacts that were clicked on three outlines, where ../shared/data is there, with the object's pose known.

Beside them stands a Gaussian process and a factor graph in turn, as published; see `palpate_lab.tactile_slam`. It is
given the friction radius and the centroid of the true outline.

Touch gives the true contact direction with the errors of an image, drawn; the two tips of CMU's hand tell contact
alone. First poses are true. A sketch is the true outline, bent by 5 mm in harmonics. One core.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from _common import write
from clicked_contacts import FIRST_SIGMA as AT_REST
from clicked_contacts import PROBE, judged

import palpate
from palpate import ContactDirection
from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate_lab.parallel import quiet
from palpate_lab.simulate.paths import kinds
from palpate_lab.simulate.recordings import Simulation
from palpate_lab.tactile_slam.smoother import Pressure
from palpate_lab.tactile_slam.tracking import TactileSlam

SEED = 20261561
OBJECTS = ("triangle", "t", "butterfly", "hexagon", "rounded-square")
SHARED = Path(__file__).resolve().parents[2] / "shared/data"
SIGMA = 0.035  # [rad] of a direction
BIAS = 0.01  # [rad] of all directions of a recording
LASTING = 0.9  # share of a direction's error that the next frame has, too
IN_95 = 7.815  # of chi squared with three degrees of freedom
BENT = 5e-3  # [m] of a sketch
FIRST_SIGMA = (5e-4, 5e-4, 5e-3)
STATED = palpate.Unknown()
OF_STATUSES = ("sure_share", "silently_wrong_share")
"""Scores of statuses, which the baseline has not."""
Make = Callable[[], palpate.Recording]
Touched = list[tuple[palpate.Frame, list[ContactDirection]]]


def main(count: int) -> None:
    """Track all recordings, and write scores of each and of each kind together."""
    found: list[dict[str, Any]] = []
    with quiet():
        clicked = judged({"unknown": learnt, "baseline": learnt_by_baseline}, outline_score)
    contacts = {"clicked": {"together": summarised(clicked), "files": clicked}} if clicked else {}
    for number, (kind, name, make) in enumerate(planned(count)):
        with quiet():
            found.append({"kind": kind, "name": name, **tracked(make(), number)})
        print(found[-1], flush=True)
        write("unknown_outline", {"seed": SEED, "planned": count, **grouped(found), **contacts, "runs": found})


def grouped(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the scores of each kind of recordings together, by outline where they are simulated."""
    names = dict.fromkeys(one["name"] for one in found if one["kind"] == "simulated")
    kinds_found = dict.fromkeys(one["kind"] for one in found)
    return {
        "together": {kind: summarised([one for one in found if one["kind"] == kind]) for kind in kinds_found},
        "by_outline": {
            name: summarised([one for one in found if one["name"] == name and one["kind"] == "simulated"])
            for name in names
        },
    }


def planned(count: int) -> list[tuple[str, str, Make]]:
    """Return kind and name of each recording, and the function that makes it."""
    plan: list[tuple[str, str, Make]] = []
    for number in range(count):
        name = OBJECTS[number % len(OBJECTS)]
        plan.append(("simulated", name, lambda name=name, number=number: simulated(name, SEED + number)))
    for number in range(count, count + count // 4):
        name = OBJECTS[number % len(OBJECTS)]
        plan.append(("shoved", name, lambda name=name, number=number: simulated(name, SEED + number, shoved=True)))
    for kind, files in (
        ("MIT", sorted((SHARED / "mit_point_push").glob("*.json.gz"))),
        ("CMU", sorted((SHARED / "cmu_two_finger").glob("*.txt"))[::2]),
    ):
        for path in files:
            plan.append((kind, path.name, lambda path=path: palpate.load_recording(path)))
    return plan


def simulated(name: str, seed: int, shoved: bool = False) -> palpate.Recording:
    """Return an exploration of an outline."""
    shape = SHAPES[name]
    return Simulation(shape, kinds(shape)[0], seed, seconds=40.0, images=False, knocks=shoved).run()


def tracked(recording: palpate.Recording, number: int) -> dict[str, Any]:
    """Return the scores of one recording."""
    shape = recording.shape
    seen = touched(recording, number)
    begun = time.monotonic()
    unknown = estimated(recording, STATED, seen)
    ended = time.monotonic()
    baseline = estimated_by_baseline(recording, seen)
    of_baseline = pose_scores(baseline, recording) | outline_scores(baseline, recording)
    scores: dict[str, Any] = {
        "unknown": pose_scores(unknown, recording) | outline_scores(unknown, recording),
        "known": pose_scores(estimated(recording, shape, seen), recording),
        "baseline": {key: value for key, value in of_baseline.items() if key not in OF_STATUSES},
        "ms_a_frame": 1e3 * (ended - begun) / len(recording.truth),
    }
    sketch = sketched(shape, number)
    if sketch is not None:
        estimates = estimated(recording, sketch, seen)
        scores["sketch"] = pose_scores(estimates, recording) | outline_scores(estimates, recording)
    return scores


def sketched(shape: palpate.Shape, number: int) -> palpate.Sketch | None:
    """Return a sketch of an outline, bent across by low harmonics; None if a sketch cannot be of such a form."""
    rng = np.random.default_rng([SEED, number, 5])
    points = shape.outline(400)
    middle = np.asarray(shape.centroid)
    ray = points - middle
    angle = np.arctan2(ray[:, 1], ray[:, 0])
    bent = sum(rng.normal() * np.cos(order * angle + rng.uniform(0.0, 2.0 * np.pi)) for order in (2, 3, 4))
    bent = BENT * bent / np.sqrt(np.mean(np.square(bent)))
    try:
        drawn = palpate.Polygon(middle + ray * (1.0 + bent / np.hypot(*ray.T))[:, None])
        return palpate.Sketch(drawn, BENT)
    except palpate.PalpateError:
        return None


def touched(recording: palpate.Recording, number: int) -> Touched:
    """Return the frames, each with the true direction and its errors, which `number` draws."""
    rng = np.random.default_rng([SEED, number])
    bias = BIAS * rng.normal()
    error = 0.0
    is_one_tip = len(recording.sensor.tips) == 1
    seen: Touched = []
    for frame, truth in zip(recording, recording.truth, strict=True):
        measured: list[ContactDirection] = []
        if frame.contact and is_one_tip and np.isfinite(truth).all():
            error = LASTING * error + np.sqrt(1.0 - LASTING**2) * 0.7 * SIGMA * rng.normal()
            measured = [ContactDirection(true_direction(recording, frame, truth) + bias + error, SIGMA**2)]
        else:
            error = 0.0
        seen.append((frame, measured))
    return seen


def first_pose(recording: palpate.Recording) -> np.ndarray:
    """Return the first true pose (3,)."""
    return recording.truth[np.isfinite(recording.truth).all(axis=1)][0]


def estimated(recording: palpate.Recording, shape: Any, seen: Touched) -> list[palpate.Estimate]:
    """Return the estimates with a known outline, an unknown one, or a sketch."""
    settings = palpate.TrackerSettings("none")
    first = first_pose(recording)
    tracker = palpate.Tracker(shape, recording.sensor, first, settings, first_pose_sigma=FIRST_SIGMA)
    return [tracker.update(frame, measured) for frame, measured in seen]


def estimated_by_baseline(recording: palpate.Recording, seen: Touched) -> list[palpate.Estimate]:
    """Return the estimates of the baseline, of which the last alone has an outline."""
    shape = recording.shape
    covariance = np.diag(np.square(FIRST_SIGMA))
    pressure = Pressure(shape.friction_radius(), shape.centroid)
    slam = TactileSlam(STATED, recording.sensor, first_pose(recording), covariance, pressure)
    estimates: list[palpate.Estimate] = []
    for frame, measured in seen:
        slam.step(frame, measured)
        in_contact = bool(frame.contact)
        estimates.append(palpate.Estimate(frame.time, slam.pose, slam.covariance, in_contact, "uncertain"))
    estimates[-1] = replace(estimates[-1], outline=slam.outline())
    return estimates


def learnt(frames: list[palpate.Frame]) -> palpate.Outline:
    """Return the outline after contacts with an object at rest, whose pose is known."""
    settings = palpate.TrackerSettings("none")
    tracker = palpate.Tracker(STATED, PROBE, np.zeros(3), settings, first_pose_sigma=AT_REST)
    outline = [tracker.update(frame) for frame in frames][-1].outline
    assert outline is not None
    return outline


def learnt_by_baseline(frames: list[palpate.Frame]) -> palpate.Outline:
    """Return the same by the baseline; nothing moves, so that pressure does not matter."""
    pressure = Pressure(0.5 * STATED.mean_width, np.zeros(2))
    slam = TactileSlam(STATED, PROBE, np.zeros(3), np.diag(np.square(AT_REST)), pressure)
    for frame in frames:
        slam.step(frame, frame.measurements)
    return slam.outline()


def true_direction(recording: palpate.Recording, frame: palpate.Frame, truth: np.ndarray) -> float:
    """Return the direction of the inward normal nearest to the tip, in the sensor frame [rad]."""
    in_object = se2.between(truth, frame.sensor_pose)
    tip = se2.transform(in_object, recording.sensor.center)
    steps = 1e-5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    right, left, up, down = recording.shape.signed_distance(tip + steps)
    return float(se2.wrap(np.arctan2(down - up, left - right) - in_object[2]))


def pose_scores(estimates: list[palpate.Estimate], recording: palpate.Recording) -> dict[str, float]:
    """Return errors and coverage of the poses in contact, and how often which status stood."""
    kept = [k for k, one in enumerate(estimates) if one.contact and np.isfinite(recording.truth[k]).all()]
    truth = recording.truth[kept]
    pose = np.array([estimates[k].pose for k in kept])
    center = recording.shape.centroid
    apart = se2.transform(pose, center) - se2.transform(truth, center)
    off = se2.log(se2.between(pose, truth))
    covariance = np.array([estimates[k].covariance for k in kept])
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    far = np.hypot(*apart.T) > 0.01
    sure = np.array([estimates[k].status in ("tracking", "resting") for k in kept])
    return {
        "rms_mm": 1e3 * float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))),
        "rms_deg": float(np.degrees(np.sqrt(np.mean(se2.wrap(pose[:, 2] - truth[:, 2]) ** 2)))),
        "in_95": float(np.mean(squared <= IN_95)),
        "sure_share": float(np.mean(sure)),
        "silently_wrong_share": float(np.mean(sure & far)),
    }


def outline_scores(estimates: list[palpate.Estimate], recording: palpate.Recording) -> dict[str, float]:
    """Return how far the last outline is off, and how much of the true one its band holds."""
    outline = estimates[-1].outline
    assert outline is not None
    return outline_score(outline, recording.shape)


def outline_score(outline: palpate.Outline, shape: palpate.Shape) -> dict[str, float]:
    """Return how far an outline is off, and how much of the true one its band holds."""
    off = np.abs(shape.signed_distance(outline.points))
    in_band = off <= 1.96 * outline.deviation
    return {
        "touched_share": float(outline.touched.mean()),
        "touched_rms_mm": 1e3 * float(np.sqrt(np.mean(np.square(off[outline.touched])))),
        "touched_in_95": float(in_band[outline.touched].mean()),
        "all_rms_mm": 1e3 * float(np.sqrt(np.mean(np.square(off)))),
        "all_in_95": float(in_band.mean()),
    }


def summarised(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the scores of all recordings of a kind together."""
    together: dict[str, Any] = {"recordings": len(found)}
    for which in ("known", "unknown", "baseline", "sketch"):
        of_this = [one[which] for one in found if which in one]
        if not of_this:
            continue
        keys = of_this[0].keys()
        medians = {f"{key}_median": median(one[key] for one in of_this) for key in keys if "rms" in key}
        means = {key: fmean(one[key] for one in of_this) for key in keys if not key.startswith("rms")}
        worst = {f"{key}_worst": max(one[key] for one in of_this) for key in keys if key == "rms_mm"}
        together[which] = {"of": len(of_this), **medians, **worst, **means}
    return together


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
