"""Measure the cost of each error of a set-up by itself: docs/study/set_up_errors.json.

    palpate simulate FOLDER --ideal --count 18 --seed 20261227 --seconds 15
    python scripts/measure_set_up_errors.py FOLDER

Each recording is tracked without errors, with each error that `set_up_errors` draws, and with all of them;
then with the outline taken for exact. Eight minutes on two cores.
"""

import sys
import zlib
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median

import numpy as np
from _common import for_each, scores, write

import palpate
from palpate.pipeline.metrics import translation_errors
from palpate.pipeline.track import track
from palpate_lab.simulate.set_up_errors import draw_errors, with_errors
from palpate_lab.study.recordings import find_recordings

NO_ERROR = {"mounting": np.zeros(3), "outline": 1.0, "late": 0, "first_pose": np.zeros(3)}
DEFAULT = palpate.NoiseSettings()
EXACT = replace(DEFAULT, priors=replace(DEFAULT.priors, outline_scale=(0.0, 1e-9)))
CASES: dict[str, tuple[tuple[str, ...], palpate.NoiseSettings]] = {
    "none": ((), DEFAULT),
    **{name: ((name,), DEFAULT) for name in NO_ERROR},
    "all": (tuple(NO_ERROR), DEFAULT),
    "outline, taken for exact": (("outline",), EXACT),
    "all, outline taken for exact": (tuple(NO_ERROR), EXACT),
}
"""Errors that are present, and the noise settings."""


def main(folder: Path) -> None:
    """Track all recordings in all cases and write medians of errors and means of coverage."""
    found = for_each(cases_of, find_recordings(folder).values())
    rows = {
        case: {
            **{name: median(each[case][name] for each in found) for name in ("contact_mm", "final_mm", "final_deg")},
            "contact_inside_95": fmean(each[case]["inside_contact"] for each in found),
            "final_inside_95": fmean(each[case]["inside_final"] for each in found),
        }
        for case in CASES
    }
    write("set_up_errors", {"recordings": len(found), "cases": rows})


def cases_of(file: Path) -> dict[str, dict[str, float]]:
    """Return the scores of a recording in each case."""
    recording = replace(palpate.load_recording(file), set_up_sigma=None)  # which it says is exact
    errors = draw_errors(np.random.default_rng(zlib.crc32(file.stem.encode())))
    found = {}
    for case, (present, noise) in CASES.items():
        absent = {name: value for name, value in NO_ERROR.items() if name not in present}
        found[case] = scored(with_errors(recording, replace(errors, **absent)), noise)
    return found


def scored(recording: palpate.Recording, noise: palpate.NoiseSettings) -> dict[str, float]:
    """Track a recording and return its scores and the mean error in contact."""
    run = track(recording, palpate.TrackerSettings("learnt", noise=noise))
    assert recording.object_pose is not None
    errors = translation_errors(run.online.pose, recording.object_pose)
    return {**scores(run.summary), "contact_mm": float(1e3 * errors[run.online.contact].mean())}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
