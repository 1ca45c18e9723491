"""What is wrong, and how sure the estimate really is: what contradicts, moves and hides makes status and covariance.

- Strain: touch says one thing and the physics of pushing another. It is the mean square, over the last frames, of the
  pushing row that is worst off, in variances. Nothing later measures what has shifted, so the covariance stays larger.
- Contradiction: measured poses of the object are far from where it is known to be, or put its outline far from where
  the sensor touches it. The covariance is larger by as much.
- Displacement: the sensor stands where the untouched object should be, or touches it where it should not be.
- Uncertainty: the covariance is so large that a linearised one is a guess itself.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.filter.belief import Prior
from palpate.filter.contradiction import Contradiction
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.contact import overlap, reaches
from palpate.graph.factors.direction import true_angle
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE, OUTLINE_SCALE
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose

Array = NDArray[np.float64]
Status = Literal["resting", "tracking", "ambiguous", "strained", "uncertain", "displaced", "indeterminate", "faulty"]
"""What to make of an estimate.

- resting: untouched, so unmoved.
- tracking: all is well.
- ambiguous: several poses far apart fit what was measured; the covariance spans them.
- strained: what touch says and how things are pushed contradict each other, or did before (a slip, a knock), or
  measured poses of the object contradict what else is known; the covariance is larger by as much.
- uncertain: the covariance is so large that it is itself a guess, or touch cannot tell anything yet.
- displaced: the object was moved while nothing touched it, and its pose is known no better than the covariance
  says, in this contact and after it.
