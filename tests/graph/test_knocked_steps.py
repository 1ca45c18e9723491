"""Steps in which something else than the sensor moves the object: rows by hand, and what a window makes of them."""

import math

import numpy as np
import pytest
from push_samples import RADIUS, model_of, sensor, values_at
from test_factors import STEP, numeric_jacobian, spread_jacobian

from palpate.config import BalanceSettings, FrictionConeSettings, NoiseSettings, StickingSettings
from palpate.filter.belief import Prior
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.balance import Balance
from palpate.graph.factors.factor import Factor, Step, Terms
from palpate.graph.factors.friction_cone import FrictionCone
from palpate.graph.factors.sticking import Sticking
from palpate.graph.values import Knock, Values
from palpate.graph.variables import FRICTION_RATIO, GRIP, IN_OBJECT, OF_STEP, SENSOR_IN_OBJECT
from palpate.graph.window import Window
from palpate.types.measurements import ContactDirection

MODEL = model_of("rectangle", sensor(RADIUS))
NOISE = NoiseSettings()
KNOCK = Knock(slid=4e-3, spread=6e-3)
STEPS = 30


def terms_of(factor: Factor) -> Terms:
    arrived = factor.terms(Step(np.zeros(3), np.array([-1e-3, 0.0, 0.0]), (), [0.0, 1.0]))
    assert arrived is not None
    return Terms(arrived.places + 1, arrived.data)


def knocked(at: Values) -> Values:
    """The values with a knock in the last step."""
    knocks = np.zeros((at.smoothers, at.steps, 2))
    knocks[:, -1] = KNOCK.slid, KNOCK.spread
    return Values(at.model, {one: at[one] for one in OF_STEP}, at.shared, knocks)


def touching_left_side(y: float) -> np.ndarray:
    """A tip that pushes the left side of the rectangle at height y, along +x."""
    g = np.array([[[-0.2, y, 0.0]]])
    return np.array([-0.2 - float(MODEL.touching(g)["gap"][0, 0]) * -1.0, y, 0.0])


def two_steps(y0: float, y1: float) -> Values:
    return values_at(MODEL, np.stack([touching_left_side(y0), touching_left_side(y1)])[None])


def test_a_slide_along_the_outline_less_what_is_expected():
    """Counter-clockwise is down the left side, where the sensor goes, so that the object slides the other way."""
    factor, at = Sticking(StickingSettings()), two_steps(0.01, 0.003)
    rows = factor.linearise(knocked(at), terms_of(factor))
    np.testing.assert_allclose(rows.residual[0, 0], [-0.007 - KNOCK.slid, 0.0], atol=1e-9)
    np.testing.assert_allclose(rows.information[0, 0], [KNOCK.spread**-2, 2e-3**-2])
    np.testing.assert_array_equal(rows.weight, rows.information)


@pytest.mark.parametrize("radius", [0.0, RADIUS])
@pytest.mark.parametrize("shape", ["rectangle", "ellipse"])
def test_the_jacobian_of_a_knocked_step(shape, radius):
    model, random = model_of(shape, sensor(radius)), np.random.default_rng(0)
    g = np.stack(
        [np.array([-0.07, 0.01, 0.2]) + random.normal(0, [4e-3, 4e-3, 0.1], (20, 3)) for _ in range(2)], axis=1
    )
    at = knocked(values_at(model, g))
    factor = Sticking(StickingSettings())
    terms = terms_of(factor)
    difference = numeric_jacobian(factor, at, terms) - spread_jacobian(factor, at, terms)
    assert np.abs(difference).max() < 1e-6 + STEP


def test_nothing_of_pushing_holds_in_a_knocked_step():
    factor, at = FrictionCone(FrictionConeSettings()), two_steps(0.01, 0.03)
    assert (factor.linearise(at, terms_of(factor)).information > 0.0).all()
    rows = factor.linearise(knocked(at), terms_of(factor))
    assert not rows.weight.any() and not rows.information.any()


def test_a_knocked_object_turns_no_farther_than_a_hand_turns_it():
    """Three times as far, at the distance c, as it slides, and whatever friction is; it turns as the sensor turns less
    in it."""
    factor, c = Balance(BalanceSettings(), MODEL), MODEL.friction_radius
    g, e = [[[-0.2, 0.0, 0.3], [-0.19, 0.02, 0.25]]], [[[0.0, 0.0, 0.1], [0.0, 0.01, 0.15]]]
    at = values_at(MODEL, g, e, {FRICTION_RATIO: 0.4})
    rows = factor.linearise(knocked(at), terms_of(factor))
    np.testing.assert_allclose(rows.residual, -(c**2) * 0.1)
    np.testing.assert_allclose(rows.information, (3.0 * c * KNOCK.spread) ** -2)
    difference = numeric_jacobian(factor, knocked(at), terms_of(factor)) - spread_jacobian(
        factor, knocked(at), terms_of(factor)
    )
    assert np.abs(difference).max() < 1e-9
    # Rows are used again: one that was knocked and is no longer is as if it had never been.
    again = factor.empty_rows(1, 1)
    for one in (at, knocked(at), at):
        factor.linearise_into(again, one, terms_of(factor))
    np.testing.assert_array_equal(again.jacobian, factor.linearise(at, terms_of(factor)).jacobian)


