"""The figures of a study, from its trials."""

from collections.abc import Mapping, Sequence
from typing import Any

from palpate.lab.study.figures import final_errors, over_time
from palpate.lab.study.figures.samples import Samples
from palpate.lab.study.figures.sheet import Key, Sheet, Tile, render
from palpate.lab.study.figures.step_time import step_time_sheet
from palpate.lab.study.figures.trajectories import trajectory_sheet
from palpate.lab.study.trial import Trial

__all__ = ["Key", "Sheet", "Tile", "render", "study_sheets"]


def study_sheets(trials: Sequence[Trial], results: Mapping[str, Any]) -> list[Sheet]:
    """The figures of trials, those that their data allow; `results` is the content of `results.json`.

    Trials without frames, see `reported`, are shown by their final errors only.
    """
    if not trials:
        return []
    sheets = [
        final_errors.box_sheet(trials, final_errors.TRANSLATION),
        final_errors.box_sheet(trials, final_errors.ROTATION),
        final_errors.slid_sheet(trials),
        *(final_errors.against_sheets(trials, results["against"]) if results.get("against") else ()),
    ]
    if all(len(trial.time) for trial in trials):
        samples = Samples(trials)
        sheets[2:2] = [
            step_time_sheet(trials),
            trajectory_sheet(trials, results.get("recordings", {})),
            over_time.nees_sheet(samples),
            over_time.coverage_sheet(samples),
            *over_time.sigma_sheets(samples),
        ]
        sheets[:0] = [over_time.translation_sheet(samples), over_time.rotation_sheet(samples)]
    return [sheet for sheet in sheets if sheet]
