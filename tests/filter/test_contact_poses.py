"""Where a sensor may have met an object that is known roughly: places all round the outline, by hand."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, rows_of, sensor, values_at

from palpate.config import DirectionSettings
from palpate.filter.belief import Prior
from palpate.filter.contact_poses import expected_starts, is_rough, starts
from palpate.geometry import se2
from palpate.geometry.objects import SHAPES as SIMULATED
from palpate.geometry.shapes import scaled
from palpate.graph.contact_geometry import ContactModel, contact_model
from palpate.graph.factors.direction import Direction
from palpate.graph.variables import (
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_RATIO,
    GRIP,
    IN_OBJECT,
    OBJECT_SIZE,
    OUTLINE_SCALE,
)
from palpate.types.measurements import ContactDirection, Measurement, Turn

Array = np.ndarray
OUTLINES = {**SHAPES, "butterfly": SIMULATED["butterfly"], "t": SIMULATED["t"]}
OFF_CENTRE = ((0.012, -0.007),)
FAR = 100.0  # [m, m, rad] of a prior that leaves nothing out
LEFT = -0.2363 / 2  # [m], the rectangle's left side
STEP = 3e-3  # [m] at a time on the way round
SPACING = 15e-3  # [m]
NEAR = (0.003, 0.01, np.radians(9.0))  # [m, m, rad] across the outline, along it, and yaw


def model_of(name: str, tips: Any = OFF_CENTRE) -> ContactModel:
    return contact_model(OUTLINES[name], sensor(tips=tips))


def known(
    deviation: Any, pose: Any = (0.0, 0.0, 0.0), depth: float = 0.0, bias: float = 0.0, scale: float = 0.0
) -> Prior:
    values = np.zeros(OBJECT_SIZE)
    values[IN_OBJECT[DEPTH]], values[IN_OBJECT[DIRECTION_BIAS]] = depth, bias
    values[IN_OBJECT[DIRECTION_SCALE]] = scale
    values[IN_OBJECT[FRICTION_RATIO]], values[IN_OBJECT[GRIP]] = 0.3, 0.5
    variances = np.square([*np.broadcast_to(deviation, 3), *[0.1] * OBJECT_SIZE])
    return Prior(np.array(pose, np.float64), values, np.diag(variances))


def felt(angle: float) -> list[Measurement]:
    return [ContactDirection(angle, 1e-3)]


def seen(found: list[tuple[Prior, float]], sensor_pose: Array) -> Array:
    """The sensor's poses (N, 3) in the object frame."""
    return np.array([se2.between(prior.pose, sensor_pose) for prior, _ in found])


def touched(g: Array, model: ContactModel) -> Array:
    """How the tip touches at poses (N, 3)."""
    return model.touching(g[None])[0]


def in_order(touch: Array, radius: float) -> Array:
    """Centres of the tip (N,) one after the other: each place's nearest neighbour that was not there yet."""
    left = list(touch["point"] + radius * touch["normal"])
    order = [left.pop(0)]
    while left:
        order.append(left.pop(int(np.argmin(np.abs(np.array(left) - order[-1])))))
    return np.array(order)


POSE = np.array([0.4, -0.3, 2.5])  # of the sensor in the world


@pytest.mark.parametrize("name", OUTLINES)
def test_places_lie_on_the_outline_all_the_way_round(name):
    model, depth, angle = model_of(name), 4e-4, 0.2
    found = starts(known(FAR, depth=depth), model, POSE, felt(angle))
    g = seen(found, POSE)
    # By the outline itself, and not by the grid: the tip's centre is as far off as its radius, less the depth.
    center = se2.transform(g, model.parts.view(np.float64))
    outline = OUTLINES[name]
    np.testing.assert_allclose(outline.signed_distance(center), RADIUS - depth, atol=3e-4)
    # Against the direction that is felt it is outward: 1 mm that way is 1 mm farther, but where two sides are near.
    way = g[:, 2] + angle
    farther = outline.signed_distance(center - 1e-3 * np.column_stack((np.cos(way), np.sin(way))))
    is_so = np.abs(farther - outline.signed_distance(center) - 1e-3) < 2e-5
    assert is_so.all() if name not in ("concave", "t") else is_so.mean() > 0.95


