from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import pushing_angles, pushing_rows, tips_of
from smoother_samples import (
    PLAIN,
    POSES,
    ROBUST,
    TWO_TIPS,
    apart,
    batch,
    contact,
    fed,
    felt,
    known_at,
    make,
    scaled_difference,
    without_relative,
)

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.graph import fixed_lag, isam2, make_smoother
from palpate.graph.fixed_lag import LAG, FixedLagSmoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.smoother import DEPTH, FRICTION, continued
from palpate.recording.measurements import Feeling, RelativePoses

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


@pytest.fixture
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fixed lag that stops when nothing moves, and an iSAM2 that relinearises whatever has moved at all."""
    monkeypatch.setattr(fixed_lag, "_CONVERGED", 1e-8)
    monkeypatch.setattr(fixed_lag, "_ITERATIONS", 20)
    monkeypatch.setattr(isam2, "RELINEARISE_ABOVE", (5e-5, 5e-5, 1e-4))
    monkeypatch.setattr(isam2, "RELINEARISE_LASTING_ABOVE", 0.01)


@pytest.mark.parametrize("what", BATCHES)
def test_fixed_lag_equals_a_batch_solution(what, exactly):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("fixed-lag", given, PLAIN), given, check=True)
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 5e-4
    assert spread < 5e-4
    assert (apart(smoother.path(), wanted.poses) < 1e-6).all()


@pytest.mark.parametrize("what", BATCHES)
def test_fixed_lag_as_it_comes_is_close_to_a_batch_solution(what):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("fixed-lag", given, PLAIN), given, check=True)
    # It stops when poses move by less than 3e-4; each frame takes another step.
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 0.05
    assert spread < 0.05
    assert (apart(smoother.path(), wanted.poses) < [1e-5, 1e-5, 3e-4]).all()


@pytest.mark.parametrize("what", BATCHES)
def test_isam2_equals_a_batch_solution(what, exactly):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("isam2", given, PLAIN), given, check=True)
    # The balance is known to 2e-6 m^2, in which poses 5e-5 off their linearisation count. Back-substitution stops at
    # changes below 1e-3 deep in the past, which path() may show.
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 1e-2
    assert spread < 1e-2
    assert (apart(smoother.path(), wanted.poses) < 1e-3).all()


@pytest.mark.parametrize("what", BATCHES)
def test_isam2_as_it_comes_is_close_to_a_batch_solution(what):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("isam2", given, PLAIN), given, check=True)
    # Poses stay up to 2e-3 off their linearisation. The error of second order, 4e-6, is as large as a step's imbalance
    # may be, which friction takes up: it is known less well than poses are.
    mean, spread = scaled_difference(smoother.belief(), wanted, POSES)
    assert mean < 0.05
    assert spread < 0.05
    assert scaled_difference(smoother.belief(), wanted)[0] < 0.2
    assert (apart(smoother.path(), wanted.poses) < 1e-3).all()


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
def test_both_smoothers_agree(noise, exactly):
    # As long as the window, in which both know all there is.
    given = felt(contact(LAG - 1, noise, seed=1), seed=1)
    lagged, incremental = (fed(make(name, given, noise), given, check=True) for name in ("fixed-lag", "isam2"))
    mean, spread = scaled_difference(lagged.belief(), incremental.belief())
    # Kernels and the angle of the force make the weights follow the estimate: those of iSAM2 are as old as its
    # linearisation.
    assert mean < 0.05
    assert spread < 0.05
    assert (apart(lagged.path(), np.stack(incremental.path(), axis=1)) < 1e-3).all()


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
def test_both_smoothers_agree_on_poses_as_they_come(noise):
    given = felt(contact(LAG - 1, noise, seed=1), seed=1)
    lagged, incremental = (fed(make(name, given, noise), given) for name in ("fixed-lag", "isam2"))
    mean, spread = scaled_difference(lagged.belief(), incremental.belief(), POSES)
    assert mean < (0.1 if noise is PLAIN else 0.2)
    assert spread < (0.1 if noise is PLAIN else 0.3)
    assert (apart(lagged.path(), np.stack(incremental.path(), axis=1)) < 2e-3).all()


def test_a_short_window_forgets_little():
    given = contact(80, ROBUST, seed=2)
    whole = fed(FixedLagSmoother(given.tips, ROBUST, lag=100), given).belief()
    for lag, share, of_all in ((41, 0.01, 0.05), (15, 3.0, 3.0)):
        smoother = fed(FixedLagSmoother(given.tips, ROBUST, lag=lag), given, check=True)
        assert isinstance(smoother, FixedLagSmoother)
        assert len(smoother._poses) == len(smoother._measured) == len(smoother._turns) == lag
        assert smoother._pairs.i.min() >= 0
        assert smoother._pairs.j.max() == lag - 1
        # What left the window stays as a Gaussian. A window of 15 lacks most pairs, which reach back 15 to 39,
        # and can be off by as much as they tell, a few standard deviations of the better estimate.
        assert scaled_difference(smoother.belief(), whole, POSES)[0] < share
        assert scaled_difference(smoother.belief(), whole)[0] < of_all


SURE_OF_FRICTION = replace(PLAIN, friction_ratio=(0.0, 1e-6), friction_center=1e-6)


@pytest.mark.parametrize(("noise", "of_all"), [(SURE_OF_FRICTION, 0.02), (PLAIN, 0.25)], ids=["sure", "learning"])
def test_a_window_loses_nothing_that_reaches_no_further_back(noise, of_all):
    # Sticking, contact, direction, turn and pairs within the window alone: marginalising a linear problem is exact. In
    # the balance friction and motion are multiplied, and what left the window keeps the friction of then.
    given = felt(contact(40, noise, seed=3), seed=3)
    near = [said and cut(said, said.back < 10) for said in given.relative]
    given = replace(given, relative=near)
    whole = fed(FixedLagSmoother(given.tips, noise, lag=100), given).belief()
    short = fed(FixedLagSmoother(given.tips, noise, lag=12), given).belief()
    assert max(scaled_difference(short, whole, POSES)) < 0.02
    assert max(scaled_difference(short, whole)) < of_all


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
    # One step: the object's pose with its covariance, the sensor with its, the depth with its, and the distance between
    # them. The pose is 3 mm short of contact, at which they are 0.3 mm deep: of these 3.3 mm each takes a share in
    # proportion to its variance.
    smoother = make(name, contact(1, PLAIN), PLAIN)
    deviation = np.array([3.7e-3, 1e-3, 1e-3])
    object_pose, sensor_pose = np.zeros(3), np.array([-0.2363 / 2 - 3e-3, 0.0, 0.0])
    depth, depth_deviation = 3e-4, 4e-4
    noise = replace(PLAIN, first_pose=tuple(deviation.tolist()), depth=(depth, depth_deviation))
    smoother.begin(sensor_pose, known_at(object_pose, noise), Feeling())
    belief = smoother.belief()
    gap_variance = 3.7e-3**2 + 1e-4**2 + 1e-3**2 + depth_deviation**2
    off = 3e-3 + depth
    np.testing.assert_allclose(belief.known.pose[0], -off * 3.7e-3**2 / gap_variance, rtol=1e-3)
    np.testing.assert_allclose(belief.known.covariance[0, 0], 3.7e-3**2 - 3.7e-3**4 / gap_variance, rtol=1e-3)
    # The depth takes its share, 1 % of the gap, and both are known together.
    np.testing.assert_allclose(belief.lasting[DEPTH], depth - off * depth_deviation**2 / gap_variance, rtol=1e-3)
    variance = depth_deviation**2 - depth_deviation**4 / gap_variance
    np.testing.assert_allclose(belief.known.covariance[3 + DEPTH, 3 + DEPTH], variance, rtol=1e-3)
    both = -((3.7e-3 * depth_deviation) ** 2) / gap_variance
    np.testing.assert_allclose(belief.known.covariance[0, 3 + DEPTH], both, rtol=1e-3)
    # Nothing has said anything of the rest.
    rest = [0, 2, 3, 4, 5]
    np.testing.assert_allclose(belief.lasting[rest], noise.lasting[0][rest], atol=1e-9)
    np.testing.assert_allclose(np.diag(belief.covariance)[6:][rest], noise.lasting[1][rest] ** 2, rtol=1e-6)
    assert smoother.pushing_error().tolist() == [0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_pushing_error_is_that_of_the_last_step(name):
    given = contact(20, ROBUST, seed=7)
    smoother = fed(make(name, given, ROBUST), given)
    g, e = smoother.path()
    moved = np.array([np.hypot(*(given.sensor[-1] - given.sensor[-2])[:2])])
    tip, friction = given.tips[0], smoother.belief().lasting[FRICTION]
    angle = pushing_angles(g, e, tip, friction)[-1:]
    residual, _ = pushing_rows(g[-2:-1], e[-2:-1], g[-1:], e[-1:], tip, friction, np.sign(angle))
    weight = ROBUST.pushing_weight(0.0 * residual, moved, tip, angle, friction[-1])
    np.testing.assert_allclose(smoother.pushing_error(), np.abs(residual * np.sqrt(weight))[0], atol=1e-6)
    # A push that sticks: the two rows that say so.
    assert weight[0, 0] == pytest.approx(np.hypot(ROBUST.sticking, ROBUST.sticking_share * moved[0]) ** -2.0, rel=1e-3)


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