def test_a_tip_goes_along_a_side_and_round_a_disc():
    start = touching_left_side(0.02)
    moved = MODEL.moved_along(np.stack([start, start]), np.array([0.015, -0.01]))
    np.testing.assert_allclose(moved - start, [[0, -0.015, 0], [0, 0.01, 0]], atol=1e-6)
    disc, length = model_of("disc", sensor(0.0)), 0.02
    radius = -float(disc.touching_at(np.zeros(3))["gap"])
    after = disc.moved_along(np.array([[radius, 0.0, 0.3]]), np.array([length]))[0]
    np.testing.assert_allclose(
        after[:2], radius * np.array([math.cos(length / radius), math.sin(length / radius)]), atol=2e-5
    )
    assert after[2] == 0.3


def window_of(steps: int = STEPS) -> tuple[Window, np.ndarray]:
    """A tip that pushes the left side straight on, through the centre, and its way."""
    start = touching_left_side(0.0)
    way = start + np.arange(steps)[:, None] * [1e-3, 0.0, 0.0]
    deviation = np.concatenate([[5e-4, 5e-4, 5e-3], NOISE.priors.deviation])
    prior = Prior(np.zeros(3), NOISE.priors.mean, np.diag(np.square(deviation)))
    said = [ContactDirection(0.0, 1e-4)]
    window = Window(make_factors(NOISE, MODEL), MODEL, [prior], way[0], said)
    for index, pose in enumerate(way[1:], 1):
        window.add(pose, said, index / 30)
    return window, way


def along(window: Window) -> float:
    """Where the tip is along the left side [m]."""
    return float(window.values[SENSOR_IN_OBJECT][0, -1, 1])


def deviation_along(window: Window) -> float:
    covariance = window.belief().prior.pose_covariance
    return math.sqrt(covariance[1, 1])


def test_a_window_slides_and_does_not_know_how_far():
    window, _ = window_of()
    before, sure = along(window), deviation_along(window)
    poses = window.values[SENSOR_IN_OBJECT].copy()
    for slid in (0.0, 0.015, -0.015):
        other = window.knocked(8, (slid, 0.01))
        # Seen from the object, which slides counter-clockwise, the sensor goes clockwise: up the left side.
        assert along(other) - before == pytest.approx(slid, abs=2e-3)
        assert deviation_along(other) == pytest.approx(0.01, rel=0.15) and sure < 3e-3
    np.testing.assert_array_equal(window.values[SENSOR_IN_OBJECT], poses)


def test_a_knocked_window_and_the_one_it_comes_from_go_their_own_ways():
    window, way = window_of()
    alone, _ = window_of()
    other = window.knocked(8, (0.015, 0.01))
    for index in range(5):
        pose = way[-1] + np.array([1e-3 * (index + 1), 0.0, 0.0])
        for each in (window, alone, other):
            each.add(pose, [ContactDirection(0.0, 1e-4)], (STEPS + index) / 30)
    np.testing.assert_array_equal(window.values[SENSOR_IN_OBJECT], alone.values[SENSOR_IN_OBJECT])
    assert window.costs().shape == other.costs().shape == (1, STEPS + 5, 2)


def test_the_balance_tells_after_a_knock_how_far_it_slid():
    """Pushed straight on without turning, the object is pushed through its centre: 15 mm beside it cannot be."""
    window, way = window_of()
    other = window.knocked(8, (0.015, 0.01))
    for index in range(40):
        pose = way[-1] + np.array([1e-3 * (index + 1), 0.0, 0.0])
        other.add(pose, [ContactDirection(0.0, 1e-4)], (STEPS + index) / 30)
    assert abs(along(other)) < 6e-3 and deviation_along(other) < 7e-3


def test_grip_is_believed_to_be_another_one():
    window, _ = window_of()
    other = window.knocked(8, (0.0, 0.01), (NOISE.priors.grip, (0.15, 0.05)))
    assert window.belief().values[IN_OBJECT[GRIP]] == pytest.approx(NOISE.priors.grip[0], abs=0.02)
    assert other.belief().values[IN_OBJECT[GRIP]] == pytest.approx(0.15, abs=0.02)


def test_a_tip_that_is_moved_aside_costs_pushing_and_not_what_is_measured():
    window, way = window_of()
    for index in range(3):
        window.add(
            way[-1] + np.array([0.0, 4e-3 * (index + 1), 0.0]), [ContactDirection(0.0, 1e-4)], (STEPS + index) / 30
        )
    measured, pushing = window.costs()[0, -3:].sum(axis=0)
    assert pushing > 10 * measured
    assert window.mean_square("sticking", 3) > 10 * window.mean_square("sticking", STEPS + 3) / 3
