import math

import numpy as np
import planar
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.geometry import se2

lengths = st.floats(-10.0, 10.0)
near_pi = st.sampled_from([1.0, -1.0]).flatmap(
    lambda sign: st.floats(0.0, 1e-3).map(lambda gap: sign * (math.pi - gap))
)
angles = st.one_of(st.floats(-math.pi, math.pi), st.floats(-1e-6, 1e-6), near_pi, st.just(0.0))
poses = st.tuples(lengths, lengths, angles).map(np.array)
points = st.tuples(lengths, lengths).map(np.array)


def assert_same_pose(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-12) -> None:
    difference = a - b
    np.testing.assert_allclose(difference[..., :2], 0.0, atol=tolerance)
    np.testing.assert_allclose(np.sin(difference[..., 2] / 2), 0.0, atol=tolerance)


def random_tangents(count: int = 100) -> np.ndarray:
    """Random tangents, a quarter of them within 1e-3 of +-pi and some at and very near angle 0."""
    rng = np.random.default_rng(7)
    xi = np.column_stack((rng.normal(size=(count, 2)), rng.uniform(-math.pi, math.pi, count)))
    quarter = count // 4
    xi[:quarter, 2] = np.sign(xi[:quarter, 2]) * (math.pi - rng.uniform(1e-5, 1e-3, quarter))
    small = [0.0, 1e-300, -1e-300, 1e-9, -1e-5, 0.0999, 0.1001, -0.1]
    xi[-len(small) :, 2] = small
    return xi


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_angle_and_lands_in_the_half_open_interval(angle):
    wrapped = se2.wrap(angle)
    assert -math.pi < wrapped <= math.pi
    turns = (angle - wrapped) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)
    assert se2.wrap(np.array([angle]))[0] == pytest.approx(wrapped, abs=1e-11)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(math.pi, math.pi), (-math.pi, math.pi), (1e-20, 1e-20), (-3.0, -3.0), (3.5, 3.5 - 2 * math.pi)],
)
def test_wrap_at_the_ends(angle, wrapped):
    assert se2.wrap(angle) == wrapped
    assert se2.wrap(np.array([angle, angle])).tolist() == [wrapped, wrapped]
    assert np.isnan([se2.wrap(math.nan), *se2.wrap(np.array([math.nan]))]).all()


def test_compose_by_hand():
    # A turn by 90 degrees takes (1, 0) to (0, 1): (1, 2) + (0, 1) = (1, 3), angle
    # 90 + 135 = 225 = -135 degrees.
    a, b = np.array([1.0, 2.0, math.pi / 2]), np.array([1.0, 0.0, 3 * math.pi / 4])
    np.testing.assert_allclose(se2.compose(a, b), [1.0, 3.0, -3 * math.pi / 4], atol=1e-15)
    # From a, the point (1, 3) is one step ahead along a's x axis.
    np.testing.assert_allclose(se2.between(a, np.array([1.0, 3.0, math.pi / 2])), [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(se2.transform(a, [1.0, 0.0]), [1.0, 3.0], atol=1e-15)


@given(poses, poses, points)
def test_poses_against_complex_numbers(a, b, point):
    assert_same_pose(se2.compose(a, b), planar.compose(a, b))
    assert_same_pose(se2.inverse(a), planar.inverse(a))
    assert_same_pose(se2.between(a, b), planar.between(a, b))
    assert_same_pose(se2.exp(a), planar.exp(a))
    np.testing.assert_allclose(se2.transform(a, point), planar.transform(a, point), atol=1e-12)
    np.testing.assert_allclose(se2.rotation(a[2]) @ point, planar.transform([0.0, 0.0, a[2]], point), atol=1e-12)


@given(poses, poses)
def test_adjoint_moves_a_tangent_to_the_left(pose, xi):
    moved = se2.compose(se2.compose(pose, se2.exp(xi)), se2.inverse(pose))
    assert_same_pose(moved, se2.exp(se2.adjoint(pose) @ xi), 1e-10)


@given(poses)
def test_log_and_exp_undo_each_other(pose):
    assert_same_pose(se2.exp(se2.log(pose)), pose)
    xi = np.array([pose[0], pose[1], se2.wrap(float(pose[2]))])
    if abs(abs(pose[2]) - math.pi) > 1e-12:  # at pi itself the sign of the angle is the wrap's choice
        np.testing.assert_allclose(se2.log(se2.exp(xi)), xi, atol=1e-11)


@pytest.mark.parametrize("angle", [1e-4, -1e-5, 1e-9, 1e-300])
def test_exp_and_log_at_small_angles_against_the_series(angle):
    # V = I + angle / 2 J - angle^2 / 6 I + ..., with J a turn by 90 degrees; the next term is below 1e-13.
    v = np.array([0.7, -1.3])
    moved = v + angle / 2 * np.array([1.3, 0.7]) - angle**2 / 6 * v
    np.testing.assert_allclose(se2.exp([*v, angle]), [*moved, angle], rtol=1e-12)
    np.testing.assert_allclose(se2.log([*moved, angle]), [*v, angle], rtol=1e-12)


def test_right_jacobian_inverse_against_finite_differences():
    xi, step = random_tangents(), 1e-6
    pose = se2.exp(xi)
    inverse = np.empty((len(xi), 3, 3))
    for k, d in enumerate(step * np.eye(3)):
        inverse[..., k] = se2.log(se2.compose(pose, se2.exp(d))) / (2 * step)
        inverse[..., k] -= se2.log(se2.compose(pose, se2.exp(-d))) / (2 * step)
    np.testing.assert_allclose(se2.right_jacobian_inverse(xi), inverse, atol=2e-9)


@pytest.mark.parametrize("function", [se2.inverse, se2.exp, se2.log, se2.adjoint, se2.right_jacobian_inverse])
def test_one_pose_and_many_give_the_same(function):
    xi = random_tangents(60).reshape(3, 20, 3)
    one = np.array([[function(pose) for pose in row] for row in xi])
    np.testing.assert_allclose(function(xi), one, rtol=1e-13, atol=1e-15, strict=True)


def test_leading_axes_broadcast():
    a, b, cloud = random_tangents(12).reshape(4, 3, 3), random_tangents()[:3], np.arange(6.0).reshape(3, 2)
    for function, other in ((se2.compose, b), (se2.between, b), (se2.transform, cloud)):
        expected = np.array([[function(a[i, j], other[j]) for j in range(3)] for i in range(4)])
        np.testing.assert_allclose(function(a, other), expected, atol=1e-14, strict=True)
        np.testing.assert_allclose(function(a, other[0])[2, 1], function(a[2, 1], other[0]), atol=1e-14)
        np.testing.assert_allclose(function(b[0], np.stack([other] * 2))[1, 2], function(b[0], other[2]), atol=1e-14)
