"""iSAM2 against a batch solution and the fixed lag; what it linearises anew, and what a long contact costs it."""

from collections.abc import Mapping

import numpy as np
import pytest
from push_samples import model_of, sensor
from smoother_samples import (
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
    make,
    prior_at,
    scaled_difference,
    without_relative,
)

from palpate.config import NoiseSettings
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.factor import Factor, Rows, Step, Terms
from palpate.graph.fixed_lag import FixedLag
from palpate.graph.smoother import Smoother
from palpate.graph.values import Values
from palpate.graph.variables import DEPTH, IN_OBJECT, OF_OBJECT, OUTLINE_SCALE, SENSOR
from palpate.lab.paper import isam2
from palpate.lab.paper.isam2 import Isam2
from palpate.types.measurements import Measurement, ObjectPose

Array = np.ndarray

BATCHES = {
    "relative": lambda: contact(12, PLAIN),
    "relative, two tips": lambda: contact(12, PLAIN, tips=TWO_TIPS),
    "direction": lambda: felt(contact(12, PLAIN), turn=False),
    "all": lambda: felt(contact(12, PLAIN)),
    "all, late": lambda: felt(contact(12, PLAIN), first=5),
    "direction and turn, disc": lambda: without_relative(felt(contact(12, PLAIN, name="disc"))),
}


