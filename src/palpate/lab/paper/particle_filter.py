"""A particle filter on what the graph's factors know: what users would otherwise take, to compare the smoothers with.

A particle is a guess of all unknowns. It moves as `pushing_motion` draws it, which stands for the factors that say how
things move. Then it is weighed by the terms that arrive with the step, under all other factors, none known by name.

What keeps it from degenerating:

- A step needs no luck to stay in contact; see `pushing_motion`. Only gaps of a contact's first step are drawn blindly.
- There the draws are ten times as many, of which as many particles as usual are kept.
- What steps share cannot be drawn anew, so a resampled particle gets it with some noise, its mean and covariance kept
  (Liu and West 2001).

It does not look back: a pose that later measurements would correct stays as it was.
"""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings
from palpate.errors import EstimationError
from palpate.filter.belief import Belief, Prior
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.evidence import add_costs
from palpate.graph.factors.factor import Factor, Rows, Step, Terms
from palpate.graph.values import Values
from palpate.graph.variables import (
    CONTACT_SIZE,
    IN_SHARED,
    LAG,
    OF_CONTACT,
    OF_STEP,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED_SIZE,
    Unknown,
)
from palpate.lab.paper.pushing_motion import FARTHEST, PushingMotion
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]

PARTICLES = 1000
CANDIDATES = 10
"""Draws for each particle at the first step of a contact."""
SHRINK = 0.98
"""Share of its distance from the mean that what is shared keeps when resampled; noise makes up for the rest."""

_FLOOR = 1e-6  # share of each variance that is added, so that few distinct particles leave no singular covariance
_WORST = 700.0  # the exponential of its negative is hardly above 0


