"""How much factors weigh: by hand, from settings; and which settings are allowed."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from push_samples import SHAPES, rows_of, sensor, touching, values_at, with_settings

from palpate.config.settings import PRESETS, PUBLISHED, STICKING, NoiseSettings
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel, contact_model
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.balance import BalanceSettings
from palpate.graph.factors.contact import Contact, ContactSettings
from palpate.graph.factors.direction import Direction, DirectionSettings
from palpate.graph.factors.factor import Rows
from palpate.graph.factors.first_pose import FirstPoseSettings
from palpate.graph.factors.friction_cone import FrictionConeSettings
from palpate.graph.factors.relative_pose import RelativePoseSettings
from palpate.graph.factors.sensor_pose import SensorPoseSettings
from palpate.graph.factors.sticking import Sticking, StickingSettings
from palpate.graph.factors.turn import Turn, TurnSettings
from palpate.graph.variables import (
    DEPTH,
    DIRECTION_BIAS,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    IN_OBJECT,
    OBJECT_SIZE,
    OUTLINE_SCALE,
    Priors,
)
from palpate.types import measurements as said
from palpate.types.measurements import ContactDirection

ONE_TIP = contact_model(SHAPES["rectangle"], sensor(), 0.06)
EDGE = np.arctan(0.4)  # half angle of the friction cone at a grip of 0.4
SLIDE = with_settings(  # holds to 5e-5 m, slides by 3e-3 m, where the sensor moves by 1 mm
    NoiseSettings(),
    sticking={"still": 3e-5, "share": 0.04, "sliding_share": 3.0, "margin": 0.1, "width": 0.02, "kernel": None},
    balance={"still": 4e-6, "share": 0.5, "kernel": None},
    friction_cone={"still": 3e-5, "share": 0.05, "width": 0.02, "kernel": None},
)


def pushed_at(angle: Any, model: ContactModel, noise: NoiseSettings, moved: float = 1e-3, grip: float = 0.4) -> dict:
    """Rows of sticking, balance and cone by name, with the pushing force at angles (N,) from the normal.

    The sensor has moved so far in the step; the contact sticks.
    """
    angle = np.atleast_1d(np.asarray(angle, np.float64))
    g = np.tile(touching(model, 0.02), (len(angle), 2, 1))
    o = np.zeros((len(angle), 2, 3))
    o[:, 1, 0], o[:, 1, 1] = 1e-3 * np.cos(angle), 1e-3 * np.sin(angle)
    at = values_at(model, g, se2.compose(o, g), {GRIP: grip})
    wanted = ("sticking", "balance", "friction_cone")
    pushing = [factor for factor in make_factors(noise, model) if factor.name in wanted]
    if noise.friction_cone.share is None:
        pushing = [factor for factor in pushing if factor.name != "friction_cone"]
    return {factor.name: rows_of(factor, at, moved=moved) for factor in pushing}


def sigmas(noise: NoiseSettings, angle: Any, moved: float = 1e-3, grip: float = 0.4) -> np.ndarray:
    """Standard deviations (N, 4) of sticking, balance and cone."""
    rows = pushed_at(angle, ONE_TIP, noise, moved, grip)
    with np.errstate(divide="ignore"):
        found = [rows[name].information[:, 0] ** -0.5 for name in rows]
    if "friction_cone" not in rows:
        found.append(np.full((len(found[0]), 1), np.inf))
    return np.concatenate(found, axis=1)


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


def test_a_contact_that_holds_whatever_the_angle():
    # The same share for sliding and sticking, and no cone, is the model without friction's limit.
    noise = with_settings(SLIDE, sticking={"sliding_share": 0.04}, friction_cone={"share": None})
    found = sigmas(noise, np.linspace(-3.1, 3.1, 20))
    np.testing.assert_allclose(found[:, :3], np.tile([5e-5, 5e-5, np.hypot(4e-6, 3e-5)], (20, 1)), rtol=1e-12)
    assert np.isinf(found[:, 3]).all()


def cauchy(rows: Rows, scale: float, together: bool) -> np.ndarray:
    """Weights by 1 / (1 + e^2 / k^2): 1 at no error, 1/2 at k, 1/10 at 3 k."""
    square = rows.information * rows.residual**2
    return rows.information / (1.0 + (square.sum(axis=-1, keepdims=True) if together else square) / scale**2)


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
    factor = Sticking(StickingSettings(still=3e-5, kernel=3.0))
    g0 = touching(ONE_TIP, 0.02)
    at = values_at(ONE_TIP, [[g0, g0 - [*(3e-5 * np.array(slid)), 0.0]]], shared={GRIP: 0.4})
    rows = rows_of(factor, at, moved=0.0)
    np.testing.assert_allclose(rows.residual[0, 0], 3e-5 * np.array(slid), atol=1e-9)
    np.testing.assert_allclose(rows.information[0, 0], 3e-5**-2)
    np.testing.assert_allclose(rows.weight[0, 0], left * 3e-5**-2, rtol=1e-3)


def test_the_kernels_of_pushing():
    rng = np.random.default_rng(1)
    g = np.tile(touching(ONE_TIP, 0.02), (50, 2, 1)) + rng.normal(0.0, 1e-4, (50, 2, 3))
    e = g + rng.normal(0.0, 1e-3, (50, 2, 3))
    at = values_at(ONE_TIP, g, e, {GRIP: 0.4})
    kernels = with_settings(SLIDE, sticking={"kernel": 3.0}, balance={"kernel": 2.0}, friction_cone={"kernel": 4.0})
    factors, plain = make_factors(kernels, ONE_TIP), make_factors(SLIDE, ONE_TIP)
    scale = {"sticking": 3.0, "balance": 2.0, "friction_cone": 4.0}
    for factor, without in zip(factors, plain, strict=True):
        if factor.name in scale:
            rows, free = (rows_of(one, at, moved=1e-3) for one in (factor, without))
            np.testing.assert_allclose(rows.weight, cauchy(rows, scale[factor.name], factor.name == "sticking"))
            share = rows.weight[rows.weight > 0.0] / rows.information[rows.weight > 0.0]
            assert share.min() < 0.5  # there is something to see
            np.testing.assert_allclose(free.weight, free.information)
            np.testing.assert_allclose(free.information, rows.information)


@pytest.mark.parametrize("kernel", [3.0, None])
def test_the_weight_of_contact(kernel):
    # 9 mm are 9 standard deviations: 1 / (1 + 81 / 9) = 0.1.
    g = touching(ONE_TIP, 0.02)
    at = values_at(ONE_TIP, [[g], [g - [9e-3, 0.0, 0.0]]])
    rows = rows_of(Contact(ContactSettings(deviation=1e-3, kernel=kernel)), at)
    np.testing.assert_allclose(rows.weight[:, 0, 0], [1e6, 1e6 if kernel is None else 1e5], rtol=1e-4)
    np.testing.assert_allclose(rows.information[:, 0, 0], 1e6)


@pytest.mark.parametrize("kernel", [3.0, None])
def test_the_weights_of_direction_and_turn(kernel):
    # 0.09 rad at a standard deviation of 0.01 are 9: 1 / (1 + 81 / 9) = 0.1.
    # The variance is four times what touch says.
    at = values_at(ONE_TIP, [[touching(ONE_TIP, 0.02)]])
    for factor, told in (
        (Direction(DirectionSettings(share=4.0, kernel=kernel)), ContactDirection),
        (Turn(TurnSettings(share=4.0, kernel=kernel)), said.Turn),
    ):
        rows = rows_of(factor, at, [told(0.0, 0.25e-4), told(0.09, 0.25e-4)])
        np.testing.assert_allclose(rows.information[0, :, 0], 1e4)
        np.testing.assert_allclose(rows.weight[0, :, 0], [1e4, 1e4 if kernel is None else 1e3], rtol=1e-3)


def test_what_is_believed_of_an_object():
    priors = Priors(
        direction_bias=(0.01, 0.02),
        direction_scale=(-0.05, 0.04),
        place_bias=(2e-4, 5e-4),
        depth=(3e-4, 1e-4),
        outline_scale=(0.02, 0.05),
        friction_ratio=(0.2, 0.3),
        friction_center=(0.05, 0.1),
        grip=(0.5, 0.15),
    )
    assert priors.mean.tolist() == [0.01, -0.05, 2e-4, 3e-4, 0.02, 0.2, 0.05, 0.05, 0.5]
    assert priors.deviation.tolist() == [0.02, 0.04, 5e-4, 1e-4, 0.05, 0.3, 0.1, 0.1, 0.15]
    assert priors.mean.shape == (OBJECT_SIZE,)
    assert priors.mean[IN_OBJECT[DIRECTION_BIAS]].tolist() == [0.01]
    assert priors.mean[IN_OBJECT[DEPTH]].tolist() == [3e-4]
    assert priors.mean[IN_OBJECT[OUTLINE_SCALE]].tolist() == [0.02]
    assert priors.mean[IN_OBJECT[FRICTION_RATIO]].tolist() == [0.2]
    assert priors.mean[IN_OBJECT[FRICTION_CENTER]].tolist() == [0.05, 0.05]
    assert priors.mean[IN_OBJECT[GRIP]].tolist() == [0.5]


def test_the_presets():
    assert {"palpate": NoiseSettings(), "sticking": STICKING, "published": PUBLISHED} == PRESETS
    assert len(set(PRESETS.values())) == 3


def kernels(noise: NoiseSettings) -> list[float | None]:
    groups = [getattr(noise, group.name) for group in dataclasses.fields(noise)]
    return [group.kernel for group in groups if hasattr(group, "kernel")]


def test_the_published_settings():
    for angle in (0.0, 0.5, 3.0):
        for moved in (0.0, 0.1):
            found = sigmas(PUBLISHED, angle, moved)
            np.testing.assert_allclose(found[:, :3], 1e-3)
            assert np.isinf(found[:, 3]).all()
    # What ours learns is known there: no depth, bias and other friction than the model's.
    priors = PUBLISHED.priors
    assert (priors.mean[:-1] == 0.0).all()
    assert (priors.deviation[:-1] <= 1e-9).all()
    assert PUBLISHED.relative_pose.oracle == PUBLISHED.relative_pose.constant == (1.0, 1.0, 1e-5)
    assert PUBLISHED.relative_pose.linear == 1e-5
    assert PUBLISHED.contact.deviation == 1e-2
    assert PUBLISHED.sensor_pose.deviation == PUBLISHED.first_pose.deviation == (1e-5,) * 3
    assert PUBLISHED.sensor_pose.calibration == (0.0,) * 3  # the paper's covariance is the graph's alone
    assert PUBLISHED.first_pose.rest == (1e-9,) * 3
    assert PUBLISHED.direction.share == PUBLISHED.turn.share == 1.0
    assert kernels(PUBLISHED) == [None] * 7
    assert kernels(NoiseSettings()) == [3.0, 3.0, 3.0, 3.0, 2.0, 2.0, 2.0]


def test_the_sticking_settings():
    found = sigmas(STICKING, np.array([0.0, 0.5, 3.0]))
    assert (found == found[0]).all()
    assert np.isinf(found[:, 3]).all()
    for unknown in (FRICTION_RATIO, FRICTION_CENTER):
        assert (STICKING.priors.mean[IN_OBJECT[unknown]] == 0.0).all()
        assert (STICKING.priors.deviation[IN_OBJECT[unknown]] <= 1e-6).all()


ABOVE, AT_LEAST = "a finite number above 0", "a finite number at least 0"
NORMAL = "a finite mean and a finite standard deviation above 0"


@pytest.mark.parametrize(
    ("kind", "name", "value", "allowed"),
    [
        (ContactSettings, "deviation", 0.0, ABOVE),
        (ContactSettings, "deviation", np.nan, ABOVE),
        (ContactSettings, "deviation", None, ABOVE),
        (ContactSettings, "deviation", "1e-3", ABOVE),
        (ContactSettings, "deviation", True, ABOVE),
        pytest.param(ContactSettings, "deviation", 10**400, ABOVE, id="huge"),
        (ContactSettings, "kernel", 0.0, f"{ABOVE}, or None"),
        (DirectionSettings, "share", 0.0, ABOVE),
        (TurnSettings, "share", -1.0, ABOVE),
        (StickingSettings, "sliding_share", None, AT_LEAST),
        (StickingSettings, "margin", 0.0, ABOVE),
        (StickingSettings, "width", -0.1, ABOVE),
        (StickingSettings, "kernel", 0.0, f"{ABOVE}, or None"),
        (StickingSettings, "share", -0.1, AT_LEAST),
        (BalanceSettings, "kernel", np.inf, f"{ABOVE}, or None"),
        (BalanceSettings, "share", np.inf, AT_LEAST),
        (FrictionConeSettings, "share", -0.1, f"{AT_LEAST}, or None"),
        (SensorPoseSettings, "deviation", (1e-4, -1e-4, 1e-3), "3 finite numbers above 0"),
        (SensorPoseSettings, "deviation", (1e-4, 1e-4), "3 finite numbers above 0"),
        (SensorPoseSettings, "deviation", 1e-4, "3 finite numbers above 0"),
        (FirstPoseSettings, "rest", (0.0, 1.0, 1.0), "3 finite numbers above 0"),
        (RelativePoseSettings, "oracle", (1.0, 1.0, np.inf), "3 finite numbers above 0"),
        (Priors, "friction_center", (0.0, 0.0), NORMAL),
        (Priors, "friction_ratio", (0.2, 0.0), NORMAL),
        (Priors, "friction_ratio", (np.nan, 0.3), NORMAL),
        (Priors, "grip", (0.4, -0.1), NORMAL),
        (Priors, "grip", 0.4, NORMAL),
        (Priors, "depth", (3e-4, np.inf), NORMAL),
    ],
)
def test_settings_that_are_wrong(kind, name, value, allowed):
    with pytest.raises(SettingError) as caught:
        kind(**{name: value})
    group = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in kind.__name__)
    group = group.lstrip("_").removesuffix("_settings")
    assert str(caught.value) == f"{group}.{name} is {value!r}; it must be {allowed}"


def test_settings_are_floats_whatever_number_is_given():
    sticking = StickingSettings(still=1, share=np.float32(0.5), kernel=2)  # pyright: ignore[reportArgumentType]
    assert [type(value) for value in (sticking.still, sticking.share, sticking.kernel)] == [float] * 3
    given: Any = [1, 2, 3]
    assert SensorPoseSettings(given).deviation == (1.0, 2.0, 3.0)


def test_settings_at_the_edge_of_what_is_allowed():
    noise = with_settings(
        NoiseSettings(),
        sticking={"share": 0.0, "sliding_share": 0.0, "kernel": None},
        balance={"share": 0.0, "kernel": None},
        friction_cone={"share": None, "kernel": None},
        priors={"depth": (-1e-4, 1e-4), "friction_ratio": (-0.5, 0.3)},
    )
    found = sigmas(noise, 1.5)
    np.testing.assert_allclose(found[0, :3], [noise.sticking.still, noise.sticking.still, noise.balance.still])
    assert np.isinf(found[0, 3])
