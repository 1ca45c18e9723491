"""Track the real pushes of MIT from eight priors of friction, without and with an expected slide.

    python scripts/measure_near_ties.py [../shared/data]

Which pushes that are knocked by hand are followed is decided by near ties: one run of each says little. So each is
tracked from eight priors of the friction coefficient between 0.30 and 0.41, less than a half of the prior's standard
deviation apart, with the true relative yaw for touch: docs/study/near_ties.json. Five minutes on two cores.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import DATA, for_each, write

import palpate
from palpate.geometry.se2 import wrap
from palpate.pipeline.metrics import flag_runs, translation_errors
from palpate.pipeline.track import track
from palpate_lab.study.recordings import find_recordings

SHARES = (0.0, 0.15)
"""Expected slides, as a share of the sensor's motion."""
GRIPS = tuple(np.linspace(-1.2, -0.9, 8).tolist())
"""Means of the prior of the logarithm of the friction coefficient."""
FOUND_MM = 10.0
"""Error a second after a knock at which the object counts as found."""
LOST_MM = 50.0
"""Final error at which it counts as lost."""


@dataclass(frozen=True)
class Case:
    """A recording, tracked from one prior."""

    file: Path
    grip: float
    """Mean of the prior of the logarithm of the friction coefficient."""
    share: float
    """Expected slide at the cone's edge, as a share of the sensor's motion."""


def main(data: Path) -> None:
    """Track all recordings from all priors and write rows of those with and without a knock for each expected slide."""
    files = find_recordings(data / "mit_point_push").values()
    rows: dict[str, Any] = {}
    for share in SHARES:
        runs = for_each(scores, [Case(path, grip, share) for path in files for grip in GRIPS])
        rows[f"not knocked, {share}"] = row([run for run in runs if not run["later"]])
        rows[f"knocked by hand, {share}"] = row([run for run in runs if run["later"]])
    write("near_ties", {"priors": len(GRIPS), "rows": rows})


def row(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the scores of runs together; errors in mm."""
    later = [error for run in runs for error in run["later"] if error is not None]
    final = [run["final_mm"] for run in runs]
    return {
        "runs": len(runs),
        "final_median_mm": float(np.median(final)),
        "final_worst_mm": max(final),
        "lost": sum(error > LOST_MM for error in final),
        "knocks": len(later),
        "found": sum(error < FOUND_MM for error in later),
        "inside_contact": float(np.mean([run["inside_contact"] for run in runs])),
        "silent": float(np.mean([run["silent"] for run in runs])),
        "ambiguous": float(np.mean([run["ambiguous"] for run in runs])),
    }


def scores(case: Case) -> dict[str, Any]:
    """Return the scores of a recording; `later` is the error [mm] a second after each knock, None if not known.

    A knock is a turn of the object by 5 degrees in five frames, which pushing alone does not reach.
    """
    recording = palpate.load_recording(case.file)
    run = track(recording, palpate.TrackerSettings("oracle", noise=noise(case)))
    summary = run.summary
    return {
        "final_mm": summary["final_translation_error_mm"],
        "inside_contact": summary["in_95_contact_share"],
        "silent": summary["silently_wrong_share"],
        "ambiguous": summary["ambiguous_share"],
        "later": after_knocks(run),
    }


def noise(case: Case) -> palpate.NoiseSettings:
    """Return the settings of a case."""
    usual = palpate.NoiseSettings()
    priors = replace(usual.priors, grip=(case.grip, usual.priors.grip[1]))
    return replace(usual, priors=priors, sticking=replace(usual.sticking, expected_share=case.share))


def after_knocks(run: palpate.Run) -> list[float | None]:
    """Return the error a second after each knock [mm]."""
    truth = run.recording.truth
    time = run.recording.time
    turned = wrap(truth[5:, 2] - truth[:-5, 2])
    errors = [*(1e3 * translation_errors(run.online.pose, truth)).tolist(), np.nan]
    ends = [last for _, last in flag_runs(np.abs(turned) > np.radians(5.0))]
    later = [errors[int(np.searchsorted(time, time[last + 5] + 1.0))] for last in ends]
    return [None if np.isnan(error) else error for error in later]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA)