class ParticleFilter:
    """A filter by particles of one contact; see Smoother. A step costs the same however long the contact.

    Raises EstimationError at a step whose measurements no particle explains with a likelihood above 0: pairs of images
    can bring that about, while a direction, turn or contact far off is let go by its kernel.
    """

    def __init__(
        self,
        factors: Sequence[Factor],
        settings: NoiseSettings,
        model: ContactModel,
        prior: Prior,
        sensor_pose: Array,
        measurements: Sequence[Measurement],
        time: float,
        random: np.random.Generator,
        count: int = PARTICLES,
    ) -> None:
        """Begin with the first frame of a contact and what is known of the object."""
        self._factors, self._random, self._count = factors, random, count
        self._motion = PushingMotion(settings, model, random)
        self._measured: deque[Array] = deque([sensor_pose], maxlen=FARTHEST + 1)
        self._times: deque[float] = deque([time], maxlen=LAG)
        self._begun: set[Factor] = set()  # whose first terms have come
        self._errors: dict[str, Array] = {}
        self._path: list[Belief] = []
        arrived = self._terms(Step(sensor_pose, None, measurements, [time]))
        self._particles = self._drawn(model, prior, sensor_pose, CANDIDATES * count)
        self._weight = np.full(CANDIDATES * count, 1.0 / (CANDIDATES * count))
        self._weigh(arrived)
        self._resample()
        self._path.append(belief_of(self._particles, self._weight))

    def add(self, sensor_pose: Array, measurements: Sequence[Measurement] = (), time: float = 0.0) -> None:
        """See Smoother."""
        step = Step(sensor_pose, self._measured[-1], measurements, [*self._times, time][-LAG:])
        arrived = self._terms(step)  # before anything changes: factors may refuse
        self._times.append(time)
        self._measured.append(sensor_pose)
        if 1.0 / np.sum(self._weight**2) < 0.5 * self._count:
            self._resample()
        self._move()
        self._weigh(arrived)
        self._path.append(belief_of(self._particles, self._weight))

    def belief(self) -> Belief:
        """See Smoother; the particles' mean and covariance."""
        return self._path[-1]

    def path(self) -> tuple[Array, Array]:
        """See Smoother; all steps as they were estimated at the time, for a filter does not smooth."""
        return np.array([belief.g for belief in self._path]), np.array([belief.e for belief in self._path])

    def last_errors(self) -> dict[str, Array]:
        """See Smoother; the mean of what the particles drew, which the measurements of the step alone shift from 0."""
        return {name: np.abs(self._weight @ drawn) for name, drawn in self._errors.items()}

    def _terms(self, step: Step) -> list[tuple[Factor, Terms]]:
        """The terms that arrive with a step, as far as the steps that are kept reach."""
        arrived = []
        for factor in self._factors:
            terms = factor.terms(step)
            if terms is not None:
                kept = terms.places.min(axis=1) > -len(step.times)
                arrived.append((factor, Terms(terms.places[kept], terms.data[kept])))
        return [(factor, terms) for factor, terms in arrived if len(terms.data)]

    def _drawn(self, model: ContactModel, prior: Prior, sensor_pose: Array, count: int) -> Values:
        """Draw particles from what is known when a contact begins."""
        apart = self._random.normal(size=(count, len(prior.covariance))) @ np.linalg.cholesky(prior.covariance).T
        e = self._motion.sensors(sensor_pose, count)
        g = se2.between(se2.compose(prior.pose, se2.exp(apart[:, :3])), e)
        shared = np.zeros((SHARED_SIZE, count))
        for one in OF_CONTACT:
            if one.prior is not None:
                shared[IN_SHARED[one]] = self._random.normal(*one.prior, size=(one.dimension, count))
        shared[CONTACT_SIZE:] = (prior.values + apart[:, 3:]).T
        return Values(model, {SENSOR_IN_OBJECT: g[:, None], SENSOR: e[:, None]}, shared)

    def _move(self) -> None:
        """Take all particles to the next step."""
        particles = self._particles
        drawn = self._motion.next(particles, self._measured)
        of_steps = {
            one: np.concatenate([particles[one][:, 1 - LAG :], new[:, None]], axis=1)
            for one, new in ((SENSOR_IN_OBJECT, drawn.g), (SENSOR, drawn.e))
        }
        self._errors = drawn.errors
        self._particles = Values(particles.model, of_steps, particles.shared)

    def _weigh(self, arrived: Sequence[tuple[Factor, Terms]]) -> None:
        """Multiply the weights by the likelihood of the terms that arrived, but for those that say how things move."""
        weighed = [(factor, terms) for factor, terms in arrived if not factor.is_motion]
        weighed = [(factor, self._bring_into_being(factor, terms)) for factor, terms in weighed]
        cost = np.zeros(self._particles.smoothers)
        recent: dict[int, Values] = {}  # several factors need the same of them
        for factor, terms in weighed:
            if len(terms.data):
                steps = 1 - int(terms.places.min())
                at = recent.setdefault(steps, _last(self._particles, steps))
                cost += cost_of(factor.linearise(at, _placed(terms, at)))
        log_weight = np.log(np.maximum(self._weight, np.finfo(float).tiny)) - cost
        best = log_weight.max()
        if not (np.isfinite(self._particles[SENSOR_IN_OBJECT]).all() and cost.min() < _WORST and np.isfinite(best)):
            raise EstimationError("no particle explains what is measured")
        weight = np.exp(log_weight - best)
        self._weight = weight / weight.sum()

    def _bring_into_being(self, factor: Factor, terms: Terms) -> Terms:
        """Draw the unknowns that a factor's first terms of a contact bring into being; return the terms that are left.

        The first term says what these unknowns are and nothing else, so that it is used up.
        """
        if factor in self._begun:
            return terms
        self._begun.add(factor)
        at = _last(self._particles, 1 - int(terms.places[0].min()))
        first = _placed(Terms(terms.places[:1], terms.data[:1]), at)
        guess = factor.first_guess(at, first)
        if not guess:
            return terms
        shared = drawn_from(factor, first, at, guess, self._random)
        self._particles = Values(self._particles.model, {one: self._particles[one] for one in OF_STEP}, shared)
        return Terms(terms.places[1:], terms.data[1:])

    def _resample(self) -> None:
        """Draw `count` particles by their weights, and what is shared with noise that keeps its mean and covariance."""
        particles, rows = self._particles, systematic(self._weight, self._count, self._random)
        of_steps = {one: particles[one][rows] for one in OF_STEP}
        shared = with_noise(particles.shared[:, rows], self._random)
        self._particles = Values(particles.model, of_steps, shared)
        self._weight = np.full(self._count, 1.0 / self._count)


def systematic(weight: Array, count: int, random: np.random.Generator) -> NDArray[np.int_]:
    """Return count rows (count,) drawn by weights (P,) of sum 1, each floor or ceiling of count times its weight."""
    places = (np.arange(count) + random.uniform()) / count
    return np.minimum(np.searchsorted(np.cumsum(weight), places, side="right"), len(weight) - 1)


