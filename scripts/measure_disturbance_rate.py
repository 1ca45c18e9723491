"""Measure how estimates depend on the expected rate of disturbances: docs/study/disturbance_rate.json.

    python scripts/measure_disturbance_rate.py

Explorations of known outlines of 40 s with contacts from several sides, of which touch tells directions with the errors
of an image, drawn, and pushes of 15 s with images; half of both with shoves that the sensor does not see. Each is
tracked with every rate. Ten minutes on two cores.
"""

from statistics import fmean, median
from typing import Any

import numpy as np
from _common import for_each, paired, write
from measure_unknown_outline import FIRST_SIGMA, OBJECTS, first_pose, pose_scores, touched

import palpate
from palpate.geometry.named_shapes import SHAPES
from palpate_lab.simulate.paths import kinds
from palpate_lab.simulate.recordings import Simulation

SEED = 20261571
RATES = (palpate.TrackerSettings().disturbance_rate, 0.1, 0.02)  # [1/s]
COUNT = 15  # of each kind
Case = tuple[bool, bool, int]
"""True with images, true with shoves, and a number."""


def main() -> None:
    """Track all recordings with all rates, and write scores of each kind together."""
    cases: list[Case] = [
        (images, shoved, k) for images in (False, True) for shoved in (False, True) for k in range(COUNT)
    ]
    found = for_each(scored, cases)
    kinds_found: dict[str, dict[str, Any]] = {}
    for images, shoved in dict.fromkeys(case[:2] for case in cases):
        of_kind = [scores for case, scores in zip(cases, found, strict=True) if case[:2] == (images, shoved)]
        name = f"{'images' if images else 'directions'}{', shoved' if shoved else ''}"
        kinds_found[name] = together(of_kind)
    write("disturbance_rate", {"seed": SEED, "of_each": COUNT, "kinds": kinds_found})


def together(found: list[dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Return scores of all recordings of a kind by rate, with paired differences from the first rate."""
    usual = f"{RATES[0]:g}"
    rates: dict[str, Any] = {}
    for rate in found[0]:
        of_rate = [one[rate] for one in found]
        rates[rate] = {key: fmean(one[key] for one in of_rate) for key in of_rate[0]}
        rates[rate]["rms_mm_median"] = median(one["rms_mm"] for one in of_rate)
        rates[rate]["change_mm"] = paired((one[usual]["rms_mm"] for one in found), (one["rms_mm"] for one in of_rate))
    return rates


def scored(case: Case) -> dict[str, dict[str, float]]:
    """Return the scores of one recording by rate."""
    images, shoved, number = case
    shape = SHAPES[OBJECTS[number % len(OBJECTS)]]
    seed = SEED + 1000 * (2 * images + shoved) + number
    recording = Simulation(
        shape, kinds(shape)[0], seed, seconds=15.0 if images else 40.0, images=images, knocks=shoved
    ).run()
    found = {}
    for rate in RATES:
        estimates = tracked(recording, rate, number)
        found[f"{rate:g}"] = {
            **pose_scores(estimates, recording),
            "ambiguous_share": float(np.mean([one.status == "ambiguous" for one in estimates])),
        }
    return found


def tracked(recording: palpate.Recording, rate: float, number: int) -> list[palpate.Estimate]:
    """Return the estimates of a recording with images, or of one whose directions `number` draws."""
    has_images = recording.image is not None
    settings = palpate.TrackerSettings("learnt" if has_images else "none", disturbance_rate=rate)
    first = recording.first_pose if has_images else first_pose(recording)
    sigma = recording.first_pose_sigma if has_images else FIRST_SIGMA
    tracker = palpate.Tracker(recording.shape, recording.sensor, first, settings, first_pose_sigma=sigma)
    if has_images:
        return [tracker.update(frame) for frame in recording]
    return [tracker.update(frame, measured) for frame, measured in touched(recording, number)]


if __name__ == "__main__":
    main()
