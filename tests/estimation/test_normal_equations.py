import numpy as np
import pytest

from palpate.graph.normal_equations import (
    NOTHING,
    SHARED,
    Block,
    DenseBlock,
    NeighbourBlock,
    NormalEquations,
    PairBlock,
    StepBlock,
)

STEPS = 5
SIZE = 6 * STEPS + SHARED  # what is shared is last


def rows(residual, jacobian, information, columns):
    """J^T W J and -J^T W r of one factor, its Jacobian spread over all unknowns."""
    spread = np.zeros((len(residual), SIZE))
    for place, column in enumerate(columns):
        spread[:, column] += jacobian[:, place]
    return spread.T @ information @ spread, -spread.T @ information @ residual


def own_of(step, unknowns):
    return range(6 * step + unknowns.start, 6 * step + unknowns.stop)


def shared_of(shared):
    return range(6 * STEPS + shared.start, 6 * STEPS + shared.stop)


def cases(rng: np.random.Generator) -> list[tuple[Block, list, list[int]]]:
    """Blocks, with the same factors one by one as (residual, jacobian, information, columns), and their first steps."""
    found = []
    for unknowns, width, weight, shared in (
        (slice(0, 3), 1, rng.uniform(1, 2, (STEPS, 1)), NOTHING),
        (slice(0, 3), 1, rng.uniform(1, 2, (STEPS, 1)), slice(0, 1)),
        (slice(3, 6), 3, rng.uniform(1, 2, 3), NOTHING),  # one weight for all
        (slice(0, 3), 2, rng.uniform(1, 2, (STEPS, 2)), slice(3, 7)),
    ):
        columns = [[*own_of(k, unknowns), *shared_of(shared)] for k in range(STEPS)]
        r, j = rng.normal(size=(STEPS, width)), rng.normal(size=(STEPS, width, len(columns[0])))
        each = np.broadcast_to(weight, r.shape)
        parts = [(r[k], j[k], np.diag(each[k]), columns[k]) for k in range(STEPS)]
        found.append((StepBlock(unknowns, r, j, weight, shared), parts, list(range(STEPS))))
    # On the oldest step alone, and all that is shared but the first.
    columns = [*range(6), *shared_of(slice(1, 7))]
    r, j, weight = rng.normal(size=(1, 9)), rng.normal(size=(1, 9, 12)), rng.uniform(1, 2, 9)
    parts = [(r[0], j[0], np.diag(weight), columns)]
    found.append((StepBlock(slice(0, 6), r, j, weight, slice(1, 7)), parts, [0]))
    for shared in (NOTHING, slice(3, 7)):
        columns = [[*range(6 * k, 6 * k + 12), *shared_of(shared)] for k in range(4)]
        r, j, weight = rng.normal(size=(4, 3)), rng.normal(size=(4, 3, len(columns[0]))), rng.uniform(1, 2, (4, 3))
        parts = [(r[k], j[k], np.diag(weight[k]), columns[k]) for k in range(4)]
        found.append((NeighbourBlock(r, j, weight, shared), parts, list(range(4))))
    # Pairs out of order, one of them twice, neighbours and the two ends.
    first, second = np.array([2, 0, 1, 0, 0, 3]), np.array([4, 4, 2, 4, 1, 4])
    r, j, root = rng.normal(size=(6, 3)), rng.normal(size=(6, 3, 6)), rng.normal(size=(6, 3, 3))
    information = root @ root.transpose(0, 2, 1)
    columns = [[*range(6 * a, 6 * a + 3), *range(6 * b, 6 * b + 3)] for a, b in zip(first, second, strict=True)]
    parts = [(r[k], j[k], information[k], columns[k]) for k in range(6)]
    found.append((PairBlock(first, second, r, j, information), parts, first.tolist()))
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


@pytest.mark.parametrize("which", range(8))
def test_the_factors_of_the_oldest_step(which):
    block, parts, first = cases(np.random.default_rng(2))[which]
    normal = NormalEquations(STEPS, [block.of_oldest()])
    information, gradient = dense([part for part, step in zip(parts, first, strict=True) if step == 0])
    np.testing.assert_allclose(normal.matrix, information, atol=1e-12)
    np.testing.assert_allclose(normal.vector, gradient, atol=1e-12)


def test_a_dense_block_is_on_the_oldest_steps_and_all_that_is_shared():
    rng = np.random.default_rng(3)
    root, gradient = rng.normal(size=(12 + SHARED, 12 + SHARED)), rng.normal(size=12 + SHARED)
    block = DenseBlock(root @ root.T, gradient)
    on, off = [*range(12), *range(6 * STEPS, SIZE)], range(12, 6 * STEPS)
    for same in (block, block.of_oldest()):
        normal = NormalEquations(STEPS, [same, same])
        np.testing.assert_allclose(normal.matrix[np.ix_(on, on)], 2 * root @ root.T)
        np.testing.assert_allclose(normal.vector[on], 2 * gradient)
        assert not normal.matrix[off].any()
        assert not normal.matrix[:, off].any()
        assert not normal.vector[off].any()


def test_a_dense_block_on_no_step_is_on_what_is_shared_alone():
    rng = np.random.default_rng(4)
    root, gradient = rng.normal(size=(SHARED, SHARED)), rng.normal(size=SHARED)
    normal = NormalEquations(STEPS, [DenseBlock(root @ root.T, gradient)])
    np.testing.assert_allclose(normal.matrix[-SHARED:, -SHARED:], root @ root.T)
    np.testing.assert_allclose(normal.vector[-SHARED:], gradient)
    assert np.count_nonzero(normal.matrix) == SHARED**2
    assert np.count_nonzero(normal.vector) == SHARED


def test_no_pairs_add_nothing():
    none = PairBlock(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty((0, 3, 6)), np.empty((0, 3, 3)))
    normal = NormalEquations(STEPS, [none, none.of_oldest()])
    assert not normal.matrix.any()
    assert not normal.vector.any()
