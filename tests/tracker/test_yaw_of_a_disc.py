"""The yaw of a disc: no touch tells it, so that it stays as unknown as it was; a camera does."""

import dataclasses
import math

import numpy as np
import pytest
from push_samples import SHAPES, contact_directions, frames, in_two_contacts, model_of, sensor
from tracker_samples import nees, se2, settings

from palpate import ContactDirection, Estimate, Frame, ObjectPose, Tracker

TRUE, SENSOR, CONTACT = in_two_contacts("disc", 60)
OFF = np.array([0.004, -0.003, 1.5])
"""By which the first pose is off."""


def tracked(sigma: float, seen: list[Frame], hypotheses: int = 9) -> list[Estimate]:
    tracker = Tracker(
        SHAPES["disc"],
        sensor(),
        se2.compose(TRUE[0], OFF),
        settings("none", hypotheses=hypotheses),
        first_pose_sigma=(5e-3, 5e-3, sigma),
    )
    return [tracker.update(frame) for frame in seen]


def felt() -> list[Frame]:
    """Frames of two contacts, the first before either, that tell where the tip is touched."""
    told = contact_directions(se2.between(TRUE, SENSOR), model_of("disc"))
    apart = dataclasses.replace(frames(TRUE[:1], se2.compose(SENSOR[:1], [-0.1, 0.0, 0.0]), False)[0], time=-1.0)
    touched = [
        dataclasses.replace(one, measurements=(ContactDirection(float(angle), 0.03**2),) if one.contact else ())
        for one, angle in zip(frames(TRUE, SENSOR, CONTACT), told, strict=True)
    ]
    return [apart, *touched]


@pytest.mark.parametrize("hypotheses", [1, 9])
@pytest.mark.parametrize("sigma", [0.8, 2.0])
def test_it_stays_as_unknown_as_it_was_through_contacts_and_rests(sigma, hypotheses):
    found = tracked(sigma, felt(), hypotheses)
    yaw = np.sqrt([estimate.covariance[2, 2] for estimate in found])
    np.testing.assert_allclose(yaw, sigma, rtol=0.01)
    assert nees(found, np.concatenate([TRUE[:1], TRUE])).max() < 7.8
    # It is said as well; where the disc is is found all the same.
    assert found[-1].status == "uncertain"
    assert np.hypot(*(found[-1].pose - TRUE[-1])[:2]) < 3e-3


def test_one_that_is_known_stays_known():
    found = tracked(0.04, felt())
    assert math.sqrt(found[-1].covariance[2, 2]) < 0.06
    assert found[-1].status == "tracking"


def test_a_camera_tells_it_whenever_it_sees_the_disc():
    seen = felt()
    rests = np.flatnonzero(~np.concatenate([[False], CONTACT]))
    for when in (0, int(rests[0])):
        told = list(seen)
        camera = ObjectPose(np.concatenate([TRUE[:1], TRUE])[when], np.diag([1e-3, 1e-3, 0.02]) ** 2)
        told[when] = dataclasses.replace(seen[when], measurements=(camera,))
        found = tracked(2.0, told)
        yaw = np.sqrt([estimate.covariance[2, 2] for estimate in found])
        np.testing.assert_allclose(yaw[:when], 2.0, rtol=0.01)
        assert yaw[when:].max() < 0.07
        assert abs(se2.wrap(found[-1].pose[2] - TRUE[-1, 2])) < 0.06
