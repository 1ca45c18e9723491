"""Real motion with rendered touch, from motions that are known in closed form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate import (
    DIGIT,
    Polygon,
    Recording,
    Rectangle,
    SensorProfile,
    SettingError,
    Tracker,
    load_recording,
    write_recording,
)
from palpate.geometry import se2
from palpate.lab.simulate.real_motion import real_contacts, real_motion
from palpate.lab.simulate.recordings import SUFFIX
from palpate.lab.simulate.replay import replay_folder, replay_recording
from palpate.lab.simulate.unit import draw_unit

HALF = 0.045  # [m] of the square, whose edge x = -HALF is pushed
TIP = SensorProfile(name="tip", radius=0.005, rate=30.0)
HAND = SensorProfile(name="hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=30.0)
REST = 18  # frames, 0.6 s at 30 Hz


def push(frames=40, turn=0.3, slip=0.004, gap=0.0, tip=TIP, rate=30.0, **changes):
    """Return a push by a tip that moves at 30 mm/s along x while the object turns and slides over it, and s.

    With the object's yaw theta, e_r = (cos theta, sin theta) across the edge and e_t along it, the edge is touched at
    (-HALF, s) if the object is at c + (r + gap + HALF) e_r - s e_t. Then the object's point there moves past the tip's
    by (r theta' - s') e_t, up to the gap: s = s0 + r theta - slip t slides by `slip` towards +y of the tip.
    """
    time = np.arange(frames) / rate
    theta = turn * time / time[-1]
    center = np.array([0.1, 0.2]) + time[:, None] * (0.03, 0.0)
    along = -0.01 + tip.radius * theta - slip * time
    across = np.column_stack((np.cos(theta), np.sin(theta)))
    edge = np.column_stack((-np.sin(theta), np.cos(theta)))
    position = center + (tip.radius + gap + HALF) * across - along[:, None] * edge
    apex = se2.compose(np.column_stack((center, np.full(frames, 0.1))), np.array([tip.radius, 0.0, 0.0]))
    made = Recording(
        time=time,
        sensor_pose=apex,
        shape=Rectangle(2 * HALF, 2 * HALF),
        sensor=tip,
        object_pose=np.column_stack((position, theta)),
        contact=np.ones(frames, np.bool_),
        source="a push",
        file=Path("push.json"),
    )
    return replace(made, **changes), along


def truth(recording) -> np.ndarray:
    assert recording.object_pose is not None
    return recording.object_pose


def contact(recording) -> np.ndarray:
    assert recording.contact is not None
    return recording.contact


def unit_of(replay):
    """Return the sensor unit that a replay's source names."""
    return draw_unit(DIGIT, int(replay.source.split("images of unit ")[1].split(";")[0]))


def gel_centers(replay, unit):
    """Return centres of curvature of the gel in the object frame (N, 2)."""
    return se2.transform(se2.between(truth(replay), replay.sensor_pose), np.array([-unit.radius, 0.0]))


@pytest.mark.parametrize("gap", [0.0, 1.2e-3, -1.2e-3])
def test_the_gel_touches_where_the_tip_did_after_a_time_of_rest(gap):
    recording, along = push(gap=gap)
    made = replay_recording(recording, seed=4)
    unit, depth = unit_of(made), made.extra["indentation"]
    center = gel_centers(made, unit)
    # The edge is straight: the centre is R - d + gap from it, straight behind (-HALF, s).
    np.testing.assert_allclose(center[REST:, 0], -HALF - (unit.radius - depth[REST:] + gap), atol=1e-6)
    np.testing.assert_allclose(center[REST:, 1], along, atol=1e-6)
    np.testing.assert_array_equal(truth(made)[REST:], truth(recording))
    # Before, the object rests and the sensor comes from 1 cm away.
    assert len(made) == REST + 40
    np.testing.assert_allclose(made.time[: REST + 1], np.arange(REST + 1) / 30.0, atol=1e-9)
    assert not contact(made)[:REST].any() and contact(made)[REST:].all()
    assert (truth(made)[:REST] == truth(recording)[0]).all()
    clear = made.shape.signed_distance(center[:REST]) - unit.radius
    assert clear[0] == pytest.approx(0.01 + gap, abs=1e-6) and (np.diff(clear) < 0).all()
    assert (depth[:REST] == 0).all() and (depth[REST:] > 0).all()


