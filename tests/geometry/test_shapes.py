import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from palpate import Disc, Ellipse, Polygon, Rectangle, Shape, ShapeError

# An L of two bars: 0.12 x 0.06 lying at the bottom and 0.05 x 0.14 standing on its left end.
L_SHAPE = Polygon(((0.0, 0.0), (0.12, 0.0), (0.12, 0.06), (0.05, 0.06), (0.05, 0.2), (0.0, 0.2)))
T_SHAPE = Polygon(
    [(-0.1, 0.05), (-0.1, 0.02), (-0.02, 0.02), (-0.02, -0.1), (0.03, -0.1), (0.03, 0.02), (0.1, 0.02), (0.1, 0.05)]
)
ROUND: list[Shape] = [Disc(0.088), Ellipse(0.1638, 0.2428), Ellipse(0.4, 0.05), Ellipse(0.1, 0.1)]
CORNERED: list[Shape] = [Rectangle(0.2363, 0.1579), Rectangle(0.051, 0.036), L_SHAPE, T_SHAPE]
every_shape = pytest.mark.parametrize("shape", ROUND + CORNERED, ids=repr)


def by_shapely(outline: NDArray[np.float64], points: ArrayLike) -> NDArray[np.float64]:
    polygon, where = shapely.Polygon(outline), shapely.points(np.asarray(points))
    distance = np.asarray(shapely.distance(polygon.exterior, where))
    return np.where(shapely.contains(polygon, where), -distance, distance)


@every_shape
def test_outline_is_even_and_counter_clockwise(shape):
    points = shape.outline(300)
    assert abs(len(points) - 300) <= 8
    np.testing.assert_allclose(shape.signed_distance(points), 0.0, atol=1e-12)
    outline = shapely.Polygon(points)
    assert outline.exterior.is_ccw
    assert outline.area == pytest.approx(shape.area, rel=1e-3)
    gaps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    assert gaps.max() < 1.2 * gaps.mean()
    assert gaps.min() > 0.8 * gaps.mean()


@pytest.mark.parametrize("shape", CORNERED, ids=repr)
@pytest.mark.parametrize("count", [3, 10, 200])
def test_outline_holds_every_corner(shape, count):
    distance = np.linalg.norm(shape.outline(count)[:, None] - shape.corners, axis=-1).min(axis=0)
    np.testing.assert_allclose(distance, 0.0, atol=1e-15)


def star(radii: ArrayLike, across: float = 1.0) -> Polygon:
    angle = np.arange(len(np.asarray(radii))) * 2 * math.pi / len(np.asarray(radii))
    return Polygon(np.column_stack((np.cos(angle), across * np.sin(angle))) * np.asarray(radii)[:, None])


