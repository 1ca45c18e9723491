"""The particle filter, against the smoothers on pushes drawn from the estimator's own model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from palpate.config import (
    BalanceSettings,
    ContactSettings,
    DirectionSettings,
    FrictionConeSettings,
    NoiseSettings,
    Priors,
    SensorPoseSettings,
    StickingSettings,
    TurnSettings,
)
from palpate.errors import EstimationError
from palpate.filter.belief import Prior
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Rectangle
from palpate.graph.contact_geometry import ContactModel, contact_model
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.factor import Rows, Step
from palpate.graph.factors.turn import Turn
from palpate.graph.smoother import Smoother, make_smoother
from palpate.graph.values import Values
from palpate.graph.variables import IN_SHARED, LAG, OBJECT_SIZE, SENSOR, SENSOR_IN_OBJECT, SHARED_SIZE, TURN_OFFSET
from palpate.lab.paper.particle_filter import ParticleFilter, cost_of, drawn_from, systematic, with_noise
from palpate.lab.paper.pushing_motion import student
from palpate.lab.simulate.limit_surface import Steering, push
from palpate.touch.relative import compared_frames
from palpate.types.measurements import (
    ContactDirection,
    Measurement,
    ObjectPose,
    OwnMeasurement,
    RelativePoses,
)
from palpate.types.measurements import Turn as TurnMeasurement
from palpate.types.sensor import SensorProfile

Array = np.ndarray
POSE = slice(0, 3)
SHAPES = {"rectangle": Rectangle(0.2363, 0.1579), "disc": Disc(0.088)}
ONE_TIP, TWO_TIPS = ((0.0, 0.0),), ((0.0, 0.025), (0.0, -0.025))
FELT = 0.01  # [rad], the standard deviation of directions and turns
TURNED = 0.02  # [rad], that of pairs
OFFSET = math.pi - 0.06  # [rad]; the sensor's yaw on the object, about 0.05, makes turns fall on both sides of +-pi

ROBUST = NoiseSettings(
    direction=DirectionSettings(share=0.8),
    turn=TurnSettings(share=20.0),
    sticking=StickingSettings(share=0.03, sliding_share=3.0, margin=0.05, kernel=5.0),
    balance=BalanceSettings(share=0.03),
    friction_cone=FrictionConeSettings(share=0.2),
    priors=Priors(friction_ratio=(0.2, 0.3), friction_center=(0.0, 0.12), grip=(0.4, 0.12)),
)
"""With all kernels and weights that depend on the estimate, but with numbers that do not move with what is tuned."""
PLAIN = replace(
    ROBUST,
    contact=ContactSettings(kernel=None),
    direction=DirectionSettings(share=0.4, kernel=None),
    turn=TurnSettings(share=4.0, kernel=None),
    sticking=StickingSettings(share=0.03, sliding_share=0.03, kernel=None),
    balance=BalanceSettings(share=0.03, kernel=None),
    friction_cone=FrictionConeSettings(share=None, kernel=None),
)
"""No weight depends on the estimate, so that what is solved is one least-squares problem."""
SURE = SensorPoseSettings(deviation=(1e-7, 1e-7, 1e-7))


@dataclass(frozen=True)
class Contact:
    """What a smoother is given of one contact."""

    truth: Array  # g, (N, 3)
    objects: Array  # (N, 3)
    model: ContactModel
    sensor: Array  # (N, 3)
    prior: Prior
    said: list[list[Measurement]]


@cache
def model_of(name: str = "rectangle", tips: tuple[tuple[float, float], ...] = ONE_TIP) -> ContactModel:
    return contact_model(SHAPES[name], SensorProfile("test", radius=0.021, tips=tips, rate=30.0))


@cache
def pushed(model: ContactModel, steps: int) -> tuple[Array, Array]:
    """Noise-free object and sensor poses (steps + 1, 3) of one push from the left."""
    g = np.array([[-0.13, 0.01, 0.05]])
    for _ in range(50):
        g[0, 0] += gap_of(model, g[0])  # never overshoots: the distance falls no faster than x grows
    o, e = push(model, np.zeros((1, 3)), g, steps, Steering())
    return o[:, 0], e[:, 0]


def gap_of(model: ContactModel, g: Array) -> float:
    return float(model.touching_at(np.array(g, np.float64))["gap"])


def prior_at(pose: Array, settings: NoiseSettings) -> Prior:
    """What is known of an object before its first contact."""
    deviation = np.concatenate([settings.first_pose.deviation, settings.priors.deviation])
    return Prior(pose, settings.priors.mean, np.diag(np.square(deviation))).loosened(np.full((3, 3), 1e-7))


def surely(pose: Array, values: Sequence[float]) -> Prior:
    return Prior(pose, np.array(values), 1e-14 * np.eye(3 + OBJECT_SIZE))


def noisy(poses: Array, sigmas: Sequence[float] | Array, rng: np.random.Generator) -> Array:
    return se2.compose(poses, se2.exp(rng.normal(size=poses.shape) * sigmas))


def contact(
    steps: int,
    settings: NoiseSettings,
    said: Sequence[str] = (),
    name: str = "rectangle",
    tips: tuple[tuple[float, float], ...] = ONE_TIP,
    turned: float = 0.0,
) -> Contact:
    """A push of an object whose frame is turned, with what is said of most steps: pairs, directions, turns, sights."""
    rng = np.random.default_rng(0)
    model = model_of(name, tips)
    o, e = pushed(model, steps)
    o = se2.compose(o, [0.0, 0.0, turned])
    g = se2.between(o, e)
    sensor = noisy(e, settings.sensor_pose.deviation, rng)
    prior = prior_at(noisy(o[0], settings.first_pose.deviation, rng), settings)
    measured: list[list[Measurement]] = [[] for _ in g]
    for t in range(steps + 1):
        back = np.append(compared_frames(t), 2 if t > 2 else []).astype(int)
        if "pairs" in said and len(back) and t % 7:
            pose = noisy(se2.between(g[t - back], g[t]), (0.5, 0.5, TURNED), rng)
            covariance = np.diag(np.square([1.0, 1.0, TURNED]))
            covariance[0, 2] = covariance[2, 0] = 0.3 * TURNED  # not every one is diagonal
            measured[t].append(RelativePoses(back, pose, np.broadcast_to(covariance, (len(back), 3, 3))))
        if "directions" in said and t % 4 != 3:
            normal = complex(model.touching_at(g[t])["normal"])
            angle = float(np.angle(-normal * np.exp(-1j * g[t, 2])))
            measured[t].append(ContactDirection(angle + rng.normal(0.0, FELT), FELT**2))
        if "turns" in said and t % 4 != 3:
            measured[t].append(TurnMeasurement(se2.wrap(float(g[t, 2] - OFFSET + rng.normal(0.0, FELT))), FELT**2))
        if "sights" in said and t % 5 == 4:  # seen four frames ago
            deviation = np.array([2e-3, 2e-3, 0.03])
            seen = noisy(o[t - 4], deviation, rng)
            measured[t].append(ObjectPose(seen, np.diag(np.square(deviation)), time_of(t - 4)))
    return Contact(g, o, model, sensor, prior, measured)


def time_of(step: int) -> float:
    return step / 30.0


def fed(name: str, given: Contact, settings: NoiseSettings) -> Smoother:
    chosen = make_smoother("batch", settings, given.model)
    smoother = chosen(given.prior, given.sensor[0], given.said[0], 0.0)
    for t in range(1, len(given.sensor)):
        smoother.add(given.sensor[t], given.said[t], time_of(t))
    return smoother


def begun(given: Contact, settings: NoiseSettings = ROBUST, seed: int = 0, count: int = 1000) -> ParticleFilter:
    factors, random = make_factors(settings, given.model), np.random.default_rng(seed)
    first = given.prior, given.sensor[0], given.said[0], 0.0
    return ParticleFilter(factors, settings, given.model, *first, random=random, count=count)


def filtered(given: Contact, settings: NoiseSettings = ROBUST, seed: int = 0, count: int = 1000) -> ParticleFilter:
    smoother = begun(given, settings, seed, count)
    for t in range(1, len(given.sensor)):
        smoother.add(given.sensor[t], given.said[t], time_of(t))
    return smoother


def along(model: ContactModel, settings: NoiseSettings, prior: Prior, sensor: Array, count: int) -> ParticleFilter:
    """The filter after sensor poses (N, 3) at which nothing is felt."""
    return filtered(Contact(sensor, sensor, model, sensor, prior, [[] for _ in sensor]), settings, count=count)


CONTACTS = {
    "pairs": lambda: contact(25, PLAIN, ["pairs"]),
    "directions": lambda: contact(25, PLAIN, ["directions"]),
    "turns": lambda: contact(25, PLAIN, ["turns"]),
    "turns, half a turn round": lambda: contact(25, PLAIN, ["turns"], turned=math.pi + 0.05),
    "directions and turns, disc": lambda: contact(25, PLAIN, ["directions", "turns"], name="disc"),
    "all that is felt": lambda: contact(25, PLAIN, ["pairs", "directions", "turns"]),
    "sights of the past": lambda: contact(25, PLAIN, ["sights"]),
    "two tips": lambda: contact(25, PLAIN, ["pairs"], tips=TWO_TIPS),
}


@pytest.mark.parametrize("what", CONTACTS)
def test_it_believes_what_the_batch_does(what):
    # In a problem that is nearly linear and Gaussian a filter and a smoother say the same of the last step. Particles
    # that are resampled again and again are some hundred independent ones, and fewer in what is shared, drawn but once.
    given = CONTACTS[what]()
    found = filtered(given, PLAIN, count=8000).belief().prior
    wanted = fed("batch", given, PLAIN).belief().prior
    deviation = np.sqrt(np.diag(wanted.covariance))
    # The load goes over from one tip to the other, which is not linear; a disc's yaw is known by what is shared alone.
    near = 1.0 if what in ("two tips", "directions and turns, disc") else 0.5
    assert (np.abs(se2.log(se2.between(wanted.pose, found.pose))) < near * deviation[POSE]).all()
    assert (np.abs(found.values - wanted.values) < deviation[3:]).all()
    ratio = np.sqrt(np.diag(found.covariance)) / deviation
    assert (ratio[POSE] > 0.6).all()
    assert (ratio[POSE] < 1.5).all()
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
    # Yaw and the bias of directions, which on a side only their sum tells; from one draw to the next it differs by 0.2.
    yaw_and_bias = [some.covariance[2, 3] / np.prod(np.sqrt(np.diag(some.covariance)[2:4])) for some in (found, wanted)]
    assert abs(yaw_and_bias[0] - yaw_and_bias[1]) < 0.5


def test_it_follows_a_push_that_sticks_without_any_touch():
    # Without noise a filter that knows the first pose, friction and outline follows by motion alone.
    o, e = pushed(model_of("rectangle"), 60)
    settings = replace(
        PLAIN,
        sensor_pose=SURE,
        sticking=StickingSettings(still=1e-7, share=0.0, kernel=None),
        balance=BalanceSettings(still=1e-10, share=0.0, kernel=None),
    )
    # That c is twice what the model says is known, too.
    model = replace(model_of(), friction_radius=0.5 * model_of().friction_radius)
    smoother = along(model, settings, surely(o[0], [0.0, 0.0, 0.0, 0.0, 0.0, np.log(4.0), 0.0, 0.0, 1.0]), e, count=20)
    moved = np.hypot(*(o[-1] - o[0])[:2])
    difference = np.abs(se2.log(se2.between(o[-1], smoother.belief().prior.pose)))
    assert moved > 0.04
    assert max(abs(gap_of(model, g)) for g in smoother.path()[0]) < 2e-6
    # The motion is taken at the start of each step: second order in steps of 1 mm and 0.01 rad, 60 times.
    assert (difference < [2e-4, 2e-4, 3e-3]).all()


def test_outside_the_cone_it_slides_along_the_edge():
    # A tip moves along the left side of a rectangle by 10 mm and into it by 2 mm: 79 degrees from the normal, far
    # outside the motion cone. With a grip of 0.2 the side lags behind the tip; if it stuck, it would not.
    way = np.linspace(0.0, 1.0, 21)[:, None] * np.array([0.002, 0.01, 0.0])
    start = np.array([-0.2363 / 2, 0.0, 0.0])
    slid, moved = {}, {}
    for grip in (0.2, 50.0):
        prior = surely(np.zeros(3), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, grip])
        smoother = along(model_of(), replace(ROBUST, sensor_pose=SURE), prior, start + way, count=1000)
        g, _ = smoother.path()
        slid[grip], moved[grip] = g[-1, 1] - g[0, 1], smoother.belief().prior.pose
        assert abs(gap_of(model_of(), g[-1])) < 2e-4  # the gap is kept either way
    # The object's motion is within atan(0.2) of the normal, that is 2 to 0.4 mm, so that some 9.6 mm are slid, less by
    # what the turning object's side comes along.
    assert 0.36e-3 < moved[0.2][1] < 0.43e-3  # 0.2 * 1.9 mm, and a little more as the noise of the edge is skewed
    assert slid[0.2] > 0.008
    assert abs(slid[50.0]) < 0.002


def test_the_same_seed_gives_the_same_and_another_another():
    given = contact(8, ROBUST, ["pairs", "directions", "turns"])
    a, b, c = (filtered(given, seed=seed, count=200).belief() for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.g, b.g)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert (a.g != c.g).any()


def test_it_is_a_smoother_like_the_others_to_look_at():
    given = contact(12, ROBUST, ["pairs", "directions", "turns"])
    begin = make_smoother("particle-filter", ROBUST, given.model)
    smoother, batch = begin(given.prior, given.sensor[0], given.said[0], 0.0), fed("batch", given, ROBUST)
    assert isinstance(smoother, ParticleFilter)
    assert smoother.last_errors() == {}
    for t in range(1, 13):
        smoother.add(given.sensor[t], given.said[t], time_of(t))
        belief = smoother.belief()
        g, e = smoother.path()
        np.testing.assert_allclose(belief.covariance, belief.covariance.T, rtol=1e-6, atol=1e-18)
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
        assert g.shape == e.shape == (t + 1, 3)
        np.testing.assert_array_equal(g[-1], belief.g)
        np.testing.assert_array_equal(e[-1], belief.e)
    errors, others = smoother.last_errors(), batch.last_errors()
    assert {name: error.shape for name, error in errors.items()} == {name: some.shape for name, some in others.items()}
    assert smoother.belief().covariance.shape == batch.belief().covariance.shape
    # A new contact forgets the old one.
    assert len(begin(given.prior, given.sensor[0], given.said[0], 0.0).path()[0]) == 1


def test_the_past_stays_as_it_was():
    given = contact(12, ROBUST, ["pairs", "directions", "turns"])
    smoother = begun(given)
    seen = [smoother.belief().g]
    for t in range(1, 12):
        smoother.add(given.sensor[t], given.said[t], time_of(t))
        seen.append(smoother.belief().g)
    np.testing.assert_array_equal(smoother.path()[0], seen)


def test_the_offset_that_a_first_turn_brings_into_being_stays_together():
    # A turn of pi at yaws around 0 is an offset around -pi, which is pi as well: resampling must see one cloud.
    count, yaw = 5000, 0.01 * np.random.default_rng(0).normal(size=5000)
    g = np.stack([np.full(count, -0.13), np.zeros(count), yaw], axis=-1)[:, None]
    at = Values(model_of(), {SENSOR_IN_OBJECT: g, SENSOR: g}, np.zeros((SHARED_SIZE, count)))
    factor = Turn(ROBUST.turn)
    term = factor.terms(Step(np.zeros(3), None, [TurnMeasurement(math.pi, FELT**2)], [0.0]))
    assert term is not None
    shared = drawn_from(factor, term, at, factor.first_guess(at, term), np.random.default_rng(1))
    offset = shared[IN_SHARED[TURN_OFFSET]][0]
    assert abs(np.cos(offset.mean()) + 1.0) < 1e-3
    np.testing.assert_allclose(offset.std(), np.hypot(0.01, FELT * math.sqrt(ROBUST.turn.share)), rtol=0.05)
    np.testing.assert_allclose(np.polyfit(yaw, offset, 1)[0], 1.0, atol=0.3)  # each has that of its own yaw
    assert (np.delete(shared, IN_SHARED[TURN_OFFSET], axis=0) == 0.0).all()


def test_systematic_resampling_by_hand():
    # Places 0.05, 0.15 ... 0.95 or wherever between: 5 or 4 fall below 0.45, and so on; none on a weight of 0.
    weight = np.array([0.45, 0.0, 0.3, 0.25])
    for seed in range(20):
        rows = systematic(weight, 10, np.random.default_rng(seed))
        counts = np.bincount(rows, minlength=4)
        assert counts.sum() == 10
        assert counts[1] == 0
        assert (np.abs(counts - 10 * weight) < 1.0).all()
    assert systematic(np.array([0.0, 1.0, 0.0]), 5, np.random.default_rng(0)).tolist() == [1] * 5
    # On average each as often as its weight says.
    mean = np.mean([np.bincount(systematic(weight, 1, np.random.default_rng(s)), minlength=4) for s in range(3000)], 0)
    np.testing.assert_allclose(mean, weight, atol=0.035)  # 3.8 deviations of sqrt(0.25 / 3000)


def test_resampling_keeps_mean_and_covariance_of_what_is_shared():
    # Numbers of very different size, two of them correlated and one that all particles agree about.
    rng = np.random.default_rng(0)
    drawn = np.array([[10.0], [1e-2], [1e-9], [0.0]]) * rng.normal(size=(4, 20000)) + [[3.0], [0.0], [1e-9], [0.5]]
    drawn[1] += 1e-3 * drawn[0]
    noise = drawn
    for _ in range(20):  # without the shrinking, noise of 4 % of the variance each time would add up to 80 %
        noise = with_noise(noise, rng)
    deviation = drawn.std(axis=1)
    assert (np.abs(noise.mean(axis=1) - drawn.mean(axis=1)) <= 0.05 * deviation).all()
    np.testing.assert_allclose(noise.std(axis=1), deviation, rtol=0.05)
    slopes = [np.polyfit(some[0], some[1], 1)[0] for some in (noise, drawn)]
    np.testing.assert_allclose(*slopes, atol=5e-5)  # 1e-3, as drawn
    assert len(np.unique(with_noise(np.repeat(drawn[:1, :10], 10, axis=1), rng))) == 100  # copies differ


def test_the_distribution_of_slip_is_the_kernels():
    # Scale 2 on one row: (1 + s / 4)^-2, Student's with 3 degrees of freedom times 2 / sqrt(3). Half of it lies within
    # 0.765 * 1.155 = 0.883, and 95 % within 3.182 * 1.155 = 3.675.
    drawn = np.abs(student(np.random.default_rng(0), 100000, 1, 2.0))
    np.testing.assert_allclose(np.quantile(drawn, [0.5, 0.95]), [0.883, 3.675], rtol=0.02)
    np.testing.assert_allclose(student(np.random.default_rng(0), 100000, 1, None).std(), 1.0, rtol=0.01)


def test_the_cost_of_a_term_is_its_kernels():
    # Scale 3 on the two rows together: 4.5 log(1 + s / 9), with s the squared length in deviations.
    residual = np.array([[0.0, 0.0], [1e-9, 2e-9], [1e-3, 2e-3], [5e-3, -1e-3], [1.0, 0.0]])[:, None]
    information = np.full_like(residual, 1e6)
    s = 1e6 * (residual**2).sum(axis=2)[:, 0]
    weight = information / (1.0 + s / 9.0)[:, None, None]
    nothing = np.empty((5, 1, 2, 0))
    np.testing.assert_allclose(
        cost_of(Rows(residual, nothing, information, weight)), 4.5 * np.log1p(s / 9.0), rtol=1e-9
    )
    np.testing.assert_allclose(cost_of(Rows(residual, nothing, information, information)), s / 2)
    # What counts for nothing costs nothing, and terms add up.
    assert (cost_of(Rows(residual, nothing, 0.0 * information, 0.0 * weight)) == 0.0).all()
    twice = (np.concatenate([part, part], axis=1) for part in (residual, nothing, information, information))
    np.testing.assert_allclose(cost_of(Rows(*twice)), s)


def test_one_bad_image_is_let_go_and_what_nothing_explains_is_told():
    given = contact(14, ROBUST, ["directions"])
    bad = replace(given, said=[*given.said[:10], [ContactDirection(-2.0, FELT**2)], *given.said[11:]])
    with_good, with_bad = (filtered(some).belief().prior for some in (given, bad))
    deviation = np.sqrt(np.diag(with_good.covariance))[POSE]
    assert (np.abs(se2.log(se2.between(with_good.pose, with_bad.pose))) < deviation).all()
    # Ten pairs half a turn off, each known to 0.02 rad and without a kernel: 10 * (3 / 0.02)^2 / 2 is far beyond 700.
    smoother = filtered(given)
    pose, covariance = np.tile([0.0, 0.0, 3.0], (10, 1)), np.tile(np.diag([1.0, 1.0, 4e-4]), (10, 1, 1))
    with pytest.raises(EstimationError, match="no particle explains what is measured"):
        smoother.add(given.sensor[-1], [RelativePoses(np.arange(1, 11), pose, covariance)], time_of(15))


def test_pairs_beyond_its_memory_are_dropped():
    given = contact(45, ROBUST)
    smoother = filtered(given, count=50)
    pose, covariance = np.array([[0.0, 0.0, 3.0]]), np.diag([1.0, 1.0, 1e-6])[None]
    # The same pair one step less back would explain nothing.
    smoother.add(given.sensor[-1], [RelativePoses(np.array([LAG]), pose, covariance)], time_of(46))
    with pytest.raises(EstimationError):
        smoother.add(given.sensor[-1], [RelativePoses(np.array([LAG - 1]), pose, covariance)], time_of(47))


def test_it_is_weighed_by_what_a_user_measures():
    class Grip(OwnMeasurement):
        on = ("grip",)

        def linearise(self, *values: Array) -> tuple[Array, Array]:
            return (values[0] - 0.3) / 0.02, np.array([[1.0 / 0.02]])

    given = contact(5, ROBUST)
    said = [*given.said[:5], [Grip()]]
    belief = filtered(replace(given, said=said)).belief().prior
    # Of 0.4 +- 0.12 and 0.3 +- 0.02: 0.3027 +- 0.0197.
    np.testing.assert_allclose(belief.values[-1], 0.303, atol=0.006)
    np.testing.assert_allclose(np.sqrt(belief.covariance[-1, -1]), 0.0197, rtol=0.2)
