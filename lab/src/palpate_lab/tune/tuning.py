"""Tuning of noise settings: maximise the log likelihood of true poses under the online estimates.

The score of a recording is its mean over frames of contact, `nats` of `metrics.summarise`. That of a kind of recordings
is the median, so that a push that is lost for good does not outweigh the others. All kinds count alike.

An evaluation tracks all recordings anew. COBYQA models the score by a quadratic in a trust region and needs few
evaluations; it works on logarithms, since noise is a matter of factors.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError, PalpateError, SettingError
from palpate.tracker import warm_up
from palpate_lab.parallel import spread
from palpate_lab.study.recordings import group_of
from palpate_lab.study.study import StudySettings, track_file

Scores = Mapping[str, dict[str, Any] | str | None]
"""Summaries of recordings by name; the reason where one cannot be used, None where the estimator could not go on."""

WORST = -50.0
"""Score of a recording that the estimator gives up, and the least of any [nats]."""

TUNABLE = {
    "direction.share": (1e-2, 100.0),
    "turn.share": (1e-2, 1000.0),
    "sticking.share": (1e-3, 10.0),
    "sticking.sliding_share": (1e-3, 100.0),
    "sticking.margin": (1e-3, 0.5),
    "sticking.kernel": (0.1, 100.0),
    "balance.share": (1e-3, 10.0),
    "friction_cone.share": (1e-3, 10.0),
    "priors.friction_ratio": (0.01, 2.0),
    "priors.friction_center": (0.01, 1.0),
    "priors.grip": (0.01, 1.0),
}
"""Ranges of the settings that are tuned; of a prior its deviation, the second of a pair.

