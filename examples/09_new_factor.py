"""A new factor with a new variable, in one file: a force sensor, and the compliance of the tip that it teaches.

A force F presses the tip in by its compliance times F. The depth of contacts is a variable of palpate; the compliance
is a new one.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate import DIGIT, Frame, Measurement, Rectangle, Tracker
from palpate.estimation.factor import Factor
from palpate.estimation.variable import Variable
from palpate.models.pushing.compiled import extended_pushing
from palpate.models.pushing.model import MODEL

FORCE, TRUE_COMPLIANCE = 2.0, 4e-4  # [N], [m/N]


@dataclass(frozen=True)
class PushForce(Measurement):
    """Force that pushes the tip, along its x axis."""

    force: float  # [N]
    variance: float  # [m^2] of the indentation that it predicts


def residual(measured: Any, depth: Any, compliance: Any) -> tuple[Any]:
    """Return `depth - compliance force` [m]; the parameters name what is read."""
    return (depth - compliance * measured.force,)


def variance(measured: Any) -> tuple[Any]:
    """Return the variance [m^2]."""
    return (measured.variance,)


COMPLIANCE = Variable("compliance", "object", prior=(2e-4, 2e-4))  # [m/N]
PUSH_FORCE = Factor("push_force", residual, variance, measurement=PushForce, data=("force",))

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
model = MODEL.extended([COMPLIANCE], [PUSH_FORCE])
graph = extended_pushing(model, folder / "push_force_generated.py")
tracker = Tracker(Rectangle(0.24, 0.16), DIGIT, [0.0, 0.0, 0.0], first_pose_sigma=(1e-4, 1e-4, 1e-3), graph=graph)
for k in range(40):  # pushed straight, the tip pressed in as deep as the force says
    sensor = np.array([-0.12 + TRUE_COMPLIANCE * FORCE + 1e-3 * max(k - 5, 0), 0.0, 0.0])
    measured = [PushForce(FORCE, variance=(5e-5) ** 2)]
    tracker.update(Frame(k / 30, sensor, contact=True), measured)
mean, deviation = tracker.variable("compliance")
print(f"compliance: {1e3 * mean[0]:.2f} +- {1e3 * deviation[0]:.2f} mm/N")
