"""Several answers at once, through the tracker: where there is one, where there are more, and what becomes of them."""

import dataclasses
import math
import re
from collections import Counter
from functools import cache
from typing import Any

import numpy as np
import planar
import pytest
from push_samples import (
    HAND,
    SHAPES,
    Steering,
    by_hand,
    contact_directions,
    frames,
    gaps,
    in_two_contacts,
    model_of,
    push,
    pushed,
    sensor,
    slid,
)
from tracker_samples import CALIBRATED, nees, poses, rotation_errors, settings, statuses, track, translation_errors

from palpate import ContactDirection, Estimate, Frame, ObjectPose, Tracker

Array = np.ndarray
ROUGH = (0.02, 0.02, math.radians(10.0))
FELT = 0.03  # [rad]


def with_directions(name: str, o: Array, e: Array, contact: Array | bool = True) -> list[Frame]:
    """Frames that tell where the tip is touched, in contact."""
    told = contact_directions(planar.between(o, e), model_of(name))
    return [
        dataclasses.replace(one, measurements=(ContactDirection(float(angle), FELT**2),) if one.contact else ())
        for one, angle in zip(frames(o, e, contact), told, strict=True)
    ]


def tracked(seen: list[Frame], first: Any, name: str = "rectangle", **how: Any) -> list[Estimate]:
    """Estimates of a tracker that is told nothing but what frames bring."""
    sigma = how.pop("sigma", None)
    chosen = settings(how.pop("tactile", "none"), **how)
    tracker = Tracker(SHAPES[name], sensor(), first, chosen, first_pose_sigma=sigma)
    return [tracker.update(frame) for frame in seen]


def origins(found: list[Estimate]) -> set[str]:
    """Origins of the answers of estimates that have several."""
    return {answer.origin for estimate in found if len(estimate.answers) > 1 for answer in estimate.answers}


def check_answers(found: list[Estimate]) -> None:
    for estimate in found:
        weights = [answer.weight for answer in estimate.answers]
        assert min(weights) > 0.0 and sum(weights) == pytest.approx(1.0)
        assert weights[1:] == sorted(weights[1:], reverse=True) and 5.0 * weights[0] > max(weights)
        np.testing.assert_array_equal(estimate.pose, estimate.answers[0].pose)
        # The covariance spans them: that of the best in its share and all others about it.
        spanned = np.zeros((3, 3))
        for answer in estimate.answers:
            apart = planar.log(planar.between(estimate.pose, answer.pose))
            spanned += answer.weight * (answer.covariance + np.outer(apart, apart))
        np.testing.assert_allclose(estimate.covariance, spanned, rtol=1e-9, atol=1e-15)
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        # Solutions that run away by kilometres are known to rounding only.
        variances = np.linalg.eigvalsh(estimate.covariance)
        assert variances.min() > -1e-12 * max(variances.max() - 1e6, 0.0)
        assert (estimate.reason == "") == (estimate.status in ("tracking", "resting"))
        if estimate.status == "ambiguous":
            assert len(estimate.answers) > 1
            assert "from the best fit what was measured: " in estimate.reason
            # It counts the answers by their origins.
            counts = Counter(answer.origin for answer in estimate.answers)
            assert sorted(map(int, re.findall(r"\((\d+)\)", estimate.reason))) == sorted(counts.values())


@pytest.mark.parametrize("tactile", ["none", "oracle"])
@pytest.mark.parametrize("name", ["rectangle", "ellipse", "concave"])
def test_one_answer_while_nothing_is_doubtful(name, tactile):
    o, e, contact = in_two_contacts(name, 25)
    (_, several), (_, one) = (
        track(name, frames(o, e, contact), o[0], settings(tactile, hypotheses=count)) for count in (9, 1)
    )
    for a, b in zip(several, one, strict=True):
        assert len(a.answers) == 1 and a.answers[0].weight == 1.0
        assert (a.reason, a.status) == ("", "tracking" if a.contact else "resting")
        np.testing.assert_array_equal(a.pose, b.pose)
        # After errors of pushing the covariance of one answer alone stays inflated.
        assert (a.covariance.diagonal() <= b.covariance.diagonal()).all()
        np.testing.assert_array_equal(a.covariance, a.answers[0].covariance)
    check_answers(several)


