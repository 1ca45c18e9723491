"""What the terms of a graph cost, by hand."""

import math

import numpy as np
import pytest
from push_samples import RADIUS, model_of, sensor, touching

from palpate.geometry import se2
from palpate.graph.evidence import add_costs, add_headings, mean_square

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


def headings(heading: float, step: float = 2e-3, at: tuple[float, float, float] = (0.3, -0.2, 2.9)) -> Array:
    """What it costs in each of six steps (N,) to go so far, at an angle from the normal of a side, on an object here.

    The object rests and the sensor stays on its side, so that seen from the side it glides; only the way in the world
    counts, which is told to go elsewhere.
    """
    model = model_of("rectangle", sensor(RADIUS))
    g = touching(model, np.full(6, 0.01))
    o = se2.compose(np.array(at), np.zeros((6, 3)))
    o[:, :2] += step * np.arange(6)[:, None] * (np.cos(at[2] + heading), np.sin(at[2] + heading))
    found = np.zeros((1, 6))
    add_headings(g[None], se2.compose(o, g)[None], model.touching(g[None]), 3, found)
    return found[0]


def test_a_way_straight_into_the_object_costs_nothing():
    np.testing.assert_allclose(headings(0.0), 0.0, atol=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_way_past_the_object_costs_the_log_of_its_cosine(side):
    # At 60 degrees the cosine is a half, softened by a tenth: (0.5 + sqrt(0.25 + 0.01)) / 2. Ways of 4 to 10 mm nearly
    # count in full. Along the side it is 0.1 / 2, and away from the object hardly anything is left of it.
    found = headings(side * math.pi / 3.0)
    assert found[0] == 0.0
    np.testing.assert_allclose(found[1:], -math.log(0.5 * (0.5 + math.sqrt(0.26))), rtol=0.03)
    np.testing.assert_allclose(headings(side * math.pi / 2.0)[1:], math.log(20.0), rtol=0.03)
    assert (headings(side * 3.0)[1:] > 5.0).all()


def test_a_sensor_that_stands_still_has_no_way():
    assert not headings(1.5, 0.0).any()
    # Of 0.1 mm in six steps, less than its pose is known by, hardly anything counts.
    assert headings(1.5, 2e-5)[1:].max() < 0.05 * headings(1.5)[1:].min()
