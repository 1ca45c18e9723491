"""The particle filter, against the smoothers on pushes drawn from the estimator's own model."""

from dataclasses import replace

import numpy as np
import pytest
from push_samples import contact_rows, pushed, sensor, tips_of
from smoother_samples import FELT, PLAIN, ROBUST, TWO_TIPS, Contact, contact, fed, felt, make, without_relative

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph import make_smoother, particle_filter
from palpate.graph.noise import GraphNoise
from palpate.graph.particle_filter import ParticleFilter, systematic
from palpate.graph.smoother import LASTING, Known
from palpate.recording.measurements import ContactDirection, Feeling, RelativePoses, Turn

Array = np.ndarray
POSE = slice(0, 3)


def filtered(given: Contact, noise: GraphNoise = ROBUST, seed: int = 0, count: int = 1000) -> ParticleFilter:
    smoother = ParticleFilter(given.tips, noise, seed, count)
    fed(smoother, given)
    return smoother


def known_of(smoother: ParticleFilter) -> Known:
    return smoother.belief().known


CONTACTS = {
    "relative": lambda: contact(25, PLAIN),
    "direction": lambda: without_relative(felt(contact(25, PLAIN), turn=False)),
    "turn": lambda: without_relative(felt(contact(25, PLAIN), direction=False)),
    "direction and turn, disc": lambda: without_relative(felt(contact(25, PLAIN, name="disc"))),
    "all": lambda: felt(contact(25, PLAIN)),
    "two tips": lambda: contact(25, PLAIN, tips=TWO_TIPS),
}


@pytest.mark.parametrize("what", CONTACTS)
def test_it_believes_what_the_batch_does(what):
    # In a problem that is nearly linear and Gaussian a filter and a smoother say the same of the last step. Particles
    # that are resampled again and again are some hundred independent ones, and fewer in what lasts, drawn but once.
    given = CONTACTS[what]()
    found = known_of(filtered(given, PLAIN, count=4000))
    wanted = fed(make("batch", given, PLAIN), given).belief().known
    deviation = np.sqrt(np.diag(wanted.covariance))
    assert (np.abs(se2.log(se2.between(wanted.pose, found.pose))) < 0.5 * deviation[POSE]).all()
    assert (np.abs(found.lasting - wanted.lasting) < deviation[3:]).all()
    ratio = np.sqrt(np.diag(found.covariance)) / deviation
    assert (ratio[POSE] > 0.75).all()
    assert (ratio[POSE] < 1.35).all()
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
    # Yaw and the bias of directions, which on a side only their sum tells.
    yaw_and_bias = [some.covariance[2, 3] / np.prod(np.sqrt(np.diag(some.covariance)[2:4])) for some in (found, wanted)]
    assert abs(yaw_and_bias[0] - yaw_and_bias[1]) < 0.3


def test_it_follows_a_push_that_sticks_without_any_touch():
    # Without noise a filter that knows the first pose, friction and outline follows by motion alone.
    o, e = pushed("rectangle", 60)
    noise = replace(
        PLAIN, sensor=(1e-7, 1e-7, 1e-7), sticking=1e-7, turning=1e-10, sticking_share=0.0, turning_share=0.0
    )
    # That c is twice what the model says is known, too.
    tips = [replace(tips_of("rectangle")[0], friction_radius=0.5 * tips_of("rectangle")[0].friction_radius)]
    known = Known(o[0], np.array([0.0, 0.0, np.log(4.0), 0.0, 0.0, 1.0]), 1e-14 * np.eye(3 + LASTING))
    smoother = ParticleFilter(tips, noise, count=20)
    smoother.begin(e[0], known, Feeling())
    for pose in e[1:]:
        smoother.add(pose, Feeling())
    moved = np.hypot(*(o[-1] - o[0])[:2])
    difference = np.abs(se2.log(se2.between(o[-1], known_of(smoother).pose)))
    assert moved > 0.04
    assert np.abs(contact_rows(smoother.path()[0], 0.0, tips[0])[0]).max() < 2e-6
    # The motion is taken at the start of each step: second order in steps of 1 mm and 0.01 rad, 60 times.
    assert (difference < [2e-4, 2e-4, 3e-3]).all()


def test_outside_the_cone_it_slides_along_the_edge():
    # A tip moves along the left side of a rectangle by 10 mm and into it by 2 mm: 79 degrees from the normal, far
    # outside the motion cone. With a grip of 0.2 the side lags behind the tip; if it stuck, it would not.
    tips = tips_of("rectangle")
    way = np.linspace(0.0, 1.0, 21)[:, None] * np.array([0.002, 0.01, 0.0])
    start = np.array([-0.2363 / 2, 0.0, 0.0])
    slid, moved = {}, {}
    for grip in (0.2, 50.0):
        known = Known(np.zeros(3), np.array([0.0, 0.0, 0.0, 0.0, 0.0, grip]), 1e-14 * np.eye(3 + LASTING))
        smoother = ParticleFilter(tips, replace(ROBUST, sensor=(1e-7, 1e-7, 1e-7)), count=50)
        smoother.begin(start, known, Feeling())
        for pose in start + way[1:]:
            smoother.add(pose, Feeling())
        g, _ = smoother.path()
        slid[grip], moved[grip] = g[-1, 1] - g[0, 1], known_of(smoother).pose
        assert abs(contact_rows(g[-1], 0.0, tips[0])[0][0]) < 2e-4  # the gap is kept either way
    # The object's motion is within atan(0.2) of the normal, that is 2 to 0.4 mm, so that some 9.6 mm are slid, less by
    # what the turning object's side comes along.
    assert 0.3e-3 < moved[0.2][1] < 0.4e-3  # 0.2 * 1.9 mm
    assert slid[0.2] > 0.008
    assert abs(slid[50.0]) < 0.002


