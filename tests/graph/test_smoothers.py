"""What all smoothers of a contact do: against a batch solution by SciPy, and against each other."""

from dataclasses import replace

import numpy as np
import pytest
from push_samples import rows_of, values_at, with_settings
from smoother_samples import (
    FELT,
    OFFSET,
    PLAIN,
    POSES,
    ROBUST,
    TWO_TIPS,
    Contact,
    apart,
    batch,
    contact,
    fed,
    felt,
    lagged,
    make,
    prior_at,
    scaled_difference,
    settled,
    without_relative,
)
from tracker_samples import SMOOTHERS

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.factor_list import make_factors
from palpate.graph.smoother import Smoother
from palpate.graph.variables import DEPTH, IN_OBJECT, LAG, OUTLINE_SCALE
from palpate.lab.paper import isam2
from palpate.types.measurements import ContactDirection, RelativePoses, Turn

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
    """An iSAM2 that relinearises whatever has moved at all."""
    monkeypatch.setattr(isam2, "RELINEARISE_ABOVE", (5e-5, 5e-5, 1e-4))
    monkeypatch.setattr(isam2, "RELINEARISE_SHARED_ABOVE", 0.01)


@pytest.mark.parametrize("what", BATCHES)
@pytest.mark.parametrize("name", ["fixed-lag", "batch"])
def test_fixed_lag_equals_a_batch_solution(name, what):
    given = settled(BATCHES[what]())
    wanted = batch(given, PLAIN)
    smoother = fed(make(name, given, PLAIN), given, check=True)
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 5e-4
    assert spread < 5e-4
    assert (apart(smoother.path(), wanted.poses) < 2e-6).all()


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


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
def test_both_smoothers_agree(noise, exactly):
    # As long as the window, in which both know all there is.
    given = settled(felt(contact(LAG - 5, noise, seed=1), seed=1))
    short, whole = (fed(make(name, given, noise), given, check=True) for name in SMOOTHERS)
    mean, spread = scaled_difference(short.belief(), whole.belief())
    # Kernels and the angle of the force make the weights follow the estimate: those of iSAM2 are as old as its
    # linearisation.
    assert mean < 0.05
    assert spread < 0.05
    assert (apart(short.path(), np.stack(whole.path(), axis=1)) < 1e-3).all()


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
def test_both_smoothers_agree_on_poses_as_they_come(noise):
    given = felt(contact(LAG - 1, noise, seed=1), seed=1)
    short, whole = (fed(make(name, given, noise), given) for name in SMOOTHERS)
    mean, spread = scaled_difference(short.belief(), whole.belief(), POSES)
    assert mean < (0.1 if noise is PLAIN else 0.2)
    assert spread < (0.1 if noise is PLAIN else 0.3)
    assert (apart(short.path(), np.stack(whole.path(), axis=1)) < 2e-3).all()


@pytest.mark.parametrize("name", SMOOTHERS)
def test_the_first_step_is_the_first_pose_seen_in_contact(name):
    # One step: the object's pose with its covariance, the sensor with its, the depth with its, and the distance between
    # them. The pose is 3 mm short of contact, at which they are 0.3 mm deep: of these 3.3 mm each takes a share in
    # proportion to its variance. What the outline is wrong by, a share of its 118 mm, takes its share too.
    deviation = np.array([3.7e-3, 1e-3, 1e-3])
    object_pose, sensor_pose = np.zeros(3), np.array([-0.2363 / 2 - 3e-3, 0.0, 0.0])
    depth, depth_deviation = 3e-4, 4e-4
    reach, scale_deviation = 0.2363 / 2, 5e-3
    noise = with_settings(
        PLAIN,
        first_pose={"deviation": tuple(deviation.tolist())},
        priors={"depth": (depth, depth_deviation), "outline_scale": (0.0, scale_deviation)},
    )
    begin = make(name, contact(1, PLAIN), PLAIN)
    smoother = begin(prior_at(object_pose, noise), sensor_pose, (), 0.0)
    belief = smoother.belief()
    prior, place = belief.prior, 3 + IN_OBJECT[DEPTH].start
    gap_variance = 3.7e-3**2 + 1e-4**2 + 1e-3**2 + depth_deviation**2 + (reach * scale_deviation) ** 2
    off = 3e-3 + depth
    np.testing.assert_allclose(prior.pose[0], -off * 3.7e-3**2 / gap_variance, rtol=1e-3)
    np.testing.assert_allclose(prior.covariance[0, 0], 3.7e-3**2 - 3.7e-3**4 / gap_variance, rtol=1e-3)
    # The depth takes its share, 1 % of the gap, and both are known together.
    np.testing.assert_allclose(prior[DEPTH], depth - off * depth_deviation**2 / gap_variance, rtol=1e-3)
    variance = depth_deviation**2 - depth_deviation**4 / gap_variance
    np.testing.assert_allclose(prior.covariance[place, place], variance, rtol=1e-3)
    both = -((3.7e-3 * depth_deviation) ** 2) / gap_variance
    np.testing.assert_allclose(prior.covariance[0, place], both, rtol=1e-3)
    scale = off * reach * scale_deviation**2 / gap_variance
    np.testing.assert_allclose(prior[OUTLINE_SCALE], scale, rtol=1e-3)
    # Nothing has said anything of the rest.
    learnt = IN_OBJECT[DEPTH].start, IN_OBJECT[OUTLINE_SCALE].start
    rest = [k for k in range(len(belief.values)) if k not in learnt]
    np.testing.assert_allclose(belief.values[rest], noise.priors.mean[rest], atol=1e-9)
    np.testing.assert_allclose(np.diag(belief.covariance)[6:][rest], noise.priors.deviation[rest] ** 2, rtol=1e-6)
    assert smoother.last_errors() == {}


