import math

import numpy as np
import pytest
from push_samples import SHAPES, contact_rows, pushing_rows, sensor, tips_of, touching

from palpate.geometry import se2
from palpate.graph.noise import GraphNoise
from palpate.simulation.limit_surface import NOMINAL, Steering, draw_residuals, push

STRAIGHT = Steering(speed=1e-3, aim=0.0, sway=0.0)


@pytest.mark.parametrize("radius", [0.0, 0.021])
def test_a_disc_pushed_through_its_centre_goes_straight(radius):
    tip = tips_of("disc", sensor(radius))[0]
    heading = 0.7
    o, e = push(tip, np.array([[0.1, -0.2, heading]]), np.array([[-0.088, 0.0, 0.0]]), 100, STRAIGHT)
    assert o.shape == e.shape == (101, 1, 3)
    # Object and sensor both go 1 mm a step along the heading. A spline cell's error in the normal may turn it by 1e-6.
    ahead = 1e-3 * np.arange(101)[:, None] * [math.cos(heading), math.sin(heading)]
    np.testing.assert_allclose(o[:, 0, :2], np.array([0.1, -0.2]) + ahead, atol=1e-7)
    np.testing.assert_allclose(o[:, 0, 2], heading, atol=1e-6)
    np.testing.assert_allclose(np.diff(e[:, 0, :2], axis=0), np.diff(ahead, axis=0), atol=1e-9)


@pytest.mark.parametrize("y", [0.02, -0.05])
def test_momentary_rotation_of_a_push_off_centre(y):
    # The contact point p = (px, py) moves by (d, 0) and sticks: vx - omega py = d, vy + omega px = 0, and
    # px vy - py vx = c^2 omega. Hence omega (c^2 + px^2 + py^2) = -py d.
    tip = tips_of("rectangle", sensor(0.0))[0]
    tiny = Steering(speed=1e-6, aim=0.0, sway=0.0)
    px = -0.2363 / 2
    o, _ = push(tip, np.zeros((1, 3)), np.array([[px, y, 0.0]]), 1, tiny)
    omega = -y * 1e-6 / (tip.friction_radius**2 + px**2 + y**2)
    # To first order in the 1 micrometre of the step, 1e-5 of the lengths.
    np.testing.assert_allclose(o[1, 0], [1e-6 + omega * y, -omega * px, omega], rtol=1e-4)


def test_momentary_rotation_with_another_friction():
    # As above about a centre of friction at (0.01, -0.02), from which the arm is (px, py), and with 1.5 times the c^2.
    # Its own motion v adds to that of the contact point: omega (c^2 + px^2 + py^2) = -py d again.
    tip = tips_of("rectangle", sensor(0.0))[0]
    tiny = Steering(speed=1e-6, aim=0.0, sway=0.0)
    aside = np.array([0.01, -0.02]) / tip.friction_radius
    friction = (math.log(1.5), *aside, 0.4)
    o, _ = push(tip, np.zeros((1, 3)), np.array([[-0.2363 / 2, 0.03, 0.0]]), 1, tiny, friction=friction)
    px, py = -0.2363 / 2 - 0.01, 0.03 + 0.02
    omega = -py * 1e-6 / (1.5 * tip.friction_radius**2 + px**2 + py**2)
    assert o[1, 0, 2] == pytest.approx(omega, rel=1e-4)
    # The contact point goes with the sensor.
    np.testing.assert_allclose(o[1, 0, :2], [1e-6 + omega * 0.03, omega * 0.2363 / 2], rtol=1e-4)


@pytest.mark.parametrize("name", SHAPES)
def test_a_noise_free_push_keeps_all_residuals_at_zero(name):
    tip = tips_of(name)[0]
    g = touching(tip, np.array([0.015]), 0.1)
    o, e = push(tip, np.array([[0.3, 0.1, 3.1]]), g, 80, Steering())
    g = se2.between(o, e)
    residual, _ = pushing_rows(g[:-1], e[:-1], g[1:], e[1:], tip, NOMINAL, 1.0)
    np.testing.assert_allclose(residual[..., :3], 0.0, atol=1e-12)
    # Rolling costs r omega^2 / 2 a step in the gap: below 0.021 (0.01 rad)^2 / 2 = 1e-6 m each.
    assert np.abs(contact_rows(g, 0.0, tip)[0]).max() < 80 * 1e-6


