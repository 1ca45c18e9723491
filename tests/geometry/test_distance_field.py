"""The spline of the distance, as a sharp tip feels it: g = (x, y, 0) is a point, and gap_by_g its gradient."""

import math

import numpy as np
import pytest

from palpate import Disc, Ellipse, Polygon, Rectangle, Shape
from palpate.geometry.distance_field import DistanceField
from palpate.models.pushing.contact_geometry import ContactModel

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


def evaluated(field: DistanceField, points) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (N,), gradient (N, 2) and Hessian (N, 2, 2) at points (N, 2)."""
    points = np.reshape(points, (-1, 2)).astype(float)
    model = ContactModel(field, np.zeros(1, np.complex128), 0.0, 0.05)
    touch = model.touching(np.column_stack([points, np.zeros(len(points))])[None])[0]
    bend = touch["normal_by_g"][:, :2]
    assert np.array_equal(touch["gap_by_g"][:, :2], np.stack([touch["normal"].real, touch["normal"].imag], axis=-1))
    return touch["gap"], touch["gap_by_g"][:, :2], np.stack([bend.real, bend.imag], axis=1)


def corners_of_grid(field: DistanceField) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = field.coefficients.shape
    return field.origin, field.origin + field.cell * np.array([columns - 4, rows - 4])


def away_from_kinks(shape: Shape, points: np.ndarray, cell: float) -> np.ndarray:
    """Points around which, over three cells, the exact distance has unit slope and no corner."""
    step = 3.0 * cell
    ring = step * np.array([[math.cos(t), math.sin(t)] for t in np.arange(16) * math.pi / 8])
    around = shape.signed_distance(points[:, None] + ring)
    opposite = around[:, :8] + around[:, 8:] - 2.0 * shape.signed_distance(points)[:, None]
    return points[np.abs(opposite).max(axis=1) < 0.05 * step]


def test_the_grid_covers_shape_and_margin():
    low, high = corners_of_grid(DistanceField.of(Rectangle(0.1, 0.06), margin=0.02))
    np.testing.assert_allclose(low, [-0.07, -0.05])
    assert (high >= [0.07 - 1e-9, 0.05]).all() and (high < [0.07 + 1e-9, 0.0503]).all()


def test_values_are_exact_at_nodes_within_10_micrometres_between_and_at_kinks_within_a_fraction_of_a_cell(sampled):
    shape, field = sampled
    rng = np.random.default_rng(1)
    low, high = corners_of_grid(field)
    nodes = field.origin + field.cell * rng.integers(0, np.rint((high - low) / field.cell) + 1, (300, 2))
    np.testing.assert_allclose(evaluated(field, nodes)[0], shape.signed_distance(nodes), atol=1e-9)
    points = shape.outline(3000)
    points = np.concatenate([points + rng.normal(scale=scale, size=points.shape) for scale in (0, 1e-3, 1e-2)])
    points = away_from_kinks(shape, points, field.cell)
    assert len(points) > 5000
    np.testing.assert_allclose(evaluated(field, points)[0], shape.signed_distance(points), atol=1e-5)
    points = rng.uniform(low, high, (20_000, 2))
    found = evaluated(field, points)[0]
    np.testing.assert_allclose(found, shape.signed_distance(points), rtol=0.0, atol=0.35 * field.cell)


def test_gradient_and_hessian_of_a_disc_by_hand():
    # At distance r from the centre the gradient points outwards and the only curvature is 1 / r, across it.
    (distance,), (gradient,), (hessian,) = evaluated(DistanceField.of(Disc(0.05)), [0.0, 0.07])
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
    _, gradient, hessian = evaluated(field, points)
    for k, d in enumerate(step * np.eye(2)):
        after, before = evaluated(field, points + d), evaluated(field, points - d)
        slope = (after[0] - before[0]) / (2 * step)
        np.testing.assert_allclose(gradient[:, k], slope, atol=1e-7 + 1e-9 / field.cell)
        tolerance = 1e-4 + 1e-3 * np.abs(hessian).max()
        np.testing.assert_allclose(hessian[..., k], (after[1] - before[1]) / (2 * step), atol=tolerance)
    np.testing.assert_allclose(hessian, np.swapaxes(hessian, -1, -2), atol=1e-12)


def test_interpolant_is_twice_continuously_differentiable():
    rng = np.random.default_rng(4)
    field = DistanceField.through(np.zeros(2), 1.0, rng.normal(size=(6, 7)))
    on_a_line = np.column_stack((np.full(50, 3.0), rng.uniform(0, 5, 50)))
    for left, right in zip(evaluated(field, on_a_line - [1e-12, 0]), evaluated(field, on_a_line), strict=True):
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
        inside, at, beyond = (evaluated(field, points + s * out)[0] for s in (-1e-9, 0.0, 1e-9))
        np.testing.assert_allclose(inside, at, atol=1e-8)
        np.testing.assert_allclose(beyond, at, atol=1e-8)
        np.testing.assert_allclose(evaluated(field, points + 0.5 * out)[0], at + 0.5, atol=1e-12)


def test_a_plane_and_beyond_it_by_hand():
    field = DistanceField.through(np.array([-0.5, 1.0]), 0.5, TINY)
    (distance,), (gradient,), (hessian,) = evaluated(field, [0.2, 1.3])
    assert distance == pytest.approx(2 * 0.2 - 1.3, abs=1e-6)
    np.testing.assert_allclose(gradient, [2.0, -1.0], atol=1e-5)
    np.testing.assert_allclose(hessian, 0.0, atol=1e-4)
    # From the grid's corner (0.5, 2) with d = -1, go 3 and 4 further: -1 + 5. The slope is (3, 4) / 5 and the
    # only curvature is 1 / 5 across it: (1 / 5) (I - n n^T) = [[16, -12], [-12, 9]] / 125.
    (distance,), (gradient,), (hessian,) = evaluated(field, [3.5, 6.0])
    assert distance == pytest.approx(4.0)
    np.testing.assert_allclose(gradient, [0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(hessian, np.array([[16, -12], [-12, 9]]) / 125, atol=1e-12)
    # Straight beyond the right edge, the slope along the edge stays that of the plane, -1.
    np.testing.assert_allclose(evaluated(field, [2.0, 1.6])[1], [[1.0, -1.0]], atol=1e-6)