@pytest.mark.parametrize("name", SMOOTHERS)
def test_last_errors_are_those_of_the_last_step(name):
    given = contact(20, ROBUST, seed=7)
    smoother = fed(make(name, given, ROBUST), given)
    g, e = smoother.path()
    moved = float(np.hypot(*(given.sensor[-1] - given.sensor[-2])[:2]))
    prior = smoother.belief().prior
    friction = {unknown: prior[unknown] for unknown in IN_OBJECT}
    # As far back as the angle of the pushing force looks.
    at = values_at(given.model, g[None, -4:], e[None, -4:], friction)
    wanted = {}
    for factor in make_factors(ROBUST, given.model):
        if factor.name in ("sticking", "balance"):
            rows = rows_of(factor, at, moved=moved)
            wanted[factor.name] = np.abs(rows.residual * np.sqrt(rows.information))[0, 0]
    found = smoother.last_errors()
    assert set(found) == set(wanted)
    for factor, errors in wanted.items():
        np.testing.assert_allclose(found[factor], errors, atol=1e-6)
    # A push that sticks: the two rows that say so.
    sticking = ROBUST.sticking
    slid = g[-2, :2] + se2.rotation(g[-2, 2]) @ material(g[-1], given) - touched(g[-1], given)
    np.testing.assert_allclose(found["sticking"], np.abs(slid) / np.hypot(sticking.still, sticking.share * moved), 1e-3)


def touched(g: Array, given: Contact) -> Array:
    """The point (2,) of the tip's surface nearest to the outline, object frame."""
    point = given.model.touching_at(g)["point"]
    return np.array([point.real, point.imag])


def material(g: Array, given: Contact) -> Array:
    """The same in the sensor frame."""
    return se2.transform(se2.inverse(g), touched(g, given))


def test_names():
    given = contact(1, ROBUST)
    with pytest.raises(SettingError, match="'kalman'; allowed are fixed-lag, isam2, batch, particle-filter"):
        make("kalman", given, ROBUST)


def yaw_variance(smoother: Smoother) -> float:
    """Variance of the object's yaw at the last step, e_theta - g_theta."""
    covariance = smoother.belief().covariance
    return covariance[2, 2] + covariance[5, 5] - 2 * covariance[2, 5]


@pytest.mark.parametrize("name", SMOOTHERS)
def test_whatever_the_offset_of_turns_the_path_is_the_same(name):
    given = felt(contact(15, ROBUST), direction=False)
    wanted = fed(make(name, given, ROBUST), given)
    for level in (0.1, 1.5, np.pi, -2.9):
        turns = [said and replace(said, angle=se2.wrap(said.angle + level)) for said in given.turns]
        found = fed(make(name, given, ROBUST), replace(given, turns=turns))
        # The weak prior on the offset pulls by pi / 10^2 at most, against turns of 1 / 0.01^2 each.
        np.testing.assert_allclose(found.path()[0], wanted.path()[0], atol=3e-6)
        np.testing.assert_allclose(found.belief().covariance, wanted.belief().covariance, rtol=1e-3, atol=1e-14)


