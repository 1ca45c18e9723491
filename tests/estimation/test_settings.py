import dataclasses
from typing import Any

import numpy as np
import pytest
from push_samples import tips_of

from palpate.errors import SettingError
from palpate.graph.factors import ContactModel
from palpate.graph.noise import PRESETS, PUBLISHED, STICKING, GraphNoise, cauchy_weight
from palpate.graph.smoother import DEPTH, FRICTION, LASTING


def tip(alone: bool = True):
    return dataclasses.replace(tips_of("disc")[0], friction_radius=0.06, alone=alone)


EDGE = np.arctan(0.4)  # half angle of the friction cone at a grip of 0.4
SLIDE = GraphNoise(  # holds to 5e-5 m, slides by 3e-3 m, where the sensor moves by 1 mm
    sticking=3e-5,
    sticking_share=0.04,
    sliding_share=3.0,
    cone_margin=0.1,
    cone_width=0.02,
    cone_share=0.05,
    turning=4e-6,
    turning_share=0.5,
    sticking_kernel=None,
    turning_kernel=None,
)


def sigmas(noise: GraphNoise, angle: Any, moved: Any = 1e-3, of: ContactModel | None = None) -> np.ndarray:
    """Standard deviations (N, 4) of the pushing rows at no residual, with a grip of 0.4."""
    angle, moved = np.broadcast_arrays(np.atleast_1d(angle), moved)
    weight = noise.pushing_weight(np.zeros((len(angle), 4)), moved, of or tip(), angle, 0.4)
    with np.errstate(divide="ignore"):
        return weight**-0.5


@pytest.mark.parametrize("angle", [0.0, 0.1, -0.1])
def test_inside_the_cone_the_contact_holds(angle):
    # Still: the floors. Moved by 1 mm: hypot(3e-5, 4e-5) = 5e-5 m and hypot(4e-6, 0.5 * 1e-3 * 0.06 = 3e-5) m^2. The
    # cone's edge is at 0.3805 rad and sliding begins around 0.2805, nine widths away: tanh leaves 1e-8 of it.
    found = sigmas(SLIDE, angle, np.array([0.0, 1e-3]))
    np.testing.assert_allclose(found[:, :3], [[3e-5, 3e-5, 4e-6], [5e-5, 5e-5, np.hypot(4e-6, 3e-5)]], rtol=1e-6)
    # Nothing says that it is at the cone's edge: there are 14 widths to it.
    assert (found[:, 3] > 1e5 * 5e-5).all()


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
    # Half way at cone_margin from the edge: the geometric mean. The cone is still 5 widths away: 1 / (1 + e^10) = 5e-5
    # of its weight.
    found = sigmas(SLIDE, side * (EDGE - 0.1))[0]
    np.testing.assert_allclose(found[:2], np.sqrt(holds * slides), rtol=1e-9)
    assert found[3] == pytest.approx(off * np.sqrt(1 + np.exp(10.0)))
    # At the edge it slides, and half the weight is on the cone.
    found = sigmas(SLIDE, side * EDGE)[0]
    np.testing.assert_allclose(found[:2], slides, rtol=1e-3)
    assert found[3] == pytest.approx(off * np.sqrt(2))
    # One width further (1 + tanh 1) / 2 = 1 / (1 + e^-2).
    assert sigmas(SLIDE, side * (EDGE + 0.02))[0, 3] == pytest.approx(off * np.sqrt(1 + np.exp(-2.0)))
    # The better the grip the wider the cone.
    weight = SLIDE.pushing_weight(np.zeros((1, 4)), np.array([1e-3]), tip(), np.array([side * EDGE]), 0.8)
    np.testing.assert_allclose(weight[0, :2] ** -0.5, holds, rtol=1e-4)


def test_a_contact_that_holds_whatever_the_angle():
    # The same share for sliding and sticking, and no cone, is the model without friction's limit.
    noise = dataclasses.replace(SLIDE, sliding_share=0.04, cone_share=None)
    found = sigmas(noise, np.linspace(-3.1, 3.1, 20))
    np.testing.assert_allclose(found[:, :3], np.tile([5e-5, 5e-5, np.hypot(4e-6, 3e-5)], (20, 1)), rtol=1e-12)
    assert np.isinf(found[:, 3]).all()


