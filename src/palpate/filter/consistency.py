"""Consistency tests: compare what was predicted with what is measured, in each hypothesis.

- Disturbance: touch and pushing contradict each other, so that something else may have moved the object.
- Contradiction: measured poses of the object are far from its estimate, or put its outline far from the contact.
- Displacement: the sensor is inside the untouched object's outline, or touches the object far from its outline.
- Ambiguity: another hypothesis is likely and farther from the best than the tolerance.
- Uncertainty: the pose is known worse than the tolerance.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Flags
from palpate.config import ALARMS, FOUND, HAND, LIKELY, SEVERAL, UNLIKELY, NoiseSettings
from palpate.filter.hypotheses import Hypotheses
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief, clearances
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.layout import NAMES
from palpate.models.pushing.window import Window
from palpate.types.estimate import Status
from palpate.types.measurements import ObjectPose

_JUDGED, _LIMITS = [NAMES.index(name) for name in ALARMS], np.array([*ALARMS.values()])
_POSES, _OUTLINE = 0, 1  # kinds of contradictions


def disturbance_alarms(window: Window) -> Flags:
    """Return True (B,) where touch and pushing contradict each other."""
    return np.asarray((window.rows["surprise"][:, _JUDGED] > _LIMITS).any(axis=1))


class ConsistencyMonitor:
    """The tests, for one object and sensor. Those named `test_...` write their results to the hypotheses."""

    def __init__(self, model: ContactModel, settings: NoiseSettings, tolerance: tuple[float, float]) -> None:
        self._model, self._contact_deviation = model, settings.contact.deviation
        self._tolerance = tolerance  # of position [m] and yaw [rad]
        self._sensor_deviation = max(settings.sensor_pose.deviation[:2])  # [m]
        self._calibration = np.diag(np.square(settings.sensor_pose.calibration))

    def clearance(self, belief: Belief, sensor_pose: Array) -> tuple[Array, Array]:
        """Return the estimated distance of a sensor pose (3,) from the object and its deviation, (B,) each [m]."""
        gap, by = clearances(belief, self._model, sensor_pose[None])
        return gap[:, 0], np.sqrt(belief.variances(by)[:, 0] + self._contact_deviation**2)

    def test_rest(self, rows: Hypotheses, sensor_pose: Array, touched: Array) -> None:
        """Test that a sensor that touches nothing is outside the object, and that it moved away from it at a release.

        `touched` is its last pose in contact (3,).
        """
        gap, by = clearances(rows.belief, self._model, np.stack([sensor_pose, touched]))
        now, before = gap.T
        if (now >= np.maximum(before, 0.0)).all():
            return
        by[:, 1] -= by[:, 0]
        variance = rows.belief.variances(by)
        deviation = np.sqrt(variance[:, 0] + self._contact_deviation**2)
        rows.displace(np.where(now < -UNLIKELY * deviation, -now, 0.0))
        deviation = np.sqrt(variance[:, 1] + 2.0 * self._sensor_deviation**2)
        rows.displace(np.where(now < before - UNLIKELY * deviation, HAND, 0.0))

    def test_first_contact(self, rows: Hypotheses, sensor_pose: Array) -> None:
        """Test that a contact begins where the object's outline is."""
        gap, deviation = self.clearance(rows.belief, sensor_pose)
        rows.displace(np.where(np.abs(gap) > UNLIKELY * deviation, np.abs(gap), 0.0))

    def test_object_poses(
        self, rows: Hypotheses, expected: Sequence[Array], measured: Sequence[ObjectPose], moved: float = 0.0
    ) -> None:
        """Test measured poses of the object, which moved by up to `moved` [m], against the estimates (B, 3)."""
        if not measured:
            return
        known = rows.belief.pose_covariance + self._calibration + self.covariance_of_motion(moved)
        worst = worst_apart = np.zeros(len(rows.weight))
        for pose, one in zip(expected, measured, strict=True):
            off = se2.log(se2.between(pose, one.pose))
            inverse = np.linalg.pinv(known + one.covariance, hermitian=True)  # a solution may have diverged
            deviations = np.sqrt(np.maximum(np.einsum("bi,bij,bj->b", off, inverse, off), 0.0))
            apart = np.maximum(np.hypot(off[:, 0], off[:, 1]), self._model.friction_radius * np.abs(off[:, 2]))
            worst_apart = np.where(deviations > worst, apart, worst_apart)
            worst = np.maximum(deviations, worst)
        rows.apart = _with_frame(rows.apart, _POSES, worst_apart, worst)

    def test_outline(self, rows: Hypotheses, sensor_pose: Array, is_measured: bool) -> None:
        """Test that the outline is at the contact if the object's pose is measured, or where it was not until now."""
        tested = np.asarray(is_measured | (rows.apart[:, _OUTLINE] > 0.0).any(axis=1))
        gap, deviation = self.clearance(rows.belief.inflated(self._calibration), sensor_pose)
        apart = _with_frame(rows.apart, _OUTLINE, np.abs(gap), np.abs(gap) / deviation)
        rows.apart = np.where(tested[:, None, None], apart, rows.apart)

    def assessed(self, rows: Hypotheses, in_contact: bool) -> tuple[Array, Array, Status, str]:
        """Return what to report: the covariance of all hypotheses about the best, those of each, status and reason.

        Covariances are in the tangent space at the pose (right, body frame), status and reason are of the best one.
        """
        known = rows.whole_belief.pose_covariance
        covariance = known + self._calibration
        by_poses = by_outline = 0.0
        if rows.apart.any():
            covariance = covariance + self.contradiction_covariance(rows)
            by_poses, by_outline = 1e3 * _contradictions(rows)[0]
        status: Status = "tracking" if in_contact else "resting"
        reason = ""
        if by_poses:
            status, reason = "strained", f"measured object poses are up to {by_poses:.0f} mm from the estimate"
        elif by_outline:
            reason = f"measured object poses put the outline up to {by_outline:.0f} mm from where the sensor touches it"
            status = "strained"
        elif rows.displacement[0] and ((known[0].diagonal() > np.square(FOUND)).any() or not in_contact):
            status = "displaced"
        if not in_contact:
            covariance = covariance + self.displacement_covariance(rows)
        joint, ambiguity = covariance[0], ""
        if len(covariance) > 1:
            joint, ambiguity = self._joint(rows.belief.pose, covariance, rows.weight)
        length, angle = self._tolerance
        x, y, yaw = np.sqrt(joint.diagonal()).tolist()
        if ambiguity:
            status, reason = "ambiguous", reason or ambiguity
        elif not reason and status != "displaced" and (2.0 * max(x, y) > length or 2.0 * yaw > angle):
            reason = f"the pose is known to {2e3 * max(x, y):.0f} mm and {np.degrees(2.0 * yaw):.0f} degrees at 95 %"
            status = "uncertain"
        return joint, covariance, status, reason

    def _joint(self, poses: Array, covariances: Array, weights: Array) -> tuple[Array, str]:
        """Return the covariance (3, 3) of all hypotheses about the best, in its body frame, and any ambiguity in words.

        They are ambiguous if another one is likely and farther from the best than the tolerance.
        """
        from_best = se2.log(se2.between(poses[0], poses))
        around = covariances + from_best[:, :, None] * from_best[:, None, :]
        joint = np.sum(weights[:, None, None] * around, axis=0)
        apart, turned = np.hypot(from_best[:, 0], from_best[:, 1]), np.abs(from_best[:, 2])
        is_far = (apart > self._tolerance[0]) | (turned > self._tolerance[1])
        if not ((weights > LIKELY) & is_far).any():
            return joint, ""
        some = weights > 0.0
        far, degrees = 1e3 * apart[some].max(), np.degrees(turned[some].max())
        words = f"{np.count_nonzero(some)} poses up to {far:.0f} mm and {degrees:.0f} degrees from the best"
        return joint, f"{words} fit what was measured"

    def displacement_covariance(self, rows: Hypotheses) -> Array:
        """Return the covariance (B, 3, 3) of a displacement: twice its size, since a gap shows one direction of it."""
        return self.covariance_of_motion(2.0 * rows.displacement)

    def contradiction_covariance(self, rows: Hypotheses) -> Array:
        """Return the covariance (B, 3, 3) of a pose that contradicts measured ones."""
        return self.covariance_of_motion(_contradictions(rows).max(axis=1))

    def covariance_of_motion(self, length: ArrayLike) -> Array:
        """Return the covariance (..., 3, 3) of an unknown motion of this size (...) [m]."""
        length = np.asarray(length, np.float64)
        sizes = np.stack([length, length, length / self._model.friction_radius], axis=-1)
        return np.square(sizes)[..., None] * np.eye(3)


def _with_frame(apart: Array, kind: int, distance: Array, deviations: Array) -> Array:
    """Return `Hypotheses.apart` with the distances (B,) [m] of another frame, unless they are likely."""
    longer = apart.copy()
    longer[:, kind, :-1] = apart[:, kind, 1:]
    longer[:, kind, -1] = np.where(deviations > UNLIKELY, distance, 0.0)
    return longer


def _contradictions(rows: Hypotheses) -> Array:
    """Return the possible error (B, 2) [m] of the pose, for contradicting measured poses and their outline."""
    return np.where((rows.apart > 0.0).sum(axis=2) >= SEVERAL, rows.apart.max(axis=2), 0.0)