@pytest.mark.parametrize("name", SMOOTHERS)
def test_turns_alone_tell_changes_of_yaw_but_not_its_level(name):
    # A disc: pushing says little of its yaw and contact nothing. It is known to 0.3 rad at first, and no better later.
    given = without_relative(felt(contact(30, PLAIN, name="disc"), direction=False))
    covariance = given.prior.covariance.copy()
    covariance[:3, :3] = np.diag(np.square([1e-4, 1e-4, 0.3]))
    given = replace(given, prior=replace(given.prior, covariance=covariance))
    turned, blind = (fed(make(name, some, PLAIN), some) for some in (given, replace(given, turns=[None] * 31)))
    # iSAM2 lets poses be off their linearisation, and the centre of friction seems to tell a percent of yaw.
    assert yaw_variance(turned) > (0.99 if name == "fixed-lag" else 0.98) * 0.3**2
    # Changes: what is left of 23 turns between the two ends, against what pushing leaves open.
    truth = se2.wrap(given.truth[:, 2] - given.truth[0, 2])
    assert np.abs(se2.wrap(turned.path()[0][:, 2] - turned.path()[0][0, 2] - truth)).max() < 2 * FELT
    assert yaw_variance(blind) - 0.3**2 > 4 * (yaw_variance(turned) - 0.3**2)
    # A turn that runs ahead by 2 mrad a step is followed.
    ahead = [said and replace(said, angle=said.angle + 2e-3 * t) for t, said in enumerate(given.turns)]
    followed = fed(make(name, given, PLAIN), replace(given, turns=ahead)).path()[0][:, 2]
    assert (followed - turned.path()[0][:, 2])[-1] - (followed - turned.path()[0][:, 2])[0] > 0.6 * 0.06


@pytest.mark.parametrize("name", ["rectangle", "disc"])
@pytest.mark.parametrize("said", [(0, 1, 2, 28, 29, 30), (15, 16, 29, 30)])
def test_the_offset_outlives_the_steps_that_told_it(name, said):
    # Turns on steps that left the window of 8 long ago, or that came when others had, bear on the last ones.
    given = without_relative(felt(contact(30, PLAIN, name=name), direction=False))
    every = [Turn(se2.wrap(float(yaw)), FELT**2) for yaw in given.truth[:, 2] - OFFSET + 0.02 * np.sin(np.arange(31))]
    given = replace(given, turns=[every[t] if t in said else None for t in range(31)])
    short = fed(lagged(8, given, PLAIN), given)
    wanted = batch(given, PLAIN)
    assert max(scaled_difference(short.belief(), wanted, POSES)) < 0.03
    assert max(scaled_difference(short.belief(), wanted)) < 0.1
    late = replace(given, turns=[one if t > 25 else None for t, one in enumerate(given.turns)])
    assert yaw_variance(fed(lagged(8, late, PLAIN), late)) > 1.01 * yaw_variance(short)


def with_one_bad_image(given: Contact, by: float) -> Contact:
    directions, turns = given.directions.copy(), given.turns.copy()
    directions[10], turns[10] = ContactDirection(by, FELT**2), Turn(se2.wrap(by - OFFSET), FELT**2)
    return replace(given, directions=directions, turns=turns)


@pytest.mark.parametrize("by", [0.3, -2.0])
@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_one_bad_image_does_not_bend_the_path(name, by):
    given = without_relative(felt(contact(14, ROBUST, seed=3), seed=3))
    good = fed(make(name, given, ROBUST), given).path()[0][:, 2]
    bad = fed(make(name, given, ROBUST), with_one_bad_image(given, by)).path()[0][:, 2]
    assert np.abs(bad - good).max() < 0.3 * FELT
    bent = fed(make(name, given, PLAIN), with_one_bad_image(given, by)).path()[0][:, 2]
    assert np.abs(bent - good).max() > 3 * np.abs(bad - good).max()


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_graph_without_a_solution_is_refused(name):
    given = contact(3, ROBUST)
    with pytest.raises(EstimationError):
        make(name, given, ROBUST)(given.prior, np.array([np.nan, 0.0, 0.0]), (), 0.0)
    smoother = make(name, given, ROBUST)(given.prior, given.sensor[0], (), 0.0)
    pair = RelativePoses(np.array([1]), np.zeros((1, 3)), np.eye(3)[None])
    pair.pose[:] = np.nan  # which is refused when it is made
    with pytest.raises(EstimationError):
        smoother.add(given.sensor[1], [pair], 1 / 30)


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_relative_pose_without_a_positive_covariance_is_refused(name):
    given = contact(3, ROBUST)
    smoother = make(name, given, ROBUST)(given.prior, given.sensor[0], (), 0.0)
    pair = RelativePoses(np.array([1]), np.zeros((1, 3)), np.diag([1.0, 1.0, 0.0])[None])
    with pytest.raises(EstimationError, match="not positive definite"):
        smoother.add(given.sensor[1], [pair], 1 / 30)
