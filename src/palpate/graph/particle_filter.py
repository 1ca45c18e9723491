"""A particle filter on what the graph's factors know: what users would otherwise take, to compare the smoothers with.

A particle is a sensor pose in the object frame g, a sensor pose e, what lasts from contact to contact and the offset of
the turns. It moves by quasi-static pushing: the contact sticks inside the friction cone and slides at its edge (Lynch
1992), with what the pushing factor leaves open drawn anew at each step. Then it is weighed by all that is measured.

What keeps it from degenerating:

- Contact needs no luck. A step leaves the gap as it was, up to what slipped, for the object is moved along the
  outline's normal by what linearising the motion did to it; only gaps of a contact's first step are drawn blindly.
- There the draws are ten times as many, of which as many particles as usual are kept.
- What lasts cannot be drawn anew, so a resampled particle gets it with some noise, its mean and covariance kept
  (Liu and West 2001).

It forgets nothing but does not look back: a pose that later measurements would correct stays as it was.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph import factors
from palpate.graph.factors import ContactModel, as_complex, cross, position, touching
from palpate.graph.noise import GraphNoise
from palpate.graph.pushing import ANGLE_STEPS
from palpate.graph.smoother import DEPTH, FRICTION, LASTING, Belief, Known, check_tips
from palpate.recording.measurements import Feeling, RelativePoses

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

PARTICLES = 1000
CANDIDATES = 10
"""Draws for each particle at the first step of a contact."""
HISTORY = 40
"""Steps that pairs may reach, this one included, as far back as touch compares images."""
SHRINK = 0.98
"""Share of its distance from the mean that what lasts keeps when resampled; noise makes up for the rest."""

_MOTIONS = 2 * ANGLE_STEPS  # steps over which the sensor's motion tells whether the contact sticks; one is mostly noise
_SMALLEST_LEVER = 0.1  # of the pushing speed along the edge of the cone, below which the contact jams and sticks
_FLOOR = 1e-6  # share of each variance that is added, so that few distinct particles leave no singular covariance
_LEAST = -700.0  # a logarithm whose exponential is hardly above 0


@dataclass(frozen=True)
class Particles:
    """P guesses, one a row."""

    g: Array
    """Sensor pose in the object frame, of the last H steps (P, H, 3) [m, m, rad]."""
    e: Array
    """Sensor pose in the world, (P, 3) [m, m, rad]."""
    lasting: Array
    """(P, LASTING)"""
    offset: Array
    """Of the turns, (P,) [rad]; NaN before the first one."""
    slip: Array
    """What the pushing factor's rows were in the last step (P, 4) [standard deviations]."""

    def __getitem__(self, rows: NDArray[np.int_]) -> "Particles":
        return Particles(*(getattr(self, field.name)[rows] for field in fields(self)))


