"""What the tests of the tracker share."""

import dataclasses
from typing import Any

import numpy as np
from push_samples import RADIUS, SHAPES, sensor, with_settings

from palpate.config import NoiseSettings, TrackerSettings
from palpate.geometry import se2
from palpate.pipeline.metrics import rotation_errors as rotation_errors
from palpate.pipeline.metrics import translation_errors as translation_errors
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame
from palpate.types.recording import Recording

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
    hypotheses: int = TrackerSettings.hypotheses,
) -> TrackerSettings:
    return TrackerSettings(tactile, smoother, noise or CALIBRATED, hypotheses=hypotheses)


def track(name: str, seen: list[Frame], first: Array, how: TrackerSettings, radius: float = RADIUS):
    """The tracker after these frames, and its estimates."""
    tracker = Tracker(SHAPES[name], sensor(radius), first, how)
    return tracker, [tracker.update(frame) for frame in seen]


def nees(estimates: list[Estimate], o: Array) -> Array:
    """Errors from the truth (N, 3) in the reported covariance, squared (N,): 7.8 is its 95 % region."""
    apart = [se2.log(se2.between(estimate.pose, true)) for estimate, true in zip(estimates, o, strict=True)]
    return np.array([off @ np.linalg.solve(one.covariance, off) for off, one in zip(apart, estimates, strict=True)])


def poses(estimates: list[Estimate]) -> Array:
    return np.array([estimate.pose for estimate in estimates])


def statuses(estimates: list[Estimate]) -> list[str]:
    return [estimate.status for estimate in estimates]


def yaw_deviations(estimates: list[Estimate]) -> Array:
    return np.sqrt([estimate.covariance[2, 2] for estimate in estimates])


def small_frame(**changes: Any) -> Frame:
    return dataclasses.replace(Frame(1.0, np.array([-0.2, 0.0, 0.0]), contact=False), **changes)


def disc_tracker(how: TrackerSettings | None = None, first: Any = (0.0, 0.0, 0.0)) -> Tracker:
    return Tracker(SHAPES["disc"], sensor(), first, how)


def simulated(shape: str, name: str, seed: int) -> Recording:
    """Return a simulated recording with touch images, ideal, of 6 s."""
    from palpate.geometry.shapes import SHAPES as OBJECTS
    from palpate.lab.simulate.recordings import simulate_recording

    return simulate_recording(OBJECTS[shape], name, seed, 6.0, ideal=True)