Nothing is tuned that the robot knows (`sensor_pose`) or that a simulation knows too well (`contact`, `priors.depth`).
"""


@dataclass(frozen=True)
class Judgement:
    """Scores of recordings tracked with some settings."""

    recordings: int
    nats: float
    """Score, the larger the better."""
    translation_rmse_mm: float | None
    """Median over recordings; None if all are given up."""
    rotation_rmse_deg: float | None
    """Median over recordings; None if all are given up."""
    inside_95: float | None
    """Share of true poses in the 95 % region since the first contact, the mean over recordings."""
    given_up: int
    """Recordings in which the estimator could not go on."""


@dataclass(frozen=True)
class Tuning:
    """The best settings so far."""

    settings: TrackerSettings
    parameters: dict[str, dict[str, float]]
    """Each parameter `before`, at the start, and `after`, now."""
    recordings: tuple[str, ...]
    """Recordings tuned on."""
    before: Judgement
    """Judgement on the recordings tuned on, at the start."""
    after: Judgement
    """Judgement on the recordings tuned on, now."""
    held_out: tuple[str, ...]
    """Recordings held out, every fourth."""
    held_out_before: Judgement | None
    """Judgement on the recordings held out, at the start; None if there are none."""
    held_out_after: Judgement | None = None
    """Judgement on the recordings held out, at the end; None while tuning."""
    left_out: dict[str, str] = field(default_factory=dict)
    """Reason why a recording cannot be used, by name."""
    evaluations: int = 1


class _Spent(Exception):
    """All evaluations are used up."""


def tune(
    files: Mapping[str, Path],
    settings: StudySettings,
    evaluations: int = 100,
    workers: int = 1,
    progress: Callable[[Tuning], object] | None = None,
) -> Tuning:
    """Tune the parameters of the settings' tracker on recordings by name; the same input gives the same result.

    The only method of the settings may be auto, too: learnt where there are images, else oracle. `progress` is called
    after each evaluation. Raises SettingError on fewer than 1 evaluations, FileError if no recording can be used.
    """
    from scipy.optimize import minimize

    if evaluations < 1:
        raise SettingError(f"evaluations is {evaluations}; it must be at least 1")
    warm_up()  # before there are workers, so that none has to, at every evaluation anew
    best = _begun(files, settings, workers)
    if progress:
        progress(best)
    start = settings.tracker
    names = tuple(best.parameters)

    def judged(recordings: Sequence[str], tracker: TrackerSettings) -> Judgement | None:
        return judge(scores_of({name: files[name] for name in recordings}, replace(settings, tracker=tracker), workers))

    def objective(logarithms: Array) -> float:
        nonlocal best
        tried = start
        for name, value in zip(names, np.exp(logarithms).tolist(), strict=True):
            tried = with_value(tried, name, value)
        if tried == start:
            return -best.before.nats
        if best.evaluations == evaluations:
            raise _Spent
        judgement = judged(best.recordings, tried)
        assert judgement is not None
        if judgement.nats > best.after.nats:
            best = replace(best, settings=tried, parameters=_changes(names, start, tried), after=judgement)
        best = replace(best, evaluations=best.evaluations + 1)
        if progress:
            progress(best)
        return -judgement.nats

    bounds = np.log([TUNABLE[name] for name in names])
    at = np.clip(np.log([max(value_of(start, name), 1e-300) for name in names]), *bounds.T)
    radii = {"initial_tr_radius": 0.7, "final_tr_radius": 0.02}  # factors of 2 and 1.02
    with suppress(_Spent):
        minimize(objective, at, method="COBYQA", bounds=bounds, options=radii)
    return replace(best, held_out_after=judged(best.held_out, best.settings))


def _begun(files: Mapping[str, Path], settings: StudySettings, workers: int) -> Tuning:
    """Return a tuning at its start: the recordings that can be used, a fourth of them held out, and their scores."""
    scores = scores_of(files, settings, workers)
    left_out = {name: reason for name, reason in scores.items() if isinstance(reason, str)}
    used = [name for name in files if name not in left_out]
    if not used:
        raise FileError(f"no recording can be tuned on; the first: {next(iter(left_out.values()), 'there is none')}")
    held_out = tuple(used[3::4])
    recordings = tuple(name for name in used if name not in held_out)
    before = judge({name: scores[name] for name in recordings})
    assert before is not None
    names = parameters_of(settings.tracker, settings.methods[0])
    return Tuning(
        settings=settings.tracker,
        parameters=_changes(names, settings.tracker, settings.tracker),
        recordings=recordings,
        before=before,
        after=before,
        held_out=held_out,
        held_out_before=judge({name: scores[name] for name in held_out}),
        left_out=left_out,
    )


def _changes(names: Sequence[str], start: TrackerSettings, now: TrackerSettings) -> dict[str, dict[str, float]]:
    return {name: {"before": value_of(start, name), "after": value_of(now, name)} for name in names}


def scores_of(files: Mapping[str, Path], settings: StudySettings, workers: int = 1) -> Scores:
    """Track recordings by name, in so many processes; return their scores in the same order."""
    scores = dict(spread(partial(_scored, settings=settings), files.items(), workers))
    return {name: scores[name] for name in files}


def judge(scores: Scores) -> Judgement | None:
    """Return the judgement on recordings that can be used; None if there are none."""
    if not scores:
        return None
    summaries = [summary for summary in scores.values() if isinstance(summary, dict)]
    kinds: dict[str, list[float]] = {}
    for name, summary in scores.items():
        nats = max(summary["nats"], WORST) if isinstance(summary, dict) else WORST
        kinds.setdefault(group_of(name), []).append(nats)

    def of_all(middle: Callable[[list[float]], float], key: str) -> float | None:
        return middle([summary[key] for summary in summaries]) if summaries else None

    return Judgement(
        recordings=len(scores),
        nats=fmean(map(median, kinds.values())),
        translation_rmse_mm=of_all(median, "translation_rmse_mm"),
        rotation_rmse_deg=of_all(median, "rotation_rmse_deg"),
        inside_95=of_all(fmean, "in_95_share"),
        given_up=len(scores) - len(summaries),
    )


def _scored(named: tuple[str, Path], settings: StudySettings) -> tuple[str, dict[str, Any] | str | None]:
    """Return the name of a recording, and its summary or why there is none."""
    name, path = named
    try:
        run = track_file(path, settings.methods[0], settings)
    except EstimationError:
        return name, None
    except PalpateError as error:
        return name, f"{path}: {str(error).removeprefix(f'{path}: ')}"
    if not np.isfinite(run.recording.truth).any():
        return name, f"{path}: has no ground truth, which noise is learnt from"
    if run.summary["nats"] is None:
        return name, f"{path}: is never in contact where ground truth is known, so there is nothing to score"
    return name, run.summary


def parameters_of(settings: TrackerSettings, tactile: str) -> tuple[str, ...]:
    """Return the parameters that matter with a kind of touch and are not off."""
    unused = {"none": ("direction.share", "turn.share"), "oracle": ("direction.share",)}.get(tactile, ())
    return tuple(name for name in TUNABLE if name not in unused and _setting(settings, name) is not None)


def value_of(settings: TrackerSettings, name: str) -> float:
    """Return the value of a parameter; of a prior that of its deviation."""
    value = _setting(settings, name)
    return float(value[1] if isinstance(value, tuple) else value)


def with_value(settings: TrackerSettings, name: str, value: float) -> TrackerSettings:
    """Return settings with another value of a parameter, rounded to four digits."""
    group, setting = name.split(".")
    old = _setting(settings, name)
    new = float(f"{value:.4g}")
    changed = replace(getattr(settings.noise, group), **{setting: (old[0], new) if isinstance(old, tuple) else new})
    return replace(settings, noise=replace(settings.noise, **{group: changed}))


def _setting(settings: TrackerSettings, name: str) -> Any:
    group, setting = name.split(".")
    return getattr(getattr(settings.noise, group), setting)