def test_of_several_tips_none_knows_how_force_and_torque_are_shared():
    several = tip(alone=False)
    angle, moved = np.array([0.0, EDGE, 1.5]), np.full(3, 1e-3)
    # They hold at any angle, for nothing tells that of one of them, and balance and cone say nothing.
    found = sigmas(SLIDE, angle, moved, several)
    np.testing.assert_allclose(found[:, :2], 5e-5)
    assert np.isinf(found[:, 2:]).all()
    # A row without weight does not pull the kernel either.
    kernels = dataclasses.replace(SLIDE, sticking_kernel=2.0, turning_kernel=2.0)
    residual = np.tile([0.0, 0.0, 1.0, 1.0], (3, 1))
    weight = kernels.pushing_weight(residual, moved, several, angle, 0.4)
    np.testing.assert_allclose(weight, [[5e-5**-2, 5e-5**-2, 0.0, 0.0]] * 3)


def test_cauchy_weight_by_hand():
    # 1 / (1 + e^2 / k^2): 1 at no error, 1/2 at k, 1/10 at 3 k.
    np.testing.assert_allclose(cauchy_weight(np.array([0.0, 4.0, 36.0]), 2.0), [1.0, 0.5, 0.1])
    plain = cauchy_weight(np.array([0.0, 1e6]), None)
    assert isinstance(plain, np.ndarray)
    assert plain.tolist() == [1.0, 1.0]


def test_the_pushing_kernels():
    # Sticking goes as a whole: one row at 6 standard deviations leaves 1 / (1 + 36 / 9) = 0.2 to both, the others stay.
    noise = dataclasses.replace(SLIDE, sticking_kernel=3.0, turning_kernel=2.0)
    moved, out = np.zeros(1), np.array([1.5])  # still and outside the cone: 3e-5 m, 4e-6 m^2 and 3e-5 m
    full = np.array([3e-5, 3e-5, 4e-6, 3e-5]) ** -2.0

    def share(*errors: float) -> np.ndarray:
        residual = np.array([errors]) * full**-0.5
        return noise.pushing_weight(residual, moved, tip(), out, 0.4)[0] / full

    np.testing.assert_allclose(share(6.0, 0.0, 0.0, 0.0), [0.2, 0.2, 1.0, 1.0])
    # 3 and 6 in both rows: 1 / (1 + 45 / 9).
    np.testing.assert_allclose(share(3.0, -6.0, 0.0, 0.0), [1 / 6, 1 / 6, 1.0, 1.0])
    # Balance and cone each by itself: 1 / (1 + 36 / 4) and 1 / (1 + 4 / 4).
    np.testing.assert_allclose(share(0.0, 0.0, 6.0, -2.0), [1.0, 1.0, 0.1, 0.5])
    noise = SLIDE  # without kernels
    np.testing.assert_allclose(share(60.0, 60.0, 60.0, 60.0), 1.0)


@pytest.mark.parametrize("kernel", [3.0, None])
def test_contact_weight(kernel):
    noise = GraphNoise(contact=1e-3, contact_kernel=kernel)
    # 9 mm are 9 standard deviations: 1 / (1 + 81 / 9) = 0.1.
    weight = noise.contact_weight(np.array([[0.0], [9e-3]]))
    assert weight.shape == (2, 1)
    np.testing.assert_allclose(weight, [[1e6], [1e6 if kernel is None else 1e5]])


@pytest.mark.parametrize("kernel", [3.0, None])
def test_feeling_weight(kernel):
    # 0.09 rad at a standard deviation of 0.01 are 9: 1 / (1 + 81 / 9) = 0.1. Where nothing is said nothing weighs.
    weight = GraphNoise(feeling_kernel=kernel).feeling_weight(np.array([0.0, 0.09, 2.0]), np.array([1e4, 1e4, 0.0]))
    np.testing.assert_allclose(weight, [1e4, 1e4 if kernel is None else 1e3, 0.0])


