"""Consistency tests: compare what was predicted with what is measured, in each hypothesis.

- Inconsistency: touch and pushing contradict each other. The statistic is the mean square, over the last steps, of the
  worst row of the pushing factors [variances]. A large value inflates the reported covariance from then on.
- Contradiction: measured poses of the object are far from its estimate, or put its outline far from the contact.
- Displacement: the sensor is inside the untouched object's outline, or touches the object far from its outline.
- Uncertainty: the covariance is too large for a linearised one to be reliable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.geometry import se2
from palpate.graph.belief import Belief, RowArrays
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.contact import overlap, reaches
from palpate.graph.factors.direction import true_angle
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE, OUTLINE_SCALE
from palpate.types.estimate import Status
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STEPS, _TYPICAL, _INCONSISTENT = 30, 0.5, 4.0
"""Steps of the mean square [variances], its usual value, and its limit: on simulated pushes, which slide, it is below
0.5 nine times in ten and at most 2; a disturbance by hand makes it 70 and more."""
_SURPRISE = 3.0  # standard deviations of a distance at which an untouched object counts as displaced
_STILL = 3e-4  # [m] noise of the sensor's own motion
_HAND_SPEED, _HAND_REACH = 0.3, 0.02  # [m/s], [m] standard deviations of a hand that moves the object away
_FOUND = np.array([0.005, 0.005, 0.1])  # [m, m, rad] standard deviations at which a displaced object is found again
_ALONG = np.linspace(-1.0, 1.0, 7)  # places along the outline where directions are compared, over the likely length
_UNCERTAIN = np.array([0.02, 0.02, 0.2])  # [m, m, rad] standard deviations too large to be reliable
_CONTRADICTS = 5.0  # standard deviations at which a measured pose contradicts
_FRAMES, _SEVERAL = 10, 3  # a contradiction counts from several of the last frames on: a single one may be an error


@dataclass(frozen=True, eq=False)
class Consistency(RowArrays):
    """State of the tests in each hypothesis."""

    squares: Array
    """Squared errors of the pushing factors at the last steps of the contact, (B, _STEPS, rows) [variances]."""
    inconsistency: Array
    """Factor on the reported covariance of the pose, (B,)."""
    displacement: Array
    """Least displacement of the object since it was last touched [m], (B,)."""
    poses_apart: Array
    """Distance between measured poses and the estimate at the last frames, 0 where they agree, (B, _FRAMES) [m]."""
    outline_apart: Array
    """Distance between measured outline and contact at the last frames, 0 where they agree, (B, _FRAMES) [m]."""
    poses_words: NDArray[np.object_]
    """Description of the last contradiction of a measured pose, (B,)."""
    outline_words: NDArray[np.object_]
    """Description of the last contradiction of a measured outline, (B,)."""

    @staticmethod
    def begin(rows: int) -> "Consistency":
        """Return the state before any test."""
        no_words = np.full(rows, "", object)
        return Consistency(
            np.zeros((rows, _STEPS, 3)),
            np.ones(rows),
            np.zeros(rows),
            np.zeros((rows, _FRAMES)),
            np.zeros((rows, _FRAMES)),
            no_words,
            no_words,
        )

    @property
    def is_displaced(self) -> Flags:
        """True where the object was moved while nothing touched it, (B,)."""
        return np.asarray(self.displacement > 0.0)

    @property
    def contradiction(self) -> Array:
        """Possible error of the pose for contradicting measured poses (B,) [m]."""
        if not (self.poses_apart.any() or self.outline_apart.any()):
            return np.zeros(len(self.poses_apart))
        return np.maximum(_possible_error(self.poses_apart), _possible_error(self.outline_apart))

    def contradiction_in_words(self, row: int) -> str:
        """Return a description of contradicting measured poses; empty if there are none."""
        if _possible_error(self.poses_apart)[row]:
            return self.poses_words[row]
        return self.outline_words[row] if _possible_error(self.outline_apart)[row] else ""

    def without_errors(self) -> "Consistency":
        """Return the state with the errors of a contact forgotten."""
        return replace(self, squares=np.zeros_like(self.squares))

    def found(self) -> "Consistency":
        """Return the state with the object found again."""
        return replace(self, displacement=np.zeros_like(self.displacement))


class ConsistencyMonitor:
    """The tests, for one object and sensor. All methods take and return rows of hypotheses."""

    def __init__(self, model: ContactModel, settings: NoiseSettings) -> None:
        self._model, self._contact_deviation = model, settings.contact.deviation
        self._calibration = np.diag(np.square(settings.sensor_pose.calibration))

    def clearance(self, belief: Belief, sensor_pose: Array) -> tuple[Array, Array]:
        """Return the estimated distance of a sensor pose (3,) from the object and its deviation, (B,) each [m].

        The inconsistency is not included: it concerns pushing, not the last contact.
        """
        gap, by_belief = self._gap(belief, sensor_pose)
        variance = np.einsum("bi,bij,bj->b", by_belief, belief.covariance, by_belief) + self._contact_deviation**2
        return gap, np.sqrt(variance)

    def test_clearance(self, state: Consistency, belief: Belief, sensor_pose: Array) -> Consistency:
        """Test that a sensor that touches nothing is outside the object."""
        gap, deviation = self.clearance(belief, sensor_pose)
        inside = np.where(gap < -_SURPRISE * deviation, -gap, 0.0)
        return replace(state, displacement=np.maximum(state.displacement, inside))

    def test_release(
        self, state: Consistency, belief: Belief, touched_from: Array, sensor_pose: Array, since: float
    ) -> Consistency:
        """Test that a sensor released the object by moving away from its last pose in contact (3,), since a time [s].

        If it moved on into the object without touching it, the object was taken away.
        """
        before, by_before = self._gap(belief, touched_from)
        now, by_now = self._gap(belief, sensor_pose)
        apart = by_now - by_before
        variance = np.einsum("bi,bij,bj->b", apart, belief.covariance, apart)
        deviation = np.sqrt(state.inconsistency * variance + _STILL**2)
        by_hand = min(0.5 * _HAND_REACH, 0.5 * _HAND_SPEED * since)
        gone = np.where(now < before - _SURPRISE * deviation, by_hand, 0.0)
        return replace(state, displacement=np.maximum(state.displacement, gone))

    def test_first_contact(
        self,
        state: Consistency,
        belief: Belief,
        sensor_pose: Array,
        measurements: Sequence[Measurement],
        sign: Array,
        from_touch: int,
    ) -> Consistency:
        """Test that a contact begins where the object's outline is, and with the direction that it has there."""
        gap, deviation = self.clearance(belief, sensor_pose)
        displacement = np.where(np.abs(gap) > _SURPRISE * deviation, np.abs(gap), 0.0)
        displacement = np.maximum(state.displacement, displacement)
        for index, one in enumerate(measurements):
            if isinstance(one, ContactDirection):
                signs = sign if index < from_touch else np.ones_like(sign)
                turns = [self._turn(belief.take([b]), sensor_pose, one, signs[[b]]) for b in range(len(belief))]
                # Half: unlike a gap, which shows one part of a motion, a turn shows all of it.
                displacement = np.maximum(displacement, 0.5 * self._model.friction_radius * np.array(turns))
        return replace(state, displacement=displacement)

    def test_object_poses(
        self,
        state: Consistency,
        belief: Belief,
        expected: Sequence[Array],
        measured: Sequence[ObjectPose],
        moved: float,
    ) -> Consistency:
        """Test measured poses of the object against the estimates (B, 3) at their times.

        Since then the object may have moved by `moved` [m].
        """
        if not measured:
            return state
        known = belief.pose_covariance + self._calibration + self.covariance_of_motion(moved)
        rows = len(belief)
        worst, worst_apart, words = np.zeros(rows), np.zeros(rows), state.poses_words.copy()
        for number, (pose, one) in enumerate(zip(expected, measured, strict=True), 1):
            off = se2.log(se2.between(pose, one.pose))
            inverse = np.linalg.pinv(known + one.covariance, hermitian=True)  # a solution may have diverged
            deviations = np.sqrt(np.maximum(np.einsum("bi,bij,bj->b", off, inverse, off), 0.0))
            apart, turn = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
            for row in np.flatnonzero((deviations > worst) & (deviations > _CONTRADICTS)):
                which = f" {number} of {len(measured)}" if len(measured) > 1 else ""
                words[row] = (
                    f"measured object pose{which} is {1e3 * apart[row]:.0f} mm and {np.degrees(turn[row]):.0f} degrees "
                    f"from the estimate, {deviations[row]:.0f} standard deviations"
                )
            is_worse = deviations > worst
            worst_apart = np.where(is_worse, np.maximum(apart, self._model.friction_radius * turn), worst_apart)
            worst = np.where(is_worse, deviations, worst)
        return replace(state, poses_apart=_with_frame(state.poses_apart, worst_apart, worst), poses_words=words)

    def test_outline(self, state: Consistency, belief: Belief, sensor_pose: Array, is_measured: bool) -> Consistency:
        """Test that the outline is at the contact if the object's pose is measured, or where it was not until now."""
        tested = np.asarray(is_measured | (state.outline_apart > 0.0).any(axis=1))
        if not tested.any():
            return state
        gap, deviation = self.clearance(belief.inflated(self._calibration), sensor_pose)
        apart, deviations, words = np.abs(gap), np.abs(gap) / deviation, state.outline_words.copy()
        for row in np.flatnonzero(tested & (deviations > _CONTRADICTS)):
            words[row] = (
                f"measured object poses put the outline {1e3 * apart[row]:.0f} mm from where the sensor touches it, "
                f"{deviations[row]:.0f} standard deviations"
            )
        longer = _with_frame(state.outline_apart, apart, deviations)
        return replace(state, outline_apart=np.where(tested[:, None], longer, state.outline_apart), outline_words=words)

    def test_innovations(self, state: Consistency, errors: Array, tested: Flags) -> Consistency:
        """Test the errors (B, rows) [standard deviations] of a step's pushing factors, in some rows (B,)."""
        squares = np.concatenate([state.squares[:, 1:], np.square(errors)[:, None]], axis=1)
        worst = squares.sum(axis=1).max(axis=1) / _STEPS
        inflated = np.where(worst > _INCONSISTENT, worst / _TYPICAL, 1.0)
        return replace(
            state,
            squares=np.where(tested[:, None, None], squares, state.squares),
            inconsistency=np.where(tested, np.maximum(state.inconsistency, inflated), state.inconsistency),
        )

    def status(self, state: Consistency, belief: Belief, covariance: Array, in_contact: bool) -> Status:
        """Return the status of the first hypothesis, whose pose has this covariance (3, 3)."""
        if state.contradiction[0]:
            return "strained"
        is_unfound = (np.diagonal(belief.pose_covariance[0]) > _FOUND**2).any()
        if state.is_displaced[0] and (is_unfound or not in_contact):
            return "displaced"
        if is_uncertain(covariance):
            return "uncertain"
        if not in_contact:
            return "resting"
        return "strained" if state.inconsistency[0] > 1.0 else "tracking"

    def covariance(self, state: Consistency, belief: Belief) -> Array:
        """Return the covariances of the pose to report, (B, 3, 3)."""
        inflated = state.inconsistency[:, None, None] * belief.pose_covariance
        return inflated + self._calibration + self.contradiction_covariance(state)

    def contradiction_covariance(self, state: Consistency) -> Array:
        """Return the covariance (B, 3, 3) of a pose that contradicts measured ones."""
        return self.covariance_of_motion(state.contradiction)

    def displacement_covariance(self, state: Consistency) -> Array:
        """Return the covariance (B, 3, 3) of a displacement: twice its size, since a gap shows one direction of it."""
        return self.covariance_of_motion(2.0 * state.displacement)

    def covariance_of_motion(self, length: ArrayLike) -> Array:
        """Return the covariance (..., 3, 3) of an unknown motion of this size (...) [m]."""
        length = np.asarray(length, np.float64)
        sizes = np.stack([length, length, length / self._model.friction_radius], axis=-1)
        return np.square(sizes)[..., None] * np.eye(3)

    def _turn(self, belief: Belief, sensor_pose: Array, measured: ContactDirection, sign: Array) -> float:
        """Return the least turn [rad] that a contact direction shows; 0 if the outline has it near the contact."""
        g, covariance = se2.between(belief.pose[0], sensor_pose), belief.pose_covariance[0]
        touch = self._model.touching(g[None, None])[0, 0]
        along = 1j * touch["normal"]
        by_object = np.array([along.real, along.imag, (along * touch["point"].conjugate()).imag])
        likely = _SURPRISE * np.sqrt(by_object @ covariance @ by_object) * _ALONG
        places = self._model.moved_along(np.tile(g, (len(likely), 1)), likely)
        normals = self._model.touching(places[None])[0]["normal"]
        off = np.angle(-normals * np.exp(1j * (-true_angle(measured, belief, sign)[0] - g[2])))
        deviation = np.sqrt(covariance[2, 2] + self._calibration[2, 2] + measured.variance)
        least = float(np.abs(off).min())
        return least if least > _SURPRISE * deviation else 0.0

    def _gap(self, belief: Belief, sensor_pose: Array) -> tuple[Array, Array]:
        """Return the distance between sensor and object (B,) [m], and its derivative (B, 3 + OBJECT_SIZE) by belief."""
        g = se2.between(belief.pose, sensor_pose)
        nearest = self._model.touching(g[:, None])[:, 0]
        gap, normal = nearest["gap"], nearest["normal"]
        reach = reaches(self._model, nearest["point"] - gap * normal, normal)
        by_object = np.zeros((len(gap), OBJECT_SIZE))
        by_object[:, IN_OBJECT[DEPTH].start], by_object[:, IN_OBJECT[OUTLINE_SCALE].start] = 1.0, -reach
        by_pose = -(nearest["gap_by_g"][:, None] @ se2.adjoint(se2.inverse(g)))[:, 0]
        return gap + overlap(belief, reach), np.concatenate([by_pose, by_object], axis=1)


def is_uncertain(covariance: Array) -> bool:
    """Return True if a covariance (3, 3) of the object's pose is too large to be reliable."""
    return bool((np.diagonal(covariance) > _UNCERTAIN**2).any())


def _possible_error(apart: Array) -> Array:
    """Return the largest distance (B,) [m] of the last frames (B, _FRAMES), or 0 if too few of them contradict."""
    return np.where((apart > 0.0).sum(axis=1) >= _SEVERAL, apart.max(axis=1), 0.0)


def _with_frame(apart: Array, now: Array, deviations: Array) -> Array:
    """Return distances (B, _FRAMES) [m] with those of another frame, which contradict from some deviations on."""
    return np.concatenate([apart[:, 1:], np.where(deviations > _CONTRADICTS, now, 0.0)[:, None]], axis=1)
