"""Quadratic forms as GTSAM takes them: blocks of steps as its variables, and factors of two or three variables each."""

from functools import cache

import gtsam
import numpy as np

from palpate.graph.compiled import Array
from palpate.graph.variables import IN_STEP, OF_STEP, SHARED_SIZE

BLOCK = 10
"""Steps of which GTSAM sees one variable for each of their unknowns."""
SHARED_KEY = gtsam.symbol("z", 0)
"""Name of the variable of what all steps share."""
IN_BLOCK = np.concatenate(
    [
        BLOCK * IN_STEP[one].start + np.arange(BLOCK * one.dimension).reshape(BLOCK, one.dimension)[:, ::-1]
        for one in OF_STEP
    ],
    axis=1,
)
"""Where the numbers of a block's steps stand in its variables, which follow each other, (BLOCK, STEP_SIZE).

The last number of a step, a yaw, comes first: it is known best when the others are given, and GTSAM refuses a number of
which nearly nothing is left after those before it."""

_Square = tuple[Array, Array]
"""Information on a variable and its negative gradient."""
_Tie = tuple[int, Array, Array, Array]
"""Another variable, the information on both together, and what there is on that one."""


def key_of(which: int, block: int) -> int:
    """Name of the variable of an unknown of a block's steps."""
    return gtsam.symbol(chr(ord("a") + which), block)


def quadratic_factors(matrix: Array, vector: Array, first: int, end: int) -> list[gtsam.LinearContainerFactor]:
    """Return a quadratic form on blocks, from the first one to before the end, as factors.

    Each is on two or three variables, for GTSAM's Python makes none on more.
    """
    matrix = matrix.T  # symmetric, and now in the order that Eigen copies fast
    keys = [key_of(which, block) for block in range(first, end) for which in range(len(OF_STEP))]
    ends = np.cumsum([BLOCK * one.dimension for _ in range(first, end) for one in OF_STEP]).tolist()
    parts = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
    shared = slice(ends[-1], None)
    made, corner = [], (matrix[shared, shared], vector[shared])
    for i, (key, part) in enumerate(zip(keys, parts, strict=True)):
        tied = [(SHARED_KEY, matrix[part, shared], *corner)]
        for other, there in zip(keys[i + 1 :], parts[i + 1 :], strict=True):
            if (tie := matrix[part, there]).any():
                tied.append((other, tie, *_nothing(tie.shape[1])))
        own, corner = (matrix[part, part], vector[part]), _nothing(SHARED_SIZE)
        for a, b in zip(tied[::2], [*tied[1::2], None], strict=False):
            made.append(_linear(key, own, a, b))
            own = _nothing(len(own[1]))
    return made


def _linear(key: int, own: _Square, a: _Tie, b: _Tie | None) -> gtsam.LinearContainerFactor:
    """Return a factor on a variable and one or two that are tied to it."""
    (square, pull), (key_a, tie_a, square_a, pull_a) = own, a
    if b is None:
        factor = gtsam.HessianFactor(key, key_a, square, tie_a, pull, square_a, pull_a, 0.0)
    else:
        key_b, tie_b, square_b, pull_b = b
        apart = np.zeros((len(pull_a), len(pull_b)))
        factor = gtsam.HessianFactor(
            key, key_a, key_b, square, tie_a, tie_b, pull, square_a, apart, pull_a, square_b, pull_b, 0.0
        )
    return gtsam.LinearContainerFactor(factor)


@cache
def _nothing(size: int) -> _Square:
    """A square without information and its pull."""
    return np.zeros((size, size)), np.zeros(size)