- indeterminate: the graph could not be solved at this frame and starts anew from the last pose.
- faulty: what arrives from the sensor or the robot cannot be so, and the reason says what.
"""

STRAIN_FRAMES, STRAIN_EXPECTED, STRAIN_LIMIT = 30, 0.5, 4.0
"""On simulated pushes, which slide, the mean square over so many frames is 0.5 and less nine times in ten and 2 at
most; a knock by hand makes it 70 and more. Beyond the limit touch and pushing contradict each other, and the covariance
is larger by the ratio to what is expected."""
_SURPRISE = 3.0  # standard deviations of a distance from which on an untouched object must have moved
_STILL = 3e-4  # [m] noise of a distance that the sensor has gone
_HAND_SPEED, _HAND_REACH = 0.3, 0.02  # [m/s], [m] how fast and far a hand moves an object, standard deviations
_FOUND = np.array([0.005, 0.005, 0.1])  # [m, m, rad] from which a displaced object is found again
_ALONG = np.linspace(-1.0, 1.0, 7)  # shares of the likely length along an outline at which its direction is looked at
UNCERTAIN = np.array([0.02, 0.02, 0.2])
"""Standard deviations [m, m, rad] from which a covariance is a guess itself."""
REASONS: dict[Status, str] = {
    "resting": "",
    "tracking": "",
    "ambiguous": "several poses fit what was measured",
    "strained": "touch and pushing contradict each other, or did before",
    "uncertain": "the pose is known so roughly that the covariance is a guess itself",
    "displaced": "the object was moved while nothing touched it",
    "indeterminate": "the graph could not be solved and began anew",
    "faulty": "what arrives cannot be so",
}
"""What each status means, in words for those who read it beside an estimate."""


class Diagnosis:
    """Follows what contradicts the graph, from contact to contact."""

    def __init__(self, model: ContactModel, contact_deviation: float, calibration: Sequence[float]) -> None:
        """Take what touches what, how well outline and gel agree [m] and how well frames do [m, m, rad]."""
        self._model, self._contact_deviation = model, contact_deviation
        self._calibration = np.diag(np.square(calibration))
        self._errors: deque[Array] = deque(maxlen=STRAIN_FRAMES)
        self._strain = 1.0  # factor on the reported covariance
        self._displacement = 0.0  # [m] by which the object must have moved since it was last touched
        self._of_poses = self._of_outline = Contradiction()

    def __copy__(self) -> "Diagnosis":
        other = object.__new__(Diagnosis)
        other.__dict__.update(self.__dict__)
        other._errors = self._errors.copy()
        return other

    @property
    def displaced(self) -> bool:
        """Whether the object must have moved while nothing touched it."""
        return self._displacement > 0.0

    def gap(self, prior: Prior, sensor_pose: Array) -> tuple[float, float]:
        """Return the estimated distance between sensor (3,) and object, and its standard deviation, both [m].

        The strain is left out: it puts pushing in doubt, not where the outline was last touched.
        """
        gap, by_prior = self._seen_gap(prior, sensor_pose)
        variance = by_prior @ prior.covariance @ by_prior + self._contact_deviation**2
        return gap, float(np.sqrt(variance))

    def see_rest(self, prior: Prior, sensor_pose: Array) -> None:
        """Compare where the sensor (3,) is with an object that nothing touches."""
        gap, deviation = self.gap(prior, sensor_pose)
        if gap < -_SURPRISE * deviation:
            self._displacement = max(self._displacement, -gap)

    def see_after_touch(self, prior: Prior, touched_from: Array, sensor_pose: Array, since: float) -> None:
        """Compare where the sensor (3,) is with where it was (3,) when it last touched the object, since a time [s].

        A sensor that goes on into the object and does not touch it has not let go of it: the object went away.
        """
        (before, by_before), (now, by_now) = (self._seen_gap(prior, pose) for pose in (touched_from, sensor_pose))
        apart = by_now - by_before
        deviation = np.sqrt(self._strain * apart @ prior.covariance @ apart + _STILL**2)
        if now < before - _SURPRISE * deviation:
            self._displacement = max(self._displacement, min(0.5 * _HAND_REACH, 0.5 * _HAND_SPEED * since))

    def see_first_touch(self, prior: Prior, sensor_pose: Array, measurements: Sequence[Measurement]) -> None:
        """Compare where the sensor (3,) is, and where it is touched, with an object that it begins to touch."""
        gap, deviation = self.gap(prior, sensor_pose)
        if abs(gap) > _SURPRISE * deviation:
            self._displacement = max(self._displacement, abs(gap))
        for said in measurements:
            if isinstance(said, ContactDirection):
                # Half, for the gap shows one part of a motion, and a turn shows all of it.
                moved = 0.5 * self._model.friction_radius * self._turn(prior, sensor_pose, said)
                self._displacement = max(self._displacement, moved)

    def see_object_poses(self, prior: Prior, measured: Sequence[tuple[Array, ObjectPose]], moved: float) -> None:
        """Compare measured poses of the object with what is known without them.

        Each comes with where the object was thought to be at its time (3,); it may have moved by so much since [m].
        """
        if not measured:
            return
        known = prior.pose_covariance + self._calibration + self.covariance_of_motion(moved)
        worst = 0.0, 0.0, ""
        for number, (pose, one) in enumerate(measured, 1):
            off = se2.log(se2.between(pose, one.pose))
            apart = off @ np.linalg.pinv(known + one.covariance, hermitian=True) @ off  # a solution may have run away
            deviations = float(np.sqrt(max(apart, 0.0)))
            if deviations > worst[1]:
                far, turn = float(np.hypot(*off[:2])), abs(float(off[2]))
                which = f" {number} of {len(measured)}" if len(measured) > 1 else ""
                said = (
                    f"measured object pose{which} is {1e3 * far:.0f} mm and {np.degrees(turn):.0f} degrees from the "
                    f"estimate, {deviations:.0f} standard deviations"
                )
                worst = max(far, self._model.friction_radius * turn), deviations, said
        self._of_poses = self._of_poses.compared(*worst)

    def see_touched_outline(self, prior: Prior, sensor_pose: Array, is_measured: bool) -> None:
        """Compare where the sensor (3,) touches the object with its outline, where its pose is measured, too.

        What once contradicted is compared until it does so no longer.
        """
        if is_measured or any(self._of_outline.apart):
            gap, deviation = self.gap(prior.loosened(self._calibration), sensor_pose)
            deviations = abs(gap) / deviation
            said = (
                f"measured object poses put the outline {1e3 * abs(gap):.0f} mm from where the sensor touches it, "
                f"{deviations:.0f} standard deviations"
            )
            self._of_outline = self._of_outline.compared(abs(gap), deviations, said)

    @property
    def contradiction(self) -> str:
        """What measured poses of the object contradict, in words; empty where they contradict nothing."""
        found = self._of_poses if self._of_poses.doubt else self._of_outline
        return found.said if found.doubt else ""

    def contradiction_covariance(self) -> Array:
        """Return that (3, 3) of how far the object may be from where it is thought to be for such a contradiction."""
        return self.covariance_of_motion(max(self._of_poses.doubt, self._of_outline.doubt))

    def see_errors(self, errors: Mapping[str, Array]) -> None:
        """Take the errors (rows,) of a step's factors that tell strain [standard deviations]."""
        if not errors:
            return
        self._errors.append(np.square(np.concatenate(list(errors.values()))))
        strain = float(np.max(np.sum(self._errors, axis=0))) / STRAIN_FRAMES
        if strain > STRAIN_LIMIT:
            self._strain = max(self._strain, strain / STRAIN_EXPECTED)

    def forget_errors(self) -> None:
        """Begin to count strain anew: a contact ended, or its graph begins anew."""
        self._errors.clear()

    def forget_displacement(self) -> None:
        """The object was found again."""
        self._displacement = 0.0

    def in_contact(self, prior: Prior) -> Status:
        """Return the status of an estimate in contact."""
        if self.contradiction:
            return "strained"
        if self.displaced and (np.diagonal(prior.pose_covariance) > _FOUND**2).any():
            return "displaced"
        if is_uncertain(self.covariance(prior)):
            return "uncertain"
        return "strained" if self._strain > 1.0 else "tracking"

    def at_rest(self, prior: Prior) -> Status:
        """Return the status of an estimate between contacts."""
        if self.contradiction:
            return "strained"
        if self.displaced:
            return "displaced"
        return "uncertain" if is_uncertain(self.covariance(prior)) else "resting"

    def covariance(self, prior: Prior) -> Array:
        """Return the covariance (3, 3) to report of what is known."""
        return self._strain * prior.pose_covariance + self._calibration + self.contradiction_covariance()

    def displacement_covariance(self) -> Array:
        """Return that (3, 3) of what may have moved the untouched object: twice what the gap shows along one line."""
        return self.covariance_of_motion(2.0 * self._displacement)

    def covariance_of_motion(self, length: float) -> Array:
        """Return the covariance (3, 3) of an unknown motion of this size [m]."""
        return np.diag(np.square([length, length, length / self._model.friction_radius]))

    def _turn(self, prior: Prior, sensor_pose: Array, said: ContactDirection) -> float:
        """How far the object must have turned [rad] to be touched where it is said to be; 0 where it need not have.

        It need not have where it would be touched so at a place on its outline that is likely.
        """
        g = se2.between(prior.pose, sensor_pose)
        covariance = prior.pose_covariance
        touch = self._model.touching_at(g)
        along = 1j * touch["normal"]
        by_object = np.array([along.real, along.imag, (along * touch["point"].conjugate()).imag])
        likely = _SURPRISE * np.sqrt(by_object @ covariance @ by_object) * _ALONG
        places = self._model.moved_along(np.tile(g, (len(likely), 1)), likely)
        normals = self._model.touching(places[None])[0]["normal"]
        off = np.angle(-normals * np.exp(1j * (-true_angle(said, prior) - g[2])))
        deviation = np.sqrt(covariance[2, 2] + self._calibration[2, 2] + said.variance)
        least = float(np.abs(off).min())
        return least if least > _SURPRISE * deviation else 0.0

    def _seen_gap(self, prior: Prior, sensor_pose: Array) -> tuple[float, Array]:
        """Estimated distance between sensor and object [m], and its derivative by what is known (3 + OBJECT_SIZE,)."""
        g = se2.between(prior.pose, sensor_pose)
        nearest = self._model.touching_at(g)
        gap, normal = nearest["gap"], nearest["normal"]
        reach = reaches(self._model, nearest["point"] - gap * normal, normal)
        by_object = np.zeros(OBJECT_SIZE)
        by_object[IN_OBJECT[DEPTH]], by_object[IN_OBJECT[OUTLINE_SCALE]] = 1.0, -reach
        by_pose = -nearest["gap_by_g"] @ se2.adjoint(se2.inverse(g))
        return float(gap + overlap(prior, reach)), np.concatenate([by_pose, by_object])


def is_uncertain(covariance: Array) -> bool:
    """Return whether a covariance (3, 3) of the object's pose is so large that it is a guess itself."""
    return bool((np.diagonal(covariance) > UNCERTAIN**2).any())
