"""Measurements of other sources, in and between contacts."""

import dataclasses
import logging
import math
import re
from typing import Any

import numpy as np
import planar
import pytest
import scipy.optimize
from push_samples import frames, pushed, with_settings
from tracker_samples import (
    CALIBRATED,
    SMOOTHERS,
    disc_tracker,
    poses,
    rotation_errors,
    settings,
    small_frame,
    statuses,
    track,
    translation_errors,
)

import palpate
from palpate import (
    ContactDirection,
    ContactPlace,
    EstimationError,
    Frame,
    Measurement,
    ObjectPose,
    OwnMeasurement,
    Turn,
)

Array = np.ndarray
WRONG = np.array([0.012, -0.016, math.radians(5.0)])
"""20 mm and 5 degrees."""
LOOSE = with_settings(CALIBRATED, first_pose={"deviation": (0.02, 0.02, 0.1)})
CAMERA = np.diag(np.square([1e-3, 1e-3, 1e-2]))


def seen(pose: Any, time: float | None = None) -> ObjectPose:
    return ObjectPose(np.array(pose), CAMERA, time)


class OwnPose(OwnMeasurement):
    """The same as an ObjectPose, by a residual of its own."""

    on = ("object_pose",)

    def __init__(self, pose: Array, time: float | None = None) -> None:
        self.pose, self.time = pose, time

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        deviation, changes = np.sqrt(np.diag(CAMERA)), 1e-6 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        off = planar.log(planar.between(self.pose, planar.compose(values[0], planar.exp(changes)))) / deviation
        return off[0], (off[1:4] - off[4:]).T / 2e-6


class Alone(OwnMeasurement):
    """The same by the residual alone."""

    on = ("object_pose",)

    def __init__(self, pose: Array) -> None:
        self.pose = pose

    def residual(self, pose: Array) -> Array:
        return OwnPose(self.pose).linearise(pose)[0]


class WrongSign(OwnPose):
    """The same with a Jacobian of the wrong sign in one column."""

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        residual, jacobian = super().linearise(*values)
        return residual, jacobian * [1.0, -1.0, 1.0]


