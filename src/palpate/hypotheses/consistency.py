"""Consistency tests: compare what was predicted with what is measured, in each hypothesis.

- Contradiction: measured poses of the object are far from its estimate, or put its outline far from the contact; or all
  that is measured fits only with a variable of the object that is implausible.
- Displacement: the sensor is inside the untouched object's outline, or touches the object far from its outline.

Disturbances are tested in `proposals/shove.py`, ambiguity and uncertainty in `posterior.py`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, changed
from palpate.config import UNLIKELY, NoiseSettings
from palpate.geometry import se2
from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.proposals.shove import SHOVE_SIGMA
from palpate.models.pushing.belief import Belief, clearances
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.priors import ObjectPrior
from palpate.types.measurements import ObjectPose

_POSES = 0
"""Contradictions by measured poses, in `Hypotheses.contradictions`."""
_OUTLINE = 1
"""Contradictions by the outline, where measured poses put it."""
_VARIABLES = 2
"""Contradictions by variables."""
_IMPLAUSIBLE = 4.0
"""Standard deviations of its prior from which a variable of the object is implausible. With the errors of a real set-up
one in 27 pushes reaches 3.4; a camera's pose that is off by 20 mm makes it 5 to 23."""
_FRAMES_TO_CONTRADICT = 3
"""Frames that must contradict, among those remembered, before it counts."""


class Tip(NamedTuple):
    """A sensor, or a finger of a hand, at a pose."""

    model: ContactModel
    """Its contact model."""
    pose: Array
    """Its pose in the world (3,), or in each hypothesis (B, 3) [m, m, rad]."""


