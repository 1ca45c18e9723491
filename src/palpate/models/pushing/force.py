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


def make_put_force(model: Model) -> Any:
    """Return the compiled function of a model that writes the angle of the force at a step, and how much it slides."""
    motion = make_motion(model)
    grip_at = model.in_shared[GRIP].start

    @kernel
    def put_force(steps: Records, k: int, row: Records, settings: Records) -> None:
        """Write the angle of the pushing force at step k, and how much the contact slides.

        On the limit surface the force points along the motion of the centre of friction.
        """
        angle = angle_from_normal(motion(steps, k, row, settings), steps[k])
        put_sliding(k, angle, row.shared[grip_at], settings, steps[k])

    return put_force


def make_put_last_force(put_force: Any) -> Any:
    """Return the compiled function that writes the same at the last step, given that for any step."""

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
def angle_from_normal(moved: complex, now: Records) -> float:
    """Return the angle [rad] of a motion in the world from the outline's inward normal, counter-clockwise."""
    inward = -now.touch.normal * now.turn_e * now.turn_g.conjugate()
    along = moved * inward.conjugate()
    return math.atan2(along.imag, along.real)


@kernel
def put_sliding(k: int, angle: float, grip: float, settings: Records, now: Records) -> None:
    """Write an angle of the force at step k, eased, and how much the contact slides with it, with its sign.

    At the first step nothing has moved: the angle is NaN there, and nothing slides.
    """
    if k == 0:
        now.force_angle = math.nan
        now.sliding = 0.0
        return
    now.force_angle = eased(now.force_angle, angle)
    edge = math.atan(math.exp(grip)) - settings.sticking.margin
    now.sliding = side(now.force_angle) * beyond(now.force_angle, edge, settings.sticking.width)


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
