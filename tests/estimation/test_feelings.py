"""Contact direction and turn in the smoothers and the tracker, beyond what they share with other factors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import SHAPES, frames, in_two_contacts, sensor
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
    make,
    scaled_difference,
    without_relative,
)
from tracker_samples import SMOOTHERS, settings

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph import isam2
from palpate.graph.fixed_lag import FixedLagSmoother
from palpate.graph.smoother import Known, Smoother
from palpate.recording.frame import Frame
from palpate.recording.measurements import ContactDirection, Feeling, RelativePoses, Turn
from palpate.tracker import Tracker

Array = np.ndarray


def offset_of(smoother: Any) -> float:
    if isinstance(smoother, FixedLagSmoother):
        return smoother._shared[0]
    return smoother._isam.calculateEstimatePose2(isam2._OFFSET).theta()


def yaw_variance(smoother: Smoother) -> float:
    """Variance of the object's yaw at the last step, e_theta - g_theta."""
    covariance = smoother.belief().covariance
    return covariance[2, 2] + covariance[5, 5] - 2 * covariance[2, 5]


@pytest.mark.parametrize("name", SMOOTHERS)
def test_the_offset_is_found(name):
    given = felt(contact(20, PLAIN, seed=1), seed=1)
    smoother = fed(make(name, given, PLAIN), given)
    # 16 directions on a straight side tell the level of yaw and 16 turns its sum with the offset: 0.01 sqrt(2 / 16).
    assert abs(se2.wrap(offset_of(smoother) - OFFSET)) < 3 * FELT * np.sqrt(2 / 16)
    assert abs(se2.wrap(offset_of(smoother) - batch(given, PLAIN).offset)) < 1e-4


@pytest.mark.parametrize("name", SMOOTHERS)
def test_the_first_turn_of_a_contact_says_the_offset(name):
    # Under so narrow a kernel a turn half a turn off weighs (0.1 / 3)^2 = 1e-3, less than the prior's 1e-2: the offset
    # has to begin where the turn says.
    given = contact(3, ROBUST)
    smoother = make(name, given, replace(ROBUST, feeling_kernel=0.1))
    for angle in (3.0, -1.5):
        smoother.begin(given.sensor[0], given.known, Feeling())
        smoother.add(given.sensor[1], Feeling(turn=Turn(angle, FELT**2)))
        assert se2.wrap(offset_of(smoother) + angle - float(smoother.belief().g[2])) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("name", SMOOTHERS)
def test_whatever_the_offset_the_path_is_the_same(name):
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
    known = replace(given.known, covariance=given.known.covariance.copy())
    known.covariance[:3, :3] = np.diag(np.square([1e-4, 1e-4, 0.3]))
    given = replace(given, known=known)
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
    short = fed(FixedLagSmoother(given.tips, PLAIN, lag=8), given)
    wanted = batch(given, PLAIN)
    assert max(scaled_difference(short.belief(), wanted, POSES)) < 0.03
    assert max(scaled_difference(short.belief(), wanted)) < 0.1
    assert abs(se2.wrap(offset_of(short) - wanted.offset)) < 0.05 * FELT
    late = replace(given, turns=[one if t > 25 else None for t, one in enumerate(given.turns)])
    assert yaw_variance(fed(FixedLagSmoother(given.tips, PLAIN, lag=8), late)) > 1.01 * yaw_variance(short)


def with_one_bad_image(given: Contact, by: float) -> Contact:
    directions, turns = given.directions.copy(), given.turns.copy()
    directions[10], turns[10] = ContactDirection(by, FELT**2), Turn(se2.wrap(by - OFFSET), FELT**2)
    return replace(given, directions=directions, turns=turns)


@pytest.mark.parametrize("by", [0.3, -2.0])
@pytest.mark.parametrize("name", SMOOTHERS)
def test_one_bad_image_does_not_bend_the_path(name, by):
    given = without_relative(felt(contact(14, ROBUST, seed=3), seed=3))
    good = fed(make(name, given, ROBUST), given).path()[0][:, 2]
    bad = fed(make(name, given, ROBUST), with_one_bad_image(given, by)).path()[0][:, 2]
    assert np.abs(bad - good).max() < 0.3 * FELT
    bent = fed(make(name, given, PLAIN), with_one_bad_image(given, by)).path()[0][:, 2]
    assert np.abs(bent - good).max() > 3 * np.abs(bad - good).max()


@pytest.mark.parametrize("said", [Feeling(direction=ContactDirection(0.1, 1e-4)), Feeling(turn=Turn(0.1, 1e-4))])
@pytest.mark.parametrize("name", SMOOTHERS)
def test_of_several_tips_nobody_knows_which_is_meant(name, said):
    given = contact(2, ROBUST, tips=TWO_TIPS)
    smoother = make(name, given, ROBUST)
    message = "the sensor has 2 tips; touch can say direction and turn for one tip only"
    with pytest.raises(SettingError, match=message):
        smoother.begin(given.sensor[0], given.known, said)
    smoother.begin(given.sensor[0], given.known, Feeling())
    with pytest.raises(SettingError, match=message):
        smoother.add(given.sensor[1], said)


class Told:
    """A touch that says what it is told for each frame of a contact, whatever the image."""

    def __init__(self) -> None:
        self.age, self.lifts = -1, 0

    def feel(self, frame: Frame) -> Feeling:
        self.age += 1
        relative = RelativePoses(np.array([1]), np.zeros((1, 3)), np.eye(3)[None]) if self.age else None
        return Feeling(relative, ContactDirection(0.1, 1.0 + self.age), Turn(0.2, 1.0 + self.age))

    def lift(self) -> None:
        self.age, self.lifts = -1, self.lifts + 1


class Noting:
    """A smoother that keeps what it is given, and fails at one age of a contact."""

    def __init__(self, smoother: Smoother, failing: int) -> None:
        self.smoother, self.failing = smoother, failing
        self.begun: list[Feeling] = []
        self.added: list[Feeling] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.smoother, name)

    def begin(self, sensor_pose: Array, known: Known, feeling: Feeling) -> None:
        self.begun.append(feeling)
        self.smoother.begin(sensor_pose, known, feeling)

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        self.added.append(feeling)
        if len(self.added) == self.failing:
            raise EstimationError("for the test")
        self.smoother.add(sensor_pose, feeling)


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_the_tracker_passes_on_all_that_is_felt(smoother):
    o, e, touched = in_two_contacts("rectangle", 4)
    tracker: Any = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none", smoother))
    tracker._touch = touch = Told()
    tracker._smoother = noting = Noting(tracker._smoother, failing=3)
    for frame in frames(o, e, touched):
        tracker.update(frame)
    # Five frames a contact: in the first one the fourth frame could not be solved and began anew, as did the second
    # contact. Two lifts, one of them between the contacts.
    assert [feeling.direction for feeling in noting.begun] == [ContactDirection(0.1, 1.0)] * 3
    assert [feeling.turn for feeling in noting.begun] == [Turn(0.2, 1.0)] * 3
    assert [feeling.relative for feeling in noting.begun] == [None] * 3
    ages = [1, 2, 3, 1, 1, 2, 3, 4]
    assert [feeling.turn for feeling in noting.added] == [Turn(0.2, 1.0 + age) for age in ages]
    assert [feeling.direction for feeling in noting.added] == [ContactDirection(0.1, 1.0 + age) for age in ages]
    assert all(feeling.relative is not None for feeling in noting.added)
    assert touch.lifts == 2
