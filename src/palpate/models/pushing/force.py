"""Angle of the pushing force, by the motion of the object over several steps, and by how much the contact slides.

The angle decides if a contact slides, and the slide turns the force: if all of a change were taken over at once, a
contact at the edge of the friction cone would stick and slide in turns and never be solved.
"""

import math
from typing import Any

from palpate.arrays import Records
from palpate.compiled import kernel
from palpate.estimation.model import Model
from palpate.manifolds.function_kernels import beyond, side
from palpate.manifolds.se2_kernels import position, rotation, wrap
from palpate.models.pushing.variables import FRICTION_CENTER, GRIP

NEIGHBOURS = 3
"""Steps before and after a step over which the angle of the force is computed: one alone is mostly noise."""
EASING = 0.25
"""Share of a change of the angle that one Gauss-Newton step takes over. With 1, shoves that did not happen win more
often."""


def make_motion(model: Model) -> Any:
    """Return the compiled function of a model of pushing that gives the motion of the centre of friction."""
    center_at = model.in_shared[FRICTION_CENTER].start

    @kernel
    def motion(steps: Records, k: int, row: Records, settings: Records) -> complex:
        """Return the motion over the steps around step k [m], in the world."""
        last = steps[min(k + NEIGHBOURS, len(steps)) - 1]
        first = steps[max(k - NEIGHBOURS, 0)]
        shift = complex(row.shared[center_at], row.shared[center_at + 1])
        center = settings.support.center + settings.support.radius * shift
        return _in_world(last, center) - _in_world(first, center)

    return motion


def make_force_angle(model: Model) -> Any:
    """Return the compiled function of a model of pushing that gives the angle of the pushing force."""
    motion = make_motion(model)

    @kernel
    def force_angle(steps: Records, k: int, row: Records, settings: Records) -> float:
        """Return the angle of the pushing force at step k, from the outline's inward normal, counter-clockwise [rad].

        On the limit surface the force points along the motion of the centre of friction. NaN at the first step.
        """
        if k == 0:
            return math.nan
        now = steps[k]
        moved = motion(steps, k, row, settings)
        inward = -now.touch.normal * now.turn_e * now.turn_g.conjugate()
        along = moved * inward.conjugate()
        return math.atan2(along.imag, along.real)

    return force_angle


def make_put_force(model: Model) -> Any:
    """Return the compiled function of a model that writes the angle of the force at a step, and how much it slides."""
    force_angle = make_force_angle(model)
    grip_at = model.in_shared[GRIP].start

    @kernel
    def put_force(steps: Records, k: int, row: Records, settings: Records) -> None:
        """Write the angle of the pushing force at step k, and how much the contact slides, with the force's sign."""
        now = steps[k]
        now.force_angle = eased(now.force_angle, force_angle(steps, k, row, settings))
        edge = math.atan(math.exp(row.shared[grip_at])) - settings.sticking.margin
        now.sliding = side(now.force_angle) * beyond(now.force_angle, edge, settings.sticking.width) if k > 0 else 0.0

    return put_force


def make_put_last_force(model: Model) -> Any:
    """Return the compiled function of a model that writes the same at the last step."""
    put_force = make_put_force(model)

    @kernel
    def put_last_force(steps: Records, row: Records, settings: Records) -> None:
        """Write the angle and the sliding at the last step, once the steps have moved."""
        last = len(steps) - 1
        for k in range(max(last - NEIGHBOURS, 0), last):
            steps[k].turn_g = rotation(steps[k].g[2])
            steps[k].turn_e = rotation(steps[k].e[2])
        put_force(steps, last, row, settings)

    return put_last_force


@kernel
def eased(before: float, angle: float) -> float:
    """Return an angle [rad] on the way from the one before, which is 0 where there is none yet."""
    if before == 0.0 or not math.isfinite(before):
        return angle
    return wrap(before + EASING * wrap(angle - before))


@kernel
def _in_world(now: Records, point: complex) -> complex:
    """Return a point of the object [m] in the world at a step."""
    return position(now.e) + now.turn_e * now.turn_g.conjugate() * (point - position(now.g))
