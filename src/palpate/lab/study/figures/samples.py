"""Trials of different lengths and rates on one grid of instants."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.lab.study.figures.methods import groups_of, methods_of
from palpate.lab.study.results import ALL
from palpate.lab.study.trial import Method, Trial

Array = NDArray[np.float64]

INSTANTS = 150
"""Of the grid, at most."""
_STEP = 0.1  # between them [s], at least: the frames of a slow sensor


@dataclass(frozen=True)
class Quartiles:
    """Over sequences, at each instant (T,); NaN where fewer than half of the sequences have a value."""

    low: Array
    """A quarter of the values lie below."""
    median: Array
    """Half of the values lie below."""
    high: Array
    """Three quarters of the values lie below."""


class Samples:
    """What trials hold at the instants of one grid, which counts from the start of each.

    Frames before the first contact are left out: the object rests at its known first pose. A value is that of the
    frame nearest in time, if that is not further than three quarters of a step.
    """

    def __init__(self, trials: Sequence[Trial]) -> None:
        self.trials = trials
        longest = max((float(trial.time[-1] - trial.time[0]) for trial in trials), default=0.0)
        step = max(_STEP, longest / (INSTANTS - 1))
        self.time = np.linspace(0.0, longest, 1 + round(longest / step))
        """(T,) [s]"""
        self._frames = [_nearest(trial, self.time, 0.75 * step) for trial in trials]
        self._group = np.array([trial.group for trial in trials])
        self._method = [trial.method for trial in trials]

    @cached_property
    def methods(self) -> list[Method]:
        """In the order of legends."""
        return methods_of(self.trials)

    @cached_property
    def groups(self) -> list[str]:
        """In the order of figures; all of them together come first where there are several."""
        groups = groups_of(self.trials)
        return [ALL, *groups] if len(groups) > 1 else groups

    def of(self, quantity: Callable[[Trial], Array]) -> Array:
        """A quantity (N,) of each trial at the instants, (S, T); NaN where it is not known."""
        rows = [np.append(quantity(trial), np.nan)[at] for trial, at in zip(self.trials, self._frames, strict=True)]
        return np.array(rows).reshape(len(self.trials), len(self.time))

    def rows(self, group: str, method: Method | None = None) -> NDArray[np.bool_]:
        """Which trials (S,) are of a group, or of any if it is ALL, and of a method."""
        in_group = np.full(len(self.trials), group == ALL) | (self._group == group)
        return in_group & np.array([method in (None, found) for found in self._method], np.bool_)


def quartiles(values: Array) -> Quartiles:
    """Quartiles of values (S, T) over S."""
    kept = _kept(values)
    found = np.full((3, len(kept)), np.nan)
    # NumPy's nanpercentile goes column by column in Python; sorting puts NaN last.
    ordered = np.sort(values[:, kept], axis=0)
    place = np.array([[0.25], [0.5], [0.75]]) * (np.isfinite(ordered).sum(axis=0) - 1)
    before = place.astype(int)
    low, high = (np.take_along_axis(ordered, at, axis=0) for at in (before, np.ceil(place).astype(int)))
    found[:, kept] = low + (place - before) * (high - low)
    return Quartiles(*found)


def share(flags: Array) -> Array:
    """Share (T,) of ones among zeros and ones (S, T); NaN as in Quartiles."""
    found = np.full(flags.shape[1], np.nan)
    kept = _kept(flags)
    if kept.any():
        found[kept] = np.nanmean(flags[:, kept], axis=0)
    return found


def _kept(values: Array) -> NDArray[np.bool_]:
    known = np.isfinite(values)
    return known.any(axis=0) & (known.sum(axis=0) >= 0.5 * known.any(axis=1).sum())


def _nearest(trial: Trial, instants: Array, reach: float) -> NDArray[np.intp]:
    """Index of the frame (T,) nearest to each instant; one past the last where none is in reach or contact is to come.

    A trial without contact is taken as a whole.
    """
    time = trial.time - trial.time[0]
    after = np.searchsorted(time, instants).clip(1, max(len(time) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(time) - 1)
    nearest = np.where(np.abs(time[after] - instants) < np.abs(time[before] - instants), after, before)
    there = (np.abs(time[nearest] - instants) <= reach) & (nearest >= int(np.argmax(trial.contact)))
    return np.where(there, nearest, len(time))
