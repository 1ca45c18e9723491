"""Learns how much each factor is to be believed from recordings with ground truth.

What is made small is the negative log likelihood of the true poses under the online estimates (see `likelihood`), for
each recording the mean over its frames of contact and the value at its end, half each, then the mean over each kind of
recording, and the mean of the kinds: ten pushes of a real robot count as much as a hundred simulated ones. One kind may
gain by what makes another too sure of itself, so coverage is guarded: where the 95 % region of a kind holds less than
88 % of the true poses and less than at the start, that has its price.

Why this and not another loss:

- The tracking error says nothing of covariances: without kernels all standard deviations could be ten times larger and
  no estimate would move. One lost push rules the mean, and a median of few recordings jumps.
- LEO (Sodhi et al., CoRL 2021) learns from the energy of the whole graph: that of the true trajectory less the mean
  energy of trajectories drawn from the graph's own Gaussian, which has a gradient. It is a likelihood too, but of the
  graph: of smoothed paths, of what one window holds, without the covariance that strain adds and without what the
  tracker does between contacts. Here it is of what users get, frame by frame, and for five to ten numbers no gradient
  is needed.

An evaluation tracks all recordings anew, which takes seconds; COBYQA, which models the score by a quadratic within a
region of trust, gets by with few of them. On logarithms, for noise is a matter of factors.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError, SettingError
from palpate.lab.tune.likelihood import negative_log_likelihood
from palpate.lab.tune.parameters import PRESSURE, TUNABLE, check_parameters, value_of, values_of, with_value
from palpate.lab.tune.recorded_touch import RecordedTouch, track_recorded
from palpate.parallel import spread
from palpate.pipeline.metrics import inside_95, nees, rms, rotation_errors, translation_errors
from palpate.pipeline.track import quiet

Array = NDArray[np.float64]

HELD_OUT = 4
"""Every fourth recording of a kind is not tuned on but judged by."""
LOST = 50.0
"""Score of a recording that the estimator gives up, and the most that one can have: it is that of an estimate 60 mm off
that tells 0.1 mm and 1 mrad."""

GUARDED = 0.88
"""Share of true poses that the 95 % region of each kind is to hold at least; that of few pushes is not always 95 %."""
_PRICE = 20.0  # [nats] for each share of 1 that a region lacks; a hundredth costs as much as deviations 7 % off

_FIRST_STEP, _LAST_STEP = 0.7, 0.02  # logarithms: a factor of 2, and 2 %


@dataclass(frozen=True)
class Judgement:
    """How recordings are tracked with some settings."""

    recordings: int
    """How many they are."""
    score: float
    """What tuning makes small [nats], but for the price of coverage that lacks."""
    translation_rmse_mm: float | None
    """Online, median of the recordings; None if all are given up."""
    rotation_rmse_deg: float | None
    """The same."""
    inside_95: float | None
    """Share of the true poses, from the first contact on, that are inside the 95 % region."""
    given_up: int
    """Recordings in which the estimator could not go on."""
    kinds: dict[str, "Judgement"] = field(default_factory=dict)
    """The same of each kind of recording; nothing where there is one."""


@dataclass(frozen=True)
class Tuning:
    """The best settings so far."""

    settings: TrackerSettings
    """How to track best."""
    values: dict[str, tuple[float, float]]
    """Each parameter at the start and now."""
    before: Judgement
    """Of the recordings tuned on, at the start."""
    after: Judgement
    """The same, now."""
    evaluations: int
    """How often they were tracked."""
    held_out: tuple[Judgement, Judgement] | None = None
    """Before and after of the recordings left out; None while tuning, or if there are none."""


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
    """Tune the parameters (see `check_parameters`), beginning with these settings.

    `progress` is called after each evaluation. Recordings are held out as `held_out` says. The same input gives the
    same result. Raises SettingError also where there are no recordings, and where c is to be tuned for several objects.
    """
    from scipy.optimize import minimize

    names = check_parameters(settings, parameters, evaluations)
    if not recordings:
        raise SettingError("there are no recordings to tune on")
    start = _with_radius(settings, recordings) if PRESSURE in names else settings
    begin = np.array([value_of(start, name) for name in names])
    left_out = held_out([recorded.kind for recorded in recordings])
    learning = [recorded for recorded, is_out in zip(recordings, left_out, strict=True) if not is_out]
    judging = [recorded for recorded, is_out in zip(recordings, left_out, strict=True) if is_out]
    before = judge(learning, start, workers)
    best = Tuning(start, values_of(names, start, start), before, before, 1)
    if progress:
        progress(best)
    low, high = np.log([(TUNABLE[name].lowest, TUNABLE[name].highest) for name in names]).T
    first = np.clip(np.log(np.maximum(begin, 1e-300)), low, high)

    def cost(logarithms: Array) -> float:
        nonlocal best
        tried = start
        for name, value in zip(names, np.exp(logarithms).tolist(), strict=True):
            tried = with_value(tried, name, value)
        if tried == start:
            return _cost(before, before)
        if best.evaluations == evaluations:
            raise _Spent
        found = judge(learning, tried, workers)
        if _cost(found, before) < _cost(best.after, before):
            best = replace(best, settings=tried, values=values_of(names, start, tried), after=found)
        best = replace(best, evaluations=best.evaluations + 1)
        if progress:
            progress(best)
        return _cost(found, before)

    options = {"initial_tr_radius": _FIRST_STEP, "final_tr_radius": _LAST_STEP}
    with suppress(_Spent):
        minimize(cost, first, method="COBYQA", bounds=np.stack([low, high], axis=1), options=options)
    if judging:
        sides = (judge(judging, start, workers), judge(judging, best.settings, workers))
        best = replace(best, held_out=sides)
    return best


def held_out(kinds: Sequence[str]) -> list[bool]:
    """Return which recordings of these kinds are not tuned on but judged by: every fourth of each kind."""
    seen: Counter[str] = Counter()
    left_out: list[bool] = []
    for kind in kinds:
        seen[kind] += 1
        left_out.append(seen[kind] % HELD_OUT == 0)
    return left_out


def _cost(found: Judgement, before: Judgement) -> float:
    """What tuning makes small: the score, and the price of what regions hold less than they should and did."""
    kinds = [(found.kinds[kind], before.kinds[kind]) for kind in found.kinds] or [(found, before)]
    held = [(now.inside_95 or 0.0, then.inside_95 or 0.0) for now, then in kinds]
    return found.score + _PRICE * float(np.mean([max(min(GUARDED, then) - now, 0.0) for now, then in held]))


def judge(recordings: Sequence[RecordedTouch], settings: TrackerSettings, workers: int = 1) -> Judgement:
    """Track all recordings, in so many processes, and say how well."""
    found = dict(spread(partial(_judged, settings=settings), list(enumerate(recordings)), workers))
    each = [found[index] for index in range(len(recordings))]  # in their order, for sums depend on it
    of_kind: dict[str, list[_One | None]] = {}
    for recorded, one in zip(recordings, each, strict=True):
        of_kind.setdefault(recorded.kind, []).append(one)
    kinds = {kind: _judgement(some) for kind, some in of_kind.items()}
    score = float(np.mean([kind.score for kind in kinds.values()]))
    return replace(_judgement(each), score=score, kinds=kinds if len(kinds) > 1 else {})


def _judgement(each: "Sequence[_One | None]") -> Judgement:
    """How some recordings are tracked, all of which count the same."""
    done = [one for one in each if one is not None]
    score = float(np.mean([LOST if one is None else one.score for one in each]))
    if not done:
        return Judgement(len(each), score, None, None, None, len(each))
    return Judgement(
        len(each),
        score,
        float(np.median([one.translation for one in done])) * 1e3,
        float(np.degrees(np.median([one.rotation for one in done]))),
        float(np.mean(np.concatenate([one.inside for one in done]))),
        len(each) - len(done),
    )


@dataclass(frozen=True)
class _One:
    """How one recording is tracked."""

    score: float
    translation: float  # RMSE [m]
    rotation: float  # RMSE [rad]
    inside: NDArray[np.bool_]  # whether each true pose from the first contact on is in the 95 % region


def _judged(numbered: tuple[int, RecordedTouch], settings: TrackerSettings) -> tuple[int, _One | None]:
    index, recorded = numbered
    try:
        with quiet():  # settings that are tried may be bad ones
            online = track_recorded(recorded, settings)
    except (EstimationError, FileError):  # the latter where an estimate is not finite
        return index, None
    contact, covariance = recorded.recording.contact, online.covariance
    assert contact is not None and covariance is not None
    score = negative_log_likelihood(online.pose, covariance, recorded.truth)
    known = np.isfinite(recorded.truth[:, 0])
    both = 0.5 * (score[known & contact].mean() + score[known][-1])
    inside = inside_95(nees(online.pose, covariance, recorded.truth)[known & np.maximum.accumulate(contact)])
    translation = rms(translation_errors(online.pose, recorded.truth))
    rotation = rms(rotation_errors(online.pose, recorded.truth))
    assert translation is not None and rotation is not None
    return index, _One(min(float(both), LOST), translation, rotation, inside)


def _with_radius(settings: TrackerSettings, recordings: Sequence[RecordedTouch]) -> TrackerSettings:
    """The settings with c in metres."""
    shapes = [recorded.recording.shape for recorded in recordings]
    if any(shape != shapes[0] for shape in shapes):
        raise SettingError("parameter 'pressure' is c [m] of one object, and the recordings are of several")
    return replace(settings, pressure=shapes[0].friction_radius(settings.pressure))
