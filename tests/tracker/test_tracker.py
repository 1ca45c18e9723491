import copy
import dataclasses
import math
import pickle
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import planar
import pytest
from push_samples import RADIUS, SHAPES, Steering, frames, in_two_contacts, noisy, pushed, sensor, with_settings
from tracker_samples import (
    CALIBRATED,
    SMOOTHERS,
    nees,
    poses,
    rotation_errors,
    same,
    settings,
    statuses,
    track,
    translation_errors,
    yaw_deviations,
)

from palpate import DIGIT, Frame, FrameError, Measurement, NoiseSettings, Tracker, Turn


@pytest.mark.parametrize("radius", [0.0, RADIUS])
@pytest.mark.parametrize("smoother", SMOOTHERS)
@pytest.mark.parametrize("name", SHAPES)
def test_noise_free_pushes_are_tracked(name, smoother, radius):
    o, e, contact = in_two_contacts(name, 40, radius)
    _, found = track(name, frames(o, e, contact), o[0], settings("oracle", smoother), radius)
    # At its first step nothing but its angle tells whether the contact sticks, and that settles in a few steps. At the
    # cone's edge, where these pushes stick, some slide is expected.
    assert translation_errors(poses(found), o).max() < 0.5e-3
    assert translation_errors(poses(found)[4:], o[4:]).max() < 0.2e-3
    assert np.abs(rotation_errors(poses(found), o)).max() < math.radians(0.3)
    assert np.abs(rotation_errors(poses(found)[4:], o[4:])).max() < math.radians(0.03)
    assert statuses(found) == ["tracking" if touched else "resting" for touched in contact]
    assert [estimate.contact for estimate in found] == contact.tolist()
    for estimate in found:
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0


def test_a_turned_world_turns_the_estimates():
    o, e, contact = in_two_contacts("concave", 30)
    e = noisy(e, (1e-4, 1e-4, 1e-3), np.random.default_rng(1))
    for smoother in SMOOTHERS:
        _, found = track("concave", frames(o, e, contact), o[0], settings("oracle", smoother))
        # The first pose lands at +-pi and on either side of it, and anywhere.
        for turn in (math.pi, math.pi - 1e-4, -math.pi + 1e-4, 2.2):
            world = np.array([0.3, -0.2, turn])
            seen = frames(planar.compose(world, o), planar.compose(world, e), contact)
            _, turned = track("concave", seen, planar.compose(world, o[0]), settings("oracle", smoother))
            difference = planar.log(planar.between(planar.compose(world, poses(found)), poses(turned)))
            np.testing.assert_allclose(difference, 0.0, atol=1e-9)
            assert statuses(turned) == statuses(found)
            for a, b in zip(found, turned, strict=True):
                np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize(("y", "both"), [(0.0, True), (0.07, False)])
@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_two_tips_push_together_or_one_of_them_does(smoother, y, both):
    # They begin with one. Pushed at its middle the side comes to the other, too; near its end it turns away from it.
    tips = ((0.0, 0.02), (0.0, -0.02))
    o, e = pushed("rectangle", 100, y, tips=tips, steering=Steering(aim=0.0, sway=0.0))
    centers = planar.transform(planar.between(o[-1], e[-1]), sensor(tips=tips).centers)
    off = SHAPES["rectangle"].signed_distance(centers) - RADIUS
    assert (off.max() < 5e-4) == both
    first, sigma = planar.compose(o[0], [1e-3, 2e-3, 0.03]), [3e-3, 3e-3, 0.05]
    given = SHAPES["rectangle"], sensor(tips=tips), first, settings("none", smoother)
    tracker = Tracker(*given, first_pose_sigma=sigma)
    found = [tracker.update(frame) for frame in frames(o, e)]
    assert translation_errors(poses(found), o).max() < 0.015
    assert np.mean(nees(found, o) < 7.8) > 0.9
    # Two points on a side tell the yaw without touch: 1 mm of contact over 40 mm, and better with time.
    assert (yaw_deviations(found)[-1] < 2e-2) == both


