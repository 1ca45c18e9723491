from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import tips_of
from smoother_samples import (
    PLAIN,
    ROBUST,
    TWO_TIPS,
    apart,
    batch,
    contact,
    fed,
    felt,
    make,
    scaled_difference,
    without_relative,
)

from palpate import se2
from palpate.errors import SettingError
from palpate.graph import factors, make_smoother
from palpate.graph.fixed_lag import LAG, FixedLagSmoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.smoother import continued
from palpate.measurement import Feeling, RelativePoses

Array = np.ndarray


BATCHES = {
    "relative": lambda: contact(12, PLAIN),
    "relative, two tips": lambda: contact(12, PLAIN, tips=TWO_TIPS),
    "direction": lambda: felt(contact(12, PLAIN), turn=False),
    "turn": lambda: felt(contact(12, PLAIN), direction=False),
    "all": lambda: felt(contact(12, PLAIN)),
    "all, late": lambda: felt(contact(12, PLAIN), first=5),
    "direction and turn, disc": lambda: without_relative(felt(contact(12, PLAIN, name="disc"))),
}


@pytest.mark.parametrize("what", BATCHES)
def test_both_smoothers_equal_a_batch_solution(what):
    given = BATCHES[what]()
    poses, covariance, _ = batch(given, PLAIN)
    # Fixed lag: a Gauss-Newton step below 1e-3 leaves about its square, 1e-6, and each frame takes another: far below a
    # thousandth of the smallest deviation, 1e-4 m. iSAM2: poses stay up to 2e-3 off their linearisation, whose
    # second-order error, 4e-6 times lengths of 0.1, is 0.4 % of it; back-substitution stops at changes below 1e-3
    # deep in the past, which path() may show.
    for name, share, path in (("fixed-lag", 1e-3, 1e-6), ("isam2", 1e-2, 1e-3)):
        smoother = fed(make(name, given, PLAIN), given, check=True)
        mean, spread = scaled_difference(smoother.belief(), poses[-1], covariance)
        assert mean < share
        assert spread < share
        assert (apart(smoother.path(), poses) < path).all()


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
def test_both_smoothers_agree(noise):
    # As long as the window, in which both know all there is.
    given = felt(contact(LAG - 1, noise, seed=1), seed=1)
    lagged, incremental = (fed(make(name, given, noise), given, check=True) for name in ("fixed-lag", "isam2"))
    other = incremental.belief()
    mean, spread = scaled_difference(lagged.belief(), np.stack([other.g, other.e]), other.covariance)
    # Kernels make the weights follow the residuals: those of iSAM2 are as old as its linearisation, up to 2e-3 or
    # several standard deviations of a sticking row ago.
    assert mean < (0.02 if noise is PLAIN else 0.2)
    assert spread < (0.01 if noise is PLAIN else 0.3)
    assert (apart(lagged.path(), np.stack(incremental.path(), axis=1)) < 2e-3).all()


def test_a_short_window_forgets_little():
    given = contact(80, ROBUST, seed=2)
    whole = fed(FixedLagSmoother(given.tips, ROBUST, lag=100), given).belief()
    for lag, share in ((41, 0.01), (15, 3.0)):
        smoother = fed(FixedLagSmoother(given.tips, ROBUST, lag=lag), given, check=True)
        assert isinstance(smoother, FixedLagSmoother)
        assert len(smoother._poses) == len(smoother._measured) == len(smoother._turns) == lag
        assert smoother._pairs.i.min() >= 0
        assert smoother._pairs.j.max() == lag - 1
        # What left the window stays as a Gaussian. A window of 15 lacks most pairs, which reach back 15 to 39,
        # and can be off by as much as they tell, a few standard deviations of the better estimate.
        mean, _ = scaled_difference(smoother.belief(), np.stack([whole.g, whole.e]), whole.covariance)
        assert mean < share


def test_a_window_loses_nothing_that_reaches_no_further_back():
    # Sticking, contact, direction, turn and pairs within the window alone: marginalising a linear problem is exact.
    given = felt(contact(40, PLAIN, seed=3), seed=3)
    near = [said and cut(said, said.back < 10) for said in given.relative]
    given = replace(given, relative=near)
    whole = fed(FixedLagSmoother(given.tips, PLAIN, lag=100), given).belief()
    short = fed(FixedLagSmoother(given.tips, PLAIN, lag=12), given).belief()
    mean, spread = scaled_difference(short, np.stack([whole.g, whole.e]), whole.covariance)
    assert mean < 0.02
    assert spread < 0.02


