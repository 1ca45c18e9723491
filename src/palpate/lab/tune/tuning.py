"""Tuning of noise settings: maximise the log likelihood of true poses under the online estimates.

The score of a recording is its mean over frames of contact, `metrics.log_likelihood`. That of a kind of recordings is
the median, so that a push that is lost for good does not outweigh the others. All kinds count alike.

An evaluation tracks all recordings anew. COBYQA models the score by a quadratic in a trust region and needs few
evaluations; it works on logarithms, since noise is a matter of factors.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from statistics import fmean, median
from typing import Any, NamedTuple

import numpy as np

from palpate.arrays import Array, Flags
from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError, SettingError
from palpate.lab.parallel import quiet, spread
from palpate.lab.study.recordings import group_of
from palpate.lab.tune.recorded_touch import RecordedTouch, track_recorded
from palpate.pipeline.metrics import inside_95, log_likelihood, nees, rms, rotation_errors, translation_errors

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
    """Share of true poses in the 95 % region since the first contact."""
    given_up: int
    """Recordings in which the estimator could not go on."""


@dataclass(frozen=True)
class Tuning:
    """The best settings so far."""

    settings: TrackerSettings
    values: dict[str, tuple[float, float]]
    """Each parameter at the start and now."""
    before: Judgement
    """Recordings tuned on, at the start."""
    after: Judgement
    """Recordings tuned on, now."""
    evaluations: int
    held_out: tuple[Judgement, Judgement] | None = None
    """Recordings held out, before and after; None while tuning, or if there are none."""


class _Spent(Exception):
    """All evaluations are used up."""


def tune(
    recordings: Sequence[RecordedTouch],
    settings: TrackerSettings,
    evaluations: int = 100,
    workers: int = 1,
    progress: Callable[[Tuning], object] | None = None,
) -> Tuning:
    """Tune the settings of `parameters_of`, starting from these; the same input gives the same result.

    `progress` is called after each evaluation. Every fourth recording is held out. Raises SettingError on fewer than 1
    evaluations and without recordings.
    """
    from scipy.optimize import minimize

    check_evaluations(evaluations)
    names = parameters_of(settings)
    if not recordings:
        raise SettingError("there are no recordings to tune on")
    learning = [recorded for index, recorded in enumerate(recordings) if not is_held_out(index)]
    judging = [recorded for index, recorded in enumerate(recordings) if is_held_out(index)]
    before = judge(learning, settings, workers)
    start = np.array([value_of(settings, name) for name in names])
    best = Tuning(settings, _values(names, settings, settings), before, before, 1)
    if progress:
        progress(best)

    def objective(logarithms: Array) -> float:
        nonlocal best
        tried = settings
        for name, value in zip(names, np.exp(logarithms).tolist(), strict=True):
            tried = with_value(tried, name, value)
        if tried == settings:
            return -before.nats
        if best.evaluations == evaluations:
            raise _Spent
        found = judge(learning, tried, workers)
        if found.nats > best.after.nats:
            best = replace(best, settings=tried, values=_values(names, settings, tried), after=found)
        best = replace(best, evaluations=best.evaluations + 1)
        if progress:
            progress(best)
        return -found.nats

    bounds = np.log([TUNABLE[name] for name in names])
    first = np.clip(np.log(np.maximum(start, 1e-300)), *bounds.T)
    radii = {"initial_tr_radius": 0.7, "final_tr_radius": 0.02}  # factors of 2 and 1.02
    with suppress(_Spent):
        minimize(objective, first, method="COBYQA", bounds=bounds, options=radii)
    if judging:
        best = replace(best, held_out=(judge(judging, settings, workers), judge(judging, best.settings, workers)))
    return best


def check_evaluations(evaluations: int) -> None:
    """Raise SettingError on fewer than 1 evaluations."""
    if evaluations < 1:
        raise SettingError(f"evaluations is {evaluations}; it must be at least 1")


def is_held_out(index: int) -> bool:
    """Return true for the recordings, by number, that are judged and not tuned on: every fourth."""
    return index % 4 == 3


def judge(recordings: Sequence[RecordedTouch], settings: TrackerSettings, workers: int = 1) -> Judgement:
    """Track all recordings in so many processes, and score them."""
    by_index = dict(spread(partial(_scored, settings=settings), list(enumerate(recordings)), workers))
    scores = [by_index[index] for index in range(len(recordings))]  # in their order, on which sums depend
    done = [each for each in scores if each is not None]
    kinds: dict[str, list[float]] = {}
    for recorded, each in zip(recordings, scores, strict=True):
        file = recorded.recording.file
        kinds.setdefault(group_of(file.name) if file else "", []).append(WORST if each is None else each.nats)
    return Judgement(
        recordings=len(scores),
        nats=fmean(map(median, kinds.values())),
        translation_rmse_mm=1e3 * float(np.median([each.translation for each in done])) if done else None,
        rotation_rmse_deg=float(np.degrees(np.median([each.rotation for each in done]))) if done else None,
        inside_95=float(np.mean(np.concatenate([each.inside for each in done]))) if done else None,
        given_up=len(scores) - len(done),
    )


class _Scores(NamedTuple):
    """One tracked recording: score, RMSE [m] and [rad], true poses inside of their regions."""

    nats: float
    translation: float
    rotation: float
    inside: Flags


def _scored(job: tuple[int, RecordedTouch], settings: TrackerSettings) -> tuple[int, _Scores | None]:
    """Return the index and the scores of a recording, None if the estimator gives up."""
    index, recorded = job
    try:
        with quiet():  # settings that are tried may be bad ones
            online = track_recorded(recorded, settings)
    except (EstimationError, FileError):  # the latter if an estimate is not finite
        return index, None
    contact, covariance, truth = recorded.recording.contact, online.covariance, recorded.truth
    assert contact is not None and covariance is not None
    known, squared = np.isfinite(truth[:, 0]), nees(online.pose, covariance, truth)
    score = np.nan_to_num(log_likelihood(squared, covariance)[known & contact], nan=WORST).mean()  # if singular
    inside = inside_95(squared[known & np.maximum.accumulate(contact)])
    translation, rotation = rms(translation_errors(online.pose, truth)), rms(rotation_errors(online.pose, truth))
    return index, _Scores(max(float(score), WORST), translation or 0.0, rotation or 0.0, inside)


def _values(names: Sequence[str], start: TrackerSettings, now: TrackerSettings) -> dict[str, tuple[float, float]]:
    return {name: (value_of(start, name), value_of(now, name)) for name in names}


def parameters_of(settings: TrackerSettings) -> tuple[str, ...]:
    """Return the parameters that matter with the settings' touch and are not off."""
    modes = {"learnt", "oracle"} if settings.tactile == "auto" else {settings.tactile}
    only_in = {"direction.share": {"learnt"}, "turn.share": {"learnt", "oracle"}}
    matter = [name for name in TUNABLE if modes & only_in.get(name, modes)]
    return tuple(name for name in matter if _setting(settings, name) is not None)


def value_of(settings: TrackerSettings, name: str) -> float:
    """Return the value of a parameter; of a prior that of its deviation."""
    value = _setting(settings, name)
    return float(value[1] if isinstance(value, tuple) else value)


def with_value(settings: TrackerSettings, name: str, value: float) -> TrackerSettings:
    """Return settings with another value of a parameter, rounded to four digits."""
    group, setting = name.split(".")
    old, new = _setting(settings, name), float(f"{value:.4g}")
    changed = replace(getattr(settings.noise, group), **{setting: (old[0], new) if isinstance(old, tuple) else new})
    return replace(settings, noise=replace(settings.noise, **{group: changed}))


def _setting(settings: TrackerSettings, name: str) -> Any:
    group, setting = name.split(".")
    return getattr(getattr(settings.noise, group), setting)
