"""Rows of the exploration: hypotheses of form and friction, each a Gaussian of pose, friction and curve together."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from palpate.arrays import Array, Complex, Flags, Integers
from palpate.exploring.curve import COEFFICIENTS, BaseCurve

CENTER = slice(0, 2)
"""Centre of friction, world frame [m]."""
CENTER_IN_OBJECT = slice(3, 5)
"""Centre of friction, object frame [m]."""
CURVE = slice(7, 7 + COEFFICIENTS)
"""Coefficients of the curve of tip centres; see `curve`."""


class Place(IntEnum):
    """Places of single variables in a row."""

    YAW = 2
    """Yaw of the object [rad]."""
    FRICTION_RADIUS = 5
    """Logarithm of the square of the friction radius c [m^2]."""
    GRIP = 6
    """Logarithm of the coefficient of friction between sensor and object."""


@dataclass(frozen=True)
class _Settings:
    """Settings of the weights."""

    temper: float = 12.0
    """Number of observations that count as one in the weights of families: their errors last, and a form is never quite
    one of the prior's. With 1 regions of tuning explorations hold too little (docs/unknown_outline.md)."""
    temper_in_family: float = 2.0
    """The same within a family. Its rows differ only in shoves, which a few observations show."""


_SETTINGS = _Settings()


@dataclass(eq=False)
class Rows:
    """B hypotheses, whose arrays are changed."""

    mean: Array
    """Means of the V variables, (B, V)."""
    covariance: Array
    """(B, V, V)."""
    base: BaseCurve
    """Curve that those of all rows are about."""
    pole: Complex
    """Pole of the curve in the object frame, (B,), complex [m]."""
    is_straight: Flags
    """True for rows that expect straight sides, (B,)."""
    family: Integers
    """Number of the first row that each comes from, (B,): rows of a family differ in what else moved the object."""
    shoves: Integers
    """Number of times that something else has moved the object, (B,)."""
    log_weight: Array
    """Logarithms of weights up to a constant, (B,)."""

    @property
    def center(self) -> Complex:
        """Centres of friction in the world, (B,), complex [m]."""
        return self.mean[:, 0] + 1j * self.mean[:, 1]

    @property
    def center_in_object(self) -> Complex:
        """Centres of friction in the object frame, (B,), complex [m]."""
        return self.mean[:, 3] + 1j * self.mean[:, 4]

    @property
    def rotation(self) -> Complex:
        """Rotations from the object to the world, (B,), complex."""
        return np.exp(1j * self.mean[:, Place.YAW])

    @property
    def weight(self) -> Array:
        """Weights, (B,), with the sum 1."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return weight / weight.sum()

    def weigh(self, log_likelihood: Array) -> None:
        """Take the logarithms of likelihoods (B,) of an observation to the weights."""
        tempered = log_likelihood / _SETTINGS.temper_in_family
        of_family = self._in_families(self.log_weight + tempered) - self._in_families(self.log_weight)
        self.log_weight += tempered - of_family
        self.log_weight += of_family * (_SETTINGS.temper_in_family / _SETTINGS.temper)

    def keep(self, chosen: Integers) -> None:
        """Keep chosen rows in their order; one that is chosen twice is there twice."""
        self.mean = self.mean[chosen]
        self.covariance = self.covariance[chosen]
        self.pole = self.pole[chosen]
        self.is_straight = self.is_straight[chosen]
        self.family = self.family[chosen]
        self.shoves = self.shoves[chosen]
        self.log_weight = self.log_weight[chosen]

    def pose(self) -> tuple[Array, Array]:
        """Return mean and covariance of world_T_object over all rows: (3,), and (3, 3) in the tangent space there."""
        weight = self.weight
        rotation = self.rotation
        origin = self.center - rotation * self.center_in_object
        yaw = float(np.angle(weight @ rotation))
        place = complex(weight @ origin)
        turned = np.angle(rotation * np.exp(-1j * yaw))
        off = (origin - place) * np.exp(-1j * yaw)
        apart = np.column_stack((off.real, off.imag, turned))
        covariance = (weight[:, None] * apart).T @ apart + self._within(weight, yaw)
        return np.array((place.real, place.imag, yaw)), covariance

    def _in_families(self, log_weight: Array) -> Array:
        """Return the logarithm of the sum of weights in the family of each row, (B,)."""
        total = np.full(self.family.max() + 1, -np.inf)
        np.logaddexp.at(total, self.family, log_weight)
        return total[self.family]

    def _within(self, weight: Array, yaw: float) -> Array:
        """Return the mean covariance (3, 3) of the pose within a row, along the axes of the mean pose."""
        back = np.exp(-1j * yaw)
        of_pose = np.zeros((len(weight), 3, 5))  # origin and yaw by centre, yaw and centre in the object
        columns: tuple[tuple[int, Complex], ...] = (
            (0, np.full(len(weight), back)),
            (1, np.full(len(weight), 1j * back)),
            (2, -1j * back * self.rotation * self.center_in_object),
            (3, -back * self.rotation),
            (4, -1j * back * self.rotation),
        )
        for column, moved in columns:
            of_pose[:, 0, column] = np.real(moved)
            of_pose[:, 1, column] = np.imag(moved)
        of_pose[:, 2, Place.YAW] = 1.0
        known = of_pose @ self.covariance[:, :5, :5] @ of_pose.transpose(0, 2, 1)
        return np.tensordot(weight, known, axes=1)
