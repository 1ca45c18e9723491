"""Weights of factors by their settings, computed by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import SHAPES, rows_of, sensor, touching, values_at, with_settings

from palpate import ContactDirection, NoiseSettings, Turn
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import contact_model
from palpate.models.pushing.variables import GRIP

ONE_TIP = replace(contact_model(SHAPES["rectangle"], sensor()), friction_radius=0.06)
EDGE = np.arctan(0.4)  # half angle of the friction cone at a grip of 0.4
SLIDE = with_settings(  # holds to 5e-5 m, slides by 3e-3 m, where the sensor moves by 1 mm
    NoiseSettings(),
    sticking={"still": 3e-5, "share": 0.04, "sliding_share": 3.0, "margin": 0.1, "width": 0.02, "kernel": None},
    balance={"still": 4e-6, "share": 0.5, "kernel": None},
    friction_cone={"still": 3e-5, "share": 0.05, "width": 0.02, "kernel": None},
)


def sigmas(noise: NoiseSettings, angle: Any, moved: float = 1e-3, grip: float = 0.4) -> np.ndarray:
    """Standard deviations (N, 4) of sticking, balance and cone, with the pushing force at angles (N,) from the normal.

    The sensor has moved so far in the step; the contact sticks.
    """
    angle = np.atleast_1d(np.asarray(angle, np.float64))
    g = np.tile(touching(ONE_TIP, 0.02), (len(angle), 2, 1))
    o = np.zeros((len(angle), 2, 3))
    o[:, 1, 0], o[:, 1, 1] = 1e-3 * np.cos(angle), 1e-3 * np.sin(angle)
    at = values_at(ONE_TIP, g, se2.compose(o, g), {GRIP: np.log(grip)})
    rows = [rows_of(name, at, moved=moved, noise=noise) for name in ("sticking", "balance", "friction_cone")]
    with np.errstate(divide="ignore"):
        return np.concatenate([each.information[:, 0] ** -0.5 for each in rows], axis=1)


@pytest.mark.parametrize("angle", [0.0, 0.1, -0.1])
def test_inside_the_cone_the_contact_holds(angle):
    # Still: the floors. Moved by 1 mm: hypot(3e-5, 4e-5) = 5e-5 m and hypot(4e-6, 0.5 * 1e-3 * 0.06 = 3e-5) m^2. The
    # cone's edge is at 0.3805 rad and sliding begins around 0.2805, nine widths away.
    found = np.concatenate([sigmas(SLIDE, angle, moved) for moved in (0.0, 1e-3)])
    np.testing.assert_allclose(found[:, :3], [[3e-5, 3e-5, 4e-6], [5e-5, 5e-5, np.hypot(4e-6, 3e-5)]], rtol=1e-6)
    # Nothing at all says that it is at the cone's edge, up to one and a half widths from it.
    assert np.isinf(found[:, 3]).all()
    assert np.isinf(sigmas(SLIDE, EDGE - 0.0301)[0, 3])
    assert np.isfinite(sigmas(SLIDE, EDGE - 0.0299)[0, 3])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_outside_the_cone_it_slides_and_the_force_is_at_the_edge(side):
    # hypot(3e-5, 3 * 1e-3) of sliding, hypot(3e-5, 0.05 * 1e-3) off the edge; the balance as before.
    wanted = [np.hypot(3e-5, 3e-3)] * 2 + [np.hypot(4e-6, 3e-5), np.hypot(3e-5, 5e-5)]
    for angle in (EDGE + 0.2, 1.5, 3.1):
        np.testing.assert_allclose(sigmas(SLIDE, side * angle), [wanted], rtol=1e-6)
    # Still, nothing slides.
    np.testing.assert_allclose(sigmas(SLIDE, side * 1.5, 0.0), [[3e-5, 3e-5, 4e-6, 3e-5]], rtol=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_between_holding_and_sliding(side):
    holds, slides, off = 5e-5, np.hypot(3e-5, 3e-3), np.hypot(3e-5, 5e-5)
    # Half way at the margin from the edge: the geometric mean. The cone is still 5 widths away.
    found = sigmas(SLIDE, side * (EDGE - 0.1))[0]
    np.testing.assert_allclose(found[:2], np.sqrt(holds * slides), rtol=1e-9)
    assert np.isinf(found[3])
    # At the edge it slides, and half the weight is on the cone.
    found = sigmas(SLIDE, side * EDGE)[0]
    np.testing.assert_allclose(found[:2], slides, rtol=1e-3)
    assert found[3] == pytest.approx(off * np.sqrt(2))
    # A width further, five sixths of the way: (5/6)^2 (3 - 5/3) = 25/27.
    assert sigmas(SLIDE, side * (EDGE + 0.02))[0, 3] == pytest.approx(off * np.sqrt(27 / 25))
    # The better the grip the wider the cone.
    np.testing.assert_allclose(sigmas(SLIDE, side * EDGE, grip=0.8)[0, :2], holds, rtol=1e-4)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (EDGE + 0.2, 0.3e-3),  # the force points up the left side: the sensor is expected to slide up by 0.3 of 1 mm
        (-EDGE - 0.2, -0.3e-3),
        (EDGE - 0.1, 0.15e-3),  # the edge less the margin: half of it
        (0.2, 0.0),
    ],
)
def test_a_slide_is_expected_to_the_side_of_the_force(angle, expected):
    # On the left side, the object moves by 1 mm at this angle from the normal, and the sensor slides up by 0.1 mm.
    noise = with_settings(SLIDE, sticking={"expected_share": 0.3, "margin": 0.1})
    g = np.tile(touching(ONE_TIP, 0.02), (1, 2, 1))
    o = [[np.zeros(3), 1e-3 * np.array([np.cos(angle), np.sin(angle), 0.0])]]
    g[0, 1, 1] += 1e-4
    at = values_at(ONE_TIP, g, se2.compose(o, g), {GRIP: np.log(0.4)})
    found = rows_of("sticking", at, moved=1e-3, noise=noise).residual[0, 0]
    # A slide is that of the object over the sensor, which is down.
    np.testing.assert_allclose(found, [0.0, expected - 1e-4], atol=2e-6)


@pytest.mark.parametrize(
    ("angle", "before", "eased"),
    [
        (0.4, 0.0, 0.4),  # there is none before
        (0.4, math.nan, 0.4),
        (0.4, 0.2, 0.25),
        (-3.1, 3.1, 3.1 + (2.0 * math.pi - 6.2) / 4.0),  # the short way round
    ],
)
def test_the_angle_of_the_force_follows_its_changes_slowly(angle, before, eased):
    g = np.tile(touching(ONE_TIP, 0.02), (1, 2, 1))
    o = [[np.zeros(3), 1e-3 * np.array([np.cos(angle), np.sin(angle), 0.0])]]
    at = values_at(ONE_TIP, g, se2.compose(o, g), {GRIP: np.log(0.4)})
    at.steps["force_angle"][0, 1] = before
    rows_of("sticking", at)
    assert at.steps["force_angle"][0, 1] == pytest.approx(eased, abs=1e-6)


@pytest.mark.parametrize(
    ("slid", "left"),
    [
        ((6.0, 0.0), 0.2),  # one row at 6 standard deviations leaves 1 / (1 + 36 / 9) to both
        ((3.0, -6.0), 1 / 6),  # 1 / (1 + 45 / 9)
        ((0.0, 0.0), 1.0),
    ],
)
def test_the_kernel_of_sticking_is_on_both_rows_together(slid, left):
    # On a flat side at which the sensor is where it was and the object 3e-5 m times this further, still.
    noise = with_settings(NoiseSettings(), sticking={"still": 3e-5, "kernel": 3.0})
    g0 = touching(ONE_TIP, 0.02)
    at = values_at(ONE_TIP, [[g0, g0 - [*(3e-5 * np.array(slid)), 0.0]]], shared={GRIP: np.log(0.4)})
    rows = rows_of("sticking", at, noise=noise)
    np.testing.assert_allclose(rows.residual[0, 0], 3e-5 * np.array(slid), atol=1e-9)
    np.testing.assert_allclose(rows.information[0, 0], 3e-5**-2)
    np.testing.assert_allclose(rows.weight[0, 0], left * 3e-5**-2, rtol=1e-3)


def test_the_kernels_of_pushing():
    rng = np.random.default_rng(1)
    g = np.tile(touching(ONE_TIP, 0.02), (50, 2, 1)) + rng.normal(0.0, 1e-4, (50, 2, 3))
    e = g + rng.normal(0.0, 1e-3, (50, 2, 3))
    at = values_at(ONE_TIP, g, e, {GRIP: np.log(0.4)})
    kernels = with_settings(SLIDE, sticking={"kernel": 3.0}, balance={"kernel": 2.0}, friction_cone={"kernel": 4.0})
    for name, scale in (("sticking", 3.0), ("balance", 2.0), ("friction_cone", 4.0)):
        rows, free = (rows_of(name, at, moved=1e-3, noise=noise) for noise in (kernels, SLIDE))
        square = rows.information * rows.residual**2
        if name == "sticking":  # both rows together
            square = square.sum(axis=-1, keepdims=True)
        np.testing.assert_allclose(rows.weight, rows.information / (1.0 + square / scale**2))
        share = rows.weight[rows.weight > 0.0] / rows.information[rows.weight > 0.0]
        assert share.min() < 0.5  # there is something to see
        np.testing.assert_allclose(free.weight, free.information)
        np.testing.assert_allclose(free.information, rows.information)


@pytest.mark.parametrize("kernel", [3.0, None])
def test_the_weights_of_contact_direction_and_turn(kernel):
    # 9 mm and 0.09 rad at standard deviations of 1 mm and 0.01 rad are 9: 1 / (1 + 81 / 9) = 0.1.
    left = 1.0 if kernel is None else 0.1
    g = touching(ONE_TIP, 0.02)
    noise = with_settings(NoiseSettings(), contact={"deviation": 1e-3, "kernel": kernel})
    rows = rows_of("contact", values_at(ONE_TIP, [[g], [g - [9e-3, 0.0, 0.0]]]), noise=noise)
    np.testing.assert_allclose(rows.information[:, 0, 0], 1e6)
    np.testing.assert_allclose(rows.weight[:, 0, 0], [1e6, left * 1e6], rtol=1e-4)
    # The variance is four times what touch says.
    for name, told in (("direction", ContactDirection), ("turn", Turn)):
        noise = with_settings(NoiseSettings(), **{name: {"share": 4.0, "floor": 0.0, "kernel": kernel}})
        rows = rows_of(name, values_at(ONE_TIP, [[g]]), [told(0.0, 0.25e-4), told(0.09, 0.25e-4)], noise=noise)
        np.testing.assert_allclose(rows.information[0, :, 0], 1e4)
        np.testing.assert_allclose(rows.weight[0, :, 0], [1e4, left * 1e4], rtol=1e-3)


def test_no_direction_counts_as_better_than_the_floor():
    # Four times the larger of both variances: the floor of 0.02 rad, and what touch says.
    noise = with_settings(NoiseSettings(), direction={"share": 4.0, "floor": 0.02})
    measured = [ContactDirection(0.0, sigma**2) for sigma in (0.001, 0.02, 0.03)]
    rows = rows_of("direction", values_at(ONE_TIP, [[touching(ONE_TIP, 0.02)]]), measured, noise=noise)
    np.testing.assert_allclose(rows.information[0, :, 0] ** -0.5, [0.04, 0.04, 0.06])
