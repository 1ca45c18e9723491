"""An object that nobody drew is touched from all sides: what a tracker says of its outline, pose and status."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import palpate
from palpate import DIGIT, ContactDirection, Disc, Frame, Outline, Polygon, Rectangle, Sketch, Tracker, Unknown
from palpate.exploring import explorer
from palpate.geometry.named_shapes import SHAPES

RADIUS = 0.06
FIRST = np.array((0.0, 0.0, 0.2))


def touches(radius: float = RADIUS, sides: int = 8, frames: int = 10, directions: bool = True) -> list[Frame]:
    """Frames of a tip that touches a resting disc about the origin head on from several sides."""
    seen: list[Frame] = []
    for side in range(sides):
        way = 2.0 * np.pi * side / sides
        outward = np.array((np.cos(way), np.sin(way)))
        for step in range(frames + 2):
            is_touching = step < frames
            place = (radius - 3e-4 if is_touching else radius + 0.05) * outward
            pose = np.array((*place, way + np.pi))
            measured = (ContactDirection(0.0, 0.02**2),) if is_touching and directions else ()
            seen.append(Frame(len(seen) / 30.0, pose, contact=is_touching, measurements=measured))
    return seen


def tracker_of(shape: Unknown | Sketch, first: np.ndarray | None = None, **more) -> Tracker:
    return Tracker(shape, DIGIT, first, palpate.TrackerSettings("none"), **more)


def tracked(
    shape: Unknown | Sketch, seen: list[Frame] | None = None, first: np.ndarray | None = None
) -> list[palpate.Estimate]:
    tracker = tracker_of(shape, first)
    return [tracker.update(frame) for frame in seen or touches()]


def outline_of(estimate: palpate.Estimate) -> Outline:
    assert estimate.outline is not None
    return estimate.outline


def test_a_known_outline_is_not_repeated_in_each_estimate():
    tracker = Tracker(Disc(RADIUS), DIGIT, FIRST, palpate.TrackerSettings("none"))
    assert tracker.update(touches()[0]).outline is None


def test_the_outline_has_points_around_the_origin_with_a_band_that_narrows_where_it_is_touched():
    estimates = tracked(Unknown((0.05, 0.2)), first=np.zeros(3))
    last = outline_of(estimates[-1])
    count = len(last.points)
    assert last.points.shape == (count, 2) and last.deviation.shape == last.touched.shape == (count,)
    angle = np.arctan2(last.points[:, 1], last.points[:, 0]) % (2.0 * np.pi)
    assert np.allclose(angle, 2.0 * np.pi * np.arange(count) / count)
    first = outline_of(estimates[0])
    assert last.touched.sum() > first.touched.sum()
    assert last.deviation[last.touched].mean() < 0.5 * first.deviation[~first.touched].mean()
    assert np.allclose(last.signed_distance(last.points), 0.0, atol=1e-12)
    inner, outer = last.edges()
    assert last.signed_distance(inner[::8]).max() <= 1e-12 and last.signed_distance(outer[::8]).min() >= -1e-12
    assert isinstance(last.shape, Polygon)


def test_the_first_contact_makes_the_object_frame():
    """Without a first pose the origin is half the least size behind the contact, along its direction."""
    (estimate, *_) = tracked(Unknown((0.06, 0.1)), touches(frames=1, sides=1))
    assert np.allclose(estimate.pose[:2], (RADIUS - 3e-4 - 0.03, 0.0), atol=2e-3)
    assert abs(np.sin(estimate.pose[2])) < 0.05 and np.cos(estimate.pose[2]) < 0.0
    before = tracked(Unknown(), [Frame(0.0, np.array((0.3, 0.0, 0.0)), contact=False)])[0]
    assert before.status == "uncertain" and before.covariance[0, 0] > 0.5


def test_the_first_contact_may_be_far_from_the_origin_of_the_world(caplog):
    """Without a first pose there is no distance from it that could be in another unit."""
    far = np.array((20.0, -50.0, 0.0))
    seen = [replace(frame, sensor_pose=frame.sensor_pose + far) for frame in touches(sides=2)]
    estimates = tracked(Unknown((0.06, 0.1)), seen)
    assert not caplog.records and np.hypot(*(estimates[-1].pose - far)[:2]) < 0.05
    tracked(Unknown(), seen, FIRST)
    assert "millimetres" in caplog.records[0].message


def pushed(lever: float, frames: int = 40) -> list[Frame]:
    """Frames of a tip that pushes a disc along x, from its left side and a lever [m] beside its middle."""
    radius = DIGIT.radius
    reach = np.sqrt((RADIUS + radius - 3e-4) ** 2 - lever**2)
    direction = np.arctan2(-lever, reach)
    seen: list[Frame] = []
    for step in range(frames):
        pose = np.array((1e-3 * step + radius - reach, lever, 0.0))
        measured = (ContactDirection(direction, 0.02**2),)
        seen.append(Frame(step / 30.0, pose, contact=True, measurements=measured))
    return seen


def test_a_push_through_the_middle_moves_the_object_as_far():
    estimate = tracked(Unknown((0.1, 0.14)), pushed(0.0), np.zeros(3))[-1]
    assert estimate.pose[0] == pytest.approx(0.039, abs=3e-3)
    deviation = np.sqrt(estimate.covariance.diagonal())
    assert np.all(np.abs(estimate.pose - (0.039, 0.0, 0.0)) < 3.0 * deviation)


def test_a_push_beside_the_middle_turns_the_object_away_and_is_less_sure_of_its_yaw():
    """A tip at the left of the middle, seen along the push, turns the object to the right."""
    middle = tracked(Unknown((0.1, 0.14)), pushed(0.0), np.zeros(3))[-1]
    left = tracked(Unknown((0.1, 0.14)), pushed(0.02), np.zeros(3))[-1]
    right = tracked(Unknown((0.1, 0.14)), pushed(-0.02), np.zeros(3))[-1]
    assert left.pose[2] < -0.02 and right.pose[2] > 0.02
    assert left.covariance[2, 2] > middle.covariance[2, 2]


def test_noise_of_a_sensor_that_rests_in_contact_does_not_push_the_object():
    rng = np.random.default_rng(3)
    still = np.array((DIGIT.radius - np.hypot(RADIUS + DIGIT.radius - 3e-4, 0.0), 0.0, 0.0))
    measured = (ContactDirection(0.0, 0.02**2),)
    seen = [
        Frame(k / 30.0, still + rng.normal(0.0, (1e-4, 1e-4, 1e-3)), contact=True, measurements=measured)
        for k in range(300)
    ]
    estimate = tracked(Unknown((0.1, 0.14)), seen, np.zeros(3))[-1]
    assert np.hypot(*estimate.pose[:2]) < 1.5e-3


def test_a_disc_that_rests_is_learnt_all_around():
    outline = outline_of(tracked(Unknown((0.08, 0.2)), touches(sides=24), np.zeros(3))[-1])
    radius = np.hypot(*outline.points.T)
    assert np.abs(radius - RADIUS).max() < 3e-3
    assert np.all(np.abs(radius - RADIUS) < 3.0 * outline.deviation)
    assert outline.touched.mean() > 0.4  # 24 patches of 8 mm, placed by a yaw that nothing tells


def test_a_sketch_is_drawn_exactly_where_a_tip_gets_to():
    far_away = [Frame(0.0, np.array((0.5, 0.0, 0.0)), contact=False)]
    for shape, reached in ((SHAPES["triangle"], 1.0), (SHAPES["t"], 0.75)):  # a tip is too large for inner corners
        points = outline_of(tracked(Sketch(shape, 1e-3), far_away, np.zeros(3))[-1]).points
        off = np.abs(shape.signed_distance(points))
        assert np.mean(off < 1e-4) >= reached


def test_a_sketch_whose_centroid_is_outside_is_drawn_about_its_origin():
    corners = np.array([(-20, -20), (300, -20), (300, 20), (20, 20), (20, 300), (-20, 300)]) / 1e3
    shape = Polygon(corners)
    assert shape.signed_distance(np.asarray(shape.centroid)) > DIGIT.radius
    far_away = [Frame(0.0, np.array((0.9, 0.0, 0.0)), contact=False)]
    points = outline_of(tracked(Sketch(shape, 1e-3), far_away, np.zeros(3))[-1]).points
    assert np.mean(np.abs(shape.signed_distance(points)) < 1e-4) >= 0.75


def test_the_band_of_a_touched_place_holds_the_error_of_the_set_up():
    """However often a place is touched, where the sensor is mounted and how far its gel gives way stay unknown."""
    one_round = touches()
    again = [replace(one, time=one.time + 10.0 * turn) for turn in range(6) for one in one_round]
    outline = outline_of(tracked(Unknown((0.05, 0.2)), again, np.zeros(3))[-1])
    mounting = palpate.TrackerSettings("none").noise.sensor_pose.calibration[0]
    assert outline.deviation.min() > mounting


def test_an_object_larger_than_stated_and_a_sketch_that_does_not_fit_are_strained():
    larger = tracked(Unknown((0.03, 0.06)), touches(radius=0.09, sides=24), np.zeros(3))[-1]
    assert larger.status == "strained" and "mm wide" in larger.reason
    across = tracked(Unknown((0.03, 0.13)), touches(radius=0.09, sides=2), np.array((0.0, 0.0, 0.25 * np.pi)))[-1]
    assert across.status == "strained" and "mm wide" in across.reason
    assert tracked(Unknown((0.03, 0.19)), touches(radius=0.09, sides=24), np.zeros(3))[-1].status != "strained"
    other = tracked(Sketch(Disc(0.05), 0.001), touches(radius=0.09, sides=24), np.zeros(3))[-1]
    assert other.status == "strained" and "from the sketch" in other.reason


@pytest.mark.parametrize(("drawn", "words"), [(1.3, "smaller than the sketch"), (0.75, "larger than the sketch")])
def test_a_sketch_of_another_size_is_strained_once_several_sides_say_so(drawn, words):
    estimates = tracked(Sketch(Disc(drawn * RADIUS), 5e-3), touches(), FIRST)
    assert estimates[-1].status == "strained" and words in estimates[-1].reason
    for nearly in (0.95, 1.0, 1.05):
        last = tracked(Sketch(Disc(nearly * RADIUS), 5e-3), touches(), FIRST)[-1]
        assert last.status != "strained"


@pytest.mark.parametrize("shape", [Sketch(Disc(RADIUS), 2e-3), Unknown((0.08, 0.2))])
def test_an_object_that_something_else_has_moved_is_found_anew(shape):
    """A disc is learnt all around, then it is 3 cm away; touches of it there say so."""
    away = np.array((0.03, 0.0, 0.0))
    before = [frame for turn in range(2) for frame in touches()]
    seen = [replace(frame, time=k / 30.0) for k, frame in enumerate(before)]
    moved = [
        replace(frame, time=(len(seen) + k) / 30.0, sensor_pose=frame.sensor_pose + away)
        for k, frame in enumerate(touches())
    ]
    estimate = tracked(shape, seen + moved, np.zeros(3))[-1]
    assert estimate.status != "strained"
    assert np.hypot(*(estimate.pose[:2] - away[:2])) < 8e-3
    deviation = np.sqrt(estimate.covariance.diagonal()[:2])
    assert np.all(np.abs(estimate.pose[:2] - away[:2]) < 3.0 * deviation)


@pytest.mark.parametrize(("directions", "times"), [(True, 7), (False, 0)])
def test_shoves_are_proposed_at_each_later_contact_if_touch_measures_directions(monkeypatch, directions, times):
    proposed: list[int] = []
    monkeypatch.setattr(explorer, "propose_shoves", lambda rows, _: proposed.append(len(rows.mean)))
    tracked(Unknown(), touches(directions=directions), np.zeros(3))
    assert len(proposed) == times


def carried_around(sides: int) -> list[Frame]:
    """Frames of a tip that pushes a disc through its middle from one side after the other, 4 in a second."""
    seen: list[Frame] = []
    middle = np.zeros(2)
    for side in range(sides):
        outward = np.array((np.cos(2.4 * side), np.sin(2.4 * side)))
        for _ in range(6):
            middle = middle - 5e-3 * outward
            pose = np.array((*(middle + (RADIUS - 3e-4) * outward), 2.4 * side + np.pi))
            seen.append(Frame(0.25 * len(seen), pose, contact=True, measurements=(ContactDirection(0.0, 0.05**2),)))
        away = np.array((*(middle + (RADIUS + 0.03) * outward), 2.4 * side + np.pi))
        seen.append(Frame(0.25 * len(seen), away, contact=False))
    return seen


def test_covariances_stay_symmetric_and_positive_for_minutes():
    """Rounding that grows with each observation made estimates infinite after three minutes."""
    for estimate in tracked(Unknown((0.08, 0.2)), carried_around(sides=40), np.zeros(3)):
        assert np.allclose(estimate.covariance, estimate.covariance.T, rtol=0.0, atol=1e-15)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        assert np.isfinite(estimate.pose).all() and np.isfinite(outline_of(estimate).points).all()


@pytest.mark.filterwarnings("error")
def test_a_tip_at_the_middle_of_a_sketch_contradicts_it_and_estimates_stay_finite():
    pose = np.array((DIGIT.radius, 0.0, 0.0))  # the centre of the tip is at the origin
    contact = Frame(0.0, pose, contact=True, measurements=(ContactDirection(0.0, 0.02**2),))
    (estimate,) = tracked(Sketch(Disc(RADIUS), 0.005), [contact], np.zeros(3))
    assert np.isfinite(estimate.pose).all() and np.linalg.eigvalsh(estimate.covariance).min() > 0.0
    assert estimate.status == "strained" and np.isfinite(outline_of(estimate).points).all()


def test_several_tips_carry_the_object_with_them():
    tips = palpate.SensorProfile(name="fingers", radius=0.005, tips=((0.0, -0.02), (0.0, 0.02)), rate=30.0)
    tracker = Tracker(Unknown(), tips, np.array((0.05, 0.0, 0.0)), palpate.TrackerSettings("none"))
    turns = 0.01 * np.arange(30)
    seen = [Frame(k / 30.0, np.array((0.0, 0.0, turn)), contact=True) for k, turn in enumerate(turns)]
    estimate = [tracker.update(frame) for frame in seen][-1]
    assert estimate.pose[2] == pytest.approx(turns[-1], abs=0.02)
    assert estimate.pose[1] == pytest.approx(0.05 * np.sin(turns[-1]), abs=3e-3)


def test_contacts_on_one_side_enclose_nothing():
    estimates = tracked(Unknown(), touches(sides=1))
    assert {estimate.status for estimate in estimates} == {"uncertain"}
    assert "enclose nothing" in estimates[-1].reason


def test_contact_flags_alone_do_not_tell_a_form():
    last = tracked(Unknown(), touches(directions=False))[-1]
    assert last.status == "uncertain" and "contact directions" in last.reason


def test_begin_anew_forgets_the_outline():
    tracker = tracker_of(Unknown(), FIRST)
    first = outline_of(tracker.update(touches(sides=1)[-1]))
    tracker.reset()
    touched = [outline_of(tracker.update(frame)).touched.any() for frame in touches(sides=3)]
    assert touched[-1]
    tracker.reset(np.array((0.5, 0.0, 0.0)))
    again = tracker.update(touches(sides=1)[-1])
    assert np.allclose(again.pose, (0.5, 0.0, 0.0)) and not outline_of(again).touched.any()
    assert np.allclose(outline_of(again).deviation, first.deviation)


def test_a_measurement_that_needs_a_known_outline_is_left_out_with_a_warning(caplog):
    class Own(palpate.OwnMeasurement):
        on = ("object_pose",)

        def residual(self, pose):
            return pose

    seen = [replace(frame, measurements=(*frame.measurements, Own())) for frame in touches(sides=1)]
    mixed = tracked(Unknown(), seen, FIRST)
    assert [record.message.count("Own") for record in caplog.records] == [1]
    for one, other in zip(mixed, tracked(Unknown(), touches(sides=1), FIRST), strict=True):
        assert np.array_equal(one.pose, other.pose)


def test_a_copy_of_a_tracker_goes_on_by_itself():
    seen = touches(sides=3)
    tracker = tracker_of(Unknown(), FIRST)
    for frame in seen[:20]:
        tracker.update(frame)
    copies = [copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))]
    last = [[one.update(frame) for frame in seen[20:]][-1] for one in (*copies, tracker)]
    for one in last[:2]:
        assert np.array_equal(one.pose, last[2].pose)
        assert np.array_equal(outline_of(one).deviation, outline_of(last[2]).deviation)


def test_estimates_can_be_copied_to_other_processes():
    last = tracked(Unknown(), touches(sides=2))[-1]
    sent = pickle.loads(pickle.dumps(last))
    assert np.array_equal(sent.outline.points, outline_of(last).points)


@pytest.mark.parametrize("size", [(0.2, 0.05), (0.0, 0.1), 0.1, (0.05, "wide"), (50.0, 200.0), (0.1, float("nan"))])
def test_sizes_that_are_not_allowed_are_named(size):
    with pytest.raises(palpate.SettingError, match="size"):
        Unknown(size)


@pytest.mark.parametrize("sigma", [0.0, -0.005, 5.0, float("nan"), "5mm"])
def test_sigmas_that_are_not_allowed_are_named(sigma):
    with pytest.raises(palpate.SettingError, match="sigma"):
        Sketch(Disc(RADIUS), sigma)


def test_a_sketch_is_seen_whole_from_its_origin():
    with pytest.raises(palpate.SettingError, match="origin"):
        Sketch(Polygon(np.array(((0.01, 0.0), (0.1, 0.0), (0.1, 0.1), (0.01, 0.1)))), 0.005)
    spiral = ((0.0, -0.02), (0.1, -0.02), (0.1, 0.08), (-0.02, 0.08), (-0.02, 0.06), (0.08, 0.06), (0.08, 0.02))
    with pytest.raises(palpate.SettingError, match="hides"):
        Sketch(Polygon(np.array((*spiral, (0.0, 0.02))) - (0.02, 0.0)), 0.002)
    with pytest.raises(palpate.SettingError, match="outline"):
        Sketch("disc", 0.005)  # pyright: ignore[reportArgumentType]
    Sketch(Rectangle(0.1, 0.05), 0.005)


def test_what_an_outline_that_is_learnt_cannot_have_is_refused():
    mounts = {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, 0.0)}
    with pytest.raises(palpate.SettingError, match="hand"):
        Tracker(Unknown(), {"left": "digit", "right": "digit"}, FIRST, mounts=mounts)
    with pytest.raises(palpate.SettingError, match="first pose"):
        tracker_of(Sketch(Disc(RADIUS), 0.005))
    with pytest.raises(palpate.SettingError, match="outline"):
        tracker_of(Unknown(), FIRST).variable("grip")


def test_an_outline_can_be_the_sketch_of_the_next_tracker():
    estimates = tracked(Unknown((0.05, 0.2)))
    outline = outline_of(estimates[-1])
    sketch = Sketch(outline.shape, min(outline.sigma, 0.01))
    estimate = tracked(sketch, first=estimates[0].pose)[0]
    assert np.abs(outline_of(estimate).signed_distance(outline.points)).max() < sketch.sigma


def band(wide: float, points: np.ndarray | None = None) -> Outline:
    """An outline of 90 points whose band is wide about an angle [rad]."""
    angle = np.arange(90) * (2.0 * np.pi / 90)
    circle = RADIUS * np.column_stack((np.cos(angle), np.sin(angle)))
    deviation = np.where(np.cos(angle - wide) > 0.9, 0.02, 0.001)
    return Outline(circle if points is None else points, deviation, deviation < 0.01)


def test_the_next_push_is_where_the_band_is_wide():
    push = palpate.next_push(band(2.0))
    assert np.cos(np.arctan2(push.point[1], push.point[0]) - 2.0) > 0.9
    assert np.dot(push.direction, push.point) == pytest.approx(-RADIUS, rel=1e-3)
    assert (
        push.information
        > palpate.next_push(Outline(band(2.0).points, np.full(90, 1e-3), np.ones(90, bool))).information
    )


def test_the_next_push_is_in_the_middle_of_what_was_not_touched():
    angle = np.arange(90) * (2.0 * np.pi / 90)
    half = Outline(band(0.0).points, np.where(np.sin(angle) > -0.5, 0.001, 0.03), np.sin(angle) > -0.5)
    push = palpate.next_push(half)
    assert np.allclose(push.point, (0.0, -RADIUS), atol=5e-3)


def test_the_next_push_of_an_estimate_is_in_the_world():
    first = np.array((0.3, -0.2, np.pi / 2.0))
    estimate = tracked(Unknown(), touches(sides=1)[-1:], first)[0]
    push = palpate.next_push(estimate)
    of_outline = palpate.next_push(outline_of(estimate))
    assert np.allclose(push.point, (0.3 - of_outline.point[1], -0.2 + of_outline.point[0]))
    assert np.allclose(push.direction, (-of_outline.direction[1], of_outline.direction[0]))


def test_the_next_push_is_where_the_tip_gets_to():
    """A notch is narrower than the tip: it is not pushed there, though nothing is known of it."""
    angle = np.arange(90) * (2.0 * np.pi / 90)
    radius = np.where(np.abs(np.angle(np.exp(1j * (angle - 2.0)))) < 0.1, 0.04, RADIUS)
    notched = band(2.0, radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))
    wide = Outline(notched.points, np.where(radius < 0.05, 0.03, 0.001), notched.touched)
    point = palpate.next_push(wide).point
    held = palpate.next_push(wide, tip_radius=0.02).point
    assert np.hypot(*point) < 0.05 < np.hypot(*held)


def test_the_next_push_of_a_known_outline_is_refused():
    known = Tracker(Disc(RADIUS), DIGIT, FIRST, palpate.TrackerSettings("none")).update(touches()[0])
    with pytest.raises(palpate.EstimationError, match="outline"):
        palpate.next_push(known)
    with pytest.raises(palpate.SettingError, match="tip_radius"):
        palpate.next_push(band(0.0), tip_radius=-1.0)


def test_a_kink_of_the_outline_makes_no_spike_of_its_band():
    angle = np.arange(64) * (np.pi / 32)
    radius = np.full(64, 0.05)
    radius[10] = 0.04
    outline = Outline(radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle))), np.full(64, 0.01), angle < 1.0)
    _, outer = outline.edges()
    assert np.hypot(*outer.T).max() < 0.05 + 1.1 * 1.96 * 0.01
