"""Shoves as hypotheses: before a contact something else may have moved the object, unseen.

So which part of the outline a contact touches is weighed: rows whose object was moved stand beside the others.
"""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Integers
from palpate.exploring.rows import CENTER, Place, Rows


@dataclass(frozen=True)
class _Settings:
    """Settings of the proposals."""

    prior: float = 0.02
    """Probability that something else has moved the object since the contact before began."""
    distance: float = 0.02
    """Deviation of that motion along each axis [m]."""
    turn: float = 0.2
    """Deviation of its turn [rad]."""
    between: float = 0.5
    """Share of these variances that is between the new rows, as one Gaussian would be too wide to be corrected."""
    count: int = 50
    """Number of rows, the best ones, that get a copy whose object was moved."""
    kept: int = 30
    """Number of rows that stay until the next contact besides the best of each family, as a contact on a side that is
    new tells nothing of a shove."""


_SETTINGS = _Settings()
_DEVIATIONS = np.array((_SETTINGS.distance, _SETTINGS.distance, _SETTINGS.turn))
_MOVED = np.array((CENTER.start, CENTER.start + 1, Place.YAW))


def propose_shoves(rows: Rows, generator: np.random.Generator) -> None:
    """Set copies beside the best rows, whose object something else has moved; the worst rows make place."""
    rows.keep(_staying(rows))
    best = np.argsort(-rows.weight, kind="stable")[: _SETTINGS.count]
    before = len(rows.mean)
    rows.keep(np.concatenate((np.arange(before), best)))
    rows.log_weight[best] += math.log1p(-_SETTINGS.prior)
    rows.log_weight[before:] += math.log(_SETTINGS.prior)
    rows.shoves[before:] += 1
    drawn = generator.normal(size=(len(best), len(_DEVIATIONS)))
    rows.mean[before:, _MOVED] += math.sqrt(_SETTINGS.between) * _DEVIATIONS * drawn
    rows.covariance[before:, _MOVED, _MOVED] += (1.0 - _SETTINGS.between) * np.square(_DEVIATIONS)


def _staying(rows: Rows) -> Integers:
    """Return the places of the rows that stay: the best of each family, and the best of the others."""
    order = np.argsort(-rows.weight, kind="stable")
    _, firsts = np.unique(rows.family[order], return_index=True)
    others = np.delete(order, firsts)
    return np.concatenate((order[firsts], others[: _SETTINGS.kept]))