@pytest.mark.parametrize("name", ["rectangle", "disc", "ellipse"])
def test_an_object_that_is_larger_than_its_outline_is_touched_farther_out(name):
    model, prior = model_of(name), known(FAR)
    prior.values[IN_OBJECT[OUTLINE_SCALE]] = 0.02  # some two millimetres
    center = se2.transform(seen(starts(prior, model, POSE, felt(0.2)), POSE), model.parts.view(np.float64))
    np.testing.assert_allclose(scaled(OUTLINES[name], 1.02).signed_distance(center), RADIUS, atol=4e-4)


@pytest.mark.parametrize("name", ["rectangle", "ellipse", "butterfly"])
def test_neighbours_are_not_far_apart(name):
    model = model_of(name)
    touch = touched(seen(starts(known(FAR), model, POSE, felt(0.0)), POSE), model)
    places = in_order(touch, RADIUS)
    apart = np.sort(np.abs(places - np.roll(places, 1)))
    # It goes on by steps until it is farther than that; where it comes round it may be farther by as much as is near.
    assert apart[-2] <= SPACING + STEP + 1e-5
    assert apart[-1] <= SPACING + 2.5 * STEP
    # And none is there twice.
    assert apart[0] >= STEP - 1e-5
    # All the way round: as the outline that is larger by the tip's radius is long.
    outline = OUTLINES[name].outline(2000)
    length = np.hypot(*np.diff(outline, axis=0, append=outline[:1]).T).sum() + 2.0 * np.pi * RADIUS
    assert 0.97 * length < apart.sum() < 1.001 * length
    # Touched points are as near, but in the butterfly's waist: of radius 46 mm, it is 46 - 21 mm for the tip's centre.
    near = 0.5 * (SPACING + 2.5 * STEP) * (46 / 25 if name == "butterfly" else 1.0)
    for corner in outline:
        assert np.abs(touch["point"] - complex(*corner)).min() < near


def test_round_a_corner_places_are_closer():
    # On the circle round a corner with the tip's radius a quarter turn is 33 mm: by 18 degrees and a step at most.
    model = model_of("rectangle")
    normal = touched(seen(starts(known(FAR), model, POSE, felt(0.0)), POSE), model)["normal"]
    angle = np.sort(np.degrees(np.angle(normal)))
    between = np.diff(angle[(angle > 1.0) & (angle < 89.0)])
    assert len(between) >= 2
    assert between.max() < 18.0 + np.degrees(STEP / RADIUS) + 0.1


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize(("angle", "bias", "scale"), [(0.0, 0.0, 0.1), (0.7, 0.02, 0.0), (-1.1, -0.3, 0.1)])
def test_a_direction_tells_yaw(name, angle, bias, scale):
    model, prior = model_of(name), known(FAR, bias=bias, scale=scale)
    found = starts(prior, model, POSE, felt(angle))
    g = seen(found, POSE)
    # The tip is touched where touch says, but for bias and scale: seen in the sensor frame, against the outward normal.
    normal = touched(g, model)["normal"]
    off = np.angle(-normal * np.exp(-1j * (g[:, 2] + (1.0 - scale) * angle - bias)))
    np.testing.assert_allclose(off, 0.0, atol=2e-3)
    # And that is what the graph makes of it.
    at = values_at(model, g[:, None], shared={DIRECTION_BIAS: bias, DIRECTION_SCALE: scale})
    rows = rows_of(Direction(DirectionSettings()), at, felt(angle))
    np.testing.assert_allclose(rows.residual[:, 0, 0], off, atol=1e-9)
    # What touch says of something else does not matter.
    again = starts(prior, model, POSE, [Turn(1.0, 1e-3), *felt(angle)])
    np.testing.assert_array_equal(seen(again, POSE), g)


def test_without_a_direction_yaw_is_that_known():
    # Less than 13.5 degrees.
    model = model_of("rectangle")
    yaw = 0.25
    for prior_yaw in (-0.4, 3.0):
        pose = np.array([0.1, 0.2, prior_yaw + yaw])
        prior = known((1.0, 1.0, np.radians(13.4)), (0.1, 0.2, prior_yaw))
        found = starts(prior, model, pose, [Turn(1.0, 1e-3)])
        g = seen(found, pose)
        np.testing.assert_allclose(g[:, 2], yaw, atol=1e-12)
        np.testing.assert_allclose(touched(g, model)["gap"], 0.0, atol=1e-5)
        # One for each place, as where a direction tells yaw.
        assert len(found) == len(starts(known(FAR), model, pose, felt(0.0)))


