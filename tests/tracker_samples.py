"""What the tests of the tracker share."""

import dataclasses
from typing import Any

import numpy as np
from planar import between, log, wrap
from push_samples import RADIUS, SHAPES, sensor, with_settings

from palpate import Estimate, Frame, NoiseSettings, Tracker, TrackerSettings

Array = np.ndarray
SMOOTHERS = ["fixed-lag", "batch"]
CALIBRATED = with_settings(
    NoiseSettings(),
    first_pose={"deviation": NoiseSettings().first_pose.truth},
    priors={"depth": (0.0, 4e-4), "friction_ratio": (0.0, 0.3)},
    sensor_pose={"calibration": (0.0, 0.0, 0.0)},
)
"""The defaults, expecting what pushes are drawn with: first pose and calibration are true, the object only just
touches, and c is the model's."""


def settings(
    tactile: Any = "oracle",
    smoother: Any = "fixed-lag",
    noise: NoiseSettings | None = None,
    **more: Any,
) -> TrackerSettings:
    return TrackerSettings(tactile, smoother, noise=noise or CALIBRATED, **more)


def track(name: str, seen: list[Frame], first: Array, how: TrackerSettings, radius: float = RADIUS):
    tracker = Tracker(SHAPES[name], sensor(radius), first, how)
    return tracker, [tracker.update(frame) for frame in seen]


def nees(estimates: list[Estimate], o: Array) -> Array:
    """Errors from the truth (N, 3) in the reported covariance, squared (N,): 7.8 is its 95 % region."""
    apart = [log(between(estimate.pose, true)) for estimate, true in zip(estimates, o, strict=True)]
    return np.array([off @ np.linalg.solve(one.covariance, off) for off, one in zip(apart, estimates, strict=True)])


def poses(estimates: list[Estimate]) -> Array:
    return np.array([estimate.pose for estimate in estimates])


def translation_errors(pose: Array, truth: Array) -> Array:
    return np.hypot(*(pose - truth)[..., :2].T)


def rotation_errors(pose: Array, truth: Array) -> Array:
    return wrap(pose[..., 2] - truth[..., 2])


def statuses(estimates: list[Estimate]) -> list[str]:
    return [estimate.status for estimate in estimates]


def same(found: list[Estimate], wanted: list[Estimate]) -> None:
    """Fail unless all values of estimates are equal, NaN being equal to NaN."""
    np.testing.assert_equal(list(map(dataclasses.asdict, found)), list(map(dataclasses.asdict, wanted)))


def yaw_deviations(estimates: list[Estimate]) -> Array:
    return np.sqrt([estimate.covariance[2, 2] for estimate in estimates])


def small_frame(**changes: Any) -> Frame:
    return dataclasses.replace(Frame(1.0, np.array([-0.2, 0.0, 0.0]), contact=False), **changes)


def disc_tracker(how: TrackerSettings | None = None, first: Any = (0.0, 0.0, 0.0)) -> Tracker:
    return Tracker(SHAPES["disc"], sensor(), first, how)
