"""Pose and outline after a frame, with the evidence for the status."""

import math
from dataclasses import dataclass

from palpate.arrays import Array
from palpate.status import PoseEvidence, Verdict
from palpate.types.estimate import Answer, Estimate
from palpate.types.outline import Outline


@dataclass(frozen=True, eq=False)
class Explored:
    """Pose and outline after a frame, with the evidence for the status."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    outline: Outline
    """The outline with its band."""
    evidence: PoseEvidence
    """Signs of how well pose and outline are known, for the status."""
    contact_point: Array | None = None
    """Contact point on the outline, (2,) [m], world frame; None between contacts."""
    contact_normal: Array | None = None
    """Outward normal of the outline there, (2,), world frame; None between contacts."""
    friction: tuple[float, float] = (math.nan, math.nan)
    """Coulomb friction between sensor and object with its standard deviation."""

    def estimate(self, time: float, verdict: Verdict) -> Estimate:
        """Return the estimate at a time [s]."""
        return Estimate(
            time=time,
            pose=self.pose.copy(),
            covariance=self.covariance,
            contact=self.evidence.in_contact,
            status=verdict.status,
            reason=verdict.reason,
            answers=(Answer(self.pose.copy(), self.covariance, 1.0),),
            friction=self.friction,
            contact_point=self.contact_point,
            contact_normal=self.contact_normal,
            outline=self.outline,
        )
