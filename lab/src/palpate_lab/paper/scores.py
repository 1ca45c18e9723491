"""Scores of the paper's study: how far pushes turn about the contact, and final errors with bootstrap intervals."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.io import load_recording
from palpate.pipeline.metrics import inside_95, since_contact
from palpate_lab.paper.images import episode_numbers
from palpate_lab.study.results import FINALS, is_lost
from palpate_lab.study.study import Trial

DRAWS = 2000
"""Draws of a bootstrap."""
ORDER = ("none", "const", "learnt", "oracle")
"""The paper's claim: each has larger final errors than the next."""


def squares_of_turns(relative: Array, episode: NDArray[np.int_]) -> Array:
    """Return the square sines of the turns of all pairs of frames of one contact, 10 to 50 apart.

    relative (N, 3) is the sensor's pose in the object frame, episode (N,) numbers the contacts, -1 outside.
    """
    squares = []
    for back in range(10, 51):
        of_one = (episode[back:] >= 0) & (episode[back:] == episode[:-back])
        squares.append(np.sin(relative[back:, 2] - relative[:-back, 2])[of_one] ** 2)
    return np.concatenate(squares)


def loss_of_constant(relative: Array, episode: NDArray[np.int_]) -> float:
    """Return the loss of Table II of a constant on one sequence: half of the mean square sine of the turn.

    NaN where there is no pair.
    """
    squares = squares_of_turns(relative, episode)
    return float(0.5 * squares.mean()) if len(squares) else float("nan")


def turning(paths: Sequence[Path]) -> dict[str, dict[str, float]]:
    """Return, by object, the loss of a constant over all pairs of sequences, and its 95 % interval by sequences.

    A constant has nothing to learn, so this takes all sequences and not those for validation alone.
    """
    by_object: dict[str, list[tuple[float, int]]] = {}
    for path in paths:
        recording = load_recording(path)
        relative = se2.between(np.asarray(recording.object_pose), recording.sensor_pose)
        squares = squares_of_turns(relative, episode_numbers(np.asarray(recording.contact)))
        by_object.setdefault(path.stem.split("-")[0], []).append((float(squares.sum()), len(squares)))
    found = {}
    for name, sums in by_object.items():
        total, pairs = np.array(sums).T
        draws = _draws(len(total))
        drawn = 0.5 * total[draws].sum(axis=1) / np.maximum(pairs[draws].sum(axis=1), 1.0)
        low, high = np.percentile(drawn, (2.5, 97.5)).tolist()
        const = float(0.5 * total.sum() / pairs.sum())
        found[name] = {"const": const, "low": low, "high": high, "sequences": len(total)}
    return found


def turn_followed(trials: Sequence[Trial]) -> float:
    """Return the median over trials of the share of the object's turning, second by second, that the estimate shows.

    By least squares: 1 where it turns as the object does, 0 where it does not know of the turning.
    """
    shares = []
    for trial in trials:
        each_second = np.searchsorted(trial.time, np.arange(trial.time[0], trial.time[-1], 1.0))
        true = np.diff(np.unwrap(trial.truth[:, 2])[each_second])
        estimated = np.diff(np.unwrap(trial.pose[:, 2])[each_second])
        shares.append(float(estimated @ true / (true @ true)))
    return float(np.median(shares))


def tracking_scores(trials: Sequence[Trial], methods: Sequence[str]) -> dict[str, Any]:
    """Return, by object, for each method: medians of final errors with 95 % intervals, sequences, lost, in 95 %.

    With `turn_followed`, and the share of frames in the regions of 95 %.
    """
    scores: dict[str, Any] = {}
    for name in dict.fromkeys(trial.recording.split("-")[0] for trial in trials):
        of_object = [trial for trial in trials if trial.recording.startswith(name)]
        scores[name] = {}
        for method in methods:
            scores[name][method] = _scores([trial for trial in of_object if trial.method == method])
    return scores


def median_with_interval(trials: Sequence[Trial], unit: str) -> dict[str, float]:
    """Return the median of final errors, in mm or deg, and its 95 % interval by a bootstrap of sequences."""
    errors = _finals(trials)[unit]
    low, high = np.percentile(np.median(errors[_draws(len(errors))], axis=1), (2.5, 97.5)).tolist()
    return {"median": float(np.median(errors)), "low": low, "high": high}


def order_scores(trials: Sequence[Trial]) -> dict[str, dict[str, dict[str, float]]]:
    """Return, by object, the share of bootstrap draws in which the medians of each error stand in the paper's order.

    Of all four modes together, "in order", and of each and the next, such as "none > const".
    """
    found = {}
    for name in dict.fromkeys(trial.recording.split("-")[0] for trial in trials):
        of_object = [trial for trial in trials if trial.recording.startswith(name)]
        shares = {"in order": share_in_order(of_object)}
        for larger, smaller in pairwise(ORDER):
            shares[f"{larger} > {smaller}"] = share_in_order(of_object, (larger, smaller))
        found[name] = shares
    return found


def share_in_order(trials: Sequence[Trial], order: Sequence[str] = ORDER) -> dict[str, float]:
    """Return the share of draws of sequences in which the medians are in order, of both errors."""
    by_mode = [_finals([trial for trial in trials if trial.method == mode]) for mode in order]
    shares = {}
    for unit in ("mm", "deg"):
        draws = _draws(len(by_mode[0][unit]))
        medians = [np.median(finals[unit][draws], axis=1) for finals in by_mode]
        in_order = np.ones(len(draws), np.bool_)
        for larger, smaller, mode in zip(medians, medians[1:], order[1:], strict=False):
            in_order &= (larger >= smaller) if mode == ORDER[-1] else (larger > smaller)
        shares[unit] = float(in_order.mean())
    return shares


def _scores(trials: Sequence[Trial]) -> dict[str, Any]:
    row: dict[str, Any] = {unit: median_with_interval(trials, unit) for unit in ("mm", "deg")}
    counted = np.concatenate([trial.nees[since_contact(trial.contact, trial.nees)] for trial in trials])
    row["sequences"] = len(trials)
    row["lost"] = sum(map(is_lost, trials))
    row["in_95_share"] = float(np.mean(inside_95(counted)))
    row["turn_followed"] = turn_followed(trials)
    return row


def _finals(trials: Sequence[Trial]) -> dict[str, Array]:
    return {
        unit: np.array([trial.summary[FINALS[f"final_{unit}"]] for trial in trials], np.float64)
        for unit in ("mm", "deg")
    }


def _draws(count: int) -> Any:
    return np.random.default_rng(0).integers(count, size=(DRAWS, count))
