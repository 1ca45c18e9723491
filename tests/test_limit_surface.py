import math

import numpy as np
import planar
import pytest
from limit_surface import Steering, push
from push_samples import SHAPES, gaps, model_of, pushing_residuals, sensor, touching

from palpate.models.pushing.variables import FRICTION_CENTER, FRICTION_RATIO


@pytest.mark.parametrize(
    ("y", "ratio", "aside"), [(0.02, 1.0, (0, 0)), (-0.05, 1.0, (0, 0)), (0.03, 1.5, (0.01, -0.02))]
)
def test_momentary_rotation_of_a_push_off_centre(y, ratio, aside):
    # The contact point p = (px, py) from the centre of friction moves by (d, 0) and sticks: vx - omega py = d,
    # vy + omega px = 0, and px vy - py vx = c^2 omega. Hence omega (c^2 + px^2 + py^2) = -py d.
    model = model_of("rectangle", sensor(0.0))
    tiny = Steering(speed=1e-6, aim=0.0, sway=0.0)
    friction = {FRICTION_RATIO: math.log(ratio), FRICTION_CENTER: np.array(aside) / model.friction_radius}
    o, _ = push(model, np.zeros((1, 3)), np.array([[-0.2363 / 2, y, 0.0]]), 1, tiny, friction=friction)
    px, py = -0.2363 / 2 - aside[0], y - aside[1]
    omega = -py * 1e-6 / (ratio * model.friction_radius**2 + px**2 + py**2)
    # To first order in the 1 micrometre of the step, 1e-5 of the lengths. The contact point goes with the sensor.
    np.testing.assert_allclose(o[1, 0], [1e-6 + omega * y, omega * 0.2363 / 2, omega], rtol=1e-4)


def test_a_contact_that_cannot_stick_slides_with_the_force_at_the_edge_of_the_friction_cone():
    # At p = (px, 0), pushed along (1, t): vx = 1, px vy = c^2 omega; it sticks if vy = t - omega px is within friction.
    model, px = model_of("rectangle", sensor(0.0)), -0.2363 / 2
    stuck = math.tan(0.6) / (1.0 + (px / model.friction_radius) ** 2)
    steering = Steering(speed=1e-6 / math.cos(0.6), aim=0.0, sway=0.0)
    for grip, vy in ((np.inf, stuck), (1.1 * stuck, stuck), (0.1, 0.1)):
        o, _ = push(model, np.zeros((1, 3)), np.array([[px, 0.0, 0.6]]), 1, steering, grip=grip)
        np.testing.assert_allclose(1e6 * o[1, 0], [1.0, vy, px * vy / model.friction_radius**2], rtol=1e-4)


@pytest.mark.parametrize("name", SHAPES)
def test_a_noise_free_push_stays_on_the_outline(name):
    model = model_of(name)
    g = touching(model, np.array([0.015]), 0.1)
    o, e = push(model, np.array([[0.3, 0.1, 3.1]]), g, 300, Steering())
    g = planar.between(o, e)
    residual = pushing_residuals(g[:-1], e[:-1], g[1:], e[1:], model)
    # Rolling costs r omega^2 / 2 a step in the gap, below 0.021 (0.015 rad)^2 / 2 = 3e-6 m, which does not add up.
    np.testing.assert_allclose(residual[..., :2], 0.0, atol=3e-6)
    np.testing.assert_allclose(residual[..., 2], 0.0, atol=1e-12)
    assert np.abs(gaps(g, model)).max() < 3e-6
