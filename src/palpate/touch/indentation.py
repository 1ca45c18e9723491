"""Imprint: how far a tip has sunk in, by how much its image differs from the untouched gel.

An object that is pushed with tens of newtons lets the tip sink in by millimetres while it rests. From then on the
imprint spreads over the image, and directions are read as nearer to the apex than they are.
"""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Levels
from palpate.compiled import compiled
from palpate.touch.touch_model import Difference, TouchModel

_MEASURED_ON = "DIGIT"
"""Sensor whose simulated imprints the numbers below are fitted to, from 0.2 to 4.6 mm."""


@dataclass(frozen=True)
class _Imprints:
    """Simulated imprints as images show them."""

    depth: float = 4.5e-3
    """[m] Indentation at the apex for a mean difference of 1. The logarithm scatters by 0.3: flat sides make large
    imprints and corners small ones."""
    off_apex: float = 1.5
    """[1/rad] Relative growth of the indentation for the same difference off the apex, where less of it is in the
    image."""
    usual: float = 1.4e-3
    """[m] Indentation that is left to the variable `depth`; more than half of all ordinary imprints show less."""
    misread_by_one: float = 2.5e-3
    """[m] Depth beyond the usual one from which a direction tells nothing: it is read wrong by 1 rad."""
    share_of_new: float = 0.5
    """Share of a new image in the depth: the mean over some two frames, without their noise."""


_IMPRINTS = _Imprints()


def is_measured(model: TouchModel | None) -> bool:
    """Return True if what a touch model sees of a sensor's imprints tells how far it has sunk in."""
    return model is not None and model.is_shipped and model.settings.sensor == _MEASURED_ON


def sunk_with(before: float, difference: Difference, angle: float) -> float:
    """Return the indentation beyond the usual one [m], with another image of a contact in which it was `before`.

    `difference` (ROWS, COLUMNS, 3) is that from the untouched gel, `angle` the direction read in it [rad].
    """
    largest = np.empty(difference.shape[:2], np.float32)
    _put_largest(np.ascontiguousarray(difference.transpose(2, 0, 1)), largest)
    change = float(largest.mean())
    seen = max(_IMPRINTS.depth * change * math.exp(_IMPRINTS.off_apex * abs(angle)) - _IMPRINTS.usual, 0.0)
    return before + _IMPRINTS.share_of_new * (seen - before)


def added_variance(sunk: float) -> float:
    """Return the growth of a direction's variance [rad^2] once the tip has sunk in so far [m]."""
    return (sunk / _IMPRINTS.misread_by_one) ** 4


@compiled(np.zeros((1, 1, 1), np.float32), np.zeros((1, 1), np.float32))
def _put_largest(difference: Levels, largest: Levels) -> None:
    """Write the largest change of each pixel (rows, columns) in any of three channels (3, rows, columns)."""
    rows, columns = largest.shape
    for row in range(rows):
        for column in range(columns):
            red = abs(difference[0, row, column])
            green = abs(difference[1, row, column])
            blue = abs(difference[2, row, column])
            largest[row, column] = max(red, green, blue)