def cut(said: RelativePoses, kept: Array) -> RelativePoses:
    return RelativePoses(said.back[kept], said.pose[kept], said.covariance[kept])


def test_pairs_that_reach_back_beyond_the_window_are_dropped():
    given = contact(45, PLAIN, seed=4)
    within = [said and cut(said, said.back < 15) for said in given.relative]
    all_of_them = fed(FixedLagSmoother(given.tips, PLAIN, lag=15), given)
    some = fed(FixedLagSmoother(given.tips, PLAIN, lag=15), replace(given, relative=within))
    for a, b in zip(all_of_them.path(), some.path(), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(all_of_them.belief().covariance, some.belief().covariance)


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_a_new_contact_forgets_the_old_one(name):
    given = felt(contact(50 if name == "fixed-lag" else 15, ROBUST, seed=5), seed=5)
    used, fresh = make(name, given, ROBUST), make(name, given, ROBUST)
    fed(used, felt(contact(45, ROBUST, seed=6), seed=6))
    a, b = fed(used, given).belief(), fed(fresh, given).belief()
    np.testing.assert_allclose(a.g, b.g, atol=1e-12)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-9)
    assert len(used.path()[0]) == len(given.sensor)


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_the_first_step_is_the_first_pose_seen_in_contact(name):
    # One step: the object's pose with its covariance, the sensor with its, and the distance between them. The pose is
    # 3 mm short of contact, which known to 3.7 mm moves by 3 * 3.7^2 / (3.7^2 + sensor and contact) mm.
    smoother = make(name, contact(1, PLAIN), PLAIN)
    deviation = np.array([3.7e-3, 1e-3, 1e-3])
    object_pose, sensor_pose = np.zeros(3), np.array([-0.2363 / 2 - 3e-3, 0.0, 0.0])
    smoother.begin(sensor_pose, object_pose, np.diag(deviation**2), Feeling())
    belief = smoother.belief()
    by_both = np.hstack([-se2.adjoint(belief.g), se2.adjoint(belief.g)])
    variance = (by_both @ belief.covariance @ by_both.T)[0, 0]
    gap_variance = 3.7e-3**2 + 1e-4**2 + 1e-3**2
    moved = -3e-3 * 3.7e-3**2 / gap_variance
    np.testing.assert_allclose(se2.compose(belief.e, se2.inverse(belief.g))[0], moved, rtol=1e-3)
    np.testing.assert_allclose(variance, 3.7e-3**2 - 3.7e-3**4 / gap_variance, rtol=1e-3)
    assert smoother.pushing_error().tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_pushing_error_is_that_of_the_last_step(name):
    given = contact(20, ROBUST, seed=7)
    smoother = fed(make(name, given, ROBUST), given)
    g, e = smoother.path()
    moved = np.hypot(*(given.sensor[-1] - given.sensor[-2])[:2])
    residual, _ = factors.pushing(g[-2], e[-2], g[-1], e[-1], given.tips[0])
    wanted = np.abs(residual / ROBUST.pushing_sigmas(moved, given.tips[0]))
    # Fixed lag says it at the last linearisation, one Gauss-Newton step earlier.
    np.testing.assert_allclose(smoother.pushing_error(), wanted, atol=0.1)


def test_guess_goes_on_as_before():
    # 1 mm ahead and 0.1 rad a step, on and on.
    step = np.array([1e-3, 0.0, 0.1])
    g = [np.array([0.1, 0.2, 3.1])]
    for _ in range(2):
        g.append(se2.compose(g[-1], step))
    np.testing.assert_allclose(continued(np.array(g[:2])), g[2], atol=1e-15)
    np.testing.assert_allclose(continued(np.array(g[:1])), g[0], atol=1e-15)


def test_names():
    tips = tips_of("disc")
    assert isinstance(make_smoother("fixed-lag", tips, ROBUST), FixedLagSmoother)
    assert isinstance(make_smoother("isam2", tips, ROBUST), Isam2Smoother)
    unknown: Any = "kalman"
    with pytest.raises(SettingError, match="'kalman'; allowed are fixed-lag, isam2"):
        make_smoother(unknown, tips, ROBUST)
