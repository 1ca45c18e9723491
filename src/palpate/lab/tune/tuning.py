"""Tuning of noise settings: minimise the negative log likelihood of true poses under the online estimates.

The score of a frame is `(NEES + log det covariance) / 2`, which is least where the estimate is right and the covariance
is that of its errors. NEES is damped to `a log(1 + NEES / b)`, so that one push that is lost for good does not outweigh
a thousand good frames. The score of a recording is the mean over its frames of contact and the value at its end, half
each; kinds of recordings count the same, however many recordings there are of each. A kind whose 95 % region holds less
than 88 % of the true poses, and less than at the start, adds a penalty.

An evaluation tracks all recordings anew. COBYQA models the score by a quadratic in a trust region and needs few
evaluations; it works on logarithms, since noise is a matter of factors.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError, SettingError
from palpate.lab.parallel import spread
from palpate.lab.tune.parameters import TUNABLE, check_parameters, value_of, with_value
from palpate.lab.tune.recorded_touch import RecordedTouch, track_recorded
from palpate.pipeline.metrics import inside_95, nees, rms, rotation_errors, translation_errors
from palpate.pipeline.track import quiet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Objective:
    """Constants of the score."""

    damping: float = 10.0
    """NEES b beyond which it is damped: 2 % of Gaussian errors are."""
    slope: float = 14.43338537605379
    """a, with which the true covariance of Gaussian errors scores best; it follows from b."""
    worst: float = 50.0
    """Score of a recording that the estimator gives up, and the largest of any [nats]."""
    coverage: float = 0.88
    """Share of true poses that the 95 % region of each kind should hold; that of few pushes is not always 95 %."""
    penalty: float = 20.0
    """For a coverage lower by 1 [nats]."""


OBJECTIVE = Objective()


@dataclass(frozen=True)
class Judgement:
    """Scores of recordings tracked with some settings."""

    recordings: int
    score: float
    """Without the penalty [nats]."""
    translation_rmse_mm: float | None
    """Median over recordings; None if all are given up."""
    rotation_rmse_deg: float | None
    """Median over recordings; None if all are given up."""
    inside_95: float | None
    """Share of true poses in the 95 % region since the first contact."""
    given_up: int
    """Recordings in which the estimator could not go on."""
    kinds: dict[str, "Judgement"] = field(default_factory=dict)
    """The same for each kind of recording, if there are several."""


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
    parameters: Sequence[str] = (),
    evaluations: int = 100,
    workers: int = 1,
    progress: Callable[[Tuning], None] | None = None,
) -> Tuning:
    """Tune the parameters (see `check_parameters`), starting from these settings; the same input gives the same result.

    `progress` is called after each evaluation. Every fourth recording of a kind is held out, see `held_out`. Raises
    SettingError on wrong parameters and without recordings.
    """
    from scipy.optimize import minimize

    names = check_parameters(settings, parameters, evaluations)
    if not recordings:
        raise SettingError("there are no recordings to tune on")
    is_out = held_out([recorded.kind for recorded in recordings])
    learning = [recorded for recorded, out in zip(recordings, is_out, strict=True) if not out]
    judging = [recorded for recorded, out in zip(recordings, is_out, strict=True) if out]
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
            return before.score
        if best.evaluations == evaluations:
            raise _Spent
        found = judge(learning, tried, workers)
        if penalised(found, before) < penalised(best.after, before):
            best = replace(best, settings=tried, values=_values(names, settings, tried), after=found)
        best = replace(best, evaluations=best.evaluations + 1)
        if progress:
            progress(best)
        return penalised(found, before)

    bounds = np.log([(TUNABLE[name].lowest, TUNABLE[name].highest) for name in names])
    first = np.clip(np.log(np.maximum(start, 1e-300)), *bounds.T)
    radii = {"initial_tr_radius": 0.7, "final_tr_radius": 0.02}  # factors of 2 and 1.02
    with suppress(_Spent):
        minimize(objective, first, method="COBYQA", bounds=bounds, options=radii)
    if judging:
        best = replace(best, held_out=(judge(judging, settings, workers), judge(judging, best.settings, workers)))
    return best


def held_out(kinds: Sequence[str]) -> list[bool]:
    """Return true for recordings that are judged and not tuned on: every fourth of each kind."""
    seen: Counter[str] = Counter()
    found: list[bool] = []
    for kind in kinds:
        seen[kind] += 1
        found.append(seen[kind] % 4 == 0)
    return found


def judge(recordings: Sequence[RecordedTouch], settings: TrackerSettings, workers: int = 1) -> Judgement:
    """Track all recordings in so many processes, and score them."""
    by_index = dict(spread(partial(_scored, settings=settings), list(enumerate(recordings)), workers))
    scores = [by_index[index] for index in range(len(recordings))]  # in their order, on which sums depend
    by_kind: dict[str, list[_Scores | None]] = {}
    for recorded, each in zip(recordings, scores, strict=True):
        by_kind.setdefault(recorded.kind, []).append(each)
    kinds = {kind: _judgement(some) for kind, some in by_kind.items()}
    score = float(np.mean([kind.score for kind in kinds.values()]))
    return replace(_judgement(scores), score=score, kinds=kinds if len(kinds) > 1 else {})


def penalised(found: Judgement, before: Judgement) -> float:
    """Return the score plus the penalty for coverage that is lower than it should be, and than at the start."""
    pairs = [(found.kinds[kind], before.kinds[kind]) for kind in found.kinds] or [(found, before)]
    lacking = [max(min(OBJECTIVE.coverage, old.inside_95 or 0.0) - (new.inside_95 or 0.0), 0.0) for new, old in pairs]
    return found.score + OBJECTIVE.penalty * float(np.mean(lacking))


def negative_log_likelihood(pose: ArrayLike, covariance: ArrayLike, truth: ArrayLike) -> Array:
    """Return the scores (N,) of poses (N, 3) with covariances (N, 3, 3) in the right tangent space.

    It is NaN where the truth (N, 3) is, and infinite where the covariance is singular.
    """
    known = np.isfinite(np.asarray(truth, dtype=np.float64)).all(axis=-1)
    score = 0.5 * (damped(nees(pose, covariance, truth)) + np.linalg.slogdet(np.asarray(covariance, np.float64))[1])
    return np.where(known & np.isnan(score), np.inf, score)


def damped(squared: ArrayLike) -> Array:
    """Return damped NEES (...)."""
    return OBJECTIVE.slope * np.log1p(np.asarray(squared, dtype=np.float64) / OBJECTIVE.damping)


@dataclass(frozen=True)
class _Scores:
    """One tracked recording: score, RMSE [m] and [rad], true poses inside of their regions."""

    score: float
    translation: float
    rotation: float
    inside: NDArray[np.bool_]


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
    scores, known = negative_log_likelihood(online.pose, covariance, truth), np.isfinite(truth[:, 0])
    score = 0.5 * (scores[known & contact].mean() + scores[known][-1])
    inside = inside_95(nees(online.pose, covariance, truth)[known & np.maximum.accumulate(contact)])
    translation, rotation = rms(translation_errors(online.pose, truth)), rms(rotation_errors(online.pose, truth))
    return index, _Scores(min(float(score), OBJECTIVE.worst), translation or 0.0, rotation or 0.0, inside)


def _judgement(scores: Sequence[_Scores | None]) -> Judgement:
    done = [each for each in scores if each is not None]
    score = float(np.mean([OBJECTIVE.worst if each is None else each.score for each in scores]))
    return Judgement(
        recordings=len(scores),
        score=score,
        translation_rmse_mm=1e3 * float(np.median([each.translation for each in done])) if done else None,
        rotation_rmse_deg=float(np.degrees(np.median([each.rotation for each in done]))) if done else None,
        inside_95=float(np.mean(np.concatenate([each.inside for each in done]))) if done else None,
        given_up=len(scores) - len(done),
    )


def _values(names: Sequence[str], start: TrackerSettings, now: TrackerSettings) -> dict[str, tuple[float, float]]:
    return {name: (value_of(start, name), value_of(now, name)) for name in names}
