"""Posterior: everything that is known of the object after a frame, with the evidence for its status."""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array
from palpate.compiled import compiled
from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.consistency import ConsistencyMonitor, contradicting_distances
from palpate.hypotheses.weigher import LIKELY_WEIGHT
from palpate.manifolds.se2_kernels import between, log
from palpate.models.pushing.hand_step import FACING
from palpate.models.pushing.layout import IN_OBJECT
from palpate.models.pushing.variables import GRIP
from palpate.status import Ambiguity, Implausible, PoseEvidence, Verdict
from palpate.types.estimate import Answer, Estimate, Origin

_FOUND_SIGMA = (0.005, 0.005, 0.1)
"""[m, m, rad] standard deviations below which a displaced object is found again."""
_GRIP = IN_OBJECT[GRIP].start


class Touching(NamedTuple):
    """The contact of the best hypothesis at the last step, in the object frame."""

    point: complex
    """Contact point on the outline [m]."""
    normal: complex
    """Outward normal of the outline there, of several fingers the mean, which is shorter than 1."""
    innovations: Array
    """Innovations of the factors; see `Estimate.innovations`."""


class Posterior(NamedTuple):
    """All hypotheses after a frame, the best first."""

    rows: Hypotheses
    """State of each of B hypotheses."""
    covariances: Array
    """Covariance of each pose, (B, 3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    covariance: Array
    """Covariance of all of them about the best, (3, 3)."""
    evidence: PoseEvidence
    """Signs of how well the pose is known, for the status."""
    touching: Touching | None
    """The contact; None between contacts."""

    def estimate(self, time: float, verdict: Verdict) -> Estimate:
        """Return the estimate at a time [s]."""
        belief = self.rows.belief
        friction = math.exp(belief.values[0, _GRIP])
        log_friction_deviation = math.sqrt(belief.covariance[0, 3 + _GRIP, 3 + _GRIP])
        touching = self.touching
        point = None
        normal = None
        if touching is not None:
            x, y, theta = belief.pose[0].tolist()
            rotation = complex(math.cos(theta), math.sin(theta))
            point = _as_vector(complex(x, y) + rotation * touching.point)
            length = abs(touching.normal)
            normal = _as_vector(rotation * touching.normal / length) if length > FACING else None
        return Estimate(
            time=time,
            pose=belief.pose[0].copy(),
            covariance=self.covariance,
            contact=touching is not None,
            status=verdict.status,
            reason=verdict.reason,
            answers=self._answers(),
            friction=(friction, friction * log_friction_deviation),
            contact_point=point,
            contact_normal=normal,
            innovations=None if touching is None else touching.innovations,
        )

    def _answers(self) -> tuple[Answer, ...]:
        """Return the hypotheses that have any weight."""
        rows = self.rows
        poses = rows.belief.pose.copy()
        covariances = self.covariances.copy()
        every = zip(poses, covariances, rows.weight.tolist(), rows.origins, strict=True)
        return tuple(Answer(*answer) for answer in every if answer[2])


class Tolerance(NamedTuple):
    """Largest error of a pose that is good enough, at two standard deviations."""

    length: float
    """[m], of the outline's centroid."""
    angle: float
    """[rad]; infinite for a round object, which looks alike at every yaw."""


class Circumstances(NamedTuple):
    """Circumstances of a frame that the hypotheses do not show."""

    hidden_motion: float = 0.0
    """Distance that the sensor may have moved since the last frame while its pose was frozen [m]."""
    has_begun_anew: bool = False
    """True if the estimator had no solution at this frame and began anew from the last pose."""
    takes_images_as_mirrored: bool = False
    """True if it was decided that touch images are mirrored or turned by half a turn, of a hand that its fingers are
    exchanged."""
    are_of_hand: bool = False
    """True for a hand of several fingers."""


