"""What sticking, balance and friction cone have in common: one term a step, and the motion of the object.

All of it is quasi-static pushing over one step from 0 to 1. The object's motion is taken at the centre of friction and
seen from the object at step 1, where the centre was at `g1 e1^-1 e0 g0^-1 center` at step 0.
"""

import numpy as np

from palpate.graph.compiled import Array, Complex, compiled
from palpate.graph.factors.factor import Step, Terms
from palpate.graph.se2_kernels import position, rotation

DATA = np.dtype([("moved", np.float64)])
"""How far the sensor moved in the step [m]."""


def pushing_terms(step: Step) -> Terms | None:
    """Return a term on a step and the one before; nothing at the first step of a contact."""
    if step.before is None:
        return None
    return Terms(np.array([[-1, 0]], np.int64), np.array([(step.moved,)], DATA))


@compiled
def center_of_friction(center: complex, c: float, besides_x: float, besides_y: float) -> complex:
    """Return where the centre of friction is, object frame [m]: the model's, and besides along x and y, in c."""
    return center + c * complex(besides_x, besides_y)


@compiled
def center_moved(
    g0: Array, e0: Array, g1: Array, e1: Array, center: complex, by_sensor0: Complex, by_sensor1: Complex
) -> tuple[complex, complex]:
    """Return how far the centre of friction moved [m], seen from the object at step 1, and that by the centre.

    Its derivative by g0, the negative of that by e0, goes into by_sensor0 (3,); that by e1, the negative of that by g1,
    into by_sensor1 (3,). All are complex.
    """
    turn_g0, turn_e0, turn_e1, turn_g1 = rotation(g0[2]), rotation(e0[2]), rotation(e1[2]), rotation(g1[2])
    in_sensor0 = turn_g0.conjugate() * (center - position(g0))
    in_world = position(e0) + turn_e0 * in_sensor0
    in_sensor1 = turn_e1.conjugate() * (in_world - position(e1))
    turn_sensor0 = turn_g1 * turn_e1.conjugate() * turn_e0
    by_sensor0[0], by_sensor0[1], by_sensor0[2] = turn_sensor0, 1j * turn_sensor0, 1j * turn_sensor0 * in_sensor0
    by_sensor1[0], by_sensor1[1], by_sensor1[2] = turn_g1, 1j * turn_g1, 1j * turn_g1 * in_sensor1
    moved = center - (position(g1) + turn_g1 * in_sensor1)
    return moved, 1.0 - turn_sensor0 * turn_g0.conjugate()


@compiled
def put_center_derivatives(lever: complex, by_sensor0: Complex, by_sensor1: Complex, row: Array) -> None:
    """Put the derivatives by g0, e0, g1, e1 of the imaginary part of lever times the centre's motion into row (12,)."""
    for c in range(3):
        row[c] = (lever * by_sensor0[c]).imag
        row[3 + c] = -row[c]
        row[9 + c] = (lever * by_sensor1[c]).imag
        row[6 + c] = -row[9 + c]


@compiled
def beyond(angle: float, limit: float, width: float) -> float:
    """Return how far an angle is beyond a limit, from 0 inside to 1 outside, going over within 1.5 widths of it.

    Farther inside it is 0 and not merely little: a contact that holds for minutes says little very often, and the
    friction cone would shrink to where the force is.
    """
    part = min(max(0.5 + (abs(angle) - limit) / (3.0 * width), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)