def test_drawn_slip_and_torque_are_what_the_residuals_show():
    rng = np.random.default_rng(1)
    tip = tips_of("ellipse")[0]
    slip, torque = rng.normal(0, 5e-5, (30, 4, 2)), rng.normal(0, 2e-5, (30, 4))
    g = touching(tip, np.linspace(-0.03, 0.03, 4))
    o, e = push(tip, rng.normal(size=(4, 3)), g, 30, Steering(), phase=np.arange(4.0), slip=slip, torque=torque)
    g = se2.between(o, e)
    residual, _ = pushing_rows(g[:-1], e[:-1], g[1:], e[1:], tip, NOMINAL, 1.0)
    np.testing.assert_allclose(residual[..., :2], slip, atol=1e-12)
    np.testing.assert_allclose(residual[..., 2], torque, atol=1e-12)
    # The sensor goes as it is steered, whatever slips: 1 mm along its own arc a step.
    np.testing.assert_allclose(
        se2.log(se2.between(e[:-1], e[1:]))[..., :2], np.broadcast_to([1e-3, 0], (30, 4, 2)), atol=1e-12
    )


def test_many_pushes_at_once_are_each_as_alone():
    rng = np.random.default_rng(2)
    tip = tips_of("rectangle")[0]
    first, g, phase = rng.normal(size=(5, 3)), touching(tip, rng.uniform(-0.03, 0.03, 5)), rng.uniform(0, 6, 5)
    slip, torque = rng.normal(0, 5e-5, (20, 5, 2)), rng.normal(0, 2e-5, (20, 5))
    friction = rng.normal(0.0, 0.2, (5, 4))
    o, e = push(tip, first, g, 20, Steering(), phase, slip, torque, friction)
    for k in range(5):
        one = slice(k, k + 1)
        o1, e1 = push(tip, first[one], g[one], 20, Steering(), phase[one], slip[:, one], torque[:, one], friction[k])
        # Newton stops when the slowest of them has converged to 1e-12.
        np.testing.assert_allclose(o[:, one], o1, atol=1e-9)
        np.testing.assert_allclose(e[:, one], e1, atol=1e-9)


def test_drawn_gaps_and_slips_belong_together():
    # On a side whose normal points to -x: a slip by s along the normal takes the gap with it, gap_1 = gap_0 - s.
    tip = tips_of("rectangle", sensor(0.0))[0]
    noise = GraphNoise()
    gap, slip, torque = draw_residuals(tip, noise, 1e-3, math.pi, 30, 50, np.random.default_rng(3))
    g = np.zeros((50, 3))
    g[:, 0] = -0.2363 / 2 - gap
    o, e = push(tip, np.zeros((50, 3)), g, 30, STRAIGHT, slip=slip, torque=torque)
    found = contact_rows(se2.between(o, e), 0.0, tip)[0][..., 0]
    wanted = gap - np.concatenate([np.zeros((1, 50)), np.cumsum(-slip[..., 0], axis=0)])
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    # Along the side and in torque, plain draws: 1500 of each, whose deviation is known to 1.8 %.
    sigmas = np.hypot(
        [noise.sticking, noise.sticking, noise.turning],
        1e-3 * np.array([noise.sticking_share, noise.sticking_share, noise.turning_share * tip.friction_radius]),
    )
    assert np.std(slip[..., 1]) == pytest.approx(sigmas[1], rel=0.06)
    assert np.std(torque) == pytest.approx(sigmas[2], rel=0.06)
    # Two Gaussians on each gap's neighbourhood: tighter than either alone.
    assert np.std(found) < noise.contact
    assert np.std(slip[..., 0]) < sigmas[0]