AT = 40  # frames before the hand


@pytest.mark.parametrize("slid", [0.018, -0.018])
@pytest.mark.parametrize("turned", [0.3, -0.3])
def test_an_object_moved_by_a_hand_in_contact_may_be_in_several_places(slid, turned):
    o, e = by_hand(*pushed("rectangle", AT, 0.015), slid, turned, 80 - AT - HAND)
    _, found = track("rectangle", frames(o, e), o[0], settings())
    check_answers(found)
    assert {len(estimate.answers) for estimate in found[: AT + 1]} == {1}
    # It is noticed within three frames, and from then on the truth is inside what is said.
    assert "ambiguous" in statuses(found)[AT + 1 : AT + 4]
    assert nees(found, o)[AT + 3 :].max() < 7.8
    assert max(len(estimate.answers) for estimate in found) <= 9
    assert origins(found[AT + 1 :]) == {"as before", "shove"}
    # One of the last answers is right.
    apart = [np.abs(planar.log(planar.between(answer.pose, o[-1]))) for answer in found[-1].answers]
    assert min(np.hypot(*off[:2]) for off in apart) < 5e-3


def test_friction_learnt_before_a_knock_survives_it_and_what_the_knock_taught_does_not():
    grip, prior = 0.3, CALIBRATED.priors.grip
    o, e = by_hand(*slid(-0.04, 0.8, grip, AT), 0.018, -0.3, 30)  # of a slide the grip is learnt
    (_, several), (_, one) = (track("rectangle", frames(o, e), o[0], settings(hypotheses=n)) for n in (9, 1))
    learnt, sigma = several[AT].friction
    assert one[AT].friction == several[AT].friction
    assert abs(learnt - grip) < 0.6 * abs(math.exp(prior[0]) - grip) and sigma < 0.7 * learnt * prior[1]
    after = slice(AT + 16, None)  # before, an answer with a slippery contact may be the best one
    means, sigmas = np.array([estimate.friction for estimate in several[after]]).T
    assert np.abs(means - learnt).max() < 0.3 * sigma and sigmas.max() < 1.2 * sigma
    # Where pushing has to explain the knock, the grip is driven off.
    assert min(estimate.friction[0] for estimate in one[after]) > grip + 4.0 * sigma


@cache
def from_two_sides() -> tuple[Array, Array, Array]:
    """A push of the rectangle on its left side and one from below, a rest between: o, e (N, 3), contact (N,)."""
    model = model_of("rectangle")
    o1, e1 = pushed("rectangle", 40, 0.02)
    below = np.array([[0.03, -0.15, 0.5 * math.pi]])
    for _ in range(50):
        below[:, 1] += gaps(below, model)[0]
    o2, e2 = push(model, o1[-1][None], below, 40, Steering())
    away = np.tile(planar.compose(o1[-1], [-0.4, 0.0, 0.0]), (5, 1))
    o = np.concatenate([o1, np.tile(o1[-1], (5, 1)), o2[:, 0]])
    return o, np.concatenate([e1, away, e2[:, 0]]), np.repeat([True, False, True], [41, 5, 41])


@pytest.mark.parametrize("off", [(0.014, -0.014, 0.17), (-0.014, 0.014, -0.17), (0.0, 0.02, 0.17)])
def test_an_object_known_roughly_is_found_by_touch(off):
    o, e, contact = from_two_sides()
    found = tracked(with_directions("rectangle", o, e, contact), planar.compose(o[0], off), sigma=ROUGH)
    check_answers(found)
    assert max(len(estimate.answers) for estimate in found) > 3
    assert origins(found[:41]) - {"shove"} == {"rough start"}
    # The first contact tells face and yaw, unless it is at a corner, the second the rest; the truth is in the regions.
    assert nees(found, o).max() < 7.8
    likely = [one for one in found[40].answers if one.weight > 0.1]
    off = np.abs([planar.log(planar.between(one.pose, o[40]))[2] for one in likely])
    assert sum(one.weight for one, turned in zip(likely, off, strict=True) if turned < math.radians(2.0)) > 0.4
    assert translation_errors(poses(found), o)[0] > 6e-3
    assert translation_errors(poses(found), o)[-1] < 2e-3
    assert np.abs(rotation_errors(poses(found), o))[-1] < math.radians(1.0)