def drawn_from(
    factor: Factor, term: Terms, at: Values, guess: Mapping[Unknown, Array], random: np.random.Generator
) -> Array:
    """Return what is shared (SHARED_SIZE, P), the guessed unknowns of it drawn from what one term says of them.

    The guess (dimension, P) of one particle serves all: a Gauss-Newton step takes each from there to what the term says
    to it. This keeps angles together, of which guesses by themselves may be full turns apart.
    """
    for unknown, value in guess.items():
        at = at.with_value(unknown, value[:, :1])
    rows, columns = factor.linearise(at, term), factor.columns
    guessed = np.concatenate([np.arange(SHARED_SIZE)[IN_SHARED[unknown]] for unknown in guess])
    mine = (columns.slot < 0) & np.isin(columns.place, guessed)
    root = np.sqrt(rows.information[:, 0])
    error = root * rows.residual[:, 0] + random.normal(size=root.shape)
    jacobian = root[..., None] * rows.jacobian[:, 0][..., mine]
    turned = jacobian.transpose(0, 2, 1)
    change = np.linalg.solve(turned @ jacobian, turned @ error[..., None])[..., 0]
    shared = at.shared.copy()
    shared[columns.place[mine]] -= change.T
    return shared


def with_noise(drawn: Array, random: np.random.Generator) -> Array:
    """Return draws (S, P) moved towards their mean and apart by noise: mean and covariance stay, copies differ."""
    mean = drawn.mean(axis=1, keepdims=True)
    deviation = drawn.std(axis=1, keepdims=True)
    deviation[deviation == 0.0] = 1.0
    apart = (drawn - mean) / deviation  # without a unit, for numbers of any size go together
    values, axes = np.linalg.eigh(apart @ apart.T / apart.shape[1])
    spread = np.sqrt(np.maximum(values, 0.0) * (1.0 - SHRINK**2))
    noise = axes @ (spread[:, None] * random.normal(size=apart.shape))
    return mean + deviation * (SHRINK * apart + noise)


def cost_of(rows: Rows) -> Array:
    """Return what terms add to the negative logarithm of the likelihood, (B,)."""
    smoothers, terms = rows.residual.shape[:2]
    costs = np.zeros((smoothers, 1))
    add_costs(rows.residual, rows.information, rows.weight, np.zeros((terms, 1), np.int64), costs)
    return costs[:, 0]


def belief_of(particles: Values, weight: Array) -> Belief:
    """Return mean and covariance of particles at their last step.

    They are of the object's pose, which is what is asked for, and carried over to g.
    """
    last_g, last_e, values = (
        particles[SENSOR_IN_OBJECT][:, -1],
        particles[SENSOR][:, -1],
        particles.shared[CONTACT_SIZE:].T,
    )
    objects = se2.compose(last_e, se2.inverse(last_g))
    pose, e, mean = _mean(objects, weight), _mean(last_e, weight), weight @ values
    g = se2.between(pose, e)
    of_object, of_sensor = se2.log(se2.between(pose, objects)), se2.log(se2.between(e, last_e))
    # g exp(d_g) = exp(-d_o) pose^-1 e exp(d_e)
    of_g = of_sensor - of_object @ se2.adjoint(se2.inverse(g)).T
    apart = np.concatenate([of_g, of_sensor, values - mean], axis=-1)
    apart -= weight @ apart
    covariance = (apart * weight[:, None]).T @ apart
    covariance[np.diag_indices_from(covariance)] += _FLOOR * np.diagonal(covariance) + 1e-24
    return Belief(g, e, mean, covariance)


def _mean(poses: Array, weight: Array) -> Array:
    """Weighted mean (3,) of poses (P, 3), circular in yaw."""
    x, y = weight @ poses[:, :2]
    return np.array([x, y, np.angle(weight @ np.exp(1j * poses[:, 2]))])


def _last(particles: Values, steps: int) -> Values:
    """The last steps of the particles, as many as there are."""
    return particles.with_steps(lambda value: value[:, -steps:])


def _placed(terms: Terms, at: Values) -> Terms:
    """Terms with places counted from the first step of the values, which were counted from the last."""
    return Terms(terms.places + (at.steps - 1), terms.data)