def test_without_a_direction_several_yaws_are_thought_of_where_it_is_not_known():
    # A deviation of 0.5: two of them either way.
    model, pose = model_of("ellipse"), np.array([0.0, 0.0, 1.0])
    for deviation, yaw, reach, count in ((0.5, 1.0, 1.0, 9), (0.24, 1.0, 0.48, 5), (1.0, 1.0, 2.0, 17)):
        found = starts(known((10.0, 10.0, deviation)), model, pose, ())
        g = seen(found, pose)
        places = len(starts(known(FAR), model, pose, felt(0.0)))
        assert len(found) == places * count
        np.testing.assert_allclose(touched(g, model)["gap"], 0.0, atol=1e-5)
        yaws = np.unique(np.round(g[:, 2], 9))
        np.testing.assert_allclose(yaws, np.linspace(yaw - reach, yaw + reach, count), atol=1e-8)
        assert np.diff(yaws).max() <= 2.0 * np.pi / 24 + 1e-9
    # All around, each once, where nothing is known of it.
    found = starts(known((10.0, 10.0, 2.0)), model, pose, ())
    yaws = np.unique(np.round(np.mod(seen(found, pose)[:, 2] + 1e-6, 2.0 * np.pi), 9))
    assert len(found) == 24 * len(starts(known(FAR), model, pose, felt(0.0)))
    np.testing.assert_allclose(np.diff(yaws), 2.0 * np.pi / 24, atol=1e-8)
    assert len(yaws) == 24


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.4, -0.3, 2.0)])
def test_only_what_is_likely_is_thought_of(where):
    # The sensor touches the left side 10 mm above its middle. Where the object is, seen in its own frame, off by: yaw
    # is told, so that there is an offset along the side alone.
    model, deviation = model_of("rectangle"), np.array([0.004, 0.011, 0.02])
    apex = np.array([LEFT - OFF_CENTRE[0][0], 0.01 - OFF_CENTRE[0][1], 0.0])
    pose = se2.compose(np.array(where), apex)
    found = starts(known(deviation, where), model, pose, felt(0.0))
    every = starts(known(FAR, where), model, pose, felt(0.0))
    off_side = apex[1] - seen(every, pose)[:, 1]  # how far the object would be up, of all places on the left side
    on_side = np.abs(touched(seen(every, pose), model)["normal"] + 1.0) < 1e-6
    likely = on_side & (np.abs(off_side) < 4.0 * 0.011)
    wanted = -0.5 * np.square(np.sort(np.abs(off_side[likely])) / 0.011)
    assert 4 <= likely.sum() < on_side.sum()
    # The last places before a corner are turned by less than anything.
    np.testing.assert_allclose([one for _, one in found], wanted, atol=1e-3)
    assert all(one > -0.5 * 4.0**2 for _, one in found)
    # The same of a covariance that ties x and y: by the inverse of a matrix of two.
    tied = known(deviation, where)
    tied.covariance[0, 1] = tied.covariance[1, 0] = 0.6 * 0.004 * 0.011
    along_alone = -0.5 * np.square(np.abs(off_side[on_side]) / 0.011) / (1.0 - 0.6**2)
    wanted = np.sort(along_alone[along_alone > -8.0])[::-1]
    np.testing.assert_allclose([one for _, one in starts(tied, model, pose, felt(0.0))], wanted, atol=1e-3)


def test_likely_ones_come_first_and_all_of_them_are_weighed_by_hand():
    model, deviation = model_of("butterfly"), np.array([0.05, 0.03, 0.8])
    prior = known(deviation, (0.1, 0.2, 0.3))
    pose = se2.compose(prior.pose, np.array([-0.14, 0.02, 0.2]))
    found = starts(prior, model, pose, felt(0.1))
    likely = np.array([one for _, one in found])
    assert len(found) > 5 and (np.diff(likely) <= 0.0).all()
    off = se2.log(se2.between(prior.pose, np.array([one.pose for one, _ in found])))
    np.testing.assert_allclose(likely, -0.5 * np.square(off / deviation).sum(axis=1), rtol=1e-9)
    # Nothing likely was left out.
    every = starts(known(FAR, prior.pose), model, pose, felt(0.1))
    off = se2.log(se2.between(prior.pose, np.array([one.pose for one, _ in every])))
    assert len(found) == (np.square(off / deviation).sum(axis=1) < 16.0).sum() < len(every)