@pytest.mark.parametrize("slip", [0.0, 0.02, -0.02])
def test_the_gel_slides_and_rolls_as_the_tip_did(slip):
    recording, _ = push(slip=slip)
    made = replay_recording(recording, seed=4)
    unit = unit_of(made)
    # Chords for arcs: 0.5 x 10 mm x (0.23 rad/s)^2 / 30 Hz = 9e-6.
    np.testing.assert_allclose(made.extra["slip"][REST:], slip, atol=2e-5)
    # Rolling by 0.3 rad moves the contact by 0.3 r over both surfaces: by 0.3 r / R as an angle of the gel.
    pad = made.extra["pad_angle"][REST:]
    np.testing.assert_allclose(pad - pad[0], TIP.radius / unit.radius * truth(recording)[:, 2], atol=1e-9)
    assert abs(pad[0]) <= np.radians(12.0)
    # The direction of the contact in the sensor that was made; the inward normal is the object's x.
    apex = se2.between(truth(made), made.sensor_pose)
    np.testing.assert_allclose(se2.wrap(-apex[REST:, 2]), pad, atol=1e-9)
    # Sliding of the gel itself, with the depth held: the same but for d / R of the rolling.
    g, depth = apex[REST + 4 : -4], made.extra["indentation"][REST + 4 : -4, None]
    touched = gel_centers(made, unit)[REST + 4 : -4] + (unit.radius - depth) * (1.0, 0.0)
    before = se2.transform(se2.compose(g[:-1], se2.inverse(g[1:])), touched[1:])
    np.testing.assert_allclose((before - touched[1:])[:, 1] * 30.0, slip, atol=1e-4)
    # Friction follows sliding: 0.25 x 2600 N/m x 0.36 mm to 0.6 x 6500 N/m x 1.1 mm.
    force = made.extra["tangential_force"][REST + 5 : -5]
    assert (
        (np.sign(force) == np.sign(slip)).all() and 0.2 < np.abs(force).max() < 4.2 if slip else abs(force).max() < 0.02
    )


def test_images_show_the_contact():
    made = replay_recording(push()[0])
    images = np.array([frame.image for frame in made], dtype=float)
    change = np.maximum(np.abs(images - images[:15].mean(axis=0)) - 8.0, 0.0)  # more than noise
    assert change[REST:].sum(axis=(1, 2, 3)).min() > 10.0 * change[:REST].sum(axis=(1, 2, 3)).max()
    column = (change[REST + 20].sum(axis=(0, 2)) * np.arange(240)).sum() / change[REST + 20].sum()
    unit = unit_of(made)
    wanted = 119.5 + (unit.radius * np.sin(made.extra["pad_angle"][REST + 20]) - unit.offset[0]) / unit.pitch
    assert column == pytest.approx(wanted, abs=25.0)  # shadows shift it
    assert column < 119.5 - 15.0  # the contact is left of the middle


def test_short_unknown_truth_is_bridged_and_stays_unknown():
    recording, _ = push(slip=0.0)
    gaps = truth(recording).copy()
    gaps[10], gaps[-3:] = np.nan, np.nan
    made = replay_recording(replace(recording, object_pose=gaps))
    assert len(made) == REST + 40 - 3  # unknown poses at the end are left out
    assert np.flatnonzero(np.isnan(truth(made)[:, 0])).tolist() == [REST + 10]
    # Turning evenly and sticking, the object goes as bridged.
    motion = real_motion(replace(recording, object_pose=gaps), 30.0)
    np.testing.assert_allclose(motion.object_pose[REST + 10], truth(recording)[10], atol=5e-6)


def test_a_hand_of_two_fingers_keeps_its_yaw():
    recording, along = push(turn=0.0, slip=0.004, tip=HAND)
    hand = np.zeros((40, 3))
    hand[:, :2] = np.array([0.1 + HAND.radius, 0.2]) + recording.time[:, None] * (0.03, 0.0)
    gaps = truth(recording).copy()
    gaps[5:34] = np.nan  # one second, in which two fingers hold the object
    made = replay_recording(replace(recording, sensor_pose=hand, object_pose=gaps))
    assert (made.sensor_pose[REST:, 2] == 0.0).all()
    np.testing.assert_allclose(made.extra["pad_angle"][REST:], 0.0, atol=1e-9)
    np.testing.assert_allclose(made.extra["slip"][REST:], 0.004, atol=1e-9)
    g = se2.between(truth(recording), made.sensor_pose[REST:])
    np.testing.assert_allclose(g[:, 1], along, atol=1e-9)
    np.testing.assert_allclose(g[:, 0], -HALF + made.extra["indentation"][REST:], atol=1e-6)


def test_other_rates_become_the_sensors_and_gaps_stay():
    fast, _ = push(121, rate=90.0)
    there = np.ones(121, np.bool_)
    there[40:70] = False  # a third of a second without frames
    time, pose = fast.time[there], truth(fast)[there]
    fast = replace(fast, time=time, sensor_pose=fast.sensor_pose[there], object_pose=pose, contact=there[there])
    motion = real_motion(fast, 30.0)
    step = np.diff(motion.time)
    assert np.isclose(step, 1 / 30).sum() == len(step) - 1 and step.max() == pytest.approx(70 / 90 - 39 / 90)
    same = np.isin(np.round(time * 90), np.round((motion.time[REST:] - motion.time[REST]) * 90))
    np.testing.assert_allclose(motion.object_pose[REST:], pose[same], atol=1e-9)
    months = replace(push(3)[0], time=np.array([0.0, 4e6, 8e6]))
    assert len(real_motion(months, 30.0).time) == REST + 3  # and not 240 million


