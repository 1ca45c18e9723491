"""Quasi-static pushing over one step: common parts of sticking, balance and friction cone.

The object's motion is taken at the centre of friction and expressed in the object frame at step 1, in which the centre
was at `g1 e1^-1 e0 g0^-1 center` at step 0.
"""

import numpy as np

from palpate.graph.compiled import Array, Complex, compiled
from palpate.graph.factors.factor import Step, Terms
from palpate.graph.se2_kernels import position, rotation

DATA = np.dtype([("moved", np.float64)])
"""Distance of the sensor from the step before [m]."""


def pushing_terms(step: Step) -> Terms | None:
    """Return a term on a step and the one before; None at the first step of a contact."""
    if step.before is None:
        return None
    return Terms(np.zeros(1, np.int64), np.array([(step.moved,)], DATA))


@compiled
def center_of_friction(centroid: complex, c: float, shift_x: float, shift_y: float) -> complex:
    """Return the centre of friction [m], object frame, shifted from the centroid along x and y in units of c."""
    return centroid + c * complex(shift_x, shift_y)


@compiled
def center_moved(
    g0: Array, e0: Array, g1: Array, e1: Array, center: complex, by_sensor0: Complex, by_sensor1: Complex
) -> tuple[complex, complex]:
    """Return the motion of the centre of friction [m] in the object frame at step 1, and its derivative by the centre.

    The derivative by g0, which is minus that by e0, is written to by_sensor0 (3,); that by e1, which is minus that by
    g1, to by_sensor1 (3,). All are complex.
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
def write_center_derivatives(lever: complex, by_sensor0: Complex, by_sensor1: Complex, row: Array) -> None:
    """Write the derivatives by g0, e0, g1, e1 of Im(lever times the centre's motion) to row (12,)."""
    for c in range(3):
        row[c] = (lever * by_sensor0[c]).imag
        row[3 + c] = -row[c]
        row[9 + c] = (lever * by_sensor1[c]).imag
        row[6 + c] = -row[9 + c]


@compiled
def beyond(angle: float, limit: float, width: float) -> float:
    """Return 0 where |angle| is inside a limit and 1 where it is outside, smoothly within 1.5 widths of it.

    Farther inside it is exactly 0: in a contact that sticks for minutes, many small values would add up and shrink the
    friction cone to the force.
    """
    part = min(max(0.5 + (abs(angle) - limit) / (3.0 * width), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)
