import numpy as np
import pytest

from palpate.graph.normal_equations import (
    Block,
    DenseBlock,
    NeighbourBlock,
    NormalEquations,
    OffsetBlock,
    PairBlock,
    StepBlock,
)

STEPS = 5
SIZE = 6 * STEPS + 1  # the offset is last


def rows(residual, jacobian, information, columns):
    """J^T W J and -J^T W r of one factor, its Jacobian spread over all unknowns."""
    spread = np.zeros((len(residual), SIZE))
    for place, column in enumerate(columns):
        spread[:, column] += jacobian[:, place]
    return spread.T @ information @ spread, -spread.T @ information @ residual


def cases(rng: np.random.Generator) -> list[tuple[Block, list, list[int]]]:
    """Blocks, with the same factors one by one as (residual, jacobian, information, columns), and their first steps."""
    found = []
    for unknowns, width, weight in (
        (slice(0, 3), 1, rng.uniform(1, 2, (STEPS, 1))),
        (slice(3, 6), 3, rng.uniform(1, 2, 3)),  # one for all
    ):
        r, j = rng.normal(size=(STEPS, width)), rng.normal(size=(STEPS, width, 3))
        each = np.broadcast_to(weight, r.shape)
        columns = [range(6 * k + unknowns.start, 6 * k + unknowns.stop) for k in range(STEPS)]
        parts = [(r[k], j[k], np.diag(each[k]), columns[k]) for k in range(STEPS)]
        found.append((StepBlock(unknowns, r, j, weight), parts, list(range(STEPS))))
    r, j, weight = rng.normal(size=(4, 3)), rng.normal(size=(4, 3, 12)), rng.uniform(1, 2, (4, 3))
    parts = [(r[k], j[k], np.diag(weight[k]), range(6 * k, 6 * k + 12)) for k in range(4)]
    found.append((NeighbourBlock(r, j, weight), parts, list(range(4))))
    # Pairs out of order, one of them twice, neighbours and the two ends.
    first, second = np.array([2, 0, 1, 0, 0, 3]), np.array([4, 4, 2, 4, 1, 4])
    r, j, root = rng.normal(size=(6, 3)), rng.normal(size=(6, 3, 6)), rng.normal(size=(6, 3, 3))
    information = root @ root.transpose(0, 2, 1)
    columns = [[*range(6 * a, 6 * a + 3), *range(6 * b, 6 * b + 3)] for a, b in zip(first, second, strict=True)]
    parts = [(r[k], j[k], information[k], columns[k]) for k in range(6)]
    found.append((PairBlock(first, second, r, j, information), parts, first.tolist()))
    r, j, weight = rng.normal(size=(STEPS, 1)), rng.normal(size=(STEPS, 1, 4)), rng.uniform(1, 2, (STEPS, 1))
    parts = [(r[k], j[k], np.diag(weight[k]), [6 * k, 6 * k + 1, 6 * k + 2, SIZE - 1]) for k in range(STEPS)]
    found.append((OffsetBlock(r, j, weight), parts, list(range(STEPS))))
    return found


def dense(parts):
    summed = [rows(*part) for part in parts]
    return sum(a for a, _ in summed), sum(b for _, b in summed)


def test_each_block_and_all_together_equal_a_dense_sum():
    known = cases(np.random.default_rng(1))
    for block, parts, _ in known:
        normal = NormalEquations(STEPS, [block])
        information, gradient = dense(parts)
        np.testing.assert_allclose(normal.matrix, information, atol=1e-12)
        np.testing.assert_allclose(normal.vector, gradient, atol=1e-12)
    everything = NormalEquations(STEPS, [block for block, _, _ in known])
    information, gradient = dense([part for _, parts, _ in known for part in parts])
    np.testing.assert_allclose(everything.matrix, information, atol=1e-12)
    np.testing.assert_allclose(everything.matrix, everything.matrix.T, atol=1e-12)
    np.testing.assert_allclose(everything.vector, gradient, atol=1e-12)


@pytest.mark.parametrize("which", range(5))
def test_the_factors_of_the_oldest_step(which):
    block, parts, first = cases(np.random.default_rng(2))[which]
    normal = NormalEquations(STEPS, [block.of_oldest()])
    information, gradient = dense([part for part, step in zip(parts, first, strict=True) if step == 0])
    np.testing.assert_allclose(normal.matrix, information, atol=1e-12)
    np.testing.assert_allclose(normal.vector, gradient, atol=1e-12)


def test_a_dense_block_is_on_the_oldest_steps_and_the_offset():
    rng = np.random.default_rng(3)
    root, gradient = rng.normal(size=(13, 13)), rng.normal(size=13)
    block = DenseBlock(root @ root.T, gradient)
    on, off = [*range(12), SIZE - 1], range(12, SIZE - 1)
    for same in (block, block.of_oldest()):
        normal = NormalEquations(STEPS, [same, same])
        np.testing.assert_allclose(normal.matrix[np.ix_(on, on)], 2 * root @ root.T)
        np.testing.assert_allclose(normal.vector[on], 2 * gradient)
        assert not normal.matrix[off].any()
        assert not normal.matrix[:, off].any()
        assert not normal.vector[off].any()


def test_a_dense_block_on_no_step_is_on_the_offset_alone():
    normal = NormalEquations(STEPS, [DenseBlock(np.array([[2.0]]), np.array([3.0]))])
    assert normal.matrix[-1, -1] == 2.0
    assert normal.vector[-1] == 3.0
    assert np.count_nonzero(normal.matrix) == np.count_nonzero(normal.vector) == 1


def test_no_pairs_add_nothing():
    none = PairBlock(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty((0, 3, 6)), np.empty((0, 3, 3)))
    normal = NormalEquations(STEPS, [none, none.of_oldest()])
    assert not normal.matrix.any()
    assert not normal.vector.any()
