"""Residuals of the factors against values worked out by hand, and against the paper's own form."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, Shared, model_of, pushing_angles, pushing_residuals, rows_of, sensor, values_at

from palpate import ContactDirection, Disc, Polygon, Rectangle
from palpate.estimation.variable import Variable
from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.models.pushing.contact_geometry import ContactModel, contact_model
from palpate.models.pushing.layout import column
from palpate.models.pushing.variables import (
    CORNER_BIAS,
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    OUTLINE_SCALE,
)
from palpate.types import measurements as said

Array = np.ndarray
ANY = model_of("disc")
POSES = list(range(12))  # columns: g0, e0, g1, e1
G1 = [6, 7, 8]


def object_pose(g: Array, e: Array, measured: Any, covariance: Array | None = None) -> tuple[Array, Array]:
    """Residual (3,) and Jacobian (3, 6) by g and e of a measured object pose."""
    seen = said.ObjectPose(np.array(measured), np.eye(3) if covariance is None else covariance)
    rows = rows_of("object_pose", values_at(ANY, [[g]], [[e]]), [seen])
    return rows.residual[0, 0], rows.jacobian[0, 0, :, 6:12]


def contact(g: Any, depth: float, model: ContactModel, scale: float = 0.0) -> tuple[Array, Array]:
    """Residual (1,) and Jacobian (1, 5) by g, the depth and the scale."""
    rows = rows_of("contact", values_at(model, [[g]], shared={DEPTH: depth, OUTLINE_SCALE: scale}))
    return rows.residual[0, 0], rows.jacobian[0, 0][:, [*G1, column(DEPTH), column(OUTLINE_SCALE)]]


def direction(g: Any, angle: float, bias: float, model: ContactModel, scale: float = 0.0) -> tuple[Array, Array]:
    """Residual (1,) and Jacobian (1, 5) by g, the bias and the scale."""
    at = values_at(model, [[g]], shared={DIRECTION_BIAS: bias, DIRECTION_SCALE: scale})
    rows = rows_of("direction", at, [ContactDirection(angle, 1.0)])
    return rows.residual[0, 0], rows.jacobian[0, 0][:, [*G1, column(DIRECTION_BIAS), column(DIRECTION_SCALE)]]


def pushing(
    name: str, before: Array, g: Array, model: ContactModel, shared: Shared, last: Variable
) -> tuple[float, Array]:
    """Residual and Jacobian (15,) by g0, e0, g1, e1, the centre of friction and one variable more.

    The contact sticks at g, and the object was at a pose before, seen from where it is now.
    """
    rows = rows_of(name, values_at(model, [[g, g]], [[se2.compose(before, g), g]], shared))
    center = column(FRICTION_CENTER)
    return float(rows.residual[0, 0, 0]), rows.jacobian[0, 0, 0, [*POSES, center, center + 1, column(last)]]


def test_object_pose_by_hand():
    # Sensor at x = 1.1, 0.1 in front of the object's origin: o = (1, 0, 0), seen at (0.9, 0, 0).
    g, e = np.array([0.1, 0.0, 0.0]), np.array([1.1, 0.0, 0.0])
    residual, jacobian = object_pose(g, e, [0.9, 0.0, 0.0])
    np.testing.assert_allclose(residual, [0.1, 0, 0], atol=1e-15)
    # Seen where it is. Turning the sensor by d about itself swings the object's origin, 0.1 behind it, by -0.1 d in y.
    residual, jacobian = object_pose(g, e, [1.0, 0.0, 0.0])
    by_e = np.array([[1, 0, 0], [0, 1, -0.1], [0, 0, 1]])
    np.testing.assert_allclose(jacobian, np.hstack([-by_e, by_e]), atol=1e-15)
    # In standard deviations: of 0.05 m along x, 0.1 m are two.
    residual, _ = object_pose(g, e, [0.9, 0.0, 0.0], np.diag(np.square([0.05, 1.0, 1.0])))
    np.testing.assert_allclose(residual, [2.0, 0, 0], atol=1e-15)


def model_with(field: DistanceField, center: complex, radius: float, c: float, friction: complex = 0j) -> ContactModel:
    """A sensor with one tip."""
    return ContactModel(field, np.array([center]), radius, c, friction)


def square(radius: float) -> ContactModel:
    return model_with(DistanceField.of(Rectangle(0.2, 0.2), margin=0.08), complex(-radius, 0.0), radius, 0.05)


def test_contact_by_hand():
    model = square(RADIUS)
    # The apex 3 mm off the left side: the centre is at -0.103 - 0.021, 0.024 from the side, less the radius.
    residual, jacobian = contact(np.array([-0.103, 0.02, 0.0]), 0.0, model)
    np.testing.assert_allclose(residual, [0.003], atol=1e-9)
    np.testing.assert_allclose(jacobian, [[-1, 0, 0, 1, -0.1]], atol=1e-9)
    # Turned to the left by 90 degrees the apex at (-0.13, 0.021) has its centre at (-0.13, 0), 0.03 - 0.021 off. The
    # side's normal is now the sensor's +y. Turning further moves the centre, 0.021 below, to the right: closer by
    # 0.021.
    residual, jacobian = contact(np.array([-0.13, 0.021, math.pi / 2]), 0.0, model)
    np.testing.assert_allclose(residual, [0.009], atol=1e-9)
    np.testing.assert_allclose(jacobian, [[0, 1, -0.021, 1, -0.1]], atol=1e-9)
    # The centre 30 mm left of and 40 mm above a corner: 50 mm from it, less the radius. The spline is good to
    # micrometres.
    residual, _ = contact(np.array([-0.109, 0.14, 0.0]), 0.0, model)
    np.testing.assert_allclose(residual, [0.029], atol=2e-6)
    # Two-sided: 2 mm inside is -2 mm.
    residual, _ = contact(np.array([-0.098, 0.0, 0.0]), 0.0, model)
    np.testing.assert_allclose(residual, [-0.002], atol=1e-9)
    # In contact they overlap by the depth: 0.3 mm. 2 mm apart is 2.3 mm too far, 0.5 mm inside 0.2 mm too deep.
    for x, wanted in ((-0.0997, 0.0), (-0.102, 2.3e-3), (-0.0995, -2e-4)):
        residual, jacobian = contact(np.array([x, 0.02, 0.0]), 3e-4, model)
        np.testing.assert_allclose(residual, [wanted], atol=1e-9)
        np.testing.assert_allclose(jacobian, [[-1, 0, 0, 1, -0.1]], atol=1e-9)


def test_contact_with_an_object_that_is_larger_than_its_outline_by_hand():
    # 2 % larger than the square its left side is at -0.102: 1 mm off the outline is 1 mm in the object.
    model = square(RADIUS)
    assert contact(np.array([-0.101, 0.02, 0.0]), 0.0, model, 0.02)[0] == pytest.approx(-1e-3, abs=1e-9)
    # Its corner is at (-0.102, 0.102), so that the centre 30 mm left of and 40 mm above that of the outline is
    # hypot(28, 38) = 47.2 mm away.
    assert contact(np.array([-0.109, 0.14, 0.0]), 0.0, model, 0.02)[0] == pytest.approx(0.0472 - RADIUS, abs=2e-5)
    # It grows about its centroid, wherever the outline's frame is: 0.19 m from it this is 0.1 m.
    aside = model_with(DistanceField.of(Rectangle(0.2, 0.2), margin=0.08), 0j, 0.0, 0.05, 0.09 + 0j)
    assert contact(np.array([-0.1, 0.02, 0.0]), 0.0, aside, 0.02)[0] == pytest.approx(-0.02 * 0.19, abs=1e-9)


def test_corner_by_hand():
    # The upper left corner (-0.05, 0.05) of a square has its bisector at -45 degrees. Seen from a centre that lies
    # straight to the left of it the normal is at 0, 45 degrees off: its cone's edge. From 135 degrees it is 0 off.
    model, r = contact_model(Rectangle(0.1, 0.1), sensor()), RADIUS
    for bearing, wanted in ((math.radians(135.0), 0.0), (math.radians(160.0), math.radians(25.0))):
        center = np.array([-0.05, 0.05]) + r * np.array([math.cos(bearing), math.sin(bearing)])
        at = values_at(model, [[[center[0] + r, center[1], 0.0]]], shared={CORNER_BIAS: 0.02})
        rows = rows_of("corner", at, [said.ContactCorner(0.1, 1.0)])
        assert rows.residual.item() == pytest.approx(wanted - 0.1 - 0.02, abs=2e-3)  # of the spline
    # On the left side it is 45 degrees, wherever and however it is touched, and nothing moves it.
    at = values_at(model, [[[-0.05, 0.01, 0.2]]])
    rows = rows_of("corner", at, [said.ContactCorner(0.0, 1.0)])
    assert rows.residual.item() == pytest.approx(math.radians(45.0), abs=1e-6)
    assert not rows.jacobian[0, 0, 0, :12].any() and rows.jacobian[0, 0, 0, column(CORNER_BIAS)] == -1.0
    # A hexagon's cone has half of 30 degrees: a slope of 1 takes 15 degrees off what a right angle would have.
    hexagon = Polygon([(0.05 * math.cos(a), 0.05 * math.sin(a)) for a in np.radians(np.arange(0, 360, 60))])
    at = values_at(contact_model(hexagon, sensor()), [[[-0.05, 0.0, 0.0]]])
    rows = rows_of("corner", at, [said.ContactCorner(0.0, 1.0, 1.0)])
    assert rows.residual.item() == pytest.approx(math.radians(15.0), abs=2e-3)
    # A disc has no corners.
    assert not rows_of("corner", values_at(ANY, [[[-0.088, 0.0, 0.0]]]), [said.ContactCorner(0.0, 1.0)]).weight.any()


def test_direction_by_hand():
    model = square(RADIUS)
    # The left side lies straight ahead: the tip is touched at its apex, and 0.1 to the left of that says an error of
    # -0.1. Turned by +0.3 the sensor is touched at -0.3. Moving along or across the side changes nothing.
    residual, jacobian = direction(np.array([-0.1, 0.02, 0.0]), 0.0, 0.0, model)
    np.testing.assert_allclose(residual, [0.0], atol=1e-6)
    np.testing.assert_allclose(jacobian, [[0, 0, -1, 1, 0]], atol=1e-6)
    assert direction(np.array([-0.1, 0.02, 0.0]), 0.1, 0.0, model)[0] == pytest.approx(-0.1, abs=1e-6)
    assert direction(np.array([-0.1, 0.02, 0.3]), 0.0, 0.0, model)[0] == pytest.approx(-0.3, abs=1e-6)
    # Turned by 3.1 it is touched at -3.1; 3.1 is measured, 6.2 more, which is 2 pi - 6.2 = 0.0831853 the other way.
    residual, _ = direction(np.array([-0.1, 0.02, 3.1]), 3.1, 0.0, model)
    np.testing.assert_allclose(residual, [2 * math.pi - 6.2], atol=1e-6)
    # The centre 15 mm left of and 20 mm above the corner (-0.1, 0.1): the corner lies 15 ahead and 20 to the right,
    # atan2(-20, 15) = -0.9273. Seen from 25 mm, 1 mm across, (0.8, 0.6), turns it by 1/25 rad per mm to the left.
    residual, jacobian = direction(np.array([-0.115 + RADIUS, 0.12, 0.0]), 0.0, 0.0, model)
    np.testing.assert_allclose(residual, [-0.927295218], atol=1e-4)
    # Turning by d about the apex carries the centre, 0.021 behind it, by -0.021 d in y: -0.021 * 0.6 / 0.025 - 1.
    # A scale counts by the sine of what is seen, -0.8.
    np.testing.assert_allclose(jacobian, [[-32.0, -24.0, -0.496, 1.0, -0.8]], rtol=1e-2)
    residual, jacobian = direction(np.array([-0.115 + RADIUS, 0.12, 0.0]), -0.5, 0.02, model, scale=0.1)
    np.testing.assert_allclose(residual, [-0.927295218 - 0.08 + 0.02 + 0.5], atol=1e-4)
    np.testing.assert_allclose(jacobian[0, 3:], [1.0, -0.8], atol=1e-4)


def test_direction_on_a_disc_by_hand():
    # Centre of the tip at bearing b from the disc's centre: touched at b + pi, less the sensor's yaw. 0.1 m away a move
    # by 1 mm round the disc turns it by 0.01.
    model = model_with(DistanceField.of(Disc(0.08)), 0j, 0.02, 0.05)
    for bearing in (2.9, -2.9, 0.4):
        g = np.array([0.1 * math.cos(bearing), 0.1 * math.sin(bearing), -0.7])
        residual, jacobian = direction(g, 0.0, 0.0, model)
        assert se2.wrap(float(residual[0]) - (bearing + math.pi + 0.7)) == pytest.approx(0.0, abs=1e-6)
        round_it = np.array([-math.sin(bearing + 0.7), math.cos(bearing + 0.7), 0.0])  # in the sensor's frame
        assert (jacobian[:, :3] @ round_it)[0] == pytest.approx(10.0, rel=1e-4)
    # A point on the outline is touched along the normal as well.
    point = model_with(model.field, 0j, 0.0, 0.05)
    residual, _ = direction(np.array([-0.08, 0.0, 0.2]), 0.0, 0.0, point)
    np.testing.assert_allclose(residual, [-0.2], atol=1e-6)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_paper_point_pushes_off_centre(share):
    # p = (-0.08, 0.03) and v = (1, 0) mm give p x v = px vy - py vx = -3e-5 m^2. With c^2 = 0.0036 the disc turns by
    # omega = -3e-5 / 0.0036 = -1/120 rad. With only a share of that turn the row is -3e-5 (1 - share).
    model = model_with(DistanceField.of(Disc(0.088)), 0j, 0.0, 0.06)
    omega = -share / 120
    object0, object1 = np.array([-1e-3, 0.0, -omega]), np.zeros(3)  # the frame at step 1 is the world's
    g = np.array([-0.08, 0.03, 0.4])  # the point sticks where it is
    residual = pushing_residuals(g, se2.compose(object0, g), g, se2.compose(object1, g), model)
    np.testing.assert_allclose(residual, [0, 0, -3e-5 * (1 - share)], atol=1e-15)


def test_balance_with_another_c_and_another_centre():
    # v = (1, 0) mm, omega = -1/120 rad of the origin, p = (-0.08, 0.03). With c = 0.06 and ln 1.5 as the ratio, c^2 is
    # 0.0054 and row 3 is -3e-5 + 0.0054 / 120 = 1.5e-5 m^2.
    model = model_with(DistanceField.of(Disc(0.088)), 0j, 0.0, 0.06)
    omega = -1 / 120
    g, before = np.array([-0.08, 0.03, 0.4]), np.array([-1e-3, 0.0, -omega])

    def found(ratio: float = 0.0, center: Any = (0.0, 0.0), of: ContactModel = model) -> tuple[float, Array]:
        shared = {FRICTION_RATIO: ratio, FRICTION_CENTER: center}
        return pushing("balance", before, g, of, shared, FRICTION_RATIO)

    residual, jacobian = found(math.log(1.5))
    assert residual == pytest.approx(1.5e-5, abs=1e-14)
    assert jacobian[14] == pytest.approx(0.0054 / 120)  # twice the c^2 is twice the torque
    # A centre aside by (0.5, -0.25) c = (0.03, -0.015). At step 0 the object stood at (-0.001, 0), turned by 1/120 rad,
    # and the centre at (-0.001 + 0.03 cos + 0.015 sin, 0.03 sin - 0.015 cos). The arm is (-0.11, 0.045).
    s, c = math.sin(1 / 120), math.cos(1 / 120)
    vx, vy = 0.001 + 0.03 * (1 - c) - 0.015 * s, -0.03 * s - 0.015 * (1 - c)
    residual, _ = found(center=(0.5, -0.25))
    assert residual == pytest.approx(-0.11 * vy - 0.045 * vx + 0.0036 / 120, abs=1e-14)
    # That is the same as a model whose centre is there.
    there = model_with(model.field, 0j, 0.0, 0.06, 0.03 - 0.015j)
    assert found(of=there)[0] == pytest.approx(residual, abs=1e-15)


def test_how_sure_the_balance_is_by_hand():
    # c is 50 mm, of which a step of 2 mm has a share of 1.3 %; fingers 30 mm apart add eight tenths of that.
    two = replace(square(0.0), parts=np.array([0.015j, -0.015j]), span=0.03)
    for model, lever in ((square(0.0), 0.0), (two, 0.8 * 0.03)):
        g = np.tile([-0.1, 0.0, 0.0], (1, 2, 1))
        rows = rows_of("balance", values_at(model, g), moved=2e-3)
        variance = 2e-7**2 + (0.013 * 2e-3 * 0.05) ** 2 + (lever * 2e-3) ** 2
        np.testing.assert_allclose(rows.information[0, 0], 1.0 / variance, rtol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_friction_cone_by_hand(side):
    # Left of a flat side, whose inward normal is +x; counter-clockwise of it is +y. With a grip of 0.5 the edges of the
    # cone are (1, 0.5) and (1, -0.5); what counts is the edge on the side of the motion.
    model, g = square(RADIUS), np.array([-0.1, 0.02, 0.3])
    for v, wanted in (
        ((1e-3, side * 1e-5), -4.9e-4),  # nearly straight in: 0.5 mm from the edge, along the outline
        ((1e-3, side * 5e-4), 0.0),  # on the edge
        ((1e-3, side * 2e-3), 1.5e-3),  # 1.5 mm outside
        ((0.0, side * 1e-3), 1e-3),  # along the outline, where any force is outside
        ((-1e-3, side * 1e-5), 5.1e-4),  # away from the sensor, which cannot pull
    ):
        before = np.array([-v[0], -v[1], 0.0])
        residual, jacobian = pushing("friction_cone", before, g, model, {GRIP: math.log(0.5)}, GRIP)
        assert residual == pytest.approx(wanted, abs=1e-9)
        # More grip, more room: by what goes into the object; the variable is a logarithm.
        assert jacobian[14] == pytest.approx(-0.5 * v[0], abs=1e-9)
    # It is the centre of friction whose motion counts. Turning by 0.01 rad about the origin carries a centre at (0.02,
    # 0) by (1 - cos, sin) 0.02 = (1e-6, 2e-4).
    before = np.array([0.0, 0.0, -0.01 * side])
    aside = {FRICTION_CENTER: (0.4, 0.0), GRIP: math.log(0.5)}  # in c, which is 0.05
    residual, _ = pushing("friction_cone", before, g, model, aside, GRIP)
    assert residual == pytest.approx(0.02 * math.sin(0.01) - 0.5 * 0.02 * (1 - math.cos(0.01)), abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.3, 1.5, 3.1, -3.1])
@pytest.mark.parametrize("yaw", [0.0, 3.1, -2.0])
def test_pushing_angle_of_a_straight_motion(angle, yaw):
    # The object goes straight, by 1 mm a step at this angle from the inward normal of its left side, its own +x.
    way = [1e-3 * math.cos(yaw + angle), 1e-3 * math.sin(yaw + angle), 0.0]
    o = np.array([0.3, -0.2, yaw]) + np.outer(np.arange(11), way)
    g = np.tile([-0.1, 0.02, 0.3], (11, 1))
    found = pushing_angles(g, se2.compose(o, g), square(RADIUS))
    assert found.shape == (10,)
    np.testing.assert_allclose(found, angle, atol=1e-6)
    # One step alone is enough to tell it.
    np.testing.assert_allclose(pushing_angles(g[:2], se2.compose(o, g)[:2], square(RADIUS)), angle, atol=1e-6)


def test_pushing_angle_across_the_seam():
    # The object turns by 0.02 rad a step about a centre of friction that goes straight along the world's x: seen from
    # its inward normal the motion is at -yaw, at each step, and jumps from -pi to pi where that passes pi.
    model = model_with(square(RADIUS).field, complex(-RADIUS, 0.0), RADIUS, 0.05, -0.01j)
    aside = {FRICTION_CENTER: (0.2, -0.2)}  # by (0.2, -0.2) c: the centre is at (0.01, -0.02)
    yaw = 3.0 + 0.02 * np.arange(15)
    turning = np.column_stack([1e-3 * np.arange(15), np.zeros(15), yaw])
    o = se2.compose(turning, se2.inverse(np.array([0.01, -0.02, 0.0])))
    g = np.tile([-0.1, 0.03, -0.4], (15, 1))
    found = pushing_angles(g, se2.compose(o, g), model, aside)
    np.testing.assert_allclose(se2.wrap(found + yaw[1:]), 0.0, atol=1e-6)
    assert found.min() < -3.0 and found.max() > 3.0


def test_pushing_angle_is_taken_over_the_steps_nearby():
    # To and fro by 1 mm across a way of 1 mm a step. At step k the motion is that from k - 3 to k + 2, cut at the ends.
    across = np.array([0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0]) * 1e-3
    o = np.column_stack([1e-3 * np.arange(9), across, np.zeros(9)])
    g = np.tile([-0.1, 0.02, 0.0], (9, 1))
    found = pushing_angles(g, se2.compose(o, g), square(RADIUS))
    # From and to: 0-3, 0-4, 0-5, 1-6, 2-7, 3-8, 4-8, 5-8.
    wanted = [(-1, 3), (0, 4), (0, 5), (0, 5), (0, 5), (1, 5), (0, 4), (0, 3)]
    np.testing.assert_allclose(found, [math.atan2(y, x) for y, x in wanted], atol=1e-6)


@pytest.mark.parametrize("angle", [0.001, 0.02, -0.02, 0.1])
def test_rolling_on_a_flat_side_is_no_sliding(angle):
    # Left of a flat side at x = -0.1 a tip that turns by +angle rolls down by 0.021 angle. The material point that
    # touches at the end was, on its cycloid, r (1 - cos angle) off the side and r (angle - sin angle) above: of
    # second and third order. At 0.02 rad, a fast turn, that is 4.2e-6 m and 2.8e-8 m.
    model, r = square(RADIUS), RADIUS
    start = np.array([-0.1 - r, 0.01, 0.0])  # of the centre
    end = start + np.array([0.0, -r * angle, angle])
    to_origin = np.array([r, 0.0, 0.0])  # the sensor's origin is its apex
    g0, g1 = se2.compose(start, to_origin), se2.compose(end, to_origin)
    residual = pushing_residuals(g0, g0, g1, g1, model)
    wanted = [-r * (1 - math.cos(angle)), r * (angle - math.sin(angle)), 0.0]
    np.testing.assert_allclose(residual, wanted, atol=1e-9)
    # The same turn on the spot is a slide by 0.021 angle, less than 0.2 % of which is hidden by the curvature.
    spot = se2.compose(start + np.array([0, 0, angle]), to_origin)
    residual = pushing_residuals(g0, g0, spot, spot, model)
    assert residual[1] == pytest.approx(-r * angle, rel=2e-3)


def paper_rows(o0: Array, e0: Array, o1: Array, e1: Array, c: float) -> Array:
    """D V - Vp in the object frame of step 1 (facts: Lynch 1992, Zhou 2017), for a point sensor."""
    turn = se2.rotation(o1[2]).T
    vx, vy = turn @ (o1 - o0)[:2]
    omega = o1[2] - o0[2]
    px, py = turn @ (e1 - o1)[:2]
    contact_velocity = turn @ (e1 - e0)[:2]
    d = np.array([[1, 0, -py], [0, 1, px], [-py, px, -(c**2)]])
    return d @ [vx, vy, omega] - [*contact_velocity, 0.0]


def test_pushing_agrees_with_the_paper_to_first_order():
    model = model_with(DistanceField.of(Disc(0.088)), 0j, 0.0, 0.06)
    rng = np.random.default_rng(5)
    for _ in range(20):
        o1, e1 = np.array([0.3, -0.2, 0.7]), np.array([0.25, -0.13, 1.9])
        by_object, by_sensor = rng.normal(size=(2, 3)) * [2e-3, 2e-3, 2e-2]
        off = []
        for scale in (1.0, 0.1):
            o0, e0 = o1 - scale * by_object, e1 - scale * by_sensor
            g0, g1 = se2.between(o0, e0), se2.between(o1, e1)
            ours = pushing_residuals(g0, e0, g1, e1, model)
            paper = paper_rows(o0, e0, o1, e1, 0.06)
            off.append(np.abs(ours - paper).max())
            # What the paper linearises away in a step turns the ways by omega: the object's, the sensor's and the
            # arm's.
            ways = np.hypot(*by_object[:2]) + np.hypot(*by_sensor[:2]) + abs(by_object[2]) * np.hypot(*(e1 - o1)[:2])
            assert off[-1] < scale**2 * abs(by_object[2]) * ways
        assert off[1] < 0.02 * off[0]  # a tenth of the motion, a hundredth of the difference


def test_contact_model_of_a_sensor():
    model = contact_model(SHAPES["concave"], sensor(0.004, ((0.0, 0.03), (0.001, -0.03))))
    np.testing.assert_allclose(model.parts, [-0.004 + 0.03j, -0.003 - 0.03j])
    # The L is 0.16 x 0.06 about (-0.01, -0.03) and 0.07 x 0.07 about (-0.055, 0.035): areas 0.0096 and 0.0049.
    # x = (0.0096 * -0.01 + 0.0049 * -0.055) / 0.0145, y = (0.0096 * -0.03 + 0.0049 * 0.035) / 0.0145
    assert model.friction_center == pytest.approx(-0.02520690 - 0.00803448j, abs=1e-8)
    alone = contact_model(Disc(0.09), sensor())
    assert alone.parts.tolist() == [-RADIUS]
    assert (model.span, alone.span) == (pytest.approx(math.hypot(0.06, 0.001)), 0.0)
    assert alone.friction_radius == pytest.approx(0.06)  # 2 r / 3 for uniform pressure
    # The centre of a tip of radius r stands r off the outline: the grid reaches further.
    wide = contact_model(Disc(0.09), sensor(0.1)).field
    assert wide.origin[0] < -0.09 - 0.1
