"""Count false alarms of the consistency test, and the shoves that it tells: docs/study/alarms.json.

    python scripts/measure_alarms.py UNDISTURBED SHOVED

Folders of simulated recordings, those of the second with `--knocks`. They are tracked with one hypothesis, so that no
alarm changes the estimate. An alarm is new half a second after the last one. A shove in contact counts if half of the
next second is contact, and as told if there is an alarm in it.
"""

import sys
from pathlib import Path

import numpy as np
from _common import for_each, write

import palpate
from palpate.estimation.innovations import JUDGED_STEPS
from palpate.hypotheses.proposals.shove import ALARM_LIMITS
from palpate.models.pushing.layout import NAMES
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import first_pose_of_recording
from palpate_lab.study.recordings import find_recordings

SECOND = 30  # frames


def main(undisturbed: Path, shoved: Path) -> None:
    """Judge all recordings and write rates and counts."""
    calm = for_each(alarms, find_recordings(undisturbed).values())
    minutes = sum(int(contact.sum()) for contact, _, _ in calm) / (60.0 * SECOND)

    def rate(columns: list[int]) -> float:
        return round(sum(begun(np.asarray(told[:, columns].any(axis=1))) for _, told, _ in calm) / minutes, 2)

    told = [
        bool(alarm[shove : shove + SECOND].any())
        for contact, alarm, shoves in for_each(alarms, find_recordings(shoved).values())
        for shove in shoves
        if contact[shove] and contact[shove : shove + SECOND].sum() >= SECOND // 2
    ]
    judged = [NAMES.index(name) for name in ALARM_LIMITS]
    rates = {name: {"limit": limit, "per_minute": rate([NAMES.index(name)])} for name, limit in ALARM_LIMITS.items()}
    shoves = {"shoves": len(told), "told": sum(told)}
    write("alarms", {"minutes": round(minutes, 1), "factors": rates, "all_per_minute": rate(judged)} | shoves)


def alarms(file: Path) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return flags of contact (N,), alarms (N, factors), and the frames at which a shove begins."""
    recording = palpate.load_recording(file)
    settings = palpate.TrackerSettings(hypotheses=1)
    first, sigma = first_pose_of_recording(recording, settings.noise)
    tracker = palpate.Tracker(recording.shape, recording.sensor, first, settings, first_pose_sigma=sigma)
    found = [tracker.update(frame) for frame in recording]
    contact = np.array([each.contact for each in found])
    surprise = np.zeros((len(found), len(NAMES)))
    for k, each in enumerate(found):
        if each.innovations is not None:
            error, predicted, stated = np.moveaxis(each.innovations, -1, 0)
            for kind in (
                NAMES.index(name) for name in ("direction", "place", "turn")
            ):  # a measurement is no better than the contact model
                noise = getattr(settings.noise, NAMES[kind])
                stated[kind, 0] = noise.share * max(stated[kind, 0], noise.floor**2) if stated[kind, 0] else 0.0
            surprise[k] = np.sum(error**2 / np.where(stated > 0.0, predicted + stated, np.inf), axis=1)
    means = np.cumsum(np.vstack([np.zeros((JUDGED_STEPS, len(NAMES))), surprise]), axis=0)
    means = (means[JUDGED_STEPS:] - means[:-JUDGED_STEPS]) / JUDGED_STEPS
    shoves = [first for first, _ in flag_runs(recording.extra.get("knocked", np.zeros(len(found))) > 0.0)]
    limits = np.array([ALARM_LIMITS.get(name, np.inf) for name in NAMES])
    return contact, (means > limits) & contact[:, None], shoves


def begun(told: np.ndarray) -> int:
    """Return the number of alarms (N,) that are half a second after the last one."""
    count = 0
    last = -SECOND
    for frame in np.flatnonzero(told).tolist():
        if frame - last > SECOND // 2:
            count += 1
            last = frame
    return count


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
