"""A new curve in place of an outline's old one: how variables of the object read with it, in beliefs and graphs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array
from palpate.geometry.closed_curve import KNOTS
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.outline_prior import CENTER_PLACE, OUTLINE_PLACE, RATIO_PLACE
from palpate.models.pushing.unknown_outline import OutlineContactModel, outline_contact_model
from palpate.types.sensor import SensorProfile


@dataclass(frozen=True)
class _Reading:
    """Errors of heights that are read from another curve."""

    resampled: float = 1e-4
    """[m] Standard deviation of heights that are read at new knots."""
    lost: float = 0.15
    """Share of the standard deviation of heights that neighbours do not share once they are read at new knots."""


_READING = _Reading()


@dataclass(frozen=True, eq=False)
class OutlineChange:
    """Variables of the object as a new curve has them: `matrix @ values + offset`."""

    model: OutlineContactModel
    """The contact model of the new curve."""
    matrix: Array
    """(V, V)"""
    offset: Array
    """(V,)"""

    def values(self, values: Array) -> Array:
        """Return values (..., V) as the new curve has them."""
        return values @ self.matrix.T + self.offset

    def belief(self, belief: Belief) -> Belief:
        """Return a belief (B,) as the new curve has it."""
        joint = self._joint(len(self.offset) + 3)
        covariance = joint @ belief.covariance @ joint.T
        if not np.array_equal(self.matrix[OUTLINE_PLACE, OUTLINE_PLACE], np.eye(KNOTS)):
            size = len(self.offset) + 3
            at = np.arange(size - KNOTS, size)  # the outline is the last variable
            covariance[:, at, at] += _READING.resampled**2 + (_READING.lost * _READING.lost) * covariance[:, at, at]
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        return Belief(belief.pose, self.values(belief.values), covariance)

    def _joint(self, size: int) -> Array:
        """Return the matrix (size, size) for vectors that end with the object's variables."""
        joint = np.eye(size)
        first = size - len(self.offset)
        joint[first:, first:] = self.matrix
        return joint

    def apply(self, rows: np.ndarray) -> None:
        """Change the rows of a window (B,) in place; see `estimation.records.row_type`."""
        count = len(self.offset)
        for part in (rows, rows["past"], rows["next_past"]):
            part["shared"][:, -count:] = self.values(part["shared"][:, -count:])
        for past in (rows["past"], rows["next_past"]):
            size = past["gradient"].shape[1]
            back = np.linalg.inv(self._joint(size))
            past["information"] = back.T @ past["information"] @ back
            past["gradient"] = past["gradient"] @ back
        rows["first_values"] = self.values(rows["first_values"])
        size = rows["first_root"].shape[1]
        rows["first_root"] = rows["first_root"] @ np.linalg.inv(self._joint(size))
        joint = self._joint(rows["covariance"].shape[1])
        rows["covariance"] = joint @ rows["covariance"] @ joint.T


class _Friction(NamedTuple):
    """Support of an outline on the table."""

    center: Array
    radius: float


def changed_outline(
    model: OutlineContactModel, coefficients: Array, sensor: SensorProfile, pole: complex | None = None
) -> OutlineChange:
    """Return the change to the curve that heights (K,) [m] of a model move it to, about another pole if one is given.

    A change of the pole cannot be taken back, so that a graph has none.
    """
    curve = model.curve.moved(coefficients)
    matrix = np.eye(KNOTS)
    if pole is not None:
        curve, matrix = curve.about(pole)
    changed = outline_contact_model(curve, sensor)
    old = _Friction(np.array((model.friction_center.real, model.friction_center.imag)), model.friction_radius)
    new = _Friction(np.array((changed.friction_center.real, changed.friction_center.imag)), changed.friction_radius)
    size = OUTLINE_PLACE.stop
    whole = np.eye(size)
    offset = np.zeros(size)
    whole[OUTLINE_PLACE, OUTLINE_PLACE] = matrix
    offset[OUTLINE_PLACE] = -matrix @ coefficients
    whole[CENTER_PLACE, CENTER_PLACE] *= old.radius / new.radius
    offset[CENTER_PLACE] = (old.center - new.center) / new.radius
    offset[RATIO_PLACE] = 2.0 * np.log(old.radius / new.radius)
    return OutlineChange(changed, whole, offset)
