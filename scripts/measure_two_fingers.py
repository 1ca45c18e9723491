"""How pushes by a hand of two fingers are tracked: docs/study/two_fingers.json.

    python scripts/measure_two_fingers.py [--seed 89102] [--count 12] [--out docs/study/two_fingers.json]

The hand is that of the real recordings by CMU; each of some objects is pushed about by it in the simulator, `count`
times, with the errors of a real set-up. A recording is tracked with its true relative yaw and without any touch: where
the fingers are is all there is besides. What is reported is what it does unasked. A minute on two cores.
"""

import argparse
import json
from contextlib import closing
from pathlib import Path
from statistics import fmean, median

import numpy as np

from palpate.config.tracker_settings import TrackerSettings
from palpate.geometry.shapes import Shape
from palpate.io.cmu_two_finger import HAND
from palpate.lab.simulate.objects import find_shape
from palpate.lab.simulate.pushes import draw_sequence, measured
from palpate.lab.simulate.systematic import draw_errors, misstated
from palpate.parallel import spread
from palpate.pipeline.quiet import quiet
from palpate.pipeline.run import track
from palpate.touch.modes import Tactile
from palpate.types.recording import Recording

OUT = Path(__file__).parents[1] / "docs/study/two_fingers.json"
OBJECTS = {"rectangle": "rectangle-edges", "ellipse": "ellipse", "disc": "disc", "triangle": "polygon-edges"}
"""Names of objects, and the kind of contact."""
TOUCH: tuple[Tactile, ...] = ("oracle", "none")
SECONDS = 12.0


def main(seed: int, count: int, out: Path) -> None:
    """Simulate and track all recordings, and write."""
    each = [(name, seed, number) for name in OBJECTS for number in range(count)]
    with closing(spread(scores, each, workers=2)) as results:
        found = list(results)
    rows = {touch: summarised([scores[touch] for scores in found]) for touch in TOUCH}
    out.write_text(json.dumps({"recordings": len(found), "touch": rows}, indent=2) + "\n", encoding="utf-8")


def summarised(scores: list[dict[str, float]]) -> dict[str, float]:
    """Return medians and means over recordings."""
    of = {name: [one[name] for one in scores] for name in scores[0]}
    middle = {f"{name}_median": median(of[name]) for name in ("final_mm", "final_deg")}
    names = ("final_mm", "inside_contact", "inside_final", "silent")
    return middle | {f"{name}_mean": fmean(of[name]) for name in names} | {"final_mm_worst": max(of["final_mm"])}


def scores(which: tuple[str, int, int]) -> dict[Tactile, dict[str, float]]:
    """Return how a recording is tracked with each touch: final errors, shares in the region and silently wrong."""
    name, seed, number = which
    recording = simulated(find_shape(name)[1], OBJECTS[name], np.random.default_rng([seed, number]))
    with quiet():
        return {touch: scored(recording, TrackerSettings(touch)) for touch in TOUCH}


def simulated(shape: Shape, kind: str, rng: np.random.Generator) -> Recording:
    """Draw pushes by the hand, and what is measured and stated of them."""
    errors = draw_errors(rng)
    sequence = draw_sequence(shape, kind, HAND, rng, SECONDS, gel_drift=errors.gel_drift)
    exact = Recording(
        time=sequence.time,
        sensor_pose=measured(sequence.sensor_pose, rng),
        shape=shape,
        sensor=HAND,
        object_pose=measured(sequence.motion.object_pose, rng),
        contact=sequence.motion.contact,
    )
    return misstated(exact, errors)


def scored(recording: Recording, settings: TrackerSettings) -> dict[str, float]:
    """Track a recording, and return its scores."""
    summary = track(recording, settings).summary
    return {
        "final_mm": summary["final_translation_error_mm"],
        "final_deg": summary["final_rotation_error_deg"],
        "inside_contact": summary["in_95_contact_share"],
        "inside_final": float(summary["in_95_final"]),
        "silent": summary["silently_wrong_share"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Tracks pushes by two fingers.")
    parser.add_argument("--seed", type=int, default=89102)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    main(given.seed, given.count, given.out)
