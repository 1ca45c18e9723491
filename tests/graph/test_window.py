"""What a sliding window does beyond what all smoothers do: it forgets little, takes late measurements, holds a bank."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from push_samples import noisy, with_settings
from smoother_samples import (
    FELT,
    OFFSET,
    PLAIN,
    POSES,
    ROBUST,
    TWO_TIPS,
    Contact,
    batch,
    contact,
    fed,
    felt,
    lagged,
    scaled_difference,
    settled,
    window_of,
    without_relative,
)

from palpate.config import NoiseSettings
from palpate.errors import EstimationError, SettingError
from palpate.filter.belief import Prior
from palpate.geometry import se2
from palpate.graph.factor_list import make_factors
from palpate.graph.values import Knock
from palpate.graph.variables import OBJECT_SIZE, SENSOR, SENSOR_IN_OBJECT, TURN_OFFSET
from palpate.graph.window import Window
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement, RelativePoses, Turn

Array = np.ndarray
RATE = 30.0


def offset_of(window: Window) -> float:
    return float(window.values[TURN_OFFSET][0, 0])


def test_the_offset_of_turns_is_found():
    given = felt(contact(20, PLAIN, seed=1), seed=1)
    window = window_of(given, PLAIN, 100)
    # 16 directions on a straight side tell the level of yaw and 16 turns its sum with the offset: 0.01 sqrt(2 / 16).
    assert abs(se2.wrap(offset_of(window) - OFFSET)) < 3 * FELT * np.sqrt(2 / 16)
    assert abs(se2.wrap(offset_of(window) - batch(given, PLAIN).offset)) < 1e-4


@pytest.mark.parametrize("angle", [3.0, -1.5])
def test_the_first_turn_of_a_contact_says_the_offset(angle):
    # Under so narrow a kernel a turn half a turn off weighs (0.1 / 3)^2 = 1e-3, less than the prior's 1e-2: the offset
    # has to begin where the turn says.
    given, noise = contact(3, ROBUST), with_settings(ROBUST, turn={"kernel": 0.1})
    window = Window(make_factors(noise, given.model), given.model, [given.prior], given.sensor[0])
    window.add(given.sensor[1], [Turn(angle, FELT**2)], 1 / RATE)
    assert se2.wrap(offset_of(window) + angle - float(window.belief().g[2])) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("said", [(0, 1, 2, 28, 29, 30), (15, 16, 29, 30)])
def test_the_offset_outlives_the_steps_that_told_it(said):
    given = without_relative(felt(contact(30, PLAIN), direction=False))
    given = replace(given, turns=[given.turns[t] or Turn(-OFFSET, FELT**2) if t in said else None for t in range(31)])
    assert abs(se2.wrap(offset_of(window_of(given, PLAIN, 8)) - batch(given, PLAIN).offset)) < 0.05 * FELT


def test_a_short_window_forgets_little():
    given = contact(80, ROBUST, seed=2)
    whole = fed(lagged(100, given, ROBUST), given).belief()
    for lag, share, of_all in ((41, 0.01, 0.05), (15, 3.0, 3.0)):
        window = window_of(given, ROBUST, lag)
        assert window.values.steps == lag
        assert [part.shape for part in window.path()] == [(1, 81, 3)] * 2
        # What left the window stays as a Gaussian. A window of 15 lacks most pairs, which reach back 15 to 39,
        # and can be off by as much as they tell, a few standard deviations of the better estimate.
        belief = fed(lagged(lag, given, ROBUST), given, check=True).belief()
        assert scaled_difference(belief, whole, POSES)[0] < share
        assert scaled_difference(belief, whole)[0] < of_all


SURE_OF_FRICTION = with_settings(PLAIN, priors={"friction_ratio": (0.0, 1e-6), "friction_center": (0.0, 1e-6)})


def within(given: Contact, back: int) -> Contact:
    """The same contact with the pairs that reach back less."""
    kept = [said and cut(said, said.back < back) for said in given.relative]
    return replace(given, relative=kept)


def cut(said: RelativePoses, kept: Array) -> RelativePoses:
    return RelativePoses(said.back[kept], said.pose[kept], said.covariance[kept])


@pytest.mark.parametrize(("noise", "of_all"), [(SURE_OF_FRICTION, 0.02), (PLAIN, 0.25)], ids=["sure", "learning"])
@pytest.mark.parametrize("banded", [False, True])
def test_a_window_loses_nothing_that_reaches_no_further_back(noise, of_all, banded):
    # Sticking, contact, direction, turn and pairs within the window alone: marginalising a linear problem is exact. In
    # the balance friction and motion are multiplied, and what left the window keeps the friction of then.
    given = felt(contact(40, noise, seed=3), seed=3)
    given = without_relative(given) if banded else within(given, 10)
    whole = fed(lagged(100, given, noise), given).belief()
    short = fed(lagged(12, given, noise), given).belief()
    assert max(scaled_difference(short, whole, POSES)) < 0.02
    assert max(scaled_difference(short, whole)) < of_all


def test_pairs_that_reach_back_beyond_the_window_are_dropped():
    given = contact(45, PLAIN, seed=4)
    some = within(given, 15)
    assert sum(len(said.back) for said in given.relative if said) > sum(
        len(said.back) for said in some.relative if said
    )
    found, wanted = (fed(lagged(15, given, PLAIN), each) for each in (given, some))
    for a, b in zip(found.path(), wanted.path(), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(found.belief().covariance, wanted.belief().covariance)


def test_steps_that_left_the_window_stay_as_they_last_were_in_it():
    given = felt(contact(20, ROBUST, seed=5), seed=5)
    factors = make_factors(ROBUST, given.model)
    window = Window(factors, given.model, [given.prior], given.sensor[0], given.said(0), lag=6)
    for t in range(1, 21):
        before = window.values
        window.add(given.sensor[t], given.said(t), t / RATE)
        if t >= 6:
            left = t - 6
            np.testing.assert_array_equal(window.path()[0][:, left], before[SENSOR_IN_OBJECT][:, 0])
            np.testing.assert_array_equal(window.path()[1][:, left], before[SENSOR][:, 0])
        np.testing.assert_array_equal(window.path()[0][:, -window.values.steps :], window.values[SENSOR_IN_OBJECT])


def bank_of(given: Contact, count: int) -> list[Prior]:
    """Priors that differ in pose, in what belongs to the object, and in covariance."""
    rng = np.random.default_rng(1)
    priors = [given.prior]
    for k in range(1, count):
        values = given.prior.values + rng.normal(size=OBJECT_SIZE) * np.sqrt(np.diag(given.prior.covariance)[3:])
        pose = noisy(given.prior.pose, (1e-3, 1e-3, 2e-2), rng)
        priors.append(Prior(pose, values, (1.0 + 0.3 * k) * given.prior.covariance))
    return priors


BANKS = {
    "pairs": lambda: felt(contact(12, ROBUST)),
    "no pairs": lambda: without_relative(felt(contact(12, ROBUST))),
    "two tips": lambda: contact(12, ROBUST, tips=TWO_TIPS),
}


@pytest.mark.parametrize("what", BANKS)
def test_a_bank_of_smoothers_is_each_as_alone(what):
    # A bank takes as many Gauss-Newton steps as the one that needs most. The sensor stands still until none moves.
    given = settled(BANKS[what](), 12)
    priors = bank_of(given, 4)
    together = window_of(given, ROBUST, 100, priors)
    assert together.values.smoothers == 4
    for k, prior in enumerate(priors):
        alone = window_of(given, ROBUST, 100, [prior])
        mine, belief = alone.belief(), together.belief(k)
        for name in ("g", "e", "values"):
            np.testing.assert_allclose(getattr(belief, name), getattr(mine, name), atol=1e-9)
        assert scaled_difference(belief, mine)[1] < 1e-6
        for path, wanted in zip(together.path(), alone.path(), strict=True):
            np.testing.assert_allclose(path[k], wanted[0], atol=1e-9)
        assert set(together.last_errors()) == set(alone.last_errors())
        for name, errors in alone.last_errors().items():
            np.testing.assert_allclose(together.last_errors()[name][k], errors[0], atol=1e-4)


@pytest.mark.parametrize("what", BANKS)
def test_a_bank_of_smoothers_on_a_window_that_moves_on(what):
    # What left the window keeps the linearisation of then, which was a Gauss-Newton step further in a bank.
    given = BANKS[what]()
    priors = bank_of(given, 3)
    together = window_of(given, ROBUST, 6, priors)
    for k, prior in enumerate(priors):
        assert max(scaled_difference(together.belief(k), window_of(given, ROBUST, 6, [prior]).belief())) < 0.05
    # The same three times is the same.
    together = window_of(given, ROBUST, 6, [given.prior] * 3)
    alone = window_of(given, ROBUST, 6).belief()
    for k in range(3):
        np.testing.assert_allclose(together.belief(k).g, alone.g, atol=1e-9)
        assert scaled_difference(together.belief(k), alone)[1] < 1e-6


@pytest.mark.parametrize("what", BANKS)
def test_smoothers_go_on_together_or_apart(what):
    # Taken out of one bank and another, and given one more frame with a knock for one of them, each is as it was alone.
    given = BANKS[what]()
    priors = bank_of(given, 3)
    first, second = (window_of(given, ROBUST, 6, some) for some in ([priors[0], priors[1]], [priors[2], priors[0]]))
    bank = Window.bank([(second, 0), (first, 1)])
    alone = [Window.bank([(second, 0)]), Window.bank([(first, 1)])]
    knocks = Knock(2e-3, 5e-3), None
    for one, knock in zip(alone, knocks, strict=True):
        one.add(given.sensor[-1], given.said(12), 13 / RATE, [knock])
    before = first.belief(1).g.copy()
    bank.add(given.sensor[-1], given.said(12), 13 / RATE, knocks)
    np.testing.assert_array_equal(first.belief(1).g, before)
    for k, one in enumerate(alone):
        np.testing.assert_allclose(bank.belief(k).g, one.belief().g, atol=1e-4)
        assert scaled_difference(bank.belief(k), one.belief())[1] < 0.02
        for path, wanted in zip(bank.path(), one.path(), strict=True):
            assert path[k].shape == (14, 3)
            np.testing.assert_allclose(path[k], wanted[0], atol=1e-4)
        np.testing.assert_allclose(bank.costs()[k, :-1], one.costs()[0, :-1], atol=0.1)
    # What is asked for of one of them is its own.
    knocked, other = (window.values.knocks[0, -1] for window in alone)
    assert knocked.tolist() == [2e-3, 5e-3] and not other.any()


def test_a_smoother_without_a_solution_leaves_the_others_theirs():
    given = without_relative(felt(contact(6, ROBUST)))
    priors = bank_of(given, 2)
    together, alone = window_of(given, ROBUST, 6, priors), window_of(given, ROBUST, 6, priors[1:])
    together._past.information[0] = np.nan
    for window in (together, alone):
        window.add(given.sensor[-1], given.said(6), 7 / RATE)
    assert together.is_lost.tolist() == [True, False]
    assert max(scaled_difference(together.belief(1), alone.belief())) < 1e-3
    alone._past.information[:] = np.nan
    with pytest.raises(EstimationError, match="the linear system of the window is indeterminate"):
        alone.add(given.sensor[-1], given.said(6), 8 / RATE)


def object_poses(given: Contact) -> Array:
    return se2.compose(given.sensor, se2.inverse(given.truth))


def seen(given: Contact, t: int, back: int) -> ObjectPose:
    """The object as a camera saw it so many frames before t, which differs from what it says at other frames."""
    rng = np.random.default_rng(1000 * t + back)
    pose = noisy(object_poses(given)[t - back], (1e-3, 1e-3, 1e-2), rng)
    return ObjectPose(pose, np.diag([1e-6, 1e-6, 1e-4]), (t - back) / RATE)


def watched(given: Contact, noise: NoiseSettings, lag: int, backs: tuple[int, ...], delay: int = 0) -> Window:
    """A window with a camera that says at each frame where the object was some frames ago.

    What it says arrives with the frame that is `delay` later.
    """
    window = None
    for t in range(len(given.sensor)):
        said: list[Measurement] = list(given.said(t))
        at = t - delay
        said += [seen(given, at, back) for back in backs if at >= back]
        if window is None:
            factors = make_factors(noise, given.model)
            window = Window(factors, given.model, [given.prior], given.sensor[0], said, 0.0, lag)
        else:
            window.add(given.sensor[t], said, t / RATE)
    assert window is not None
    return window


@pytest.mark.parametrize("backs", [(0,), (5,), (5, 0), (0, 5), (0, 3, 1)])
def test_a_late_measurement_is_of_the_step_of_its_time(backs):
    # A window from which steps leave, against one that holds them all: what comes late is not in the order of steps.
    given = without_relative(felt(contact(40, SURE_OF_FRICTION), turn=False))
    short, whole = (watched(given, SURE_OF_FRICTION, lag, backs).belief() for lag in (8, 100))
    assert max(scaled_difference(short, whole)) < 0.05


def test_a_measurement_that_comes_later_says_the_same_in_the_end():
    given = without_relative(contact(30, PLAIN))
    # By the last frame those that are late lack what was seen in the last four frames; they get the rest.
    late = watched(given, PLAIN, 100, (0,), delay=4).belief()
    last = len(given.sensor)
    window = None
    for t in range(last):
        said = [seen(given, t, 0)] if t < last - 4 else []
        if window is None:
            factors = make_factors(PLAIN, given.model)
            window = Window(factors, given.model, [given.prior], given.sensor[0], said, 0.0, 100)
        else:
            window.add(given.sensor[t], said, t / RATE)
    assert window is not None
    assert max(scaled_difference(late, window.belief())) < 0.02


@pytest.mark.parametrize("time", [-5.0, float("nan"), 99.0])
def test_a_measurement_of_no_time_at_hand_is_left_out_with_a_warning(time, caplog):
    given = without_relative(contact(12, ROBUST))
    windows = [Window(make_factors(ROBUST, given.model), given.model, [given.prior], given.sensor[0]) for _ in range(2)]
    for t in range(1, 13):
        strange = ObjectPose(np.array([0.3, 0.0, 1.0]), 1e-8 * np.eye(3), time)
        windows[0].add(given.sensor[t], [strange] if t == 8 else [], t / RATE)
        windows[1].add(given.sensor[t], [], t / RATE)
    np.testing.assert_array_equal(windows[0].path()[0], windows[1].path()[0])
    (record,) = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert "frame at 0.267 s: measurement ObjectPose is of" in record.message
    assert "which is not between 0.000 s and now; it is left out" in record.message


def test_a_measurement_of_a_step_that_left_the_window_is_left_out(caplog):
    given = without_relative(contact(12, ROBUST))
    factors = make_factors(ROBUST, given.model)
    windows = [Window(factors, given.model, [given.prior], given.sensor[0], lag=5) for _ in range(2)]
    for t in range(1, 13):
        windows[0].add(given.sensor[t], [replace(seen(given, t, 8))] if t == 10 else [], t / RATE)
        windows[1].add(given.sensor[t], [], t / RATE)
    np.testing.assert_array_equal(windows[0].path()[0], windows[1].path()[0])
    assert "measurement ObjectPose is of 0.0666" in caplog.text


def test_a_step_that_is_refused_leaves_the_window_as_it_was():
    class OfYaw(OwnMeasurement):
        on = ("yaw",)

    given = contact(3, ROBUST)
    window = Window(make_factors(ROBUST, given.model), given.model, [given.prior], given.sensor[0])
    before = window.values
    with pytest.raises(SettingError, match="unknown 'yaw' is not known"):
        window.add(given.sensor[1], [OfYaw()], 1 / RATE)
    assert window.values is before
