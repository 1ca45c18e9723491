"""Both kinds of normal equations against NumPy, from random rows of factors."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.graph.block_tridiagonal import BandedEquations
from palpate.graph.dense_equations import DenseEquations
from palpate.graph.factors.factor import Columns, Rows, columns_of
from palpate.graph.normal_equations import LAST_SIZE, Gaussian, Solution
from palpate.graph.variables import OF_OBJECT, OF_STEP, SENSOR, SENSOR_IN_OBJECT, SHARED, SHARED_SIZE, STEP_SIZE

Array = np.ndarray
Equations = BandedEquations | DenseEquations
SMOOTHERS, STEPS = 3, 5
SIZE = STEP_SIZE * STEPS + SHARED_SIZE  # what is shared is last
STEP, G, E = tuple(OF_STEP), (SENSOR_IN_OBJECT,), (SENSOR,)


@dataclass(frozen=True)
class Case:
    """Terms of one factor."""

    rows: Rows
    places: Array  # (T, K)
    columns: Columns

    def summed(self, kept: Callable[[Array], bool] = lambda _: True) -> tuple[Array, Array]:
        """J^T W J (B, SIZE, SIZE) and -J^T W r (B, SIZE) by NumPy, its Jacobian spread over all unknowns."""
        matrix, vector = np.zeros((SMOOTHERS, SIZE, SIZE)), np.zeros((SMOOTHERS, SIZE))
        for t, places in enumerate(self.places):
            if not kept(places):
                continue
            spread = np.zeros((SMOOTHERS, self.rows.residual.shape[2], SIZE))
            for column, (slot, place) in enumerate(zip(self.columns.slot, self.columns.place, strict=True)):
                first = STEP_SIZE * STEPS if slot < 0 else STEP_SIZE * places[slot]
                spread[:, :, first + place] = self.rows.jacobian[:, t, :, column]
            pulled = spread.transpose(0, 2, 1) * self.rows.weight[:, t, None]
            matrix += pulled @ spread
            vector -= (pulled @ self.rows.residual[:, t, :, None])[..., 0]
        return matrix, vector


def case(rng: np.random.Generator, places: list[list[int]], steps: tuple, shared: tuple, rows: int) -> Case:
    columns = columns_of(steps, shared)
    shape = (SMOOTHERS, len(places), rows)
    residual, jacobian = rng.normal(size=shape), rng.normal(size=(*shape, len(columns.slot)))
    given = Rows(residual, jacobian, np.full(shape, np.nan), rng.uniform(1.0, 2.0, shape))
    return Case(given, np.array(places, np.int64).reshape(-1, len(steps)), columns)


def neighbours(seed: int) -> list[Case]:
    """Terms that tie a step and the next one at most: on all steps, on one, on one twice, with all that is shared."""
    rng = np.random.default_rng(seed)
    every, pairs = [[k] for k in range(STEPS)], [[k, k + 1] for k in range(STEPS - 1)]
    return [
        case(rng, every, (G,), (), 3),
        case(rng, every, (E,), (), 3),
        case(rng, every, (STEP,), SHARED, 2),
        case(rng, [[2], [0], [2]], (G,), (SHARED[1],), 1),
        case(rng, [[0]], (STEP,), OF_OBJECT, 9),
        case(rng, pairs, (G, G), (), 2),
        case(rng, pairs, (STEP, STEP), SHARED[3:], 1),
        case(rng, [pairs[3], pairs[1]], (E, STEP), SHARED, 2),
        case(rng, [], (G,), SHARED, 2),
    ]


def ties(seed: int) -> list[Case]:
    """Terms that tie steps apart: out of order, one of them twice, neighbours and the two ends."""
    rng = np.random.default_rng(seed)
    pairs = [[2, 4], [0, 4], [1, 2], [0, 4], [0, 1], [3, 4]]
    return [case(rng, pairs, (G, G), (), 3), case(rng, pairs[:2], (STEP, G), SHARED, 2)]


def gaussian(seed: int, steps: int) -> Gaussian:
    """One on so many of the oldest steps and what is shared."""
    rng = np.random.default_rng(seed)
    size = STEP_SIZE * steps + SHARED_SIZE
    root = rng.normal(size=(SMOOTHERS, size, size))
    return Gaussian(steps, root @ root.transpose(0, 2, 1), rng.normal(size=(SMOOTHERS, size)))


def solved(equations: Equations) -> Solution:
    with equations.threads():
        return equations.solve()


def check(solution: Solution, matrix: Array, vector: Array) -> None:
    """Check a solution against NumPy's."""
    wanted = np.linalg.solve(matrix, vector[..., None])[..., 0]
    assert solution.by_step.shape == (SMOOTHERS, STEPS, STEP_SIZE)
    found = np.concatenate([solution.by_step.reshape(SMOOTHERS, -1), solution.by_shared], axis=1)
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-10)
    covariance = np.linalg.inv(matrix)[:, -LAST_SIZE:, -LAST_SIZE:]
    np.testing.assert_allclose(solution.covariance, covariance, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("kind", [BandedEquations, DenseEquations])
@pytest.mark.parametrize("past", [0, 1])
def test_terms_of_neighbours(kind, past):
    equations, known = kind(SMOOTHERS, STEPS), gaussian(7, past)
    matrix, vector = spread_gaussian(known)
    for each in neighbours(1):
        equations.add(each.rows, each.places, each.columns)
        information, gradient = each.summed()
        matrix, vector = matrix + information, vector + gradient
    equations.add_gaussian(known)
    check(solved(equations), matrix, vector)


@pytest.mark.parametrize("which", range(9))
@pytest.mark.parametrize("kind", [BandedEquations, DenseEquations])
def test_each_kind_of_terms_by_itself(kind, which):
    # On top of something that is known of everything.
    each, known = neighbours(2)[which], [neighbours(3)[0], neighbours(3)[1], neighbours(3)[2]]
    equations = kind(SMOOTHERS, STEPS)
    matrix, vector = spread_gaussian(gaussian(8, 0))
    for one in (each, *known):
        equations.add(one.rows, one.places, one.columns)
        information, gradient = one.summed()
        matrix, vector = matrix + information, vector + gradient
    equations.add_gaussian(gaussian(8, 0))
    check(solved(equations), matrix, vector)


@pytest.mark.parametrize("past", [0, 1, 3, 5])
def test_terms_of_any_steps(past):
    equations, known = DenseEquations(SMOOTHERS, STEPS), gaussian(9, past)
    matrix, vector = spread_gaussian(known)
    for each in [*neighbours(4), *ties(5)]:
        equations.add(each.rows, each.places, each.columns)
        information, gradient = each.summed()
        matrix, vector = matrix + information, vector + gradient
    equations.add_gaussian(known)
    check(solved(equations), matrix, vector)


def spread_gaussian(known: Gaussian) -> tuple[Array, Array]:
    """The same on all unknowns."""
    on = [*range(STEP_SIZE * known.steps), *range(STEP_SIZE * STEPS, SIZE)]
    matrix, vector = np.zeros((SMOOTHERS, SIZE, SIZE)), np.zeros((SMOOTHERS, SIZE))
    matrix[:, np.array(on)[:, None], on], vector[:, on] = known.information, known.gradient
    return matrix, vector


def test_one_step_alone():
    rng = np.random.default_rng(6)
    one, known = case(rng, [[0]], (STEP,), SHARED, 13), gaussian(3, 1)
    wanted = None
    for kind in (BandedEquations, DenseEquations):
        equations = kind(SMOOTHERS, 1)
        equations.add(one.rows, one.places, one.columns)
        equations.add_gaussian(known)
        found = solved(equations)
        pulled = one.rows.jacobian[:, 0].transpose(0, 2, 1) * one.rows.weight[:, 0, None]
        matrix = known.information + pulled @ one.rows.jacobian[:, 0]
        np.testing.assert_allclose(found.covariance, np.linalg.inv(matrix), rtol=1e-8, atol=1e-10)
        vector = known.gradient - (pulled @ one.rows.residual[:, 0, :, None])[..., 0]
        wanted = np.linalg.solve(matrix, vector[..., None])[..., 0]
        np.testing.assert_allclose(np.hstack([found.by_step[:, 0], found.by_shared]), wanted, rtol=1e-8)


def test_without_the_oldest_step_there_is_a_schur_complement():
    # Of all terms those that are tied to the oldest step alone take part.
    equations, known = DenseEquations(SMOOTHERS, STEPS), gaussian(10, 2)
    matrix, vector = spread_gaussian(known)
    for each in [*neighbours(11), *ties(12)]:
        equations.add(each.rows, each.places, each.columns, of_oldest=True)
        information, gradient = each.summed(lambda places: 0 in places)
        matrix, vector = matrix + information, vector + gradient
    equations.add_gaussian(known)
    left = equations.without_oldest()
    assert left.steps == STEPS - 1
    gone, rest = slice(0, STEP_SIZE), slice(STEP_SIZE, None)
    share = matrix[:, rest, gone] @ np.linalg.inv(matrix[:, gone, gone])
    np.testing.assert_allclose(left.information, matrix[:, rest, rest] - share @ matrix[:, gone, rest], atol=1e-9)
    np.testing.assert_allclose(left.gradient, vector[:, rest] - (share @ vector[:, gone, None])[..., 0], atol=1e-9)


def test_a_gaussian_seen_from_elsewhere():
    # Of a Gaussian with its mean at m the negative gradient at x is A (m - x).
    known, rng = gaussian(13, 2), np.random.default_rng(14)
    change = rng.normal(size=known.gradient.shape)
    mean = np.linalg.solve(known.information, known.gradient[..., None])[..., 0]
    found = known.moved(change)
    wanted = (known.information @ (mean - change)[..., None])[..., 0]
    np.testing.assert_allclose(found.gradient, wanted, rtol=1e-8, atol=1e-9)
    assert found.steps == known.steps
    np.testing.assert_array_equal(found.information, known.information)


@pytest.mark.parametrize("steps", [0, 2])
def test_other_prior_knowledge_of_one_number(steps):
    # One number, independent of all others: N(0.4, 0.1) before, measured to be 0.3 within 0.2, and now N(0.15, 0.05):
    # informations are 100, 25 and 400.
    shared, at = 4, np.array([0.1, 0.35, 0.6])  # where it is for each smoother
    known = gaussian(15, steps)
    place = STEP_SIZE * steps + shared
    information, gradient = known.information.copy(), known.gradient.copy()
    information[:, place], information[:, :, place] = 0.0, 0.0
    information[:, place, place] = 100.0 + 25.0
    gradient[:, place] = 100.0 * (0.4 - at) + 25.0 * (0.3 - at)
    found = Gaussian(steps, information, gradient).believing(shared, at, (0.4, 0.1), (0.15, 0.05))
    assert found.steps == steps
    np.testing.assert_allclose(found.information[:, place, place], 400.0 + 25.0, rtol=1e-12)
    np.testing.assert_allclose(found.gradient[:, place], 400.0 * (0.15 - at) + 25.0 * (0.3 - at), rtol=1e-9)
    # The others stay, and so does the one that it was made of.
    others = np.arange(gradient.shape[1]) != place
    np.testing.assert_array_equal(found.gradient[:, others], known.gradient[:, others])
    np.testing.assert_array_equal(
        found.information[:, others][:, :, others], known.information[:, others][:, :, others]
    )
    np.testing.assert_array_equal(found.information[:, place, others], 0.0)
    np.testing.assert_array_equal(information[:, place, place], 125.0)
    np.testing.assert_array_equal(gradient[:, place], 100.0 * (0.4 - at) + 25.0 * (0.3 - at))
    # Of a Gaussian that ties it to others, too, that alone changes; and back is the way there.
    tied = known.believing(shared, at, (0.4, 0.1), (0.15, 0.05))
    more = np.zeros_like(known.information)
    more[:, place, place] = 300.0
    np.testing.assert_allclose(tied.information, known.information + more, rtol=1e-12)
    back = tied.believing(shared, at, (0.15, 0.05), (0.4, 0.1))
    np.testing.assert_allclose(back.information, known.information, rtol=1e-9)
    np.testing.assert_allclose(back.gradient, known.gradient, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", [BandedEquations, DenseEquations])
@pytest.mark.parametrize("bad", [np.nan, np.inf, None])
def test_what_leaves_one_smoother_no_solution_leaves_the_others_theirs(kind, bad):
    equations = kind(SMOOTHERS, STEPS)
    for each in neighbours(1)[:2]:
        if bad is not None:
            each.rows.residual[1, 2, 0] = each.rows.jacobian[1, 2, 0, 0] = bad
        equations.add(each.rows, each.places, each.columns)
    if bad is not None:  # without, nothing is known of what is shared
        equations.add_gaussian(gaussian(7, 0))
    solution = solved(equations)
    assert solution.is_found.tolist() == [bad is not None, False, *[bad is not None] * (SMOOTHERS - 2)]
    assert not solution.by_step[1].any() and not solution.by_shared[1].any()


def test_an_oldest_step_of_which_nothing_is_known_leaves_no_solution():
    equations = DenseEquations(SMOOTHERS, STEPS)
    left = equations.without_oldest()
    assert np.isnan(left.information).all() and np.isnan(left.gradient).all()
    equations = DenseEquations(SMOOTHERS, STEPS - 1)
    equations.add_gaussian(left)
    assert not solved(equations).is_found.any()


def test_columns_follow_the_unknowns():
    columns = columns_of((G, STEP), SHARED[1:3])
    assert columns.slot.tolist() == [0] * 3 + [1] * 6 + [-1] * 2
    assert columns.place.tolist() == [0, 1, 2, 0, 1, 2, 3, 4, 5, 1, 2]
    with pytest.raises(ValueError, match="have gaps, or are in another order"):
        columns_of(((SENSOR, SENSOR_IN_OBJECT),), ())
    with pytest.raises(ValueError, match="have gaps, or are in another order"):
        columns_of((G,), (SHARED[0], SHARED[2]))


def test_what_changes_unmeasured_is_less_certain_and_stays_where_it_is():
    rng = np.random.default_rng(5)
    size = 2 * STEP_SIZE + SHARED_SIZE
    root = rng.normal(size=(3, size, size))
    information, gradient = root @ root.transpose(0, 2, 1) + np.eye(size), rng.normal(size=(3, size))
    variance = np.zeros(SHARED_SIZE)
    variance[[1, SHARED_SIZE - 1]] = 0.3, 2.0
    later = Gaussian(2, information, gradient).loosened(variance)
    more = np.diag(np.concatenate([np.zeros(2 * STEP_SIZE), variance]))
    np.testing.assert_allclose(np.linalg.inv(later.information), np.linalg.inv(information) + more, atol=1e-9)
    for one in range(3):
        before = np.linalg.solve(information[one], gradient[one])
        np.testing.assert_allclose(np.linalg.solve(later.information[one], later.gradient[one]), before, atol=1e-9)
