"""What is wrong, and how sure the estimate really is: strain, displacement and uncertainty make status and covariance.

- Strain: touch says one thing and the physics of pushing another. It is the mean square, over the last frames, of the
  pushing row that is worst off, in variances. Nothing later measures what has shifted, so the covariance stays larger.
- Displacement: the sensor stands where the untouched object should be, or touches it where it should not be.
- Uncertainty: the covariance is so large that a linearised one is a guess itself.
"""

from collections import deque
from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.belief import Prior
from palpate.estimation.contact_model import ContactModel
from palpate.estimation.unknowns import DEPTH
from palpate.geometry import se2

Array = NDArray[np.float64]
Status = Literal["resting", "tracking", "strained", "uncertain", "displaced", "indeterminate"]
"""What to make of an estimate.

- resting: untouched, so unmoved.
- tracking: all is well.
- strained: what touch says and how things are pushed contradict each other, or did before (a slip, a knock); the
  covariance is larger by as much.
- uncertain: the covariance is so large that it is itself a guess.
- displaced: the object was moved while nothing touched it, and its pose is known no better than the covariance
  says, in this contact and after it.
- indeterminate: the graph could not be solved at this frame and starts anew from the last pose.
"""

STRAIN_FRAMES, STRAIN_EXPECTED, STRAIN_LIMIT = 30, 0.5, 4.0
"""On simulated pushes, which slide, the mean square over so many frames is 0.5 and less nine times in ten and 2 at
most; a knock by hand makes it 70 and more. Beyond the limit touch and pushing contradict each other, and the covariance
is larger by the ratio to what is expected."""
_SURPRISE = 3.0  # standard deviations of a distance from which on an untouched object must have moved
_UNCERTAIN = np.array([0.02, 0.02, 0.2])  # [m, m, rad]


class Diagnosis:
    """Follows what contradicts the graph, from contact to contact."""

    def __init__(self, model: ContactModel, contact_deviation: float) -> None:
        """Take what touches what, and how well outline and gel agree [m]."""
        self._model, self._contact_deviation = model, contact_deviation
        self._errors: deque[Array] = deque(maxlen=STRAIN_FRAMES)
        self._strain = 1.0  # factor on the reported covariance
        self._displacement = 0.0  # [m] by which the object must have moved since it was last touched

    @property
    def displaced(self) -> bool:
        """Whether the object must have moved while nothing touched it."""
        return self._displacement > 0.0

    def see_rest(self, prior: Prior, sensor_pose: Array) -> None:
        """Compare where the sensor (3,) is with an object that nothing touches."""
        gap, deviation = self._gap(prior, sensor_pose)
        if gap < -_SURPRISE * deviation:
            self._displacement = max(self._displacement, -gap)

    def see_first_touch(self, prior: Prior, sensor_pose: Array) -> None:
        """Compare where the sensor (3,) is with an object that it begins to touch."""
        gap, deviation = self._gap(prior, sensor_pose)
        if abs(gap) > _SURPRISE * deviation:
            self._displacement = max(self._displacement, abs(gap))

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
        if self.displaced:
            return "displaced"
        if (np.diagonal(self.covariance(prior)) > _UNCERTAIN**2).any():
            return "uncertain"
        return "strained" if self._strain > 1.0 else "tracking"

    def at_rest(self) -> Status:
        """Return the status of an estimate between contacts."""
        return "displaced" if self.displaced else "resting"

    def covariance(self, prior: Prior) -> Array:
        """Return the covariance (3, 3) to report of what is known."""
        return self._strain * prior.pose_covariance

    def displacement_covariance(self) -> Array:
        """Return that (3, 3) of what may have moved the untouched object: twice what the gap shows along one line."""
        return self.covariance_of_motion(2.0 * self._displacement)

    def covariance_of_motion(self, length: float) -> Array:
        """Return the covariance (3, 3) of an unknown motion of this size [m]."""
        return np.diag(np.square([length, length, length / self._model.friction_radius]))

    def _gap(self, prior: Prior, sensor_pose: Array) -> tuple[float, float]:
        """Estimated distance between sensor and object, and its standard deviation, both [m].

        The strain is left out: it puts pushing in doubt, not where the outline was last touched.
        """
        g = se2.between(prior.pose, sensor_pose)
        tips = self._model.touching(g[None, None])[0, 0]
        nearest = tips[np.argmin(tips["gap"])]
        by_object = -nearest["gap_by_g"] @ se2.adjoint(se2.inverse(g))
        variance = by_object @ prior.pose_covariance @ by_object + self._contact_deviation**2
        return float(nearest["gap"] + prior[DEPTH][0]), float(np.sqrt(variance))