@pytest.fixture
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linearise anew whatever has moved at all, until nothing does."""
    monkeypatch.setattr(isam2, "RELINEARISE_ABOVE", (1e-6, 1e-6, 1e-6))
    monkeypatch.setattr(isam2, "RELINEARISE_SHARED_ABOVE", 1e-4)
    monkeypatch.setattr(isam2, "_CONVERGED", (1e-7, 1e-7, 1e-7))
    monkeypatch.setattr(isam2, "_UPDATES", 20)


def quick(steps: int, noise: NoiseSettings = ROBUST, seed: int = 0) -> Contact:
    """A noise-laden push of which touch tells direction and turn."""
    return without_relative(felt(contact(steps, noise, seed), seed=seed))


def isam2_of(given: Contact, noise: NoiseSettings, *more: Factor) -> Isam2:
    """A smoother at the first step."""
    return Isam2((*make_factors(noise, given.model), *more), given.model, given.prior, given.sensor[0], given.said(0))


def whole_of(given: Contact, noise: NoiseSettings, *more: Factor) -> FixedLag:
    """The batch solution at the first step: a window that no contact here exceeds."""
    factors = *make_factors(noise, given.model), *more
    return FixedLag(factors, given.model, given.prior, given.sensor[0], given.said(0), 0.0, 10_000)


def go_on(smoother: Smoother, given: Contact, more: Mapping[int, Measurement] | None = None) -> None:
    """Add all other steps, with more measurements at some."""
    for t in range(1, len(given.sensor)):
        said = given.said(t) if more is None or t not in more else (*given.said(t), more[t])
        smoother.add(given.sensor[t], said, t / 30)


def path_of(smoother: Smoother) -> Array:
    return np.stack(smoother.path(), axis=1)


@pytest.mark.parametrize("what", BATCHES)
def test_equals_a_batch_solution(what, exactly):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("isam2", given, PLAIN), given, check=True)
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 2e-3
    assert spread < 2e-3
    assert (apart(smoother.path(), wanted.poses) < 2e-5).all()


@pytest.mark.parametrize("what", BATCHES)
def test_as_it_comes_is_close_to_a_batch_solution(what):
    given = BATCHES[what]()
    wanted = batch(given, PLAIN)
    smoother = fed(make("isam2", given, PLAIN), given)
    mean, spread = scaled_difference(smoother.belief(), wanted)
    assert mean < 0.06
    assert spread < 0.06
    assert (apart(smoother.path(), wanted.poses) < 4e-4).all()


@pytest.mark.parametrize("noise", [PLAIN, ROBUST], ids=["plain", "robust"])
@pytest.mark.parametrize("pairs", [True, False], ids=["pairs", "no pairs"])
def test_over_many_blocks_it_says_what_a_window_of_all_steps_does(noise, pairs):
    given = felt(contact(75, noise, seed=1), seed=1)
    given = given if pairs else without_relative(given)
    whole, smoother = whole_of(given, noise), isam2_of(given, noise)
    go_on(whole, given)
    go_on(smoother, given)
    # Old steps keep the friction of then until it is off by RELINEARISE_SHARED_ABOVE.
    assert max(scaled_difference(smoother.belief(), whole.belief(), POSES)) < 0.1
    assert max(scaled_difference(smoother.belief(), whole.belief())) < 0.2
    assert (apart(smoother.path(), path_of(whole)) < 1e-3).all()
    errors, wanted = smoother.last_errors(), whole.last_errors()
    assert list(errors) == list(wanted)
    for name, values in errors.items():
        np.testing.assert_allclose(values, wanted[name], atol=0.1)


@pytest.mark.parametrize("anew", [True, False], ids=["anew", "never"])
def test_blocks_are_linearised_anew_when_they_move(anew, monkeypatch):
    # At step 40 a camera says that the object has been 30 mm aside all the time.
    if not anew:
        monkeypatch.setattr(isam2, "RELINEARISE_ABOVE", (np.inf, np.inf, np.inf))
        monkeypatch.setattr(isam2, "RELINEARISE_SHARED_ABOVE", np.inf)
    given = quick(60, PLAIN)
    o = se2.compose(given.sensor[40], se2.inverse(given.truth[40]))
    seen = {40: ObjectPose(se2.compose(o, np.array([0.0, 0.03, 0.0])), np.diag(np.square([2e-5, 2e-5, 2e-3])))}
    smoother, whole, unseen = isam2_of(given, PLAIN), whole_of(given, PLAIN), isam2_of(given, PLAIN)
    for each, more in ((smoother, seen), (whole, seen), (unseen, {})):
        go_on(each, given, more)
    assert apart(smoother.path(), path_of(unseen))[1] > 0.02
    off = apart(smoother.path(), path_of(whole))
    if anew:
        assert (off < [1e-4, 1e-4, 2.5e-3]).all()
    else:
        assert (off > [2e-4, 1e-4, 4e-3]).all()


def test_what_arrives_late_is_tied_to_the_step_of_its_time():
    given = quick(45, PLAIN)
    o = se2.compose(given.sensor[3], se2.inverse(given.truth[3]))
    covariance = np.diag(np.square([2e-4, 2e-4, 2e-3]))
    late, in_time, never = (isam2_of(given, PLAIN) for _ in range(3))
    go_on(late, given, {40: ObjectPose(o, covariance, time=3 / 30)})
    go_on(in_time, given, {3: ObjectPose(o, covariance)})
    go_on(never, given)
    assert max(scaled_difference(late.belief(), in_time.belief(), POSES)) < 0.05
    assert max(scaled_difference(never.belief(), in_time.belief(), POSES)) > 0.2
    assert (apart(late.path(), path_of(in_time)) < 2e-4).all()


def test_a_long_contact_costs_a_step_no_more(monkeypatch):
    given = quick(150)
    smoother, linearised, original = isam2_of(given, ROBUST), [], Factor.linearise
    monkeypatch.setattr(
        Factor, "linearise", lambda self, at, terms: linearised.append(terms) or original(self, at, terms)
    )
    counts = []
    for t in range(1, 151):
        linearised.clear()
        smoother.add(given.sensor[t], given.said(t), t / 30)
        counts.append(sum(len(terms.data) for terms in linearised))
    # At most steps all but the newest blocks stay as they are.
    assert np.mean(counts[100:]) <= 1.5 * np.mean(counts[40:90])


class Straight(Factor):
    """A sensor that went straight on and evenly: ties three steps, at first beyond the newest blocks."""

    name = "straight"
    steps = ((SENSOR,), (SENSOR,), (SENSOR,))
    rows = 1
    data = np.dtype([("deviation", np.float64)])

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        data = np.array([(5e-5,)], self.data)
        return Terms(np.array([[-27, -9, 0]]), data) if len(step.times) % 10 == 9 else None

    def linearise_into(self, rows: Rows, at: Values, terms: Terms) -> None:
        """See Factor."""
        e, share = at[SENSOR][:, terms.places], np.array([0.3, -1.0, 0.7])
        rows.residual[..., 0] = e[..., 1] @ share
        by_e = rows.jacobian.reshape(*rows.jacobian.shape[:2], 3, 3)
        by_e[..., 0], by_e[..., 1], by_e[..., 2] = share * np.sin(e[..., 2]), share * np.cos(e[..., 2]), 0.0
        rows.information[:] = rows.weight[:] = terms.data["deviation"][:, None] ** -2.0


def test_it_knows_no_factor():
    given = quick(58, PLAIN)
    smoother, whole, without = (
        isam2_of(given, PLAIN, Straight()),
        whole_of(given, PLAIN, Straight()),
        isam2_of(given, PLAIN),
    )
    for each in (smoother, whole, without):
        go_on(each, given)
    assert max(scaled_difference(smoother.belief(), whole.belief(), POSES)) < 0.05
    assert max(scaled_difference(without.belief(), whole.belief(), POSES)) > 0.2
    assert (apart(smoother.path(), path_of(whole)) < 2e-4).all()


def test_the_first_step_is_the_first_pose_seen_in_contact():
    # See the same test of all smoothers. The pose is 3 mm short of contact, at which they are 0.3 mm deep.
    sensor_pose = np.array([-0.2363 / 2 - 3e-3, 0.0, 0.0])
    model = model_of("rectangle", sensor())
    prior = prior_at(np.zeros(3), PLAIN)
    deviation = np.sqrt(np.diag(prior.covariance))
    belief = Isam2(make_factors(PLAIN, model), model, prior, sensor_pose).belief()
    sensor_deviation, depth_deviation = PLAIN.sensor_pose.deviation[0], deviation[3 + IN_OBJECT[DEPTH].start]
    scale_deviation = deviation[3 + IN_OBJECT[OUTLINE_SCALE].start] * 0.2363 / 2
    told = PLAIN.contact.deviation**2 + depth_deviation**2 + scale_deviation**2
    variance = deviation[0] ** 2 + sensor_deviation**2 + told
    off = 3e-3 + prior[DEPTH][0]
    np.testing.assert_allclose(belief.prior.pose[0], -off * deviation[0] ** 2 / variance, rtol=1e-3)
    np.testing.assert_allclose(belief.prior[DEPTH], prior[DEPTH][0] - off * depth_deviation**2 / variance, rtol=1e-3)
    learnt = DEPTH, OUTLINE_SCALE
    untold = [place for one in OF_OBJECT if one not in learnt for place in range(*IN_OBJECT[one].indices(99))]
    np.testing.assert_allclose(np.diag(belief.covariance)[6:][untold], deviation[3:][untold] ** 2, rtol=1e-6)


class Silent(Factor):
    """A factor that has no more terms from a step on."""

    def __init__(self, factor: Factor, end: int) -> None:
        self._factor, self._end = factor, end
        self.name, self.steps, self.shared, self.rows = factor.name, factor.steps, factor.shared, factor.rows  # pyright: ignore

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return self._factor.terms(step) if len(step.times) <= self._end else None

    def linearise_into(self, rows: Rows, at: Values, terms: Terms) -> None:
        """See Factor."""
        self._factor.linearise_into(rows, at, terms)


def test_a_step_that_nothing_determines_is_named():
    given = quick(8, PLAIN)
    factors = [Silent(factor, 5) for factor in make_factors(PLAIN, given.model)]
    smoother = Isam2(factors, given.model, given.prior, given.sensor[0], given.said(0))
    with pytest.raises(EstimationError, match="step 5 of the contact is indeterminate"):
        go_on(smoother, given)
