"""Angle of the pushing force, by the motion of the object over several steps."""

import math
from typing import Any

from palpate.arrays import Records
from palpate.compiled import kernel
from palpate.estimation.model import Model
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.pushing.variables import FRICTION_CENTER

NEIGHBOURS = 3
"""Steps before and after a step over which the angle of the force is computed: one alone is mostly noise."""


def make_force_angle(model: Model) -> Any:
    """Return the compiled function of a model of pushing that gives the angle of the pushing force."""
    center_at = model.in_shared[FRICTION_CENTER].start

    @kernel
    def force_angle(steps: Records, k: int, row: Records, settings: Records) -> float:
        """Return the angle of the pushing force at step k, from the outline's inward normal, counter-clockwise [rad].

        On the limit surface the force points along the motion of the centre of friction. NaN at the first step.
        """
        if k == 0:
            return math.nan
        now = steps[k]
        last = steps[min(k + NEIGHBOURS, len(steps)) - 1]
        first = steps[max(k - NEIGHBOURS, 0)]
        shift = complex(row.shared[center_at], row.shared[center_at + 1])
        center = settings.support.center + settings.support.radius * shift
        moved = _in_world(last, center) - _in_world(first, center)
        inward = -now.touch.normal * now.turn_e * now.turn_g.conjugate()
        along = moved * inward.conjugate()
        return math.atan2(along.imag, along.real)

    return force_angle


def make_put_force_angle(model: Model) -> Any:
    """Return the compiled function that writes the angle of the pushing force at a step."""
    force_angle = make_force_angle(model)

    @kernel
    def put_force_angle(steps: Records, k: int, row: Records, settings: Records) -> None:
        """Write the angle of the pushing force at step k."""
        steps[k].force_angle = force_angle(steps, k, row, settings)

    return put_force_angle


def make_put_last_force_angle(model: Model) -> Any:
    """Return the compiled function that writes the angle of the pushing force at the last step."""
    force_angle = make_force_angle(model)

    @kernel
    def put_last_force_angle(steps: Records, row: Records, settings: Records) -> None:
        """Write the angle at the last step, once the steps have moved."""
        last = len(steps) - 1
        for k in range(max(last - NEIGHBOURS, 0), last):
            steps[k].turn_g = rotation(steps[k].g[2])
            steps[k].turn_e = rotation(steps[k].e[2])
        steps[last].force_angle = force_angle(steps, last, row, settings)

    return put_last_force_angle


@kernel
def _in_world(now: Records, point: complex) -> complex:
    """Return a point of the object [m] in the world at a step."""
    return position(now.e) + now.turn_e * now.turn_g.conjugate() * (point - position(now.g))