class ParticleFilter:
    """A filter by particles; the cost of a step does not depend on the length of the contact.

    Raises EstimationError at a step whose measurements no particle explains with a likelihood above 0: pairs of images
    can bring that about, while a direction, turn or contact far off is let go by its kernel.
    """

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise, seed: int = 0, count: int = PARTICLES) -> None:
        self._tips, self._noise, self._count = tips, noise, count
        self._random = np.random.default_rng(seed)

    def begin(self, sensor_pose: Array, known: Known, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        count = CANDIDATES * self._count
        root = np.linalg.cholesky(known.covariance)
        drawn = self._random.normal(size=(count, len(root))) @ root.T
        e = self._sensed(sensor_pose, count)
        g = se2.between(se2.compose(known.pose, se2.exp(drawn[:, :3])), e)
        lasting = known.lasting + drawn[:, 3:]
        self._measured: deque[Array] = deque([sensor_pose], maxlen=_MOTIONS + 1)
        self._path: list[Belief] = []
        self._weight = np.full(count, 1.0 / count)
        self._particles = Particles(g[:, None], e, lasting, np.full(count, np.nan), np.zeros((count, 4)))
        self._weigh(feeling)
        self._resample()
        self._believe()

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        if 1.0 / np.sum(self._weight**2) < 0.5 * self._count:
            self._resample()
        self._measured.append(sensor_pose)
        before = self._particles
        e = self._sensed(sensor_pose, self._count)
        g, slip = self._along(e) if len(self._tips) > 1 else self._pushed(e, self._tips[0])
        history = np.concatenate([before.g[:, 1 - HISTORY :], g[:, None]], axis=1)
        self._particles = Particles(history, e, before.lasting, before.offset, slip)
        self._weigh(feeling)
        self._believe()

    def belief(self) -> Belief:
        """See Smoother; the particles' mean and covariance."""
        return self._path[-1]

    def pushing_error(self) -> Array:
        """See Smoother; the mean of what the particles drew, which the measurements of the step alone shift from 0."""
        return np.abs(self._weight @ self._particles.slip)

    def path(self) -> tuple[Array, Array]:
        """See Smoother; all steps as they were estimated at the time, for a filter does not smooth."""
        return np.array([belief.g for belief in self._path]), np.array([belief.e for belief in self._path])

    def _sensed(self, sensor_pose: Array, count: int) -> Array:
        """Draw true sensor poses (count, 3)."""
        return se2.compose(sensor_pose, se2.exp(self._random.normal(size=(count, 3)) * self._noise.sensor))

    def _along(self, e: Array) -> tuple[Array, Array]:
        """Move the particles' objects along with several tips, which hold them: g (P, 3) and slip (P, 4)."""
        slide, _ = self._spreads()
        centers = np.array([tip.center for tip in self._tips])
        apart = 0.5 * np.hypot(*np.ptp(centers, axis=0))
        slip = np.zeros((len(e), 4))
        drawn = _student(self._random, len(e), 3, self._noise.sticking_kernel)
        slip[:, :2] = drawn[:, :2]
        return se2.compose(self._particles.g[:, -1], se2.exp(drawn * slide / [1.0, 1.0, apart])), slip

    def _pushed(self, e: Array, tip: ContactModel) -> tuple[Array, Array]:
        """Push the particles' objects to where the sensor is now: g (P, 3) and slip (P, 4).

        All vectors are complex and in the object frame before the step.
        """
        before, noise = self._particles, self._noise
        g = before.g[:, -1]
        touch = touching(g, tip)
        inward, material = -touch.normal, touch.material
        ratio, aside_x, aside_y, grip = before.lasting[:, FRICTION].T
        c_squared = tip.friction_radius**2 * np.exp(ratio)
        middle = complex(*tip.friction_center) + tip.friction_radius * (aside_x + 1j * aside_y)
        arm = touch.point - middle

        slide, torque = self._spreads()
        slip = np.empty((len(e), 4))
        slip[:, :2] = _student(self._random, len(e), 2, noise.sticking_kernel)
        slip[:, 2:] = np.column_stack([_student(self._random, len(e), 1, noise.turning_kernel) for _ in range(2)])
        in_object = np.exp(1j * (g[:, 2] - before.e[:, 2]))
        push = in_object * _moved(before.e, e, material) + slide * as_complex(slip)
        imbalance = torque * slip[:, 2]

        # Does it stick? Then v + i omega arm = push and arm x v = c^2 omega, and the force points along v.
        smooth = in_object * _moved(self._measured[0], self._measured[-1], material)
        stuck = smooth - 1j * arm * cross(arm, smooth) / (c_squared + np.abs(arm) ** 2)
        angle = np.angle(stuck * np.conj(inward))
        edge = np.arctan(np.maximum(grip, 0.0)) + (noise.cone_share or 0.0) * slip[:, 3]
        force = inward * np.exp(1j * np.sign(angle) * edge)
        lever = _dot(inward, force + 1j * arm * cross(arm, force) / c_squared)
        pushing = _dot(inward, smooth) > 0.0
        slides = pushing & (np.abs(angle) > edge) & (lever > _SMALLEST_LEVER) & (noise.cone_share is not None)

        omega = (cross(arm, push) - imbalance) / (c_squared + np.abs(arm) ** 2)
        motion = push - 1j * omega * arm
        # If not, the force is at the edge of the cone and the outline keeps up with the sensor only along its normal.
        along = force * _dot(inward, push + 1j * arm * imbalance / c_squared) / np.where(slides, lever, 1.0)
        omega = np.where(slides, (cross(arm, along) - imbalance) / c_squared, omega)
        motion = np.where(slides, along, motion)
        slip[slides, :2] = 0.0
        slip[~slides, 3] = 0.0

        place = middle + motion - np.exp(1j * omega) * middle
        step = np.stack([place.real, place.imag, omega], axis=-1)
        objects = se2.compose(before.e, se2.inverse(g))
        g_next = se2.between(se2.compose(objects, step), e)
        after = touching(g_next, tip)
        back = (after.gap - touch.gap - slide * _dot(-inward, as_complex(slip))) * after.normal
        g_next[:, 0] -= back.real
        g_next[:, 1] -= back.imag
        return g_next, slip

    def _spreads(self) -> tuple[float, float]:
        """Standard deviations of slip [m] and of the imbalance of force and torque [m^2] in the last step."""
        noise = self._noise
        moved = float(np.hypot(*(self._measured[-1] - self._measured[-2])[:2]))
        slide = float(np.hypot(noise.sticking, noise.sticking_share * moved))
        torque = float(np.hypot(noise.turning, noise.turning_share * moved * self._tips[0].friction_radius))
        return slide, torque

    def _weigh(self, feeling: Feeling) -> None:
        """Multiply the weights by the likelihood of all that is measured at the last step."""
        particles, noise = self._particles, self._noise
        g = particles.g[:, -1]
        cost = np.zeros(len(g))
        touches = [touching(g, tip) for tip in self._tips]
        for touch in touches:
            gap = touch.gap + particles.lasting[:, DEPTH]
            cost += _cost(gap, noise.contact_weight(0.0 * gap), noise.contact_weight(gap))
        if (direction := feeling.direction) is not None:
            residual = factors.direction(touches[0], direction.angle, particles.lasting[:, 0])[0][:, 0]
            cost += self._feeling_cost(residual, 1.0 / (direction.variance * noise.direction_share))
        if (turn := feeling.turn) is not None:
            if np.isnan(particles.offset[0]):
                # Nothing is known of it, so that the first turn says what it is and nothing of the pose.
                drawn = np.sqrt(turn.variance * noise.turn_share) * self._random.normal(size=len(g))
                particles.offset[:] = g[:, 2] - turn.angle - drawn
            else:
                residual = factors.turn(g, particles.offset, turn.angle)[0][:, 0]
                cost += self._feeling_cost(residual, 1.0 / (turn.variance * noise.turn_share))
        if feeling.relative is not None:
            cost += _pair_cost(particles.g, feeling.relative)
        log_weight = np.log(np.maximum(self._weight, np.finfo(float).tiny)) - cost
        best = log_weight.max()
        if not (np.isfinite(g).all() and cost.min() < -_LEAST and np.isfinite(best)):
            raise EstimationError("no particle explains what is measured")
        weight = np.exp(log_weight - best)
        self._weight = weight / weight.sum()

    def _feeling_cost(self, residual: Array, information: float) -> Array:
        return _cost(residual, np.full_like(residual, information), self._noise.feeling_weight(residual, information))

    def _resample(self) -> None:
        """Draw `count` particles by their weights, and what lasts with noise that keeps its mean and covariance."""
        particles = self._particles[systematic(self._weight, self._count, self._random)]
        self._weight = np.full(self._count, 1.0 / self._count)
        shared = np.column_stack([particles.lasting, particles.offset])
        known = slice(0, LASTING + (not np.isnan(shared[0, -1])))
        mean = shared[:, known].mean(axis=0)
        apart = shared[:, known] - mean
        values, axes = np.linalg.eigh(apart.T @ apart / self._count)
        drawn = self._random.normal(size=apart.shape) * np.sqrt(np.maximum(values, 0.0) * (1.0 - SHRINK**2))
        shared[:, known] = mean + SHRINK * apart + drawn @ axes.T
        self._particles = Particles(particles.g, particles.e, shared[:, :-1], shared[:, -1], particles.slip)

    def _believe(self) -> None:
        """Take mean and covariance of the particles.

        They are of the object's pose, which is what is asked for, and carried over to g.
        """
        particles, weight = self._particles, self._weight
        objects = se2.compose(particles.e, se2.inverse(particles.g[:, -1]))
        pose, e = _mean(objects, weight), _mean(particles.e, weight)
        g, lasting = se2.between(pose, e), weight @ particles.lasting
        of_object, of_sensor = se2.log(se2.between(pose, objects)), se2.log(se2.between(e, particles.e))
        # g exp(d_g) = exp(-d_o) pose^-1 e exp(d_e)
        of_g = of_sensor - of_object @ se2.adjoint(se2.inverse(g)).T
        apart = np.concatenate([of_g, of_sensor, particles.lasting - lasting], axis=-1)
        apart -= weight @ apart
        covariance = (apart * weight[:, None]).T @ apart
        covariance[np.diag_indices_from(covariance)] += _FLOOR * np.diagonal(covariance) + 1e-24
        self._path.append(Belief(g, e, lasting, covariance))


def systematic(weight: Array, count: int, random: np.random.Generator) -> NDArray[np.int_]:
    """Return count rows (count,) drawn by weights (P,) of sum 1, each floor or ceiling of count times its weight."""
    places = (np.arange(count) + random.uniform()) / count
    return np.minimum(np.searchsorted(np.cumsum(weight), places, side="right"), len(weight) - 1)


def _student(random: np.random.Generator, count: int, size: int, kernel: float | None) -> Array:
    """Draw (count, size) from what a Cauchy kernel of this scale on `size` rows together makes of a unit Gaussian.

    `exp(-rho) = (1 + s / k^2)^(-k^2 / 2)` is Student's distribution with k^2 - size degrees of freedom, if that many.
    """
    drawn = random.normal(size=(count, size))
    if kernel is not None:
        freedom = max(kernel**2 - size, 1.0)
        drawn *= kernel / np.sqrt(random.chisquare(freedom, size=(count, 1)))
    return drawn if size > 1 else drawn[:, 0]


def _cost(residual: Array, information: Array, weight: Array) -> Array:
    """What a residual (P,) adds to the negative logarithm of the likelihood (P,).

    With q the ratio of the inverse variances without and with the Cauchy kernel, which is 1 + s / k^2 for s the squared
    residual in variances, k^2 / 2 log(1 + s / k^2) is s / 2 log(q) / (q - 1); without a kernel it is s / 2.
    """
    less = information / weight - 1.0
    return 0.5 * information * residual**2 * np.where(less > 1e-12, np.log1p(less) / np.maximum(less, 1e-12), 1.0)


def _pair_cost(history: Array, relative: RelativePoses) -> Array:
    """The same (P,) for pairs with earlier steps of the history (P, H, 3), as far as it reaches."""
    kept = relative.back < history.shape[1]
    predicted = se2.between(history[:, -1 - relative.back[kept]], history[:, -1:])
    residual = se2.log(se2.between(relative.pose[kept], predicted))
    return 0.5 * np.einsum("pbi,bij,pbj->p", residual, np.linalg.inv(relative.covariance[kept]), residual)


def _moved(before: Array, after: Array, point: Complex) -> Complex:
    """How far a point of the sensor frame moved in the world, (P,), from one sensor pose (P, 3) or (3,) to another."""
    turned = np.exp(1j * after[..., 2]) - np.exp(1j * before[..., 2])
    return position(after) - position(before) + turned * point


def _mean(poses: Array, weight: Array) -> Array:
    """Weighted mean (3,) of poses (P, 3), circular in yaw."""
    x, y = weight @ poses[:, :2]
    return np.array([x, y, np.angle(weight @ np.exp(1j * poses[:, 2]))])


def _dot(a: Complex, b: Complex) -> Array:
    return (np.conj(a) * b).real
