"""How a sensor unit changes while it is used: its lights warm up, and marks come on its skin."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.lab.simulate.marks import Mark, draw_mark
from palpate.lab.simulate.scene import WARMS_FOR
from palpate.lab.simulate.unit import SensorUnit

Array = NDArray[np.float64]

_LIGHT = 0.05  # most by which all lights change together, and each besides
_MARKS = 2  # most that come in a recording
_STEP = 0.5  # [s] in which a light of 250 grey levels changes by less than one


@dataclass(frozen=True, eq=False)
class Ageing:
    """What becomes of one unit in one recording."""

    light: Array
    """Shares by which the three lights grow, (3,) [1/s], for WARMS_FOR."""
    marks: tuple[Mark, ...]
    """Marks that come on its skin, and stay."""


def draw_ageing(rng: np.random.Generator) -> Ageing:
    """Draw what becomes of a unit."""
    light = rng.uniform(-_LIGHT, _LIGHT) + rng.uniform(-_LIGHT, _LIGHT, 3)
    return Ageing(light / WARMS_FOR, tuple(draw_mark(rng) for _ in range(rng.integers(_MARKS + 1))))


def over_time(unit: SensorUnit, ageing: Ageing | None, time: Array) -> Iterator[SensorUnit]:
    """Yield the unit as it is at each of these times (N,) [s], from 0; it does not change without ageing."""
    now, last = unit, -1
    for seconds in time.tolist():
        step = int(seconds / _STEP)
        if ageing is not None and step != last:
            last = step
            now = aged(unit, ageing, step * _STEP, float(time[-1]))
        yield now


def aged(unit: SensorUnit, ageing: Ageing, seconds: float, duration: float) -> SensorUnit:
    """Return the unit so many seconds after the beginning of a recording of this duration [s].

    Each light is as much stronger in an imprint as where nothing touches. What is seen there changes by as much as the
    lights do that reach it: where one hardly does, the others' part in its colour shows, and the slope of the picture
    from one side to the other drifts.
    """
    strength = 1.0 + ageing.light * min(seconds, WARMS_FOR)
    colour = strength[:, None] * unit.colour
    before, after = (np.tensordot(unit.illumination, each, axes=(0, 0)) for each in (unit.colour, colour))
    image = unit.no_contact * (after / np.maximum(before, 1e-6))
    for mark in ageing.marks:
        if mark.when * duration <= seconds:
            image += mark.on(image.shape[:2])
    no_contact = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return replace(unit, colour=colour, no_contact=no_contact)