@given(st.lists(st.floats(0.02, 1.0), min_size=3, max_size=40), st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_signed_distance_of_any_star_against_shapely(radii, point):
    outline = star(radii)
    assert outline.signed_distance(point) == pytest.approx(by_shapely(outline.corners, point), abs=1e-12)


OUTLINES: dict[str, Any] = {
    **{repr(shape): shape for shape in CORNERED},
    "circle": star(np.full(500, 0.08)),  # at its centre all edges are equally far
    "jagged": star(np.random.default_rng(0).uniform(0.04, 0.12, 300)),
    "concave": star(0.08 + 0.05 * np.cos(np.arange(400) * 8 * np.pi / 400)),
    "thin": star(np.full(400, 0.1), across=5e-3),
    "comb": Polygon(
        [(0.0, 0.0), (0.2, 0.0)]
        + [(0.2 - 0.0025 * k, 0.1 if k % 4 in (1, 2) else 0.01) for k in range(79)]
        + [(0.0, 0.01)]
    ),
    "cornered": Polygon(np.concatenate([T_SHAPE.outline(300)[:60], T_SHAPE.corners[3:]])),  # collinear, uneven
}


@pytest.mark.parametrize("name", OUTLINES)
def test_signed_distance_of_corners_and_edges_against_shapely(name):
    shape, rng = OUTLINES[name], np.random.default_rng(2)
    outline = shape.corners[rng.integers(len(shape.corners), size=500)]
    around = [outline + rng.normal(scale=scale, size=outline.shape) for scale in (0.0, 1e-5, 1e-3)]
    grid = np.stack(np.meshgrid(np.linspace(-0.15, 0.15, 61), np.linspace(-0.15, 0.15, 61)), axis=-1).reshape(-1, 2)
    points = np.concatenate([*around, grid, rng.uniform(-0.5, 0.5, (500, 2)), np.zeros((1, 2))])
    np.testing.assert_allclose(shape.signed_distance(points), by_shapely(shape.corners, points), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("shape", ROUND, ids=repr)
def test_signed_distance_of_curves_against_a_dense_outline(shape):
    points = np.random.default_rng(4).uniform(-0.3, 0.3, (1000, 2))
    points[:500] *= 0.2
    expected = by_shapely(shape.outline(50_000), points)
    np.testing.assert_allclose(shape.signed_distance(points), expected, atol=1e-8)


@given(st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.floats(0.0, 2 * math.pi), st.floats(-0.95, 3.0))
def test_signed_distance_of_an_ellipse_along_its_normals(a, b, angle, share):
    # Going from a point of the outline along the normal, that point stays the nearest one up to the smallest
    # radius of curvature inwards, min(a, b)^2 / max(a, b), and for ever outwards.
    offset = share * min(a, b) ** 2 / max(a, b)
    start = np.array([a * math.cos(angle), b * math.sin(angle)])
    normal = np.array([b * math.cos(angle), a * math.sin(angle)])
    point = start + offset * normal / np.linalg.norm(normal)
    assert Ellipse(2 * a, 2 * b).signed_distance(point) == pytest.approx(offset, abs=1e-9)


def test_signed_distance_of_an_ellipse_where_the_nearest_point_is_not_unique():
    shape = Ellipse(0.4, 0.2)  # a = 0.2, b = 0.1
    # The centre: the ends of the short axis are nearest. On the long axis at x < a - b^2 / a = 0.15 the
    # nearest points are at cos t = a x / (a^2 - b^2): for x = 0.06 that is 0.4, so (0.08, 0.1 sqrt(0.84)),
    # at a distance of sqrt(0.02^2 + 0.0084) = sqrt(0.0088). At the cusp x = 0.15 and on, the end (0.2, 0).
    points = [[0.0, 0.0], [0.06, 0.0], [-0.06, 0.0], [0.15, 0.0], [0.18, 0.0], [0.2, 0.0], [0.0, 0.3]]
    expected = [-0.1, -math.sqrt(0.0088), -math.sqrt(0.0088), -0.05, -0.02, 0.0, 0.2]
    np.testing.assert_allclose(shape.signed_distance(points), expected, atol=1e-12)
    turned = Ellipse(0.2, 0.4).signed_distance(np.array(points)[:, ::-1])
    np.testing.assert_allclose(turned, expected, atol=1e-12)


@every_shape
def test_signed_distance_keeps_leading_axes(shape):
    points = np.random.default_rng(5).uniform(-0.2, 0.2, (2, 3, 2))
    many = shape.signed_distance(points)
    assert many.shape == (2, 3)
    assert shape.signed_distance(points[1, 2]) == pytest.approx(many[1, 2], abs=1e-15)


def test_area_and_centroid_by_hand():
    # Bars of 0.12 x 0.06 = 0.0072 about (0.06, 0.03) and 0.05 x 0.14 = 0.007 about (0.025, 0.13).
    area = 0.0072 + 0.007
    assert L_SHAPE.area == pytest.approx(area, rel=1e-12)
    x = (0.0072 * 0.06 + 0.007 * 0.025) / area
    y = (0.0072 * 0.03 + 0.007 * 0.13) / area
    np.testing.assert_allclose(L_SHAPE.centroid, [x, y], rtol=1e-12)
    assert Ellipse(0.2, 0.1).area == pytest.approx(math.pi * 0.1 * 0.05)
    assert Disc(0.1).area == pytest.approx(math.pi * 0.01)
    assert Rectangle(0.2, 0.1).area == pytest.approx(0.02)
    for shape in (Disc(0.1), Rectangle(0.2, 0.1), Ellipse(0.2, 0.1)):
        np.testing.assert_array_equal(shape.centroid, [0.0, 0.0])


def test_friction_radius_by_hand():
    assert Disc(0.09).friction_radius() == pytest.approx(0.06, rel=1e-12)  # 2 r / 3
    # Square of side s: the mean distance from its centre is s (sqrt 2 + asinh 1) / 6.
    root = math.sqrt(2.0) + math.asinh(1.0)
    square = Rectangle(0.1, 0.1)
    assert square.friction_radius() == pytest.approx(0.1 * root / 6, rel=1e-12)
    assert Ellipse(0.2, 0.2).friction_radius() == pytest.approx(0.2 / 3, rel=1e-12)


@every_shape
def test_uniform_friction_radius_against_numerical_integration(shape):
    # A fan of thin triangles about the centroid, with signed areas, because the L and the T do not see all of
    # their outline from there.
    outline = shape.outline(2000) - shape.centroid
    nodes, weights = np.polynomial.legendre.leggauss(6)
    across, across_weights = 0.5 * (nodes + 1.0), 0.5 * weights
    a, b = outline, np.roll(outline, -1, axis=0)
    signed = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    # On the triangle (0, a, b) the distance grows linearly from 0: its mean is 2/3 of that on the far edge.
    far = np.linalg.norm(a[:, None] + across[:, None] * (b - a)[:, None], axis=-1) @ across_weights
    expected = (signed * 2.0 / 3.0 * far).sum() / signed.sum()
    tolerance = 1e-7 if shape in CORNERED else 1e-5  # a curve is cut off by its chords
    assert shape.friction_radius() == pytest.approx(expected, rel=tolerance)


def test_polygon_comes_out_counter_clockwise_and_open():
    clockwise_closed = np.array([[0, 0], [0, 1], [0, 1], [2, 1], [2, 0], [0, 0]])
    assert Polygon(clockwise_closed).vertices == ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0))
    assert Polygon(L_SHAPE.vertices[::-1]).friction_radius() == pytest.approx(L_SHAPE.friction_radius())
    assert hash(L_SHAPE) == hash(Polygon(L_SHAPE.corners))


@pytest.mark.parametrize("size", [0, -0.1, math.nan, math.inf, "0.1", None, True])
def test_bad_sizes(size):
    for make in (Disc, lambda s: Rectangle(s, 0.1), lambda s: Rectangle(0.1, s), lambda s: Ellipse(s, 0.1)):
        with pytest.raises(ShapeError, match="must be a length from"):
            make(size)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], r"crosses.*0\.5 0\.5"),
        ([[0, 0], [1, 1]], "2 different vertices"),
        ([[0, 0], [1, 1], [3, 3]], "no area"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], r"\(3, 3\)"),
        ([[0, 0], [1, math.nan], [1, 1]], "vertex 1"),
        ([[0, 0], [1], [1, 1]], "no numbers"),
    ],
)
def test_bad_polygons(vertices, message):
    with pytest.raises(ShapeError, match=message):
        Polygon(vertices)


def test_corners_that_are_as_good_as_one_are_one():
    square = Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 1e-200), (1.0, 1.0), (0.0, 1.0)])
    assert len(square.vertices) == 4
    assert np.isfinite(square.signed_distance(np.array([[0.5, 0.5], [1.0, 0.0]]))).all()
