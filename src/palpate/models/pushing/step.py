"""What a step of pushing brings besides its factors: contact geometry, the object's pose, and its first values."""

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.manifolds.se2_kernels import adjoint, between, position, rotation, wrap
from palpate.models.generated import put_rotations
from palpate.models.pushing.contact_geometry import Surface, put_touch

SHARE_OF_SINKING = 16.0
"""Motion of the sensor that says as little about the object as sinking in by 1: while the tip sinks in, the object
rests until the force reaches the friction with the table."""


@kernel
def prepare_step(now: Records, surface: Surface) -> None:
    """Write rotations and contact geometry, which several factors read."""
    put_rotations(now)
    put_touch(position(now.g), now.turn_g, surface, now.touch)


@kernel
def put_object_pose(now: Records, pose: Array) -> None:
    """Write the object's pose o = e g^-1."""
    turn = rotation(now.e[2] - now.g[2])
    place = position(now.e) - turn * position(now.g)
    pose[0] = place.real
    pose[1] = place.imag
    pose[2] = wrap(now.e[2] - now.g[2])


@kernel
def put_object_derivative(now: Records, jacobian: Array, first: int) -> None:
    """Write the derivative of the object's pose by g and e, whose columns begin at `first`, to the first three rows.

    A perturbation d of e moves o = e g^-1 by Ad_g d, one of g by -Ad_g d.
    """
    by_g = jacobian[:3, first : first + 3]
    by_e = jacobian[:3, first + 3 : first + 6]
    adjoint(now.g, by_e)
    for r in range(3):
        for c in range(3):
            by_g[r, c] = -by_e[r, c]


def begin_step(steps: Records) -> None:
    """Begin the last of the steps (N, B), in which the measured sensor pose and the disturbance are set.

    The sensor pose in the object is that of constant motion from the two steps before.
    """
    last = len(steps) - 1
    for b in range(steps.shape[1]):
        now = steps[last, b]
        before = steps[last - 1, b]
        now.turn_measured = rotation(now.measured[2])
        travel = abs(position(now.measured) - position(before.measured))
        now.moved = travel + SHARE_OF_SINKING * abs(now.sunk - before.sunk)
        predict_step(steps[:, b])


@kernel
def predict_step(steps: Records) -> None:
    """Give the last of the steps (N,) the sensor pose in the object that constant motion would bring.

    The cost of pushing does not count in it if something else may move the object.
    """
    last = len(steps) - 1
    now = steps[last]
    before = steps[last - 1]
    now.cost[2] = 1.0 if now.spread > 0.0 else 0.0
    between(steps[max(last - 2, 0)].g, before.g, now.g)
    ahead = position(before.g) + rotation(before.g[2]) * position(now.g)
    now.g[0] = ahead.real
    now.g[1] = ahead.imag
    now.g[2] = wrap(before.g[2] + now.g[2])