@pytest.mark.parametrize("noise", [NoiseSettings(), CALIBRATED], ids=["default", "calibrated"])
def test_an_untouched_object_rests(noise):
    first = np.array([0.1, 0.2, 3.0])
    far = np.tile([1.0, 1.0, 0.0], (20, 1))
    _, found = track("disc", frames(np.tile(first, (20, 1)), far, False), first, settings(noise=noise))
    assert set(statuses(found)) == {"resting"}
    # What frames and outline are apart by is in doubt all the time, beside what is known of the pose.
    known, apart = np.square(noise.first_pose.deviation), np.square(noise.sensor_pose.calibration)
    assert (apart.max() > 0.0) == (noise == NoiseSettings())
    for estimate in found:
        assert estimate.pose.tolist() == first.tolist()
        np.testing.assert_allclose(estimate.covariance, np.diag(known + apart), rtol=1e-15)
        assert estimate.contact is False
        assert (estimate.reason, len(estimate.answers)) == ("", 1)


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_the_next_contact_starts_from_the_last_marginal(smoother):
    # The outline is known exactly, so that a first frame of contact adds resting and one distance. Its derivatives by
    # object and sensor are the normal of a disc in either frame: a point that touches it has no lever.
    o, e, contact = in_two_contacts("disc", 40, radius=0.0)
    exact, rest, deviation = (0.0, 1e-9), (1e-3, 1e-3, 1e-2), 1e-3
    noise = with_settings(
        CALIBRATED,
        first_pose={"rest": rest},
        priors={"depth": exact, "outline_scale": exact},
        contact={"deviation": deviation},
    )
    _, found = track("disc", frames(o, e, contact), o[0], settings("none", smoother, noise), radius=0.0)
    before, resting, again = found[40], found[41:51], found[51]
    for estimate in resting:
        np.testing.assert_array_equal(estimate.pose, before.pose)
        np.testing.assert_array_equal(estimate.covariance, before.covariance)
    known = before.covariance + np.diag(np.square(rest))
    normal = e[51, :2] - before.pose[:2]
    gap = np.append(planar.transform([0.0, 0.0, -before.pose[2]], normal) / np.hypot(*normal), 0.0)
    variance = deviation**2 + gap @ known @ gap + noise.sensor_pose.deviation[0] ** 2
    wanted = known - np.outer(known @ gap, known @ gap) / variance
    np.testing.assert_allclose(again.covariance, wanted, rtol=0.01, atol=1e-9)
    assert again.covariance[2, 2] > 4 * noise.first_pose.deviation[2] ** 2  # not that of the first pose
    assert yaw_deviations(found)[-1] > yaw_deviations(found)[51]


class CountedTouch:
    def __init__(self) -> None:
        self.begun = 0
        self._away = True

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        self.begun += self._away
        self._away = False
        turn = planar.between(np.asarray(frame.object_pose), frame.sensor_pose)[2]
        return (Turn(float(turn), 1e-6),)

    def end_contact(self) -> None:
        self._away = True


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_a_gap_in_time_ends_a_contact(smoother):
    # Ten sensor periods are a third of a second. What happens between is not seen, so touch must not compare across.
    o, e = pushed("rectangle", 60)
    seen = frames(o, e)
    late = [*seen[:30], *(dataclasses.replace(frame, time=frame.time + 0.5) for frame in seen[30:])]
    soon = [*seen[:30], *(dataclasses.replace(frame, time=frame.time + 0.2) for frame in seen[30:])]
    compared = []
    for sequence in (late, soon):
        touch = CountedTouch()
        tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none", smoother), touch=touch)
        found = [tracker.update(frame) for frame in sequence]
        compared.append(touch.begun)
        assert translation_errors(poses(found), o).max() < 1.5e-3  # the step across the gap is a rest of 1 mm
    assert compared == [2, 1]


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_as_the_tracker_does(copied):
    o, e, contact = in_two_contacts("rectangle", 20)
    turns = planar.between(o, e)[:, 2].tolist()
    measured = [(Turn(turn, 1e-4),) if touched else () for turn, touched in zip(turns, contact, strict=True)]
    seen = [
        dataclasses.replace(frame, measurements=turn)
        for frame, turn in zip(frames(o, e, contact), measured, strict=True)
    ]
    tracker = Tracker(SHAPES["rectangle"], DIGIT, o[0])
    for frame in seen[:30]:
        tracker.update(frame)
    twin = copied(tracker)
    wanted = [tracker.update(frame) for frame in seen[30:]]
    same([twin.update(frame) for frame in seen[30:]], wanted)


def test_two_threads_may_update_one_tracker():
    """Frames that come too late are refused, and nothing else happens; each update is whole before the next begins."""
    o, e, contact = in_two_contacts("rectangle", 40)
    tracker = Tracker(SHAPES["rectangle"], DIGIT, o[0])
    seen = frames(o, e, contact)
    left = iter(seen)
    taken: list[float] = []
    late: list[FrameError] = []

    def work() -> None:
        for frame in left:
            try:
                taken.append(tracker.update(frame).time)
            except FrameError as error:
                late.append(error)

    with ThreadPoolExecutor(2) as pool:
        for task in [pool.submit(work), pool.submit(work)]:
            task.result()
    assert len(taken) + len(late) == len(seen) and max(taken) == tracker.frame.time
