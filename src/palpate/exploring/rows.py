"""Rows of the exploration: hypotheses of form and friction, each a Gaussian of pose, friction and curve together."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from palpate.arrays import Array, Complex, Flags
from palpate.exploring.curve import COEFFICIENTS, UNIT_CIRCLE, BaseCurve

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

    temper: float = 6.0
    """Number of observations that count as one in the weights of rows: their errors last, and a form is never quite one
    of the prior's. With 1 regions of tuning explorations hold too little (docs/unknown_outline.md)."""


_SETTINGS = _Settings()


@dataclass(eq=False)
class Rows:
    """B hypotheses, whose arrays are changed in place."""

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
    log_likelihood: Array
    """(B,)."""

    @property
    def is_sketched(self) -> bool:
        """True if the curves are about that of a sketch."""
        return self.base is not UNIT_CIRCLE

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
        weight = np.exp((self.log_likelihood - self.log_likelihood.max()) / _SETTINGS.temper)
        return weight / weight.sum()

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
