"""What a trained model is worth on recordings that it was not trained on: the paper's Table II, and honesty."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.lab.train.features import Features, PairModels, kind_of_pairs, told_by_pair
from palpate.lab.train.learn import Touch
from palpate.lab.train.pairs import draw_pairs, turned
from palpate.lab.train.samples import Samples
from palpate.lab.train.scores import coverage, log_likelihood, spread_of, without_offset
from palpate.touch.model import KINDS, Spread
from palpate.touch.relative import BACK

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

PAIRS = 50_000
"""Pairs that models are judged by."""
_FEWEST = 100  # pairs of a kind that a number is given for


def measure_spread(samples: Samples, seen: Features, models: PairModels, touch: Touch) -> dict[str, Spread]:
    """Return how far each kind of prediction is to be believed, from recordings that were held out.

    No variance is made smaller than predicted: networks learn on images of light and gels that vary more than simulated
    ones do, and real ones vary as much.
    """
    errors = prediction_errors(samples, seen, touch)
    spread = {name: _no_surer(spread_of(*errors[name], samples.episode)) for name in errors if name != "pair"}
    # An image takes part in a pair with each of those that it is compared with, and they tell no more than it does.
    together = len(BACK) * spread["turn"].together
    error, variance = errors["pair"]
    each = np.arange(len(error))  # drawn in no order, so that nothing goes together but for the above
    spread["pair"] = Spread(_no_surer(spread_of(error, variance, each)).scale, together)
    earlier, later, true = _pairs(samples)
    sine = models.tell["linear learnt"](seen, earlier, later)
    spread["linear"] = Spread(float(np.mean((np.sin(true) - sine) ** 2)), together)
    return spread


def _no_surer(spread: Spread) -> Spread:
    return replace(spread, scale=max(spread.scale, 1.0))


def judge(
    samples: Samples, seen: Features, models: PairModels, touch: Touch, spread: dict[str, Spread]
) -> dict[str, Any]:
    """Return the mean square errors of sin(yaw) by model and kind of contact, and how honest predicted variances are.

    The published loss is half of these mean squares. "sine" is the standard deviation of the true sine.
    """
    earlier, later, true = _pairs(samples)
    sine = np.sin(true)
    kinds = {name: chosen for name, chosen in kind_of_pairs(samples, earlier, later).items() if chosen.sum() >= _FEWEST}
    table: dict[str, dict[str, float]] = {}
    for name, tell in models.tell.items():
        squares = (tell(seen, earlier, later) - sine) ** 2
        table[name] = {kind: float(squares[chosen].mean()) for kind, chosen in kinds.items()}
    honesty = {}
    for name, (error, variance) in prediction_errors(samples, seen, touch).items():
        scaled = variance * spread[name].scale
        unit, per_unit = ("mm", 1e-3) if name == "place" else ("deg", np.radians(1.0))
        honesty[name] = {
            "coverage": {f"{share:g}": found for share, found in coverage(error, scaled).items()},
            "log_likelihood": log_likelihood(error, scaled),
            "log_likelihood_constant": log_likelihood(error, float(np.mean(error**2))),
            f"rms_{unit}": float(np.sqrt(np.mean(error**2)) / per_unit),
            f"median_{unit}": float(np.median(np.abs(error)) / per_unit),
        }
    told_kind = seen.kinds.argmax(axis=1)
    return {
        "frames": len(samples),
        "pairs": {kind: int(chosen.sum()) for kind, chosen in kinds.items()},
        "mean_square_of_sine": table,
        "sine": {kind: float(sine[chosen].std()) for kind, chosen in kinds.items()},
        "honesty": honesty,
        "direction_offset_of_units_deg": _unit_offsets(samples, seen),
        "kinds_told": {
            kind: float(np.mean(told_kind[samples.kind == i] == i))
            for i, kind in enumerate(KINDS)
            if np.count_nonzero(samples.kind == i) >= _FEWEST
        },
    }


def _unit_offsets(samples: Samples, seen: Features) -> float:
    """Return by how much directions are off all through a recording, standard deviation over recordings [degrees]."""
    error = se2.wrap(seen.direction[:, 0] - samples.direction)
    offsets = [np.median(error[samples.recording == number]) for number in np.unique(samples.recording)]
    return float(np.degrees(np.std(offsets)))


def prediction_errors(samples: Samples, seen: Features, touch: Touch) -> dict[str, tuple[Array, Array]]:
    """Return errors [rad] of "direction" and "turn" (N,) and "pair" (P,), each with the predicted variances.

    Of a flat pad also those of "place" (N,) [m].
    """
    earlier, later, true = _pairs(samples)
    told, variance = told_by_pair(touch, seen, earlier, later)
    place = {} if seen.place is None else {"place": (seen.place[:, 0] - samples.place, seen.place[:, 1])}
    return {
        **place,
        "direction": (se2.wrap(seen.direction[:, 0] - samples.direction), seen.direction[:, 1]),
        "turn": (_turn_error(samples, seen), seen.turn[:, 1]),
        "pair": (se2.wrap(told - true), variance),
    }


def _pairs(samples: Samples) -> tuple[Indices, Indices, Array]:
    """The pairs (P,) that models are judged by, always the same, and the true turns (P,) [rad]."""
    earlier, later = draw_pairs(samples, PAIRS, np.random.default_rng(1))
    return earlier, later, turned(samples, earlier, later)


def _turn_error(samples: Samples, seen: Features) -> Array:
    """Errors of the turn (N,) [rad], each contact's offset taken out."""
    error = seen.turn[:, 0] - samples.yaw
    starts = np.flatnonzero(np.diff(samples.episode, prepend=-1))
    for begin, end in zip(starts, [*starts[1:], len(error)], strict=True):
        error[begin:end] = np.unwrap(error[begin:end])
    _, contact = np.unique(samples.episode, return_inverse=True)
    return without_offset(error, seen.turn[:, 1], contact)
