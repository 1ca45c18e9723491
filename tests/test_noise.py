import dataclasses

import numpy as np
import pytest
from push_samples import tips_of

from palpate.graph.noise import PRESETS, PUBLISHED, GraphNoise, cauchy_weight


def tip(alone: bool = True):
    return dataclasses.replace(tips_of("disc")[0], friction_radius=0.06, alone=alone)


def test_pushing_sigmas_grow_with_the_motion():
    noise = GraphNoise(sticking=3e-5, sticking_share=0.04, turning=4e-6, turning_share=0.5)
    # Still: the floors. Moved by 1 mm: hypot(3e-5, 4e-5) = 5e-5 m and hypot(4e-6, 0.5 * 1e-3 * 0.06 = 3e-5) m^2.
    found = noise.pushing_sigmas(np.array([0.0, 1e-3]), tip())
    np.testing.assert_allclose(found, [[3e-5, 3e-5, 4e-6], [5e-5, 5e-5, np.hypot(4e-6, 3e-5)]], rtol=1e-12)


def test_of_several_tips_none_knows_the_balance_of_force_and_torque():
    noise = GraphNoise()
    moved = np.array([0.0, 1e-3])
    assert np.isinf(noise.pushing_sigmas(moved, tip(alone=False))[:, 2]).all()
    residual = np.array([[0.0, 0.0, 1.0]] * 2)
    weight = noise.pushing_weight(residual, moved, tip(alone=False))
    assert (weight[:, 2] == 0.0).all()
    # A row without weight does not pull the kernel either.
    np.testing.assert_allclose(weight[:, :2], noise.pushing_sigmas(moved, tip())[:, :2] ** -2.0)


def test_cauchy_weight_by_hand():
    # 1 / (1 + e^2 / k^2): 1 at no error, 1/2 at k, 1/10 at 3 k.
    np.testing.assert_allclose(cauchy_weight(np.array([0.0, 4.0, 36.0]), 2.0), [1.0, 0.5, 0.1])
    plain = cauchy_weight(np.array([0.0, 1e6]), None)
    assert isinstance(plain, np.ndarray)
    assert plain.tolist() == [1.0, 1.0]


def test_the_pushing_kernel_lets_all_rows_go_together():
    noise = GraphNoise(sticking=1e-4, sticking_share=0.0, turning=1e-5, turning_share=0.0, pushing_kernel=2.0)
    # One row at 6 standard deviations: weight 1 / (1 + 36 / 4) = 0.1 for all three.
    weight = noise.pushing_weight(np.array([[6e-4, 0.0, 0.0]]), np.zeros(1), tip())
    np.testing.assert_allclose(weight, [[0.1e8, 0.1e8, 0.1e10]])
    # 2 and 4 standard deviations in two rows: 1 / (1 + 20 / 4).
    weight = noise.pushing_weight(np.array([[0.0, 2e-4, 4e-5]]), np.zeros(1), tip())
    np.testing.assert_allclose(weight, np.array([[1e8, 1e8, 1e10]]) / 6)


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


def test_the_published_settings():
    presets = PRESETS
    assert presets == {"palpate": GraphNoise(), "published": PUBLISHED}
    np.testing.assert_allclose(PUBLISHED.pushing_sigmas(np.array([0.0, 0.1]), tip()), np.full((2, 3), 1e-3))
    assert PUBLISHED.tactile == PUBLISHED.constant == (1.0, 1.0, 1e-5)
    assert PUBLISHED.contact == 1e-2
    assert PUBLISHED.sensor == PUBLISHED.first_pose == (1e-5,) * 3
    assert PUBLISHED.rest == (1e-9,) * 3
    assert PUBLISHED.pushing_kernel is None
    assert PUBLISHED.contact_kernel is None
    assert PUBLISHED.feeling_kernel is None
