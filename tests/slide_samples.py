"""Pushes in which the object slides over the sensor, which `limit_surface` does not draw: by itself, or by a hand."""

import math

import numpy as np
from push_samples import model_of, rows_of, touching, values_at
from smoother_samples import ROBUST

from palpate.geometry import se2
from palpate.graph.variables import GRIP
from palpate.lab.simulate.limit_surface import Steering, push

Array = np.ndarray
MODEL = model_of("rectangle")
HAND = 5  # frames in which a hand moves the object
DEEPER = np.array([ROBUST.priors.depth[0], 0.0, 0.0])  # [m], into the left side as deep as is expected


def slid(y: float, heading: float, grip: float, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push by which the sensor slides along the rectangle's left side.

    The sensor goes straight on at an angle of heading [rad] from the side's normal at first, outside the friction cone.
    The object moves as the balance says with the force at the cone's edge, and the sensor stays on its side.
    """
    on_normal_balance_and_cone = [0, 2, 3]
    g = touching(MODEL, y) + DEEPER
    touches, sensors = [g], [g]
    for _ in range(steps):
        e = sensors[-1] + 1e-3 * np.array([math.cos(heading), math.sin(heading), 0.0])
        g = touches[-1]
        for _ in range(8):
            at = values_at(MODEL, [[touches[-1], g]], [[sensors[-1], e]], {GRIP: grip})
            rows = [rows_of(name, at) for name in ("sticking", "balance", "friction_cone")]
            residual = np.concatenate([one.residual[0, 0] for one in rows])[on_normal_balance_and_cone]
            jacobian = np.concatenate([one.jacobian[0, 0, :, 6:9] for one in rows])  # by g1
            change = -np.linalg.solve(jacobian[on_normal_balance_and_cone], residual)
            g = se2.compose(g, se2.exp(change))
        touches.append(g)
        sensors.append(e)
    return se2.compose(np.array(sensors), se2.inverse(np.array(touches))), np.array(sensors)


def by_hand(o: Array, e: Array, slid: float, turned: float, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push of the rectangle, what a hand does after it, and so many steps of pushing on.

    The hand slides the object over the sensor [m] and turns it [rad].
    """
    objects, sensors, g = [*o], [*e], se2.between(o[-1], e[-1])
    for _ in range(HAND):
        sensor_pose = se2.compose(sensors[-1], [1e-3, 0.0, 0.0])
        g = MODEL.moved_along(g[None], np.array([-slid / HAND]))[0] - [0.0, 0.0, turned / HAND]
        for _ in range(5):
            touch = MODEL.touching(g[None, None])[0, 0]
            way = touch["gap"] * touch["normal"]
            g = g - [way.real, way.imag, 0.0]
        objects.append(se2.compose(sensor_pose, se2.inverse(g)))
        sensors.append(sensor_pose)
    o_after, e_after = push(MODEL, objects[-1][None], g[None], steps, Steering())
    return np.concatenate([objects, o_after[1:, 0]]), np.concatenate([sensors, e_after[1:, 0]])
