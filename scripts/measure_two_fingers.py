"""Track simulated pushes by a hand of two fingers: docs/study/two_fingers.json.

    python scripts/measure_two_fingers.py [COUNT]

The hand is that of CMU's real recordings; it pushes each of four objects COUNT times (12 by default), with the errors
of a set-up. Each push is tracked with the true relative yaw and without touch. A minute on two cores.
"""

import sys
from statistics import fmean, median

import numpy as np
from _common import for_each, scores, write
from traced import pushed_by_two_fingers

import palpate
from palpate.pipeline.track import track
from palpate_lab.simulate.set_up_errors import draw_errors, with_errors

SEED = 20261228
OBJECTS = ("rectangle edges", "ellipse", "disc", "triangle edges")


def main(count: int) -> None:
    """Simulate and track all pushes, and write medians and means of their scores."""
    found = for_each(tracked, [(name, number) for name in OBJECTS for number in range(count)])
    rows = {touch: summarised([each[touch] for each in found]) for touch in ("oracle", "none")}
    write("two_fingers", {"recordings": len(found), "touch": rows})


def tracked(which: tuple[str, int]) -> dict[str, dict[str, float]]:
    """Return the scores of one push by the kind of touch."""
    name, number = which
    recording = simulated(name, np.random.default_rng([SEED, number]))
    oracle = palpate.TrackerSettings("oracle")
    none = palpate.TrackerSettings("none")
    return {"oracle": scores(track(recording, oracle).summary), "none": scores(track(recording, none).summary)}


def simulated(what: str, rng: np.random.Generator) -> palpate.Recording:
    """Draw a push by the hand, with the errors of a set-up."""
    errors = draw_errors(rng)
    return with_errors(pushed_by_two_fingers(what, rng, 12.0, gel_drift=errors.gel_drift), errors)


def summarised(found: list[dict[str, float]]) -> dict[str, float]:
    """Return medians and the worst of final errors, and means of shares."""
    of = {name: [each[name] for each in found] for name in found[0]}
    medians = {f"{name}_median": median(of[name]) for name in ("final_mm", "final_deg")}
    means = {f"{name}_mean": fmean(of[name]) for name in ("inside_contact", "inside_final", "silent")}
    return medians | means | {"final_mm_worst": max(of["final_mm"])}


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
