"""The normal equations of a window of steps, summed from blocks of factors of one kind each.

The unknowns are those of every step in order from the oldest, and last those that all steps share: a border of a few
rows and columns.
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
SHARED = 7
"""Of all steps together: the offset of the turns, then what lasts from contact to contact (`smoother.LASTING`)."""
NOTHING = slice(0, 0)
"""Of what is shared: none."""


class NormalEquations:
    """Information matrix and negative gradient of a sum of squares over a number of steps and what they share."""

    matrix: Array
    """(6 steps + SHARED, 6 steps + SHARED)"""
    vector: Array
    """Negative gradient, (6 steps + SHARED,)."""
    information: Array
    """The matrix between steps, a view (steps, 6, steps, 6)."""
    own: Array
    """The matrix of each step, a view (steps, 6, 6)."""
    border: Array
    """The matrix between what is shared and the steps, a view (SHARED, steps, 6)."""
    corner: Array
    """The matrix of what is shared, a view (SHARED, SHARED)."""
    gradient: Array
    """The vector of the steps, a view (steps, 6)."""
    edge: Array
    """The vector of what is shared, a view (SHARED,)."""

    def __init__(self, steps: int, blocks: Iterable["Block"]) -> None:
        size = UNKNOWNS * steps
        self.matrix, self.vector = np.zeros((size + SHARED, size + SHARED)), np.zeros(size + SHARED)
        # These split axes, or take a diagonal, and copy nothing.
        self.information = self.matrix[:size, :size].reshape(steps, UNKNOWNS, steps, UNKNOWNS)
        self.own = _diagonal(self.information)
        self.border = self.matrix[size:, :size].reshape(SHARED, steps, UNKNOWNS)
        self.corner = self.matrix[size:, size:]
        self.gradient, self.edge = self.vector[:size].reshape(steps, UNKNOWNS), self.vector[size:]
        for block in blocks:
            block.add_to(self)
        self.matrix[:size, size:] = self.matrix[size:, :size].T


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
    """(N, R, U + S)"""
    weight: Array
    """Inverse variances, (N, R) or (R,)."""
    shared: slice
    """Which S of the shared unknowns it is on as well; they come last in the Jacobian."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        count = len(self.residual)
        information, gradient = _weighted(self.residual, self.jacobian, self.weight)
        own = self.unknowns.stop - self.unknowns.start
        normal.own[:count, self.unknowns, self.unknowns] += information[:, :own, :own]
        normal.gradient[:count, self.unknowns] += gradient[:, :own]
        normal.border[self.shared, :count, self.unknowns] += information[:, own:, :own].transpose(1, 0, 2)
        _add_shared(normal, self.shared, information[:, own:, own:], gradient[:, own:])

    def of_oldest(self) -> "StepBlock":
        """See Block."""
        weight = self.weight if self.weight.ndim == 1 else self.weight[:1]
        return StepBlock(self.unknowns, self.residual[:1], self.jacobian[:1], weight, self.shared)


@dataclass(frozen=True)
class NeighbourBlock:
    """One factor on every step and the one after it, in order from the oldest."""

    residual: Array
    """(N, R)"""
    jacobian: Array
    """(N, R, 12 + S)"""
    weight: Array
    """Inverse variances, (N, R)."""
    shared: slice
    """Which S of the shared unknowns it is on as well; they come last in the Jacobian."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        before, after = slice(0, len(self.residual)), slice(1, len(self.residual) + 1)
        information, gradient = _weighted(self.residual, self.jacobian, self.weight)
        first, second, rest = slice(0, UNKNOWNS), slice(UNKNOWNS, 2 * UNKNOWNS), slice(2 * UNKNOWNS, None)
        normal.own[before] += information[:, first, first]
        normal.own[after] += information[:, second, second]
        upper, lower = _diagonal(normal.information[before, :, after]), _diagonal(normal.information[after, :, before])
        upper += information[:, first, second]
        lower += information[:, second, first]
        normal.gradient[before] += gradient[:, first]
        normal.gradient[after] += gradient[:, second]
        normal.border[self.shared, before] += information[:, rest, first].transpose(1, 0, 2)
        normal.border[self.shared, after] += information[:, rest, second].transpose(1, 0, 2)
        _add_shared(normal, self.shared, information[:, rest, rest], gradient[:, rest])

    def of_oldest(self) -> "NeighbourBlock":
        """See Block."""
        return NeighbourBlock(self.residual[:1], self.jacobian[:1], self.weight[:1], self.shared)


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
        normal.own[:, :3, :3] += own
        normal.gradient[:, :3] += _summed(gradient[:, :3], self.i, steps) + _summed(gradient[:, 3:], self.j, steps)

    def of_oldest(self) -> "PairBlock":
        """See Block."""
        mine = self.i == 0
        return PairBlock(self.i[mine], self.j[mine], self.residual[mine], self.jacobian[mine], self.information[mine])


@dataclass(frozen=True)
class DenseBlock:
    """A Gaussian on all unknowns of the oldest steps and on all that are shared."""

    information: Array
    """(6 N + SHARED, 6 N + SHARED)"""
    gradient: Array
    """Negative gradient, (6 N + SHARED,)."""

    def add_to(self, normal: NormalEquations) -> None:
        """See Block."""
        size = len(self.gradient) - SHARED
        normal.matrix[:size, :size] += self.information[:size, :size]
        normal.matrix[-SHARED:, :size] += self.information[size:, :size]
        normal.corner += self.information[size:, size:]
        normal.vector[:size] += self.gradient[:size]
        normal.edge += self.gradient[size:]

    def of_oldest(self) -> "DenseBlock":
        """See Block."""
        return self


def _diagonal(blocks: Array) -> Array:
    """The blocks (N, A, B) on the diagonal of a matrix of blocks (N, A, N, B): a view that can be written to."""
    return np.einsum("iaib->iab", blocks)


def _add_shared(normal: NormalEquations, shared: slice, information: Array, gradient: Array) -> None:
    normal.corner[shared, shared] += information.sum(axis=0)
    normal.edge[shared] += gradient.sum(axis=0)


def _weighted(residual: Array, jacobian: Array, weight: Array) -> tuple[Array, Array]:
    """Information (N, U, U) and negative gradient (N, U) of residuals with the given inverse variances."""
    pulled = np.swapaxes(jacobian * weight[..., None], -1, -2)
    return pulled @ jacobian, -(pulled @ residual[..., None])[..., 0]


def _summed(values: Array, place: Indices, places: int) -> Array:
    """Sum values (N, ...) that go to the same place (N,): (places, ...)."""
    width = int(np.prod(values.shape[1:]))
    index = (place[:, None] * width + np.arange(width)).ravel()
    sums = np.bincount(index, weights=values.ravel(), minlength=places * width)
    return sums.reshape(places, *values.shape[1:]).astype(np.float64, copy=False)