def turned(deviation: Any, angle: float) -> Array:
    """Covariance (3, 3) of x, y and yaw, of standard deviations (3,) along axes that are turned by an angle [rad]."""
    axes = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return axes @ np.diag(np.square(deviation)) @ axes.T


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.4, -0.3, 2.0)])
@pytest.mark.parametrize(
    ("name", "deviation", "apex"),
    [
        ("rectangle", (0.004, 0.011, 0.02), (LEFT - 0.012, 0.017, 0.0)),
        ("butterfly", (0.05, 0.03, 0.8), (-0.14, 0.02, 0.2)),
    ],
)
def test_likely_places_come_first_and_are_known_by_the_prior_and_the_touch(name, deviation, apex, where):
    # By hand, as the product of two normal distributions of x, y and yaw in the world: what was known, and a place.
    model = model_of(name)
    pose = se2.compose(np.array(where), np.array(apex))
    found = expected_starts(known(deviation, where), model, pose, felt(0.1))
    before = turned(deviation, where[2])
    wanted = []
    every = starts(known(FAR, where), model, pose, felt(0.1))
    normals = touched(seen(every, pose), model)["normal"]
    for (place, _), normal in zip(every, normals, strict=True):
        near = turned(NEAR, place.pose[2] + np.angle(normal))
        off = np.array(where) - place.pose
        off[2] = se2.wrap(off[2])
        far = off @ np.linalg.inv(before + near) @ off
        covariance = np.linalg.inv(np.linalg.inv(before) + np.linalg.inv(near))
        mean = place.pose + covariance @ np.linalg.inv(before) @ off
        likely = 0.5 * np.log(np.linalg.det(near) / np.linalg.det(before + near)) - 0.5 * far
        if far < 16.0:
            wanted.append((likely, mean, covariance))
    wanted.sort(key=lambda one: -one[0])
    assert 4 < len(wanted) <= len(every)
    np.testing.assert_allclose([likely for _, likely in found], [likely for likely, _, _ in wanted], atol=2e-3)
    for (prior, _), (_, mean, covariance) in zip(found, wanted, strict=True):
        np.testing.assert_allclose(prior.pose[:2], mean[:2], atol=1e-5)
        np.testing.assert_allclose(se2.wrap(prior.pose[2] - mean[2]), 0.0, atol=1e-4)
        axes = turned((1.0, 1.0, 1.0), 0.0)
        axes[:2, :2] = se2.rotation(prior.pose[2])
        np.testing.assert_allclose(axes @ prior.pose_covariance @ axes.T, covariance, rtol=1e-2, atol=1e-7)


def test_touch_of_a_place_is_as_likely_as_it_was_expected():
    # All places together: near 0 where the object was known to be touched so, and the less the wider that was known.
    model, pose = model_of("rectangle"), np.array([LEFT - OFF_CENTRE[0][0], 0.007, 0.0])
    of = [
        np.logaddexp.reduce([likely for _, likely in expected_starts(known(deviation), model, pose, felt(0.0))])
        for deviation in ((1e-3, 1e-3, 0.01), (0.03, 0.03, 0.5), (0.3, 0.3, 2.0))
    ]
    assert abs(of[0]) < 1.0 and of[0] > of[1] + 1.0 > of[2] + 2.0
    shifted = expected_starts(known((1e-3, 1e-3, 0.01), (0.01, 0.0, 0.0)), model, pose, felt(0.0))
    assert np.logaddexp.reduce([likely for _, likely in shifted]) < of[0] - 4.0


@pytest.mark.parametrize("found", [starts, expected_starts])
def test_nothing_likely_leaves_no_place(found):
    prior = known((0.01, 0.01, 0.1))
    assert found(prior, model_of("disc"), np.array([0.3, 0.0, 0.0]), felt(0.0)) == []


@pytest.mark.parametrize("name", [name for name in OUTLINES if name != "disc"])
def test_a_place_is_known_across_better_than_along(name):
    model = model_of(name)
    found = starts(known(FAR, (0.1, 0.2, 0.3)), model, POSE, felt(0.3))
    normals = touched(seen(found, POSE), model)["normal"]
    assert np.ptp(np.angle(normals)) > 4.0  # in all directions
    for (prior, _), normal in zip(found, normals, strict=True):
        normal = normal / abs(normal)
        across, along = np.array([normal.real, normal.imag]), np.array([-normal.imag, normal.real])
        place = prior.pose_covariance[:2, :2]
        np.testing.assert_allclose(across @ place @ across, 0.003**2, rtol=2e-3)
        np.testing.assert_allclose(along @ place @ along, 0.01**2, rtol=2e-3)
        np.testing.assert_allclose(across @ place @ along, 0.0, atol=1e-7)
        np.testing.assert_allclose(prior.covariance[2, 2], np.radians(9.0) ** 2)
        assert not prior.covariance[2, :2].any() and not prior.covariance[:2, 2].any()


