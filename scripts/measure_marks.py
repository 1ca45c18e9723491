"""Measure what a mark that appears on the gel in a contact, or just before one, costs: docs/study/marks.json.

    python scripts/measure_marks.py [PAIRS] [SEED]

Both recordings of a pair are of one seed, and so of the same motion, sensor unit and noise. One has no mark, the other
a grain or a scratch, which appears in a contact or up to a second before one, with equal chances near the middle of
the imprint, in the middle half of the image or anywhere in it. A recording takes four seconds to make and to track.
"""

import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from _common import clipped_rmse, for_each, paired, pooled_rmse, write

import palpate
from palpate import Recording
from palpate.arrays import Array, Flags
from palpate.geometry.named_shapes import SHAPES
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import track
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.touch_model import difference_in_light, reduced, shipped_model
from palpate_lab.simulate.recordings import Simulation, plan
from palpate_lab.simulate.set_up_errors import Mark, draw_mark

LOST_MM = 50.0
"""Final error from which an object counts as lost."""
WRONG = np.radians(8.0)
"""Error of a direction [rad] from which it is wrong ..."""
SURE = np.radians(10.0)
"""... if the image states at most this standard deviation [rad]."""
NEAR = 3  # frames by which contact in images may begin and end before or after the true one
BEFORE = 1.0  # [s] before a contact
SPREAD = 0.15  # of marks about the middle of an imprint, in shares of the image


def main(pairs: int, seed: int) -> None:
    """Make and track pairs of recordings and write the scores of both halves."""
    found = for_each(pair_of_scores, simulations(pairs, seed))
    rows = {case: pooled([each[case] for each in found]) for case in ("without", "with")}
    more_mm = paired(*([each[case]["rmse_mm"] for each in found] for case in ("without", "with")))
    write("marks", {"pairs": len(found), "seed": seed, **rows, "more_rmse_mm": more_mm})


def simulations(pairs: int, seed: int) -> list[Simulation]:
    """Return the recordings to make: the objects and their kinds of contact in turn."""
    count = -(-pairs // len(SHAPES))
    return list(plan(SHAPES, count, seed).values())[:pairs]


def pair_of_scores(simulation: Simulation) -> dict[str, dict[str, float]]:
    """Return the scores of a recording without a mark and with one."""
    return {name: scored(recording) for name, recording in pair(simulation).items()}


def pair(simulation: Simulation) -> dict[str, Recording]:
    """Return a recording without a mark and the same with one."""
    rng = np.random.default_rng(zlib.crc32(simulation.source.encode()))
    mark = draw_mark_near_contact(replace(simulation, images=False).run(), rng)
    return {"without": replace(simulation, marks=()).run(), "with": replace(simulation, marks=(mark,)).run()}


def draw_mark_near_contact(recording: Recording, rng: np.random.Generator) -> Mark:
    """Draw a mark that appears while a recording's sensor touches its object or is about to, where it may matter."""
    assert recording.contact is not None
    time = recording.time - recording.time[0]
    contacts = flag_runs(recording.contact)
    first, last = contacts[rng.integers(len(contacts))]
    moments = np.arange(0.0, time[-1], 0.5)  # a simulated unit changes every half second
    moment = float(rng.choice(moments[(moments > time[first] - BEFORE) & (moments <= time[last])]))
    mark = replace(draw_mark(rng), when=(moment - 1e-3) / float(time[-1]))
    near, in_the_middle, _ = rng.permutation(np.eye(3, dtype=np.bool_))[0].tolist()
    if near:
        angle = recording.extra["shown_angle"][max(int(np.searchsorted(time, moment)), first)]
        column = 0.5 + np.sin(angle) * recording.sensor.radius / (2.0 * (recording.sensor.half_width or np.nan))
        return replace(mark, place=(rng.normal(0.5, SPREAD), rng.normal(min(max(float(column), 0.0), 1.0), SPREAD)))
    if in_the_middle:
        return replace(mark, place=(rng.uniform(0.25, 0.75), rng.uniform(0.25, 0.75)))
    return mark


def scored(recording: Recording) -> dict[str, float]:
    """Track a recording and return its scores."""
    run = track(recording, palpate.TrackerSettings("learnt"))
    seen, error, sigma = readings(recording)
    assert recording.contact is not None
    touched = np.convolve(recording.contact, np.ones(2 * NEAR + 1), mode="same") > 0.0
    return {
        "rmse_mm": clipped_rmse(run),
        "final_mm": run.summary["final_translation_error_mm"],
        "contact_frames": int(seen.sum()),
        "false_contacts": int((seen & ~touched).sum()),
        "missed_contacts": int((~seen & recording.contact).sum()),
        "wrong_directions": int((np.abs(error) > WRONG)[sigma < SURE].sum()),
    }


def readings(recording: Recording) -> tuple[Flags, Array, Array]:
    """Return contact in the images of a recording, and error and stated deviation [rad] of their directions, (N,) each.

    They are NaN where there is no contact. The true direction is the one that the unit's image shows, and the deviation
    that of one image.
    """
    detector = ContactDetector(recording.sensor)
    model = shipped_model(recording.sensor.name)
    spread = model.settings.spread["direction"].scale
    seen = np.zeros(len(recording), np.bool_)
    error = np.full(len(recording), np.nan)
    sigma = np.full(len(recording), np.nan)
    for index, frame in enumerate(recording):
        assert frame.image is not None
        image = detector.read(frame.image)
        seen[index] = detector.update(image)
        if seen[index]:
            assert detector.background is not None
            direction = model.read(difference_in_light(image, reduced(detector.background.mean)))["direction"]
            error[index] = direction[0] - recording.extra["shown_angle"][index]
            sigma[index] = np.sqrt(spread * direction[1])
    return seen, error, sigma


def pooled(scores: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the scores of recordings together."""
    of = {name: np.array([each[name] for each in scores]) for name in scores[0]}
    contact = of["contact_frames"].sum()
    return {
        "rmse_mm": pooled_rmse(of["rmse_mm"]),
        "final_median_mm": float(np.median(of["final_mm"])),
        "lost": int((of["final_mm"] > LOST_MM).sum()),
        "false_contact_frames": int(of["false_contacts"].sum()),
        "missed_contact_frames": int(of["missed_contacts"].sum()),
        "wrong_direction_share": float(of["wrong_directions"].sum() / contact),
    }


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:] or ("60", "20261228")))
