"""Measured poses of the object that contradict each other or touch, and those that do not."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import planar
import pytest
from push_samples import SHAPES, contact_directions, frames, in_two_contacts, model_of, noisy, pushed, sensor
from tracker_samples import SMOOTHERS, nees, settings, statuses

from palpate import ContactDirection, Estimate, Measurement, ObjectPose, Tracker, TrackerSettings

Array = np.ndarray
FINE, ROUGH = (1e-4, 1e-4, 1e-3), (5e-3, 5e-3, 5e-2)


def camera(o: Array, off: Any = (0.0, 0.0, 0.0), sigma: Any = FINE) -> list[ObjectPose]:
    return [ObjectPose(true + off, np.diag(np.square(sigma))) for true in o]


def tracked(
    name: str,
    o: Array,
    e: Array,
    contact: Any,
    cameras: Sequence[Sequence[Measurement]],
    start: int = 0,
    how: Any = None,
) -> list[Estimate]:
    """The estimates of a push that cameras see from a frame on."""
    tracker = Tracker(SHAPES[name], sensor(), o[0], how or TrackerSettings("none", hypotheses=1))
    said = list(zip(*cameras, strict=True))
    return [
        tracker.update(dataclasses.replace(frame, measurements=said[k] if k >= start else ()))
        for k, frame in enumerate(frames(o, e, contact))
    ]


def is_told(estimate: Estimate) -> bool:
    return "measured object pose" in estimate.reason


@pytest.mark.parametrize("smoother", SMOOTHERS)
@pytest.mark.parametrize("off", [0.05, 0.5])
@pytest.mark.parametrize("ways", [(1.0, -1.0), (1.0, 0.0)])
def test_two_cameras_that_contradict_each_other(ways, off, smoother):
    o, e, contact = in_two_contacts("rectangle", 12)
    cameras = [camera(o, (way * off, 0.0, 0.0)) for way in ways]
    found = tracked("rectangle", o, e, contact, cameras, how=TrackerSettings("none", smoother, hypotheses=1))
    assert set(statuses(found)[2:]) == {"strained"}  # at rest, too
    half = 1e3 * off * (ways[0] - ways[1]) / 2.0
    for estimate in found[5:]:
        assert estimate.reason.startswith("measured object poses are up to ") and estimate.reason.endswith(
            "from the estimate"
        )
        assert 0.94 * half < float(estimate.reason.split()[6]) < 1.06e3 * off
    assert nees(found, o)[2:].max() < 7.8


def test_a_camera_that_contradicts_touch():
    o, e, contact = in_two_contacts("rectangle", 15)
    found = tracked("rectangle", o, e, contact, [camera(o, (0.05, 0.0, 0.0))])
    assert set(statuses(found)[2:]) == {"strained"}
    assert "put the outline up to 50 mm from where the sensor touches it" in found[10].reason
    assert nees(found, o)[2:].max() < 7.8


@pytest.mark.parametrize(("turned", "start"), [(0.35, 0), (0.35, 20), (-0.35, 20), (0.0, 20)])
def test_a_camera_that_is_turned_all_the_time(turned, start):
    # It is believed, so that touch fits only with directions that are wrong by more than any sensor's.
    sigma = (1e-3, 1e-3, 1e-2)
    o, e = pushed("rectangle", 80)
    seen = noisy(planar.compose(o, [0.0, 0.0, turned]), sigma, np.random.default_rng(5))
    felt = contact_directions(planar.between(o, e), model_of("rectangle"))
    direction = [ContactDirection(angle, np.radians(2.0) ** 2) for angle in felt.tolist()]
    found = tracked("rectangle", o, e, True, [camera(seen, sigma=sigma), direction], start)
    told = np.array([estimate.status == "strained" and "standard deviations" in estimate.reason for estimate in found])
    assert told[start + 30 :].all() == bool(turned)
    assert told.any() == bool(turned)


@pytest.mark.parametrize("sigma", [FINE, (1e-3, 1e-3, 1e-2), ROUGH])
def test_a_camera_as_good_as_it_says_contradicts_nothing(sigma):
    rng = np.random.default_rng(3)
    o, e, contact = in_two_contacts("rectangle", 40)
    seen = noisy(o, sigma, rng)
    seen[::9] = planar.compose(o[::9], planar.exp(np.array([3.0, 0.0, 0.0]) * sigma))  # three standard deviations off
    for how in (settings("none"), TrackerSettings("none")):
        found = tracked("rectangle", o, e, contact, [camera(seen, sigma=sigma)], how=how)
        assert not any(is_told(estimate) for estimate in found)


@pytest.mark.parametrize("rests", [5, 60])
def test_an_object_that_a_hand_has_moved_is_followed(rests):
    o1, e1 = pushed("rectangle", 10)
    moved = planar.compose(o1[-1], [0.0, 0.05, 0.3])
    away = np.broadcast_to(planar.compose(o1[-1], [-0.4, 0.0, 0.0]), (rests + 20, 3))
    o = np.concatenate([o1, np.tile(o1[-1], (rests, 1)), np.tile(moved, (20, 1))])
    sigma = (1e-3, 1e-3, 1e-2)
    seen = camera(noisy(o, sigma, np.random.default_rng(1)), sigma=sigma)
    found = tracked("rectangle", o, np.concatenate([e1, away]), np.arange(len(o)) < 11, [seen])
    # Two frames may be errors, the third is none, and it is said until eight frames have agreed.
    told = [k - 11 - rests for k, estimate in enumerate(found) if is_told(estimate)]
    assert told == [*range(2, 11)]
    assert statuses(found)[-1] == "resting" and nees(found, o)[-17:].max() < 11.3
    assert np.hypot(*(found[-1].pose - moved)[:2]) < 2e-3
