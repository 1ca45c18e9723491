"""A new factor with a new variable, in one file: a force sensor, and the compliance of the tip that it teaches.

A force presses the tip in by its compliance times the force. The depth of contacts is a variable of palpate, the
compliance a new one. The part is machined and seen by a camera, so that the depth shows.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate import DIGIT, Frame, Measurement, NoiseSettings, ObjectPose, Rectangle, Tracker, TrackerSettings
from palpate.config import ContactSettings, Priors
from palpate.estimation.factor import Factor
from palpate.estimation.variable import Variable
from palpate.models.pushing.compiled import extended_pushing
from palpate.models.pushing.model import MODEL


@dataclass(frozen=True)
class PushForce(Measurement):
    """Force that pushes the tip, along its x axis."""

    force: float  # [N]
    variance: float  # [m^2], of the depth that it predicts


def residual(measured: Any, depth: Any, compliance: Any) -> tuple[Any]:
    """Return `depth - compliance force` [m]; the parameters name what is read."""
    return (depth - compliance * measured.force,)


def variance(measured: Any) -> tuple[Any]:
    """Return the variance [m^2]."""
    return (measured.variance,)


COMPLIANCE = Variable("compliance", "object", prior=(2e-4, 2e-4))  # [m/N]
PUSH_FORCE = Factor("push_force", residual, variance, measurement=PushForce, data=("force",))

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
graph = extended_pushing(MODEL.extended([COMPLIANCE], [PUSH_FORCE]), folder / "push_force_kernels.py")

exact = NoiseSettings(contact=ContactSettings(deviation=2e-4), priors=Priors(outline_scale=(0.0, 1e-4)))
tracker = Tracker(Rectangle(0.24, 0.16), DIGIT, np.zeros(3), TrackerSettings(noise=exact), graph=graph)
force, true_compliance = 2.0, 4e-4  # [N], [m/N]
seen = np.diag([1e-4, 1e-4, 1e-3]) ** 2  # covariance of the camera [m^2, rad^2]
for k in range(60):  # a straight push; the tip is pressed in as deep as the force says
    moved = np.array([1e-3 * max(k - 5, 0), 0.0, 0.0])
    sensor = moved + np.array([true_compliance * force - 0.12, 0.0, 0.0])
    measured = [PushForce(force, variance=(2e-5) ** 2), ObjectPose(moved, seen)]
    tracker.update(Frame(k / 30, sensor, contact=True), measured)
mean, deviation = tracker.variable("compliance")
print(f"compliance: {1e3 * mean[0]:.2f} +- {1e3 * deviation[0]:.2f} mm/N")
