import math

import numpy as np
import pytest

from palpate import Disc, Ellipse, EstimationError, Polygon, Rectangle, SettingError, Shape
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.polygon import sharp_corners

L_SHAPE = Polygon(((0.0, 0.0), (0.12, 0.0), (0.12, 0.06), (0.05, 0.06), (0.05, 0.2), (0.0, 0.2)))
SHAPES: list[Shape] = [
    Disc(0.088),
    Rectangle(0.2363, 0.1579),
    Ellipse(0.1638, 0.2428),
    Rectangle(0.051, 0.036),
    L_SHAPE,
]
# d = 2 x - y at x = -0.5, 0, 0.5 (columns) and y = 1, 1.5, 2 (rows): first row -1 - 1, 0 - 1, 1 - 1.
TINY = np.array([[-2.0, -1.0, 0.0], [-2.5, -1.5, -0.5], [-3.0, -2.0, -1.0]])


@pytest.fixture(scope="module", params=SHAPES, ids=repr)
def sampled(request):
    return request.param, DistanceField.of(request.param)


def corners_of_grid(field: DistanceField) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = field.values.shape
    return field.origin, field.origin + field.cell * np.array([columns - 1, rows - 1])


def away_from_kinks(shape: Shape, points: np.ndarray, cell: float) -> np.ndarray:
    """Points around which, over three cells, the exact distance has unit slope and no corner."""
    step = 3.0 * cell
    ring = step * np.array([[math.cos(t), math.sin(t)] for t in np.arange(16) * math.pi / 8])
    around = shape.signed_distance(points[:, None] + ring)
    opposite = around[:, :8] + around[:, 8:] - 2.0 * shape.signed_distance(points)[:, None]
    return points[np.abs(opposite).max(axis=1) < 0.05 * step]


def test_values_are_exact_at_nodes(sampled):
    shape, field = sampled
    rows, columns = field.values.shape
    nodes = np.random.default_rng(0).integers(0, (columns, rows), (300, 2))
    points = field.origin + field.cell * nodes
    exact = shape.signed_distance(points)
    np.testing.assert_allclose(field.values[nodes[:, 1], nodes[:, 0]], exact, atol=1e-12)
    np.testing.assert_allclose(field.value(points), exact, atol=1e-9)


def test_values_between_nodes_are_within_10_micrometres_and_at_kinks_within_a_fraction_of_a_cell(sampled):
    shape, field = sampled
    rng = np.random.default_rng(1)
    points = shape.outline(3000)
    points = np.concatenate([points + rng.normal(scale=scale, size=points.shape) for scale in (0, 1e-3, 1e-2)])
    points = away_from_kinks(shape, points, field.cell)
    assert len(points) > 5000
    np.testing.assert_allclose(field.value(points), shape.signed_distance(points), atol=1e-5)
    points = rng.uniform(*corners_of_grid(field), (20_000, 2))
    np.testing.assert_allclose(field.value(points), shape.signed_distance(points), rtol=0.0, atol=0.35 * field.cell)


