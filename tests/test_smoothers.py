from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from push_samples import noisy, pushed, sensor, tips_of
from scipy.optimize import least_squares

from palpate import se2
from palpate.errors import SettingError
from palpate.graph import factors, make_smoother
from palpate.graph.factors import ContactModel
from palpate.graph.fixed_lag import LAG, FixedLagSmoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import Belief, Smoother, continued
from palpate.measurement import RelativePoses
from palpate.touch.relative import compared_frames

Array = np.ndarray
PLAIN = replace(GraphNoise(), pushing_kernel=None, contact_kernel=None)
ROBUST = GraphNoise()
TWO_TIPS = ((0.0, 0.025), (0.0, -0.025))


@dataclass(frozen=True)
class Contact:
    """What a smoother is given of one contact."""

    tips: list[ContactModel]
    sensor: Array  # (N, 3)
    object_pose: Array
    covariance: Array
    relative: list[RelativePoses | None]


def contact(steps: int, noise: GraphNoise, seed: int = 0, tips: Any = ((0.0, 0.0),), touch: bool = True) -> Contact:
    rng = np.random.default_rng(seed)
    o, e = pushed("rectangle", steps)
    if len(tips) > 1:  # two points on one side hold the object as they are
        o = se2.compose(e, se2.inverse(np.array([-0.2363 / 2, 0.01, 0.0])))
    g = se2.between(o, e)
    covariance = np.diag(np.square(noise.tactile))
    covariance[0, 2] = covariance[2, 0] = 0.3 * noise.tactile[0] * noise.tactile[2]  # not every one is diagonal
    relative: list[RelativePoses | None] = [None]
    for t in range(1, steps + 1):
        back = np.append(compared_frames(t), 2 if t > 2 else [])[:].astype(int)
        pose = noisy(se2.between(g[t - back], g[t]), (0.5, 0.5, noise.tactile[2]), rng)
        said = RelativePoses(back, pose, np.broadcast_to(covariance, (len(back), 3, 3)))
        relative.append(said if touch and len(back) and t % 7 else None)
    return Contact(
        tips_of("rectangle", sensor(tips=tuple(tips))),
        noisy(e, noise.sensor, rng),
        noisy(o[0], noise.first_pose, rng),
        np.diag(np.square(noise.first_pose)) + 1e-7 * np.ones((3, 3)),
        relative,
    )


def fed(smoother: Smoother, given: Contact, check: bool = False) -> Smoother:
    smoother.begin(given.sensor[0], given.object_pose, given.covariance)
    for t in range(1, len(given.sensor)):
        smoother.add(given.sensor[t], given.relative[t])
        if check:
            covariance = smoother.belief().covariance
            np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6, atol=1e-18)
            assert np.linalg.eigvalsh(covariance).min() > 0.0
            g, e = smoother.path()
            assert g.shape == e.shape == (t + 1, 3)
            np.testing.assert_allclose(g[-1], smoother.belief().g, atol=1e-12)
            np.testing.assert_allclose(e[-1], smoother.belief().e, atol=1e-12)
    return smoother


def make(name: str, given: Contact, noise: GraphNoise) -> Smoother:
    chosen: Any = name
    return make_smoother(chosen, given.tips, noise)


def batch(given: Contact, noise: GraphNoise) -> tuple[Array, Array]:
    """The whole contact at once, by SciPy, from the factors: poses (N, 2, 3) and covariance (6, 6) of the last step."""
    root = np.linalg.inv(np.linalg.cholesky(given.covariance))
    moved = np.hypot(*np.diff(given.sensor[:, :2], axis=0).T)
    resting = np.broadcast_to(se2.between(given.object_pose, given.sensor[0]), given.sensor.shape)
    start = np.stack([resting, given.sensor], axis=1)
    said = [(t, relative) for t, relative in enumerate(given.relative) if relative is not None]
    i = np.concatenate([t - relative.back for t, relative in said])
    j = np.concatenate([np.full(len(relative.back), t) for t, relative in said])
    measured = np.concatenate([relative.pose for _, relative in said])
    whiten = np.linalg.inv(np.linalg.cholesky(np.concatenate([relative.covariance for _, relative in said])))

    def residuals(poses: Array) -> Array:
        g, e = poses[:, 0], poses[:, 1]
        rows = [root @ factors.first_pose(g[0], e[0], given.object_pose)[0]]
        rows.append(factors.prior(e, given.sensor)[0] / noise.sensor)
        for tip in given.tips:
            rows.append(factors.contact(g, tip)[0] / noise.contact)
            rows.append(factors.pushing(g[:-1], e[:-1], g[1:], e[1:], tip)[0] / noise.pushing_sigmas(moved, tip))
        rows.append(np.einsum("nij,nj->ni", whiten, factors.between(g[i], g[j], measured)[0]))
        return np.concatenate([row.ravel() for row in rows])

    def at(change: Array) -> Array:
        return se2.compose(start, se2.exp(change.reshape(start.shape)))

    solved = least_squares(lambda change: residuals(at(change)), np.zeros(start.size), method="lm", xtol=1e-11)
    poses = at(solved.x)
    step = 1e-6 * np.eye(start.size).reshape(-1, *start.shape)
    ends = [[residuals(se2.compose(poses, se2.exp(s * one))) for one in step] for s in (1, -1)]
    jacobian = (np.array(ends[0]) - np.array(ends[1])).T / 2e-6
    return poses, np.linalg.inv(jacobian.T @ jacobian)[-6:, -6:]


def apart(poses: tuple[Array, Array], wanted: Array) -> Array:
    """Largest difference per coordinate (3,) between paths."""
    return np.abs(se2.log(se2.between(np.stack(poses, axis=1), wanted))).max(axis=(0, 1))


def scaled_difference(belief: Belief, poses: Array, covariance: Array) -> tuple[float, float]:
    """Largest difference of mean and of covariance from those wanted, in standard deviations and variances."""
    deviation = np.sqrt(np.diag(covariance))
    mean = np.concatenate([se2.log(se2.between(belief.g, poses[0])), se2.log(se2.between(belief.e, poses[1]))])
    difference = (belief.covariance - covariance) / np.outer(deviation, deviation)
    return float(np.abs(mean / deviation).max()), float(np.abs(difference).max())


@pytest.mark.parametrize("tips", [((0.0, 0.0),), TWO_TIPS], ids=["one tip", "two tips"])
def test_both_smoothers_equal_a_batch_solution(tips):
    given = contact(12, PLAIN, tips=tips)
    poses, covariance = batch(given, PLAIN)
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
    given = contact(LAG - 1, noise, seed=1)
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
        assert len(smoother._poses) == len(smoother._measured) == lag
        assert smoother._pairs.i.min() >= 0
        assert smoother._pairs.j.max() == lag - 1
        # What left the window stays as a Gaussian. A window of 15 lacks most pairs, which reach back 15 to 39,
        # and can be off by as much as they tell, a few standard deviations of the better estimate.
        mean, _ = scaled_difference(smoother.belief(), np.stack([whole.g, whole.e]), whole.covariance)
        assert mean < share


def test_a_window_loses_nothing_that_reaches_no_further_back():
    # Sticking, contact and pairs within the window alone: marginalising a linear problem is exact.
    given = contact(40, PLAIN, seed=3)
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
    given = contact(50 if name == "fixed-lag" else 15, ROBUST, seed=5)
    used, fresh = make(name, given, ROBUST), make(name, given, ROBUST)
    fed(used, contact(45, ROBUST, seed=6))
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
    smoother.begin(sensor_pose, object_pose, np.diag(deviation**2))
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