def posterior_of(
    rows: Hypotheses,
    touching: Touching | None,
    monitor: ConsistencyMonitor,
    tolerance: Tolerance,
    circumstances: Circumstances,
) -> Posterior:
    """Return the posterior of hypotheses after a frame; `touching` is None between contacts."""
    in_contact = touching is not None
    known = rows.whole_belief.pose_covariance
    covariances = _with_doubts(known, rows, in_contact, monitor)
    covariance = covariances[0]
    ambiguity = None
    if len(rows) > 1:
        from_best = np.empty((len(rows), 3))
        covariance = np.zeros((3, 3))
        _put_spread(rows.belief.pose, covariances, rows.weight, monitor.to_centroid, from_best, covariance)
        ambiguity = _ambiguity(from_best, rows, tolerance)
    by_poses, by_outline, by_variables = contradicting_distances(rows)[0].tolist()
    x, y, yaw = monitor.deviations_of_centroid(covariance)
    position = max(x, y)
    was_displaced = bool(rows.displacement[0] > 0.0)
    evidence = PoseEvidence(
        in_contact=in_contact,
        position_deviation=position,
        yaw_deviation=yaw,
        is_beyond_tolerance=2.0 * position > tolerance.length or 2.0 * yaw > tolerance.angle,
        ambiguity=ambiguity,
        has_begun_anew=circumstances.has_begun_anew,
        contradicting_poses=by_poses,
        contradicting_outline=by_outline,
        implausible=Implausible(*monitor.least_plausible(rows)) if by_variables > 0.0 else None,
        is_displaced=was_displaced and not _is_found_again(known[0], in_contact, monitor, tolerance),
        takes_images_as_mirrored=circumstances.takes_images_as_mirrored,
        may_images_be_mirrored=rows.has_mirrors,
        are_of_hand=circumstances.are_of_hand,
    )
    if circumstances.hidden_motion > 0.0:
        covariance = covariance + monitor.covariance_of_motion(circumstances.hidden_motion)
    return Posterior(rows, covariances, covariance, evidence, touching)


def _with_doubts(known: Array, rows: Hypotheses, in_contact: bool, monitor: ConsistencyMonitor) -> Array:
    """Return the covariances (B, 3, 3) of poses as users see them: with the set-up, and with what contradicts them."""
    covariances = known + monitor.set_up_covariance
    if np.count_nonzero(rows.contradictions):
        covariances = covariances + monitor.contradiction_covariance(rows)
    if not in_contact and np.count_nonzero(rows.displacement):
        covariances = covariances + monitor.displacement_covariance(rows)
    return covariances


def _is_found_again(covariance: Array, in_contact: bool, monitor: ConsistencyMonitor, tolerance: Tolerance) -> bool:
    """Return True if a contact has found an object that was displaced; `covariance` (3, 3) is that of its pose."""
    deviations = monitor.deviations_of_centroid(covariance)
    is_known = [deviation <= found for deviation, found in zip(deviations, _FOUND_SIGMA, strict=True)]
    return in_contact and all(is_known if math.isfinite(tolerance.angle) else is_known[:2])


@compiled(np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros(1), np.zeros((3, 3)), np.zeros((1, 3)), np.zeros((3, 3)))
def _put_spread(
    poses: Array, covariances: Array, weights: Array, to_centroid: Array, from_best: Array, covariance: Array
) -> None:
    """Add up the covariance (3, 3) of all hypotheses about the best, in its body frame.

    Their centroids in the tangent space at the best one are written to `from_best` (B, 3).
    """
    for b in range(len(poses)):
        off = from_best[b]
        between(poses[0], poses[b], off)
        log(off, off)
        for i in range(3):
            for j in range(3):
                covariance[i, j] += weights[b] * (covariances[b, i, j] + off[i] * off[j])
        x = off[0]
        y = off[1]
        yaw = off[2]
        for i in range(3):
            off[i] = to_centroid[i, 0] * x + to_centroid[i, 1] * y + to_centroid[i, 2] * yaw


def _ambiguity(from_best: Array, rows: Hypotheses, tolerance: Tolerance) -> Ambiguity | None:
    """Return the ambiguity if another hypothesis is likely and farther from the best than the tolerance.

    `from_best` (B, 3) are their centroids in the tangent space at the best one.
    """
    # Of some ten hypotheses, Python's numbers take a quarter of the time of NumPy's arrays.
    off = [(math.hypot(x, y), abs(yaw)) for x, y, yaw in from_best.tolist()]
    weights = rows.weight.tolist()
    likely = [each for each, weight in zip(off, weights, strict=True) if weight > LIKELY_WEIGHT]
    if not any(distance > tolerance.length or angle > tolerance.angle for distance, angle in likely):
        return None
    distances, angles = zip(*(each for each, weight in zip(off, weights, strict=True) if weight > 0.0), strict=True)
    origins: Counter[Origin] = Counter(
        origin for origin, weight in zip(rows.origins, weights, strict=True) if weight > 0.0
    )
    return Ambiguity(max(distances), max(angles), dict(origins))


def _as_vector(number: complex) -> Array:
    """Return a complex number as a vector (2,)."""
    return np.array((number.real, number.imag))