def test_an_object_that_may_be_anywhere():
    o, e, contact = from_two_sides()
    found = tracked(with_directions("rectangle", o, e, contact), None)
    check_answers(found)
    assert found[0].status in ("ambiguous", "uncertain")  # at first no single place is likely
    assert nees(found, o).max() < 7.8
    # Nor does it matter which yaw it has: both in which a rectangle looks the same are left.
    for yaw in (1.0, -2.5):
        turned = np.array([0.0, 0.0, yaw])
        world = planar.compose(turned, o), planar.compose(turned, e)
        found = tracked(with_directions("rectangle", *world, contact), None)
        last = world[0][-1]
        off = [planar.log(planar.between(last, answer.pose)) for answer in found[-1].answers if answer.weight > 0.3]
        assert sorted(abs(round(float(one[2]), 1)) for one in off) == [0.0, 3.1]
        assert found[-1].status == "ambiguous" and max(np.hypot(*one[:2]) for one in off) < 5e-3
    # And untouched it is uncertain.
    rest = tracked(frames(o[:3], np.tile([3.0, 0.0, 0.0], (3, 1)), False), None)
    assert set(statuses(rest)) == {"uncertain"}
    np.testing.assert_allclose(rest[-1].covariance, np.diag([1.0, 1.0, 4.0]))


def tracked_disc(sigma: float, hypotheses: int = 9, camera: int | None = None) -> tuple[list[Estimate], Array, Array]:
    """Estimates, true poses and contact of a disc, yaw off by 1.5 rad, untouched and in two contacts, maybe seen."""
    o, e, contact = in_two_contacts("disc", 60)
    (apart,) = frames(o[:1], planar.compose(e[:1], [-0.1, 0.0, 0.0]), False, start=-1.0)
    seen = [apart, *with_directions("disc", o, e, contact)]
    o, contact = np.concatenate([o[:1], o]), np.append(False, contact)
    if camera is not None:
        measured = ObjectPose(o[camera], np.diag([1e-3, 1e-3, 0.02]) ** 2)
        seen[camera] = dataclasses.replace(seen[camera], measurements=(measured,))
    first = planar.compose(o[0], [0.004, -0.003, 1.5])
    return tracked(seen, first, "disc", sigma=(5e-3, 5e-3, sigma), hypotheses=hypotheses), o, contact


@pytest.mark.parametrize("hypotheses", [1, 9])
@pytest.mark.parametrize("sigma", [0.8, 2.0])
def test_yaw_of_a_disc_stays_as_unknown_as_it_was_through_contacts_and_rests(sigma, hypotheses):
    found, o, _ = tracked_disc(sigma, hypotheses)
    yaw = np.sqrt([estimate.covariance[2, 2] for estimate in found])
    np.testing.assert_allclose(yaw, sigma, rtol=0.01)
    assert nees(found, o).max() < 7.8
    assert found[-1].status == "tracking"
    assert np.hypot(*(found[-1].pose - o[-1])[:2]) < 3e-3
    # One that is known stays known.
    found, _, _ = tracked_disc(0.04)
    assert found[-1].covariance[2, 2] < 0.06**2 and found[-1].status == "tracking"


@pytest.mark.parametrize("at_rest", [True, False])
def test_a_camera_tells_the_yaw_of_a_disc_whenever_it_sees_it(at_rest):
    when = 65 if at_rest else 0
    found, o, contact = tracked_disc(2.0, camera=when)
    assert not contact[when]
    yaw = np.sqrt([estimate.covariance[2, 2] for estimate in found])
    np.testing.assert_allclose(yaw[:when], 2.0, rtol=0.01)
    assert yaw[when:].max() < 0.07
    assert abs(planar.wrap(found[-1].pose[2] - o[-1, 2])) < 0.06
