"""How the particles of the particle filter move over a step: quasi-static pushing, drawn.

The sensor goes to where it was measured to be, up to the noise of that. The object follows: it sticks to the sensor
while the pushing force is inside the friction cone, and slides along it with the force at the cone's edge (Lynch 1992).
What the factors sticking, balance and friction cone leave open is drawn from what they say of it, kernels included.

Contact needs no luck. A step leaves the gap between tip and outline as it was, up to what slipped, for the object is
moved along the outline's normal by what linearising the motion did to it.

Inside, a planar vector is a complex number.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.balance import Balance
from palpate.graph.factors.sticking import Sticking
from palpate.graph.values import ANGLE_STEPS, Values
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO, GRIP, SENSOR, SENSOR_IN_OBJECT

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FARTHEST = 2 * ANGLE_STEPS
"""Steps over which the sensor's motion tells whether the contact sticks; that of one is mostly noise."""
_SMALLEST_LEVER = 0.1  # of the pushing speed along the edge of the cone, below which the contact jams and sticks


class Drawn(NamedTuple):
    """The next step of P particles."""

    g: Array
    """Sensor pose in the object frame, (P, 3) [m, m, rad]."""
    e: Array
    """Sensor pose in the world, (P, 3) [m, m, rad]."""
    errors: dict[str, Array]
    """What the factors that tell strain say is wrong with it, by their names: what was drawn for it, (P, rows)
    [standard deviations]."""


class PushingMotion:
    """Draws where particles go."""

    def __init__(self, settings: NoiseSettings, model: ContactModel, random: np.random.Generator) -> None:
        self._settings, self._model, self._random = settings, model, random
        self._balance = Balance(settings.balance, model)

    def sensors(self, measured: Array, count: int) -> Array:
        """Draw true sensor poses (count, 3) of a measured one (3,)."""
        noise = self._random.normal(size=(count, 3)) * self._settings.sensor_pose.deviation
        return se2.compose(measured, se2.exp(noise))

    def next(self, particles: Values, measured: Sequence[Array]) -> Drawn:
        """Draw the next step of the particles after their last one: the sensor pushes their objects to where it is now.

        measured are the measured sensor poses (3,) of the last steps, the next one last, FARTHEST steps back at most.
        """
        settings, model, count = self._settings, self._model, particles.smoothers
        e = self.sensors(measured[-1], count)
        # All vectors are in the object frame before the step.
        g, e_before = particles[SENSOR_IN_OBJECT][:, -1], particles[SENSOR][:, -1]
        touch = model.touching(np.ascontiguousarray(g[:, None]))[:, 0]
        inward, material = -touch["normal"], touch["material"]
        c_squared = model.friction_radius**2 * np.exp(particles[FRICTION_RATIO][0])
        center = model.friction_center + model.friction_radius * _complex(particles[FRICTION_CENTER].T)
        arm = touch["point"] - center
        stiffness = c_squared + np.abs(arm) ** 2

        # What pushing leaves open: how far the contact creeps, how far force and torque are off balance, and the edge.
        moved, cone = _way(measured), settings.friction_cone
        creep = student(self._random, count, 2, settings.sticking.kernel)
        off_balance = student(self._random, count, 1, settings.balance.kernel)
        imbalance = self._balance.deviation(moved) * off_balance[:, 0]
        aside = (cone.share or 0.0) * student(self._random, count, 1, cone.kernel)[:, 0]

        # Does it stick? Then v + i omega arm = push and arm x v = c^2 omega, and the force points along v.
        in_object = np.exp(1j * (g[:, 2] - e_before[:, 2]))
        smooth = in_object * _moved(measured[0], measured[-1], material)
        stuck = smooth - 1j * arm * _cross(arm, smooth) / stiffness
        angle = np.angle(stuck * np.conj(inward))
        edge = np.arctan(np.maximum(particles[GRIP][0], 0.0)) + aside
        force = inward * np.exp(1j * np.sign(angle) * edge)
        lever = _dot(inward, force + 1j * arm * _cross(arm, force) / c_squared)
        slides = (_dot(inward, smooth) > 0.0) & (np.abs(angle) > edge) & (lever > _SMALLEST_LEVER)
        slides &= cone.share is not None
        creep[slides] = 0.0
        slip = self._slide(moved) * _complex(creep)

        push = in_object * _moved(e_before, e, material) + slip
        omega = (_cross(arm, push) - imbalance) / stiffness
        motion = push - 1j * omega * arm
        # If not, the force is at the edge of the cone and the outline keeps up with the sensor only along its normal.
        along = force * _dot(inward, push + 1j * arm * imbalance / c_squared) / np.where(slides, lever, 1.0)
        omega = np.where(slides, (_cross(arm, along) - imbalance) / c_squared, omega)
        motion = np.where(slides, along, motion)

        place = center + motion - np.exp(1j * omega) * center
        object_before = se2.compose(e_before, se2.inverse(g))
        object_now = se2.compose(object_before, np.stack([place.real, place.imag, omega], axis=-1))
        g_now = self._with_gap(se2.between(object_now, e), touch["gap"] + _dot(inward, slip))
        return Drawn(g_now, e, {Sticking.name: creep, Balance.name: off_balance})

    def _with_gap(self, g: Array, gap: Array) -> Array:
        """Return poses (P, 3) moved along the outline's normal to where the gap (P,) [m] is what it should be."""
        touch = self._model.touching(np.ascontiguousarray(g[:, None]))[:, 0]
        back = (touch["gap"] - gap) * touch["normal"]
        return g - np.stack([back.real, back.imag, np.zeros(len(g))], axis=-1)

    def _slide(self, moved: float) -> float:
        """Standard deviation of how far a contact that holds slides while the sensor moves so far [m]."""
        sticking = self._settings.sticking
        return float(np.hypot(sticking.still, sticking.share * moved))


def student(random: np.random.Generator, count: int, size: int, kernel: float | None) -> Array:
    """Draw (count, size) from what a Cauchy kernel of this scale on `size` rows together makes of a unit Gaussian.

    `exp(-rho) = (1 + s / k^2)^(-k^2 / 2)` is Student's distribution with k^2 - size degrees of freedom, if that many.
    """
    drawn = random.normal(size=(count, size))
    if kernel is not None:
        freedom = max(kernel**2 - size, 1.0)
        drawn *= kernel / np.sqrt(random.chisquare(freedom, size=(count, 1)))
    return drawn


def _way(measured: Sequence[Array]) -> float:
    """How far the sensor moved in the last step [m]."""
    return float(np.hypot(*(measured[-1] - measured[-2])[:2]))


def _moved(before: Array, after: Array, point: Complex) -> Complex:
    """How far a point of the sensor frame moved in the world, (P,), from one sensor pose (P, 3) or (3,) to another."""
    turned = np.exp(1j * after[..., 2]) - np.exp(1j * before[..., 2])
    return _complex(after) - _complex(before) + turned * point


def _complex(vectors: Array) -> Complex:
    """The first two numbers of each row as a complex number, (..., 2 or more) to (...)."""
    return vectors[..., 0] + 1j * vectors[..., 1]


def _cross(a: Complex, b: Complex) -> Array:
    return (np.conj(a) * b).imag


def _dot(a: Complex, b: Complex) -> Array:
    return (np.conj(a) * b).real
