"""The normal equations of a window of steps, summed from blocks of factors of one kind each.

The unknowns are those of every step in order from the oldest, and last the offset of the turns, which all steps share:
a border of one row and one column.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

UNKNOWNS = 6
"""Per step: three of g, then three of e."""


class NormalEquations:
    """Information matrix and negative gradient of a sum of squares over a number of steps and the offset."""

    matrix: Array
    """(6 steps + 1, 6 steps + 1)"""
    vector: Array
    """Negative gradient, (6 steps + 1,)."""
    information: Array
    """The matrix between steps, a view (steps, 6, steps, 6)."""
    border: Array
    """The matrix between the offset and the steps, a view (steps, 6)."""
    gradient: Array
    """The vector of the steps, a view (steps, 6)."""

    def __init__(self, steps: int, blocks: Iterable["Block"]) -> None:
        size = UNKNOWNS * steps
        self.matrix, self.vector = np.zeros((size + 1, size + 1)), np.zeros(size + 1)
        self.information = self.matrix[:-1, :-1].reshape(steps, UNKNOWNS, steps, UNKNOWNS)  # splits axes: no copy
        self.border = self.matrix[-1, :-1].reshape(steps, UNKNOWNS)
        self.gradient = self.vector[:-1].reshape(steps, UNKNOWNS)
        for block in blocks:
            block.add_to(self)
        self.matrix[:-1, -1] = self.matrix[-1, :-1]


class Block(Protocol):
    """Linearised factors of one kind."""

    def add_to(self, normal: NormalEquations) -> None:
        """Add the squares of the block."""
        ...

    def of_oldest(self) -> "Block":
        """Return those factors of the block that are tied to the oldest step."""
        ...


@dataclass(frozen=True)
class StepBlock:
    """One factor on every step, in order from the oldest."""

    unknowns: slice
    """Which unknowns of its step a factor is on."""
    residual: Array
    """(N, R)"""
    jacobian: Array
    """(N, R, U)"""
    weight: Array
    """Inverse variances, (N, R) or (R,)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        at = np.arange(len(self.residual))
        information, gradient = _weighted(self.residual, self.jacobian, self.weight)
        normal.information[at, self.unknowns, at, self.unknowns] += information
        normal.gradient[at, self.unknowns] += gradient

    def of_oldest(self) -> "StepBlock":
        """See Block."""
        weight = self.weight if self.weight.ndim == 1 else self.weight[:1]
        return StepBlock(self.unknowns, self.residual[:1], self.jacobian[:1], weight)


@dataclass(frozen=True)
class NeighbourBlock:
    """One factor on every step and the one after it, in order from the oldest."""

    residual: Array
    """(N, R)"""
    jacobian: Array
    """(N, R, 12)"""
    weight: Array
    """Inverse variances, (N, R)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        at = np.arange(len(self.residual))
        information, gradient = _weighted(self.residual, self.jacobian, self.weight)
        first, second = slice(0, UNKNOWNS), slice(UNKNOWNS, None)
        normal.information[at, :, at, :] += information[:, first, first]
        normal.information[at, :, at + 1, :] += information[:, first, second]
        normal.information[at + 1, :, at, :] += information[:, second, first]
        normal.information[at + 1, :, at + 1, :] += information[:, second, second]
        normal.gradient[at] += gradient[:, first]
        normal.gradient[at + 1] += gradient[:, second]

    def of_oldest(self) -> "NeighbourBlock":
        """See Block."""
        return NeighbourBlock(self.residual[:1], self.jacobian[:1], self.weight[:1])


@dataclass(frozen=True)
class PairBlock:
    """Factors on g of any two steps each."""

    i: Indices
    """Place of the earlier step, (P,)."""
    j: Indices
    """Place of the later step, (P,)."""
    residual: Array
    """(P, 3)"""
    jacobian: Array
    """(P, 3, 6)"""
    information: Array
    """Inverse covariances, (P, 3, 3)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        steps = len(normal.gradient)
        pulled = np.swapaxes(self.jacobian, -1, -2) @ self.information
        squares = pulled @ self.jacobian
        gradient = -(pulled @ self.residual[..., None])[..., 0]
        both = _summed(squares[:, :3, 3:], self.i * steps + self.j, steps * steps).reshape(steps, steps, 3, 3)
        normal.information[:, :3, :, :3] += both.transpose(0, 2, 1, 3) + both.transpose(1, 3, 0, 2)
        own = _summed(squares[:, :3, :3], self.i, steps) + _summed(squares[:, 3:, 3:], self.j, steps)
        at = np.arange(steps)
        normal.information[at, :3, at, :3] += own
        normal.gradient[:, :3] += _summed(gradient[:, :3], self.i, steps) + _summed(gradient[:, 3:], self.j, steps)

    def of_oldest(self) -> "PairBlock":
        """See Block."""
        mine = self.i == 0
        return PairBlock(self.i[mine], self.j[mine], self.residual[mine], self.jacobian[mine], self.information[mine])


@dataclass(frozen=True)
class OffsetBlock:
    """One factor on g of every step and the offset, in order from the oldest."""

    residual: Array
    """(N, R)"""
    jacobian: Array
    """(N, R, 4): three of g, then the offset."""
    weight: Array
    """Inverse variances, (N, R)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        at = np.arange(len(self.residual))
        information, gradient = _weighted(self.residual, self.jacobian, self.weight)
        normal.information[at, :3, at, :3] += information[:, :3, :3]
        normal.border[at, :3] += information[:, 3, :3]
        normal.matrix[-1, -1] += information[:, 3, 3].sum()
        normal.gradient[at, :3] += gradient[:, :3]
        normal.vector[-1] += gradient[:, 3].sum()

    def of_oldest(self) -> "OffsetBlock":
        """See Block."""
        return OffsetBlock(self.residual[:1], self.jacobian[:1], self.weight[:1])


@dataclass(frozen=True)
class DenseBlock:
    """A Gaussian on all unknowns of the oldest steps and the offset."""

    information: Array
    """(6 N + 1, 6 N + 1)"""
    gradient: Array
    """Negative gradient, (6 N + 1,)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        size = len(self.gradient) - 1
        normal.matrix[:size, :size] += self.information[:-1, :-1]
        normal.matrix[-1, :size] += self.information[-1, :-1]
        normal.matrix[-1, -1] += self.information[-1, -1]
        normal.vector[:size] += self.gradient[:-1]
        normal.vector[-1] += self.gradient[-1]

    def of_oldest(self) -> "DenseBlock":
        """See Block."""
        return self


def _weighted(residual: Array, jacobian: Array, weight: Array) -> tuple[Array, Array]:
    """Information (N, U, U) and negative gradient (N, U) of residuals with the given inverse variances."""
    pulled = np.swapaxes(jacobian * np.broadcast_to(weight, residual.shape)[..., None], -1, -2)
    return pulled @ jacobian, -(pulled @ residual[..., None])[..., 0]


def _summed(values: Array, place: Indices, places: int) -> Array:
    """Sum values (N, ...) that go to the same place (N,): (places, ...)."""
    width = int(np.prod(values.shape[1:]))
    index = (place[:, None] * width + np.arange(width)).ravel()
    sums = np.bincount(index, weights=values.ravel(), minlength=places * width)
    return sums.reshape(places, *values.shape[1:]).astype(np.float64, copy=False)