def test_the_contact_of_a_corner():
    # A tip of 5 mm at 4 + 3 mm off the corner (0.045, 0.045) touches it: 5 mm away, from direction (0.8, 0.6).
    tip = replace(TIP, tips=((0.005, 0.0),))  # its centre is the origin of the sensor frame
    found = real_contacts(Rectangle(0.09, 0.09), tip, np.array([[0.049, 0.048, 0.0]]), np.zeros((1, 3)))
    np.testing.assert_allclose(found.point, [[0.045, 0.045]], atol=1e-9)
    np.testing.assert_allclose(found.normal, [[0.8, 0.6]], atol=1e-9)
    assert found.gap[0] == pytest.approx(0.0, abs=1e-12)
    assert found.angle[0] == pytest.approx(np.arctan2(-0.6, -0.8))


def test_two_contacts_each_begin_near_the_apex():
    touched = np.ones(150, np.bool_)
    touched[60:95] = False
    made = replay_recording(push(150, turn=2.0, tip=replace(TIP, radius=0.015), contact=touched)[0])
    pad = made.extra["pad_angle"]
    assert np.isnan(pad[~contact(made)]).all() and np.abs(pad[contact(made)]).max() <= np.radians(20.0) + 1e-9
    assert np.abs(np.diff(made.sensor_pose[REST:, 2])).max() < 0.1  # no jump in between


SLOT = Polygon([(0, -0.05), (0.08, -0.05), (0.08, 0.05), (0, 0.05), (0, 0.01), (0.03, 0.01), (0.03, -0.01), (0, -0.01)])
"""A block with a slot, 20 mm wide and 30 mm deep, in which a tip fits and a gel does not."""
DROPPED = np.where((np.arange(40) // 10 == 1)[:, None], np.nan, truth(push()[0]))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"object_pose": None}, "has no object poses"),
        ({"object_pose": np.full((40, 3), np.nan)}, "has no object poses"),
        ({"contact": None}, "has no contact flags"),
        ({"contact": np.zeros(40, np.bool_)}, "has no contact flags, or none that is set"),
        ({"object_pose": DROPPED}, r"frames 10 to 19, in contact, .*: 0\.37 s .*up to 0\.12 s can be bridged"),
        ({"turn": 1.0, "tip": replace(TIP, radius=0.06)}, "frames 18 to 57 of .*degrees from the middle of the gel"),
        (
            {"shape": SLOT, "sensor_pose": np.tile((0.03, 0.0, 0.0), (40, 1)), "object_pose": np.zeros((40, 3))},
            "frames 18 to 57 of the replay .*the outline is hollow",
        ),
    ],
)
def test_a_motion_that_cannot_be_rendered_is_refused(changes, said):
    with pytest.raises(SettingError, match=f"^push.json: {said}"):
        replay_recording(push(**changes)[0])


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    recording, _ = push(12)
    renamed = replace(recording, file=Path("other.json"))
    made = [replay_recording(one, seed) for one, seed in ((recording, 1), (recording, 1), (recording, 2), (renamed, 1))]
    for name, one in zip("abcd", made, strict=True):
        write_recording(one, tmp_path / f"{name}{SUFFIX}")
    a, b, c, d = ((tmp_path / f"{name}{SUFFIX}").read_bytes() for name in "abcd")
    assert a == b and len({a, c, d}) == 3
    assert replay_recording(recording, seed=1, unit=7).source.endswith("images of unit 7")
    replay_folder(tmp_path / "two", {f"x{SUFFIX}": recording, f"y{SUFFIX}": renamed}, seed=1, workers=2)
    assert (tmp_path / f"two/x{SUFFIX}").read_bytes() == a and (tmp_path / f"two/y{SUFFIX}").read_bytes() == d


def test_a_real_push_is_replayed_and_tracked(shared_data):
    name = "StraightLine_2016_10_23_StraightLineNoPerturbationsPlywoodNoLighting.json.gz"
    recording = load_recording(shared_data / "mit_point_push" / name)
    made = replay_recording(recording)
    known = ~np.isnan(truth(recording)[:, 0])
    np.testing.assert_array_equal(truth(made)[REST:], truth(recording)[known])
    tracker = Tracker(made.shape, made.sensor, truth(made)[0])
    estimate = [tracker.update(frame) for frame in made][-1]
    x, y, theta = se2.between(truth(made)[-1], estimate.pose)
    assert np.hypot(x, y) < 6e-3 and abs(theta) < np.radians(3.0)


def test_real_runs_with_long_dropouts_are_refused(shared_data):
    refused = 0
    for path in sorted((shared_data / "mit_point_push").glob("*.json.gz")):
        try:
            motion = real_motion(load_recording(path), DIGIT.rate)
        except SettingError as error:
            assert str(error).startswith(f"{path}: frames ")
            refused += 1
        else:
            assert motion.known[REST:].mean() > 0.95
    assert refused == 5
