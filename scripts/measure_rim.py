"""Measure what it costs that no image shows a contact at the pad's hard rim: docs/study/rim.json.

    python scripts/measure_rim.py [PAIRS] [SEED]

Pushes without errors of a set-up are drawn until so many of them have a contact that ends at the rim. Both recordings
of a pair are of one seed, and so of the same motion and noise; one has a gel that is soft up to its edge. A recording
takes four seconds to make and to track.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from _common import clipped_rmse, for_each, paired, pooled_rmse, write

import palpate
from palpate import Recording
from palpate.geometry.shapes import SHAPES
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import track
from palpate_lab.simulate.recordings import COUNT, Simulation, plan

AT_RIM = np.radians(20.0)
"""Angle on the pad [rad] beyond which images lose a contact."""
LEAST_FRAMES = 10
"""Frames at the end of a contact that are at the rim."""


def main(pairs: int, seed: int) -> None:
    """Make and track pairs of recordings and write the scores of both halves."""
    found = for_each(pair_of_scores, list(islice(ending_at_rim(seed), pairs)))
    with_rim = [with_rim for with_rim, _ in found]
    without = [without for _, without in found]
    more_mm = paired((each["rmse_mm"] for each in without), (each["rmse_mm"] for each in with_rim))
    rows = {"without": pooled(without), "with": pooled(with_rim), "more_rmse_mm": more_mm}
    write("rim", {"pairs": len(found), "seed": seed, **rows})


def ending_at_rim(seed: int) -> Iterator[Simulation]:
    """Yield the simulations that have a contact which ends at the rim."""
    for simulation in plan(SHAPES, COUNT // 100, seed, ideal=True).values():
        recording = replace(simulation, images=False).run()
        assert recording.contact is not None
        is_at_rim = np.abs(recording.extra["pad_angle"]) > AT_RIM
        for _, last in flag_runs(recording.contact):
            if is_at_rim[last - LEAST_FRAMES : last].all():
                yield simulation
                break


def pair_of_scores(simulation: Simulation) -> tuple[dict[str, float], dict[str, float]]:
    """Return the scores of a recording as it is, and with a gel that is soft up to its edge."""
    return scored(simulation.run()), scored(replace(simulation, has_rim=False).run())


def scored(recording: Recording) -> dict[str, float]:
    """Track a recording and return its scores."""
    run = track(recording, palpate.TrackerSettings("learnt"))
    assert recording.contact is not None
    return {
        "rmse_mm": clipped_rmse(run),
        "final_mm": run.summary["final_translation_error_mm"],
        "missed_frames": int(np.sum(recording.contact & ~run.online.contact)),
        "contact_frames": int(recording.contact.sum()),
        "ambiguous": float(run.summary["ambiguous_share"] or 0.0),
    }


def pooled(scores: list[dict[str, float]]) -> dict[str, float]:
    """Return the scores of all recordings of one half."""
    return {
        "rmse_mm": pooled_rmse([each["rmse_mm"] for each in scores]),
        "final_mm": float(np.median([each["final_mm"] for each in scores])),
        "missed_share": sum(each["missed_frames"] for each in scores) / sum(each["contact_frames"] for each in scores),
        "ambiguous": float(np.mean([each["ambiguous"] for each in scores])),
    }


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60, int(sys.argv[2]) if len(sys.argv) > 2 else 20261306)