def test_the_same_seed_gives_the_same_and_another_another():
    given = felt(contact(8, ROBUST))
    a, b, c = (filtered(given, seed=seed, count=200).belief() for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.g, b.g)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert (a.g != c.g).any()


def test_it_is_a_smoother_like_the_others_to_look_at():
    given = felt(contact(12, ROBUST))
    smoother = make_smoother("particle-filter", given.tips, ROBUST)
    assert isinstance(smoother, ParticleFilter)
    fed(smoother, given, check=True)
    assert smoother.belief().covariance.shape == (6 + LASTING, 6 + LASTING)
    assert smoother.pushing_error().shape == (4,)
    # A new contact forgets the old one.
    smoother.begin(given.sensor[0], given.known, given.feeling(0))
    assert len(smoother.path()[0]) == 1
    assert smoother.pushing_error().tolist() == [0.0] * 4


def test_the_past_stays_as_it_was():
    given = felt(contact(12, ROBUST))
    smoother = ParticleFilter(given.tips, ROBUST)
    smoother.begin(given.sensor[0], given.known, given.feeling(0))
    seen = [smoother.belief().g]
    for t in range(1, 12):
        smoother.add(given.sensor[t], given.feeling(t))
        seen.append(smoother.belief().g)
    np.testing.assert_array_equal(smoother.path()[0], seen)


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


def test_resampling_keeps_mean_and_covariance_of_what_lasts():
    given = felt(contact(3, PLAIN))
    smoother = filtered(given, PLAIN, count=20000)
    before = smoother.belief().lasting, smoother.belief().covariance[6:, 6:]
    for _ in range(20):  # without the shrinking, noise of 4 % of the variance each time would add up to 80 %
        smoother._resample()
    smoother._believe()
    deviation = np.sqrt(np.diag(before[1]))
    assert (np.abs(smoother.belief().lasting - before[0]) < 0.1 * deviation).all()
    np.testing.assert_allclose(np.diag(smoother.belief().covariance[6:, 6:]), deviation**2, rtol=0.15)


def test_the_distribution_of_slip_is_the_kernels():
    # Scale 2 on one row: (1 + s / 4)^-2, Student's with 3 degrees of freedom times 2 / sqrt(3). Half of it lies within
    # 0.765 * 1.155 = 0.883, and 95 % within 3.182 * 1.155 = 3.675.
    drawn = np.abs(particle_filter._student(np.random.default_rng(0), 100000, 1, 2.0))
    np.testing.assert_allclose(np.quantile(drawn, [0.5, 0.95]), [0.883, 3.675], rtol=0.02)
    plain = particle_filter._student(np.random.default_rng(0), 100000, 1, None)
    np.testing.assert_allclose(plain.std(), 1.0, rtol=0.01)


def test_the_cost_of_a_residual_is_its_kernels():
    residual = np.array([0.0, 1e-9, 1e-3, 5e-3, 1.0])
    s = (residual / ROBUST.contact) ** 2
    at_zero = ROBUST.contact_weight(0.0 * residual)
    cost = particle_filter._cost(residual, at_zero, ROBUST.contact_weight(residual))
    np.testing.assert_allclose(cost, 4.5 * np.log1p(s / 9.0), rtol=1e-9)
    np.testing.assert_allclose(particle_filter._cost(residual, at_zero, at_zero), s / 2)


def test_one_bad_image_is_let_go_and_what_nothing_explains_is_told():
    given = without_relative(felt(contact(14, ROBUST), turn=False))
    directions = list(given.directions)
    directions[10] = ContactDirection(-2.0, FELT**2)
    good, bad = (known_of(filtered(some)) for some in (given, replace(given, directions=directions)))
    deviation = np.sqrt(np.diag(good.covariance))[POSE]
    assert (np.abs(se2.log(se2.between(good.pose, bad.pose))) < deviation).all()
    # Ten pairs half a turn off, each known to 0.02 rad and without a kernel: 10 * (3 / 0.02)^2 / 2 is far beyond 700.
    smoother = filtered(given)
    pose, covariance = np.tile([0.0, 0.0, 3.0], (10, 1)), np.tile(np.diag([1.0, 1.0, 4e-4]), (10, 1, 1))
    with pytest.raises(EstimationError, match="no particle explains what is measured"):
        smoother.add(given.sensor[-1], Feeling(RelativePoses(np.arange(1, 11), pose, covariance)))


def test_of_several_tips_nobody_knows_which_is_meant():
    smoother = ParticleFilter(tips_of("rectangle", sensor(tips=TWO_TIPS)), ROBUST)
    given = contact(1, ROBUST, tips=TWO_TIPS)
    with pytest.raises(SettingError, match="the sensor has 2 tips"):
        smoother.begin(given.sensor[0], given.known, Feeling(turn=Turn(0.1, 1e-4)))


def test_pairs_beyond_its_memory_are_dropped():
    given = contact(45, ROBUST)
    smoother = filtered(given, count=50)
    far = RelativePoses(np.array([40]), np.array([[0.0, 0.0, 3.0]]), np.diag([1.0, 1.0, 1e-6])[None])
    smoother.add(given.sensor[-1], Feeling(far))  # the same pair 39 steps back would explain nothing
    near = replace(far, back=np.array([39]))
    with pytest.raises(EstimationError):
        smoother.add(given.sensor[-1], Feeling(near))