def test_what_lasts():
    noise = GraphNoise(
        direction_bias=0.02, depth=(3e-4, 1e-4), friction_ratio=(0.2, 0.3), friction_center=0.1, grip=(0.5, 0.15)
    )
    mean, deviation = noise.lasting
    assert mean.tolist() == [0.0, 3e-4, 0.2, 0.0, 0.0, 0.5]
    assert deviation.tolist() == [0.02, 1e-4, 0.3, 0.1, 0.1, 0.15]
    assert mean.shape == (LASTING,)
    assert mean[DEPTH] == noise.depth[0]
    assert mean[FRICTION].tolist() == [0.2, 0.0, 0.0, 0.5]


def test_the_presets():
    assert {"palpate": GraphNoise(), "sticking": STICKING, "published": PUBLISHED} == PRESETS
    assert len(set(PRESETS.values())) == 3


def test_the_published_settings():
    for angle in (0.0, 0.5, 3.0):
        found = sigmas(PUBLISHED, angle, np.array([0.0, 0.1]))
        np.testing.assert_allclose(found[:, :3], np.full((2, 3), 1e-3))
        assert np.isinf(found[:, 3]).all()
    # What ours learns is known there: no depth, bias and other friction than the model's.
    mean, deviation = PUBLISHED.lasting
    assert (mean[:-1] == 0.0).all()
    assert (deviation[:-1] <= 1e-9).all()
    assert PUBLISHED.tactile == PUBLISHED.constant == (1.0, 1.0, 1e-5)
    assert PUBLISHED.contact == 1e-2
    assert PUBLISHED.sensor == PUBLISHED.first_pose == (1e-5,) * 3
    assert PUBLISHED.rest == (1e-9,) * 3
    assert PUBLISHED.direction_share == PUBLISHED.turn_share == 1.0
    kernels = {field.name for field in dataclasses.fields(GraphNoise) if field.name.endswith("kernel")}
    assert kernels == {"sticking_kernel", "turning_kernel", "contact_kernel", "feeling_kernel"}
    assert all(getattr(PUBLISHED, name) is None for name in kernels)


def test_the_sticking_settings():
    found = sigmas(STICKING, np.array([0.0, 0.5, 3.0]))
    assert (found == found[0]).all()
    assert np.isinf(found[:, 3]).all()
    mean, deviation = STICKING.lasting
    assert (mean[FRICTION][:3] == 0.0).all()
    assert (deviation[FRICTION][:3] <= 1e-6).all()


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("contact", 0.0, "finite and above 0"),
        ("contact", np.nan, "finite and above 0"),
        ("contact", None, "finite and above 0"),
        ("sliding_share", None, "finite and at least 0"),
        ("sensor", (1e-4, -1e-4, 1e-3), "finite and above 0"),
        ("cone_margin", 0.0, "finite and above 0"),
        ("cone_width", -0.1, "finite and above 0"),
        ("sticking_kernel", 0.0, "finite and above 0"),
        ("turning_kernel", np.inf, "finite and above 0"),
        ("friction_center", 0.0, "finite and above 0"),
        ("sticking_share", -0.1, "finite and at least 0"),
        ("turning_share", np.inf, "finite and at least 0"),
        ("cone_share", -0.1, "finite and at least 0"),
        ("friction_ratio", (0.2, 0.0), "finite and a mean and a standard deviation above 0"),
        ("friction_ratio", (np.nan, 0.3), "finite and a mean and a standard deviation above 0"),
        ("grip", (0.4, -0.1), "finite and above 0"),
        ("grip", (-0.4, 0.1), "finite and above 0"),
        ("depth", (3e-4, np.inf), "finite and a mean and a standard deviation above 0"),
    ],
)
def test_settings_that_are_wrong(name, value, allowed):
    with pytest.raises(SettingError) as caught:
        GraphNoise(**{name: value})
    assert str(caught.value) == f"noise {name} is {value!r}; it must be {allowed}"


def test_settings_at_the_edge_of_what_is_allowed():
    off = dict.fromkeys(("sticking_kernel", "turning_kernel", "contact_kernel", "feeling_kernel", "cone_share"))
    none = dict.fromkeys(("sticking_share", "sliding_share", "turning_share"), 0.0)
    noise = GraphNoise(**off, **none, depth=(-1e-4, 1e-4), friction_ratio=(-0.5, 0.3))  # pyright: ignore[reportArgumentType]
    found = sigmas(noise, 1.5)
    np.testing.assert_allclose(found[0, :3], [noise.sticking, noise.sticking, noise.turning])
    assert np.isinf(found[0, 3])
