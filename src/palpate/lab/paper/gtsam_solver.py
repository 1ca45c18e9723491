"""GTSAM's iSAM2 over quadratic forms on blocks of steps: what of it is solved anew is GTSAM's business.

Its variables are how far the unknowns moved, those of a block's steps and what all steps share.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import gtsam
import numpy as np

from palpate.graph.compiled import Array
from palpate.graph.variables import CONTACT_SIZE, IN_STEP, OF_STEP, SHARED_SIZE, STEP_SIZE
from palpate.lab.paper.gtsam_quadratic import BLOCK, IN_BLOCK, SHARED_KEY, key_of, quadratic_factors

_WILDFIRE = 1e-5  # [m], [rad]; smaller changes are not followed into the past


class Quadratic(NamedTuple):
    """A quadratic form on blocks that follow each other, numbers of steps by IN_BLOCK, and on what is shared."""

    first: int
    """The first of its blocks."""
    end: int
    """One past the last of them."""
    matrix: Array
    """Information (S, S)."""
    vector: Array
    """Information times the mean (S,)."""


class GtsamSolver:
    """Adds up quadratic forms that come and go, and solves for how far all unknowns moved."""

    def __init__(self, known: Array) -> None:
        """Take the information on each number that is shared, before anything is measured (SHARED_SIZE,)."""
        parameters, solver = gtsam.ISAM2Params(), gtsam.ISAM2GaussNewtonParams()
        solver.setWildfireThreshold(_WILDFIRE)
        parameters.setOptimizationParams(solver)
        parameters.enableRelinearization = False  # what is linearised anew comes as another form
        parameters.findUnusedFactorSlots = True
        self._isam = gtsam.ISAM2(parameters)
        self._known = known

    def update(self, forms: Iterable[Quadratic], removed: Sequence[int], blocks: int) -> list[list[int]]:
        """Take forms, and drop others by their places; return the places of each.

        Raises RuntimeError where the sum of all is indeterminate. `blocks` is how many there are now.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        if not self._isam.valueExists(SHARED_KEY):
            values.insert(SHARED_KEY, np.zeros(SHARED_SIZE))
            known = gtsam.HessianFactor(SHARED_KEY, np.diag(self._known), np.zeros(SHARED_SIZE), 0.0)
            graph.push_back(gtsam.LinearContainerFactor(known))
        if not self._isam.valueExists(key_of(0, blocks - 1)):
            for which, one in enumerate(OF_STEP):
                values.insert(key_of(which, blocks - 1), np.zeros(BLOCK * one.dimension))
        ends, first = [graph.size()], blocks
        for form in forms:
            first = min(first, form.first)
            for factor in quadratic_factors(form.matrix, form.vector, form.first, form.end):
                graph.push_back(factor)
            ends.append(graph.size())
        order = _elimination_order(first, blocks)
        places = list(self._isam.update(graph, values, removed, order).getNewFactorsIndices())
        return [places[begin:end] for begin, end in pairwise(ends)]

    def moved(self, steps: int) -> tuple[Array, Array]:
        """Return how far the unknowns of steps moved (N, STEP_SIZE), and what they share (SHARED_SIZE,)."""
        blocks = (steps - 1) // BLOCK + 1
        keys = [key_of(which, block) for which in range(len(OF_STEP)) for block in range(blocks)]
        change = self._isam.getDelta().vector([*keys, SHARED_KEY])
        moved, end = np.empty((steps, STEP_SIZE)), 0
        for one in OF_STEP:
            begin, end = end, end + blocks * BLOCK * one.dimension
            moved[:, IN_STEP[one]] = change[begin:end].reshape(-1, one.dimension)[:steps, ::-1]
        return moved, change[end:]

    def covariance(self, step: int) -> Array:
        """Return that of a step of the last block and of what belongs to the object; RuntimeError where there is none.

        It is (STEP_SIZE + OBJECT_SIZE,) squared.
        """
        keys = [key_of(which, step // BLOCK) for which in range(len(OF_STEP))]
        joint = self._isam.jointMarginalCovariance([*keys, SHARED_KEY]).fullMatrix()
        objects = BLOCK * STEP_SIZE + np.arange(CONTACT_SIZE, SHARED_SIZE)
        chosen = np.append(IN_BLOCK[step % BLOCK], objects)
        return joint[np.ix_(chosen, chosen)]


def _elimination_order(first: int, blocks: int) -> gtsam.KeyGroupMap:
    """What is eliminated after what: blocks from the first one on in the order of time, last what is shared."""
    order = gtsam.KeyGroupMap()
    for block in range(first, blocks):
        for which in range(len(OF_STEP)):
            order.insert2(key_of(which, block), block - first)
    order.insert2(SHARED_KEY, blocks - first)
    return order