@pytest.mark.parametrize("at_places", [starts, expected_starts])
def test_what_is_known_of_friction_stays_but_not_what_ties_it_to_the_pose(at_places):
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3 + OBJECT_SIZE, 3 + OBJECT_SIZE))
    prior = Prior(np.zeros(3), rng.normal(size=OBJECT_SIZE) * 1e-3, 1e4 * root @ root.T)
    before = prior.covariance.copy()
    found = at_places(prior, model_of("ellipse"), POSE, felt(0.0))
    assert len(found) > 10
    for one, _ in found:
        np.testing.assert_array_equal(one.values, prior.values)
        np.testing.assert_array_equal(one.covariance[3:, 3:], before[3:, 3:])
        assert not one.covariance[:3, 3:].any() and not one.covariance[3:, :3].any()
    np.testing.assert_array_equal(prior.covariance, before)
    assert not prior.pose.any()


@pytest.mark.parametrize("at_places", [starts, expected_starts])
@pytest.mark.parametrize("deviation", [0.3, 2.0, 3.0])
def test_no_touch_tells_the_yaw_of_a_disc(at_places, deviation):
    # There is one place, with the yaw that was known, for all others look the same; its centre lies where touch says.
    model = model_of("disc")
    prior = known((0.03, 0.02, deviation), (0.3, -0.2, 0.5))
    ((found, _),) = at_places(prior, model, POSE, felt(0.4))
    assert abs(found.pose[2] - 0.5) < 1e-12
    np.testing.assert_allclose(found.covariance[2, 2], deviation**2, rtol=1e-3)
    if at_places is starts:
        g = se2.between(found.pose, POSE)
        np.testing.assert_allclose(np.angle(-touched(g[None], model)["normal"][0]), se2.wrap(g[2] + 0.4), atol=2e-3)
    # Without a direction it may be on any side.
    assert len(at_places(known(FAR), model, POSE, ())) > 10


def test_yaws_are_alike_where_none_is_known():
    # From 1.7 rad on; that of all yaws alike is 1.81. Nearer than that, the yaw that is thought likely is.
    model = model_of("ellipse")

    def likely(turned: float, deviation: float) -> Array:
        prior = known((0.05, 0.05, deviation), (0.0, 0.0, turned))
        found = expected_starts(prior, model, POSE * [0.0, 0.0, 1.0], felt(0.0))
        return np.sort([of for _, of in found])

    for turned in (1.0, 3.0, -2.0):
        np.testing.assert_allclose(likely(turned, 1.75), likely(0.0, 1.75), atol=1e-2)
    assert abs(likely(1.0, 1.0)[-1] - likely(0.0, 1.0)[-1]) > 0.02


def test_a_round_object_is_rough_by_its_place_alone():
    disc = model_of("disc")
    assert not is_rough(known((0.005, 0.005, 3.0)), disc) and is_rough(known((0.007, 0.005, 0.1)), disc)
    assert is_rough(known((0.005, 0.005, 3.0)), model_of("ellipse"))


@pytest.mark.parametrize("number", range(3))
def test_what_is_rough(number):
    limit = (0.006, 0.006, 0.15)[number]
    for share in (0.99, 1.01):
        deviation = [1e-4, 1e-4, 1e-4]
        deviation[number] = share * limit
        assert is_rough(known(deviation), model_of("ellipse")) == (share > 1.0)
    assert not is_rough(known((0.0059, 0.0059, 0.149)), model_of("ellipse"))


def test_a_pose_of_which_nothing_is_known_any_more_begins_somewhere():
    prior = known(FAR)
    covariance = prior.covariance.copy()
    covariance[:3, :3] = 1e12  # as after a long doubt: it has no inverse
    model = model_of("rectangle")
    assert starts(dataclasses.replace(prior, covariance=covariance), model, POSE, felt(0.0))
