"""What the terms of a graph cost, by hand."""

import math

import numpy as np
import pytest

from palpate.estimation.evidence import add_costs, mean_square

Array = np.ndarray
SCALE = 2.0  # of the kernels [standard deviations]


def rows(of_terms: list[list[float]]) -> Array:
    """(B, T, R) of one smoother."""
    return np.array([of_terms], np.float64)


def costs(residual: Array, information: Array, weight: Array, places: list[list[int]], steps: int = 1) -> list[float]:
    both = np.zeros((2, steps, 2))
    # Beside another smoother that is twice as far off, which changes nothing.
    off, known, counts = (np.concatenate([one, one]) for one in (residual, information, weight))
    off[1] *= 2.0
    add_costs(off, known, counts, np.array(places, np.int64), both[..., 1])
    assert not both[..., 0].any()
    assert all(both[1, :, 1] >= both[0, :, 1])
    return both[0, :, 1].tolist()


def cauchy(square: float) -> float:
    """What a Cauchy kernel leaves of half a square."""
    return 0.5 * SCALE**2 * math.log1p(square / SCALE**2)


@pytest.mark.parametrize("residual", [0.0, 1e-6, 0.05, -0.4, 3.0, 1e3])
@pytest.mark.parametrize("information", [4.0, 1e4])
def test_what_a_kernel_leaves_of_one_row(residual, information):
    square = information * residual**2
    weight = information / (1.0 + square / SCALE**2)
    (found,) = costs(rows([[residual]]), rows([[information]]), rows([[weight]]), [[0]])
    np.testing.assert_allclose(found, cauchy(square), rtol=1e-6)


def test_two_rows_under_one_kernel_cost_what_their_squares_cost_together():
    information, residual = np.array([4.0, 9.0]), np.array([1.5, -0.5])
    square = 4.0 * 2.25 + 9.0 * 0.25
    weight = information / (1.0 + square / SCALE**2)
    given = [rows([one.tolist()]) for one in (residual, information, weight)]
    (found,) = costs(given[0], given[1], given[2], [[0]])
    np.testing.assert_allclose(found, cauchy(square), rtol=1e-12)
    # Two kernels of their own leave less.
    assert found < 0.99 * (cauchy(9.0) + cauchy(2.25))


def test_without_a_kernel_it_is_half_the_square():
    information = rows([[4.0, 100.0]])
    (found,) = costs(rows([[1.5, -0.2]]), information, information, [[0]])
    np.testing.assert_allclose(found, 0.5 * (4.0 * 2.25 + 100.0 * 0.04), rtol=1e-12)


def test_what_is_not_known_costs_nothing():
    given = rows([[2.0, 5.0], [7.0, 3.0]])
    information, weight = rows([[4.0, 0.0], [0.0, 0.0]]), rows([[4.0, 0.0], [0.0, 0.0]])
    assert costs(given, information, weight, [[0], [0]]) == [0.5 * 4.0 * 4.0]


def test_a_term_costs_its_last_step():
    # Of terms on one step and on two; what a step costs already stays.
    information = rows([[1.0], [1.0], [1.0], [1.0]])
    given = rows([[1.0], [2.0], [3.0], [4.0]])
    assert costs(given, information, information, [[0, 1], [1, 2], [0, 2], [2, 3]], 4) == [0.0, 0.5, 6.5, 8.0]
    found = np.zeros((1, 3, 2))
    found[0, :, 0] = (10.0, 20.0, 30.0)
    add_costs(given, information, information, np.array([[0], [1], [1], [2]], np.int64), found[..., 0])
    assert found[0, :, 0].tolist() == [10.5, 20.0 + 2.0 + 4.5, 38.0]


def test_mean_square_of_the_last_terms():
    # Two rows each; a term counts by its last step.
    given = rows([[3.0, 1.0], [1.0, 2.0], [0.5, 0.0]])
    information = rows([[2.0, 1.0], [1.0, 4.0], [4.0, 9.0]])
    places = np.array([[0, 1], [0, 2], [2, 3]], np.int64)
    squares = (2.0 * 9.0 + 1.0, 1.0 + 4.0 * 4.0, 4.0 * 0.25)
    for first, wanted in ((0, sum(squares) / 3), (1, sum(squares) / 3), (2, sum(squares[1:]) / 2), (3, squares[2])):
        np.testing.assert_allclose(mean_square(given[0], information[0], places, first), wanted, rtol=1e-12)
    assert mean_square(given[0], information[0], places, 4) == 0.0
    assert mean_square(given[0, :0], information[0, :0], places[:0], 0) == 0.0
