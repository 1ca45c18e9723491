"""Scores of the paper's study: how far pushes turn about the contact, and final errors with bootstrap intervals."""

from collections.abc import Sequence
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


def loss_of_constant(relative: Array, episode: NDArray[np.int_]) -> float:
    """Return the loss of Table II of a constant on one sequence: half of the mean square sine of the turn.

    Over all pairs of frames of one contact, 10 to 50 apart; relative (N, 3) is the sensor's pose in the object frame,
    episode (N,) numbers the contacts, -1 outside. NaN where there is no pair.
    """
    squares = []
    for back in range(10, 51):
        of_one = (episode[back:] >= 0) & (episode[back:] == episode[:-back])
        squares.append(np.sin(relative[back:, 2] - relative[:-back, 2])[of_one] ** 2)
    together = np.concatenate(squares)
    return float(0.5 * together.mean()) if len(together) else float("nan")


def turning(paths: Sequence[Path]) -> dict[str, dict[str, float]]:
    """Return, by object, the loss of a constant over sequences, each of which counts the same, and its 95 % interval.

    A constant has nothing to learn, so this takes all sequences and not those for validation alone.
    """
    by_object: dict[str, list[float]] = {}
    for path in paths:
        recording = load_recording(path)
        relative = se2.between(np.asarray(recording.object_pose), recording.sensor_pose)
        loss = loss_of_constant(relative, episode_numbers(np.asarray(recording.contact)))
        by_object.setdefault(path.stem.split("-")[0], []).append(loss)
    found = {}
    for name, losses in by_object.items():
        known = np.array(losses)[np.isfinite(losses)]
        drawn = known[_draws(len(known))].mean(axis=1)
        low, high = np.percentile(drawn, (2.5, 97.5)).tolist()
        found[name] = {"const": float(known.mean()), "low": low, "high": high, "sequences": len(known)}
    return found


def tracking_scores(trials: Sequence[Trial], methods: Sequence[str]) -> dict[str, Any]:
    """Return, by object, for each method: medians of final errors with 95 % intervals, sequences, lost, in 95 %.

    Objects that have all the paper's modes have `in_order` too: the share of bootstrap draws in which the medians of
    both errors stand in the paper's order.
    """
    scores: dict[str, Any] = {}
    for name in dict.fromkeys(trial.recording.split("-")[0] for trial in trials):
        of_object = [trial for trial in trials if trial.recording.startswith(name)]
        scores[name] = {}
        for method in methods:
            scores[name][method] = _scores([trial for trial in of_object if trial.method == method])
        if set(ORDER) <= set(methods):
            scores[name]["in_order"] = _share_in_order(of_object)
    return scores


def _scores(trials: Sequence[Trial]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for unit, errors in _finals(trials).items():
        low, high = np.percentile(np.median(errors[_draws(len(errors))], axis=1), (2.5, 97.5)).tolist()
        row[unit] = {"median": float(np.median(errors)), "low": low, "high": high}
    counted = np.concatenate([trial.nees[since_contact(trial.contact, trial.nees)] for trial in trials])
    row["sequences"] = len(trials)
    row["lost"] = sum(map(is_lost, trials))
    row["in_95_share"] = float(np.mean(inside_95(counted)))
    return row


def _finals(trials: Sequence[Trial]) -> dict[str, Array]:
    return {
        unit: np.array([trial.summary[FINALS[f"final_{unit}"]] for trial in trials], np.float64)
        for unit in ("mm", "deg")
    }


def _share_in_order(trials: Sequence[Trial]) -> dict[str, float]:
    """Return the share of draws of sequences in which the medians are in order, of both errors."""
    by_mode = [_finals([trial for trial in trials if trial.method == mode]) for mode in ORDER]
    shares = {}
    for unit in ("mm", "deg"):
        draws = _draws(len(by_mode[0][unit]))
        medians = [np.median(finals[unit][draws], axis=1) for finals in by_mode]
        in_order = (medians[0] > medians[1]) & (medians[1] > medians[2]) & (medians[2] >= medians[3])
        shares[unit] = float(in_order.mean())
    return shares


def _draws(count: int) -> Any:
    return np.random.default_rng(0).integers(count, size=(DRAWS, count))