def pushed_or_resting(contact: bool, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push, or of an object that rests far from the sensor."""
    o, e = pushed("rectangle", steps)
    return (o, e) if contact else (np.tile(o[0], (steps + 1, 1)), np.tile([-0.5, 0.0, 0.0], (steps + 1, 1)))


def with_measurements(given: list[Frame], said: list[Measurement]) -> list[Frame]:
    return [dataclasses.replace(frame, measurements=(one,)) for frame, one in zip(given, said, strict=True)]


def test_a_wrong_pose_is_put_right_while_the_object_rests():
    truth = np.array([0.1, 0.2, 3.1])
    tracker = disc_tracker(settings(noise=LOOSE), first=truth + WRONG)
    estimates = [tracker.update(small_frame(time=k / 30), measurements=[seen(truth)]) for k in range(30)]
    assert statuses(estimates) == ["resting"] * 30
    found = estimates[-1]
    assert not found.contact
    assert translation_errors(found.pose[None], truth[None]).item() < 0.1e-3
    assert abs(rotation_errors(found.pose[None], truth[None]).item()) < math.radians(0.1)
    # Thirty times as well as a single time, for what was known before is of no account.
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(CAMERA) / 30, rtol=0.01)


def test_a_measurement_at_rest_counts_as_much_as_it_is_believed():
    # Both to 1 mm along x, as known and as seen: it is halfway, and surer by the root of 2.
    noise = with_settings(CALIBRATED, first_pose={"deviation": (1e-3, 1e-3, 1e-2)})
    tracker = disc_tracker(settings(noise=noise))
    found = tracker.update(small_frame(), [seen([4e-3, 0.0, 0.0])])
    np.testing.assert_allclose(found.pose, [2e-3, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance), 0.5 * np.diag(CAMERA), rtol=1e-4)


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_a_wrong_pose_is_put_right_in_contact(smoother):
    o, e = pushed("rectangle", 60)
    how, first = settings("none", smoother, LOOSE), planar.compose(o[0], WRONG)
    _, found = track("rectangle", with_measurements(frames(o, e), [seen(pose) for pose in o]), first, how)
    assert translation_errors(poses(found), o)[20:].max() < 1e-3
    assert np.abs(rotation_errors(poses(found), o))[20:].max() < math.radians(0.5)
    _, blind = track("rectangle", frames(o, e), first, how)
    assert translation_errors(poses(blind), o)[20:].min() > 5e-3
    assert found[-1].covariance.trace() < 0.1 * blind[-1].covariance.trace()


@pytest.mark.parametrize("smoother", SMOOTHERS)
@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("kind", [OwnPose, Alone])
def test_an_own_residual_is_worth_as_much(kind, contact, smoother, caplog):
    o, e = pushed_or_resting(contact, 30)
    how, first, given = settings("none", smoother, LOOSE), planar.compose(o[0], WRONG), frames(o, e, contact)
    _, found = track("rectangle", with_measurements(given, [kind(pose) for pose in o]), first, how)
    assert not caplog.messages
    _, wanted = track("rectangle", with_measurements(given, [seen(pose) for pose in o]), first, how)
    np.testing.assert_allclose(poses(found), poses(wanted), atol=1e-9 if kind == OwnPose else 1e-7)
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("contact", [False, True])
def test_a_wrong_jacobian_is_named_once_and_left_out(contact, caplog):
    o, e = pushed_or_resting(contact, 5)
    given, first = frames(o, e, contact), planar.compose(o[0], WRONG)
    _, found = track("rectangle", with_measurements(given, [WrongSign(pose) for pose in o]), first, settings("none"))
    assert len(caplog.messages) == 1
    assert "WrongSign returns a Jacobian that is not the derivative of its residual: row " in caplog.messages[0]
    if not contact:
        _, wanted = track("rectangle", given, first, settings("none"))
        np.testing.assert_array_equal(poses(found), poses(wanted))
    assert translation_errors(poses(found), o).min() > 5e-3  # not drawn to what is measured


def test_a_residual_with_a_kink_may_have_either_slope(caplog):
    class Beyond(OwnMeasurement):
        on = ("object_pose",)

        def linearise(self, pose: Array) -> tuple[float, Array]:
            return max(0.0, pose[0]) / 1e-3, np.array([1e3, 0.0, 0.0])

    disc_tracker().update(small_frame(), [Beyond()])
    assert not caplog.messages


def test_a_measurement_without_a_residual_is_refused():
    class Empty(OwnMeasurement):
        on = ("object_pose",)

    with pytest.raises(palpate.FrameError, match=r"measurement Empty has no method residual"):
        disc_tracker().update(small_frame(), [Empty()])


@pytest.mark.parametrize("own", [False, True])
def test_a_slow_camera_tells_of_when_it_looked(own):
    # Ten frames late, an object that moves on at 1 mm a frame is 10 mm behind.
    o, e = pushed("rectangle", 35)
    given, late = frames(o, e), o[np.maximum(np.arange(36) - 10, 0)]
    times = [given[max(k - 10, 0)].time for k in range(36)]
    how, first = settings("none", noise=LOOSE), planar.compose(o[0], WRONG)
    kind = OwnPose if own else seen
    said: list[Measurement] = [kind(pose, time) for pose, time in zip(late, times, strict=True)]
    _, found = track("rectangle", with_measurements(given, said), first, how)
    assert translation_errors(poses(found), o)[20:].max() < 1e-3
    _, unaware = track("rectangle", with_measurements(given, [kind(pose) for pose in late]), first, how)
    assert translation_errors(poses(unaware), o)[20:].max() > 3e-3


@pytest.mark.parametrize("contact", [False, True])
def test_a_measurement_of_long_ago_is_left_out(contact, caplog):
    o, e = pushed_or_resting(contact, 60)
    given = frames(o, e, contact, start=100.0)
    tracker, _ = track("rectangle", given[:60], o[0], settings("none"))
    alone, _ = track("rectangle", given[:60], o[0], settings("none"))
    with caplog.at_level(logging.WARNING):
        found = tracker.update(given[60], [seen(o[0] + WRONG, 99.0)])
    assert found.pose.tolist() == alone.update(given[60]).pose.tolist()
    assert "has time 99.0 s, which is not between" in caplog.text


def test_an_object_that_was_moved_is_found_again():
    # The sensor stands 20 mm inside where the disc should be; a camera sees that it is 40 mm further.
    tracker = disc_tracker(settings())
    e = np.array([-0.088 + 0.02, 0.0, 0.0])
    assert tracker.update(Frame(0.0, e, contact=False)).status == "displaced"
    truth = np.array([0.04, 0.01, 0.3])
    found = [tracker.update(Frame(0.1 * k, e, contact=False), [seen(truth)]) for k in range(1, 11)]
    assert statuses(found) == ["resting"] * 10
    assert translation_errors(found[-1].pose[None], truth[None]).item() < 1e-3
    assert abs(rotation_errors(found[-1].pose[None], truth[None]).item()) < 5e-3


class Firm(OwnMeasurement):
    """The grip, which tells nothing of the pose."""

    on = ("grip",)

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        return (values[0] - math.log(0.5)) / 0.01, np.array([[100.0]])


class Failing(OwnPose):
    def linearise(self, *values: Array) -> tuple[Array, Array]:
        raise RuntimeError("no camera")


@pytest.mark.parametrize("said", [Firm(), Failing(np.zeros(3))])
def test_what_tells_nothing_of_the_pose_finds_no_object_that_was_moved(said):
    # The sensor has stood where the rectangle should be, and draws back.
    where = np.array([[-0.098, 0.0, 0.0], *[[-0.3, 0.0, 0.0]] * 4])
    seen = frames(np.zeros((5, 3)), where, contact=False)
    told = [dataclasses.replace(frame, measurements=(said,)) for frame in seen[1:]]
    found, expected = (track("rectangle", given, np.zeros(3), settings())[1] for given in ([seen[0], *told], seen))
    assert statuses(found) == ["displaced"] * 5
    assert [one.reason for one in found] == [one.reason for one in expected]
    np.testing.assert_allclose(poses(found), poses(expected), atol=1e-12)
    np.testing.assert_allclose(found[-1].covariance, expected[-1].covariance, rtol=1e-9, atol=1e-15)
    # What was measured counts nevertheless.
    assert (found[-1].friction[0] > 0.45) == isinstance(said, Firm)


def test_a_measurement_that_cannot_be_of_an_object_at_rest_is_left_out(caplog):
    class OfSensor(OwnPose):
        on = ("sensor",)

    tracker = disc_tracker()
    with caplog.at_level(logging.WARNING):
        found = tracker.update(small_frame(), [OfSensor(np.ones(3))])
    assert found.pose.tolist() == [0.0, 0.0, 0.0]
    assert "measurement OfSensor is of sensor; at rest there are object_pose" in caplog.text


ODD = {
    r"Jacobian of shape \(3, 2\); they must be \(R,\) and \(R, 3\) with R at most 6": (np.zeros(3), np.zeros((3, 2))),
    r"\(R, 3\) with R at most 6": (np.zeros(7), np.zeros((7, 3))),
    "is not finite": (np.full(3, np.nan), np.eye(3)),
}


@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("said", ODD)
def test_what_an_own_measurement_returns_is_checked(said, contact, caplog):
    class Odd(OwnPose):
        def linearise(self, *values: Array) -> tuple[Array, Array]:
            return ODD[said]

    o, e = pushed_or_resting(contact, 5)
    given = frames(o, e, contact)
    tracker, _ = track("rectangle", given[:5], o[0], settings("none"))
    with caplog.at_level(logging.WARNING):
        found = tracker.update(given[5], [Odd(np.zeros(3))])
    assert len(caplog.records) == 1
    assert re.fullmatch(f"frame at 0.167 s: measurement Odd returns .*{said}; it is left out.*", caplog.messages[0])
    tracker.update(dataclasses.replace(given[5], time=0.2), [Odd(np.zeros(3))])
    assert len(caplog.records) == 1  # nothing is said of the next one
    _, wanted = track("rectangle", given, o[0], settings("none"))
    np.testing.assert_allclose(found.pose, wanted[-1].pose, atol=1e-12)


def test_an_object_pose_is_checked_where_it_is_made():
    for pose in ((0, 0), (0, 0, np.nan), None, "here"):
        with pytest.raises(EstimationError, match=r"^object pose is .* must be three finite numbers"):
            ObjectPose(pose, CAMERA)  # pyright: ignore[reportArgumentType]
    for covariance in (np.eye(2), np.diag([1.0, -1.0, 1.0]), np.tri(3), np.full((3, 3), np.nan), "sure"):
        with pytest.raises(EstimationError, match=r"^object pose has covariance .*; it must be"):
            ObjectPose(np.zeros(3), covariance)  # pyright: ignore[reportArgumentType]


def turned(angle: float, _: float) -> ObjectPose:
    return ObjectPose(np.array([0, 0, angle]), CAMERA)


@pytest.mark.parametrize("kind", [ContactDirection, Turn, ContactPlace, turned])
def test_another_unit_is_asked_about(kind):
    with pytest.raises(EstimationError, match=r"100.* are these (degrees|millimetres)\?"):
        kind(100.0, 1.0)


def test_numbers_may_be_arrays_of_one():
    assert ContactPlace(np.array([0.1]), np.array([2.0])) == ContactPlace(0.1, 2.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [ContactDirection, ContactPlace, Turn])
@pytest.mark.parametrize("given", [(None, 1), ("a", 1), (math.nan, 1), (1, None), (1, 0.0), (1, -1), (1, math.inf)])
def test_what_touch_tells_is_numbers(kind, given):
    with pytest.raises(EstimationError, match=r"its numbers must be finite, the variance above 0"):
        kind(*given)


def test_at_rest_a_measured_pose_is_fused_exactly():
    # The most likely pose, by SciPy: both Gaussians are on the manifold, and yaw is rough enough that they bend.
    first = np.array([0.4, 0.1, 0.3])
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 3)) * [0.01, 0.01, 0.15]
    covariance = root.T @ root + np.diag([1e-5, 1e-5, 1e-3])
    measured = planar.compose(first, np.array([0.012, -0.008, 0.2]))
    measured_covariance = np.diag(np.square([3e-3, 3e-3, 0.08]))
    tracker = palpate.Tracker(palpate.Rectangle(0.2, 0.1), palpate.DIGIT, first, first_pose_sigma=covariance)
    tracked = tracker.update(
        Frame(0.0, np.array([0.0, 0.3, 0.0]), contact=False), [ObjectPose(measured, measured_covariance)]
    )

    def residuals(change: Array) -> Array:
        pose = planar.compose(first, planar.exp(change))
        before = np.linalg.solve(np.linalg.cholesky(covariance), planar.log(planar.between(first, pose)))
        seen_off = planar.log(planar.between(measured, pose))
        return np.concatenate([before, np.linalg.solve(np.linalg.cholesky(measured_covariance), seen_off)])

    best = scipy.optimize.least_squares(residuals, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    exact = planar.compose(first, planar.exp(best.x))
    off = planar.log(planar.between(exact, tracked.pose))
    assert (np.abs(off) < 1e-4 * np.sqrt(np.diag(tracked.covariance))).all()