def test_gradient_and_hessian_of_a_disc_by_hand():
    # At distance r from the centre the gradient points outwards and the only curvature is 1 / r, across it.
    field = DistanceField.of(Disc(0.05))
    distance, gradient, hessian = field.value_gradient_hessian([0.0, 0.07])
    assert distance == pytest.approx(0.02, abs=1e-9)
    np.testing.assert_allclose(gradient, [0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(hessian, [[1 / 0.07, 0.0], [0.0, 0.0]], atol=1e-3)


def test_gradient_and_hessian_are_the_derivatives_of_the_value(sampled):
    shape, field = sampled
    low, high = corners_of_grid(field)
    rng = np.random.default_rng(3)
    outline = shape.outline(100)
    near = outline + rng.normal(scale=0.002, size=outline.shape)
    points = np.concatenate([rng.uniform(low - 0.05, high + 0.05, (100, 2)), near])
    outside = ((points < low) | (points > high)).any(axis=1)
    assert outside.sum() > 20
    step = 1e-6
    _, gradient, hessian = field.value_gradient_hessian(points)
    for k, d in enumerate(step * np.eye(2)):
        slope = (field.value(points + d) - field.value(points - d)) / (2 * step)
        np.testing.assert_allclose(gradient[:, k], slope, atol=1e-7 + 1e-9 / field.cell)
        after, before = (field.value_gradient_hessian(points + s * d)[1] for s in (1, -1))
        tolerance = 1e-4 + 1e-3 * np.abs(hessian).max()
        np.testing.assert_allclose(hessian[..., k], (after - before) / (2 * step), atol=tolerance)
    np.testing.assert_allclose(hessian, np.swapaxes(hessian, -1, -2), atol=1e-12)


def test_interpolant_is_twice_continuously_differentiable():
    rng = np.random.default_rng(4)
    field = DistanceField(np.zeros(2), 1.0, rng.normal(size=(6, 7)))
    on_a_line = np.column_stack((np.full(50, 3.0), rng.uniform(0, 5, 50)))
    before, at = field.value_gradient_hessian(on_a_line - [1e-12, 0]), field.value_gradient_hessian(on_a_line)
    for left, right in zip(before, at, strict=True):
        np.testing.assert_allclose(left, right, atol=1e-9)


def test_continuous_across_the_border_and_growing_beyond(sampled):
    _, field = sampled
    low, high = corners_of_grid(field)
    along = np.linspace(0.0, 1.0, 50)[:, None] * (high - low) + low
    for axis, border, sign in ((0, low, -1), (1, low, -1), (0, high, 1), (1, high, 1)):
        points = along.copy()
        points[:, axis] = border[axis]
        out = np.zeros(2)
        out[axis] = sign
        inside, at, beyond = (field.value(points + s * out) for s in (-1e-9, 0.0, 1e-9))
        np.testing.assert_allclose(inside, at, atol=1e-8)
        np.testing.assert_allclose(beyond, at, atol=1e-8)
        np.testing.assert_allclose(field.value(points + 0.5 * out), at + 0.5, atol=1e-12)


def test_a_plane_by_hand():
    field = DistanceField(np.array([-0.5, 1.0]), 0.5, TINY)
    distance, gradient, hessian = field.value_gradient_hessian([0.2, 1.3])
    assert distance == pytest.approx(2 * 0.2 - 1.3, abs=1e-6)
    np.testing.assert_allclose(gradient, [2.0, -1.0], atol=1e-5)
    np.testing.assert_allclose(hessian, 0.0, atol=1e-4)


def test_beyond_a_corner_of_the_grid_by_hand():
    # From the grid's corner (0.5, 2) with d = -1, go 3 and 4 further: -1 + 5. The slope is (3, 4) / 5 and the
    # only curvature is 1 / 5 across it: (1 / 5) (I - n n^T) = [[16, -12], [-12, 9]] / 125.
    field = DistanceField(np.array([-0.5, 1.0]), 0.5, TINY)
    distance, gradient, hessian = field.value_gradient_hessian([3.5, 6.0])
    assert distance == pytest.approx(4.0)
    np.testing.assert_allclose(gradient, [0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(hessian, np.array([[16, -12], [-12, 9]]) / 125, atol=1e-12)
    # Straight beyond the right edge, the slope along the edge stays that of the plane, -1.
    _, gradient, _ = field.value_gradient_hessian([2.0, 1.6])
    np.testing.assert_allclose(gradient, [1.0, -1.0], atol=1e-6)


def test_one_point_and_many_give_the_same(sampled):
    _, field = sampled
    points = np.random.default_rng(5).uniform(-0.3, 0.3, (3, 4, 2))
    many = field.value_gradient_hessian(points)
    assert [part.shape for part in many] == [(3, 4), (3, 4, 2), (3, 4, 2, 2)]
    for part, one in zip(many, field.value_gradient_hessian(points[2, 1]), strict=True):
        np.testing.assert_allclose(part[2, 1], one, atol=1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_point_that_is_not_finite(bad):
    field = DistanceField.of(Disc(0.01))
    with pytest.raises(EstimationError, match=str(bad)):
        field.value([[0.0, 0.0], [0.1, bad]])


@pytest.mark.parametrize("settings", [{"cell": 0.0}, {"cell": -1.0}, {"cell": 9.0}, {"margin": -0.01}])
def test_bad_settings(settings):
    with pytest.raises(SettingError):
        DistanceField.of(Disc(0.05), **settings)


def test_grid_covers_shape_and_margin():
    field = DistanceField.of(Rectangle(0.1, 0.06), cell=0.001, margin=0.02)
    low, high = corners_of_grid(field)
    np.testing.assert_allclose(low, [-0.07, -0.05])
    np.testing.assert_allclose(high, [0.07, 0.05])
    assert field.values.shape == (101, 141)


def test_sharp_corners_stick_out():
    notched = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])  # the fourth points inwards
    assert sharp_corners(notched).tolist() == [0, 1, 2, 4]
    assert not len(sharp_corners(Disc(1.0).outline(13)))  # 27.7 degrees each
    assert len(sharp_corners(Disc(1.0).outline(11))) == 11  # 32.7
