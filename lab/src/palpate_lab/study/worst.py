"""Figures of the worst trials of a study."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from palpate.pipeline.figures import draw, run_figure
from palpate_lab.study.results import FINALS
from palpate_lab.study.study import StudySettings, Trial, track_file


def worst_of(trials: Sequence[Trial], count: int) -> list[Trial]:
    """Return the trials with the largest final errors in position; those without truth follow, by their sigma."""

    def badness(trial: Trial) -> tuple[bool, float]:
        error = trial.summary[FINALS["final_mm"]]
        sigma = math.hypot(*trial.summary["final_sigma"][:2])
        return error is not None, sigma if error is None else error

    return sorted(trials, key=badness, reverse=True)[:count]


def draw_worst(
    trials: Sequence[Trial],
    files: Mapping[str, Path],
    settings: StudySettings,
    folder: Path,
    progress: Callable[[int], None],
) -> list[Path]:
    """Track trials again and draw each as palpate track does, into a folder; return the figures, in their order."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    figures: list[Path] = []
    for rank, trial in enumerate(trials, 1):
        name = trial.recording.replace("/", "_")
        figure = folder / f"{rank:02d}-{name}-{trial.method}.png"
        run = track_file(files[trial.recording], trial.method, settings)
        draw(figure, lambda path, run=run: run_figure(run).savefig(path, format="png", dpi=120))
        figures.append(figure)
        progress(rank)
    return figures