class ConsistencyMonitor:
    """The tests, for one object and sensor. Those named `test_...` return the hypotheses with their results."""

    def __init__(self, model: ContactModel, settings: NoiseSettings, prior: ObjectPrior) -> None:
        self._model = model
        self._prior = prior
        self._implausible = _IMPLAUSIBLE * prior.deviation  # distance of variables from their priors
        self._contact_deviation = settings.contact.deviation
        self._sensor_deviation = max(settings.sensor_pose.deviation[:2])  # [m]
        self.to_centroid = model.to_centroid
        """Matrix (3, 3) from the tangent space at the object's pose to that at its centroid."""
        self._from_centroid = np.linalg.inv(model.to_centroid)
        self.set_up_covariance: Array = self._about_centroid(np.square(settings.sensor_pose.calibration))
        """Covariance of the constant offset between sensor, world and outline, (3, 3)."""

    def clearance(self, belief: Belief, tip: Tip) -> tuple[Array, Array]:
        """Return the estimated distance of a tip from the object and its deviation, (B,) each [m]."""
        gap, by_belief = clearances(belief, tip.model, tip.pose[..., None, :])
        variance = belief.variances(by_belief)[:, 0] + self._contact_deviation**2
        return gap[:, 0], np.sqrt(variance)

    def test_rest(self, rows: Hypotheses, tip: Tip, touched: Array) -> Hypotheses:
        """Test that a tip that touches nothing is outside the object, and that it moved away from it at a release.

        `touched` is its last pose in contact (3,) or (B, 3).
        """
        poses = np.empty((*tip.pose.shape[:-1], 2, 3))
        poses[..., 0, :] = tip.pose
        poses[..., 1, :] = touched
        gaps, by_belief = clearances(rows.belief, tip.model, poses)
        now = gaps[:, 0]
        before = gaps[:, 1]
        if np.count_nonzero(now >= np.maximum(before, 0.0)) == len(now):
            return rows
        by_belief[:, 1] -= by_belief[:, 0]
        variance = rows.belief.variances(by_belief)
        deviation = np.sqrt(variance[:, 0] + self._contact_deviation**2)
        inside = np.where(now < -UNLIKELY * deviation, -now, 0.0)
        deviation_of_motion = np.sqrt(variance[:, 1] + 2.0 * self._sensor_deviation**2)
        followed = np.where(now < before - UNLIKELY * deviation_of_motion, SHOVE_SIGMA, 0.0)
        return rows.displaced(np.maximum(inside, followed))

    def test_outside(self, rows: Hypotheses, tip: Tip) -> Hypotheses:
        """Test that a tip that touches nothing is outside the object."""
        gap, deviation = self.clearance(rows.belief, tip)
        return rows.displaced(np.where(gap < -UNLIKELY * deviation, -gap, 0.0))

    def test_first_contact(self, rows: Hypotheses, tip: Tip) -> Hypotheses:
        """Test that a contact begins where the object's outline is."""
        gap, deviation = self.clearance(rows.belief, tip)
        distance = np.abs(gap)
        return rows.displaced(np.where(distance > UNLIKELY * deviation, distance, 0.0))

    def test_object_poses(
        self, rows: Hypotheses, expected: Sequence[Array], measured: Sequence[ObjectPose], moved: float = 0.0
    ) -> Hypotheses:
        """Test measured poses of the object, which moved by up to `moved` [m], against the estimates (B, 3)."""
        if not measured:
            return rows
        known = rows.belief.pose_covariance + self.set_up_covariance + self.covariance_of_motion(moved)
        most_deviations = np.zeros(len(rows))
        distance = np.zeros(len(rows))  # of the pose with the most deviations
        for pose, one in zip(expected, measured, strict=True):
            off = se2.log(se2.between(pose, one.pose))
            information = np.linalg.pinv(known + one.covariance, hermitian=True)  # a solution may have diverged
            squares = np.einsum("bi,bij,bj->b", off, information, off)
            deviations = np.sqrt(np.maximum(squares, 0.0))
            turned_by = self._model.friction_radius * np.abs(off[:, 2])
            at_centroid = off @ self.to_centroid.T
            apart = np.maximum(np.hypot(at_centroid[:, 0], at_centroid[:, 1]), turned_by)
            distance = np.where(deviations > most_deviations, apart, distance)
            most_deviations = np.maximum(deviations, most_deviations)
        return changed(rows, contradictions=_with_frame(rows.contradictions, _POSES, distance, most_deviations))

    def test_outline(self, rows: Hypotheses, touching: Sequence[Tip], is_measured: bool) -> Hypotheses:
        """Test that the outline is at the contact if the object's pose is measured, or where it was not until now."""
        is_tested = np.asarray(is_measured | (rows.contradictions[:, _OUTLINE] > 0.0).any(axis=1))
        known = rows.belief.inflated(self.set_up_covariance)
        distances = np.abs([self.clearance(known, tip) for tip in touching])  # and deviations, (K, 2, B)
        distance = distances[:, 0].max(axis=0)
        deviations = (distances[:, 0] / distances[:, 1]).max(axis=0)
        tested = _with_frame(rows.contradictions, _OUTLINE, distance, deviations)
        return changed(rows, contradictions=np.where(is_tested[:, None, None], tested, rows.contradictions))

    def test_variables(self, rows: Hypotheses) -> Hypotheses:
        """Test that the object's variables are plausible; each of their standard deviations may hide one of contact."""
        is_implausible = np.abs(rows.belief.values - self._prior.mean) > self._implausible
        if not np.count_nonzero(is_implausible) and not np.count_nonzero(rows.contradictions):
            return rows
        deviations = np.abs(self._unusual(rows)).max(axis=1)
        off = np.where(deviations > _IMPLAUSIBLE, deviations * self._contact_deviation, 0.0)
        return changed(rows, contradictions=_with_distance(rows.contradictions, _VARIABLES, off))

    def least_plausible(self, rows: Hypotheses) -> tuple[str, float]:
        """Return the variable of the best hypothesis that is farthest from its prior, and by how many deviations."""
        deviations = np.abs(self._unusual(rows)[0])
        worst = int(deviations.argmax())
        return self._prior.names[worst], float(deviations[worst])

    def _unusual(self, rows: Hypotheses) -> Array:
        """Return the differences of the object's variables from their priors, (B, V) [standard deviations]."""
        return (rows.belief.values - self._prior.mean) / self._prior.deviation

    def displacement_covariance(self, rows: Hypotheses) -> Array:
        """Return the covariance (B, 3, 3) of a displacement: twice its size, since a gap shows one direction of it."""
        return self.covariance_of_motion(2.0 * rows.displacement)

    def contradiction_covariance(self, rows: Hypotheses) -> Array:
        """Return the covariance (B, 3, 3) of a pose that contradicts measured ones."""
        return self.covariance_of_motion(contradicting_distances(rows).max(axis=1))

    def covariance_of_motion(self, length: ArrayLike) -> Array:
        """Return the covariance (..., 3, 3) of an unknown motion of this size (...) [m] of the object's centroid."""
        length = np.asarray(length, np.float64)
        sizes = np.stack([length, length, length / self._model.friction_radius], axis=-1)
        return self._about_centroid(np.square(sizes))

    def deviations_of_centroid(self, covariance: Array) -> tuple[float, float, float]:
        """Return the standard deviations (x, y, yaw) of the centroid's pose from the covariance (3, 3) of the object's.

        They are those of `to_centroid`, in a fifth of the time of a product of matrices.
        """
        (xx, _, x_yaw), (_, yy, y_yaw), (_, _, yaw) = covariance.tolist()
        to_x = self._model.friction_center.real
        to_y = self._model.friction_center.imag
        x = xx - 2.0 * to_y * x_yaw + to_y**2 * yaw
        y = yy + 2.0 * to_x * y_yaw + to_x**2 * yaw
        return math.sqrt(max(x, 0.0)), math.sqrt(max(y, 0.0)), math.sqrt(max(yaw, 0.0))

    def _about_centroid(self, variances: Array) -> Array:
        """Return the covariance (..., 3, 3) of the pose by a motion with variances (..., 3) of the centroid."""
        return (self._from_centroid * variances[..., None, :]) @ self._from_centroid.T


def contradicting_distances(rows: Hypotheses) -> Array:
    """Return the possible error (B, 3) [m] of the pose: by measured poses, by their outline, and by variables."""
    if not np.count_nonzero(rows.contradictions):
        return np.zeros(rows.contradictions.shape[:2])
    count = (rows.contradictions > 0.0).sum(axis=2)
    return np.where(count >= _FRAMES_TO_CONTRADICT, rows.contradictions.max(axis=2), 0.0)


def _with_frame(contradictions: Array, kind: int, distance: Array, deviations: Array) -> Array:
    """Return `Hypotheses.contradictions` with the distances (B,) [m] of another frame, unless they are likely."""
    return _with_distance(contradictions, kind, np.where(deviations > UNLIKELY, distance, 0.0))


def _with_distance(contradictions: Array, kind: int, distance: Array) -> Array:
    """Return `Hypotheses.contradictions` with the distances (B,) [m] of another frame, 0 where all agrees."""
    longer = contradictions.copy()
    longer[:, kind, :-1] = contradictions[:, kind, 1:]
    longer[:, kind, -1] = distance
    return longer
