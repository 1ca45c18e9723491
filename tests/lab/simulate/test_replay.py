"""`palpate simulate --replay`: real motion with rendered touch, from motions that are known in closed form."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import planar
import pytest

from palpate import DIGIT, Polygon, Recording, Rectangle, SensorProfile, load_recording, write_recording

HALF = 0.045  # [m] of the square, whose edge x = -HALF is pushed
TIP = SensorProfile(name="tip", radius=0.005, rate=30.0)
HAND = SensorProfile(name="hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=30.0)
REST = 18  # frames, 0.6 s at 30 Hz


def push(frames=40, turn=0.3, slip=0.004, gap=0.0, tip=TIP, rate=30.0, **changes) -> tuple[Any, Any]:
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
    apex = planar.compose(np.column_stack((center, np.full(frames, 0.1))), np.array([tip.radius, 0.0, 0.0]))
    made = Recording(
        time=time,
        sensor_pose=apex,
        shape=Rectangle(2 * HALF, 2 * HALF),
        sensor=tip,
        object_pose=np.column_stack((position, theta)),
        contact=np.ones(frames, np.bool_),
        source="a push",
    )
    return replace(made, **changes), along


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def replayed(run_palpate):
    def run(recording, *words, name="push"):
        if recording is not None:
            write_recording(recording, f"{name}.mcap", overwrite=True)
        folder = f"out{len(list(Path().glob('out*')))}"
        code, _, err = run_palpate("simulate", folder, "--replay", f"{name}.mcap", *(words or ("--seed", "4")))
        assert code == 0, err
        return load_recording(f"{folder}/{name}.mcap")

    return run


def turned_and_apex(made):
    """Return the contact's angle on the gel (N,) and the sensor pose in the object frame (N, 3), after the rest."""
    return made.extra["pad_angle"][REST:], planar.between(made.object_pose, made.sensor_pose)[REST:]


@pytest.mark.parametrize("gap", [0.0, 1.2e-3, -1.2e-3])
def test_the_gel_touches_where_the_tip_did_after_a_time_of_rest(replayed, gap):
    recording, along = push(gap=gap)
    made = replayed(recording)
    depth, (pad, apex) = made.extra["indentation"], turned_and_apex(made)
    # The edge is straight: the gel's centre is R - d + gap behind (-HALF, s), and its apex R ahead of that at -pad.
    np.testing.assert_allclose(planar.wrap(-apex[:, 2] - pad), 0.0, atol=1e-9)
    radius = np.median((apex[:, 1] - along) / np.sin(-pad))
    assert 0.0195 < radius < 0.022
    np.testing.assert_allclose(apex[:, 1] - along, radius * np.sin(-pad), atol=1e-6)
    behind = radius * (1.0 - np.cos(pad)) - depth[REST:] + gap
    np.testing.assert_allclose(apex[:, 0], -HALF - behind, atol=1e-6)
    np.testing.assert_array_equal(made.object_pose[REST:], recording.object_pose)
    # Before, the object rests and the sensor comes from 1 cm away.
    assert len(made) == REST + 40 and not made.contact[:REST].any() and made.contact[REST:].all()
    np.testing.assert_allclose(made.time[: REST + 1], np.arange(REST + 1) / 30.0, atol=1e-9)
    assert (made.object_pose[:REST] == recording.object_pose[0]).all()
    assert (depth[:REST] == 0).all() and (depth[REST:] > 0).all()
    way = np.hypot(*(made.sensor_pose[:REST, :2] - made.sensor_pose[REST, :2]).T)
    assert way[0] == pytest.approx(0.01, abs=1e-3) and (np.diff(way) < 0.0).all()


@pytest.mark.parametrize("slip", [0.0, 0.02, -0.02])
def test_the_gel_slides_and_rolls_as_the_tip_did(replayed, slip):
    recording, along = push(slip=slip)
    made = replayed(recording)
    # Chords for arcs: 0.5 x 10 mm x (0.23 rad/s)^2 / 30 Hz = 9e-6.
    np.testing.assert_allclose(made.extra["slip"][REST:], slip, atol=2e-5)
    # Rolling by 0.3 rad moves the contact by 0.3 r over both surfaces: by 0.3 r / R as an angle of the gel.
    pad, apex = turned_and_apex(made)
    radius = np.median((apex[:, 1] - along) / np.sin(-pad))
    np.testing.assert_allclose(pad - pad[0], TIP.radius / radius * recording.object_pose[:, 2], atol=1e-5)
    assert abs(pad[0]) <= np.radians(12.0)
    # Friction follows sliding: 0.25 x 2600 N/m x 0.36 mm to 0.6 x 6500 N/m x 1.1 mm.
    force = made.extra["tangential_force"][REST + 5 : -5]
    if slip:
        assert (np.sign(force) == np.sign(slip)).all() and 0.2 < np.abs(force).max() < 4.2
    else:
        assert np.abs(force).max() < 0.02


def test_images_show_the_contact(replayed):
    made = replayed(push()[0])
    images = np.array([frame.image for frame in made], dtype=float)
    change = np.maximum(np.abs(images - images[:15].mean(axis=0)) - 8.0, 0.0)  # more than noise
    assert change[REST:].sum(axis=(1, 2, 3)).min() > 10.0 * change[:REST].sum(axis=(1, 2, 3)).max()
    column = (change[REST + 20].sum(axis=(0, 2)) * np.arange(240)).sum() / change[REST + 20].sum()
    seen = 119.5 + 21e-3 * np.sin(made.extra["shown_angle"][REST + 20]) * 240 / 18.4e-3  # a DIGIT's pad
    assert column == pytest.approx(seen, abs=45.0)  # shadows shift it, and the border cuts off a part


def test_short_unknown_truth_is_bridged_and_stays_unknown(replayed):
    recording, _ = push(slip=0.0)
    whole, gaps = replayed(recording), recording.object_pose.copy()
    gaps[10], gaps[-3:] = np.nan, np.nan
    made = replayed(replace(recording, object_pose=gaps))
    assert len(made) == REST + 40 - 3  # unknown poses at the end are left out
    assert np.flatnonzero(np.isnan(made.object_pose[:, 0])).tolist() == [REST + 10]
    # Turning evenly and sticking, the object goes as bridged.
    rolled = [each.extra["pad_angle"] - each.extra["pad_angle"][REST] for each in (made, whole)]
    np.testing.assert_allclose(rolled[0][REST + 10], rolled[1][REST + 10], atol=1e-4)


def test_a_hand_of_two_fingers_keeps_its_yaw(replayed):
    recording, along = push(turn=0.0, slip=0.004, tip=HAND)
    hand = np.zeros((40, 3))
    hand[:, :2] = np.array([0.1 + HAND.radius, 0.2]) + recording.time[:, None] * (0.03, 0.0)
    gaps = recording.object_pose.copy()
    gaps[5:34] = np.nan  # one second, in which two fingers hold the object
    made = replayed(replace(recording, sensor_pose=hand, object_pose=gaps))
    assert (made.sensor_pose[REST:, 2] == 0.0).all()
    np.testing.assert_allclose(made.extra["pad_angle"][REST:], 0.0, atol=1e-9)
    np.testing.assert_allclose(made.extra["slip"][REST:], 0.004, atol=1e-9)
    g = planar.between(recording.object_pose, made.sensor_pose[REST:])
    np.testing.assert_allclose(g[:, 1], along, atol=1e-9)
    np.testing.assert_allclose(g[:, 0], -HALF + made.extra["indentation"][REST:], atol=1e-6)


def hand_push(**changes) -> Recording:
    """Return a push by two tips that keep their yaw, as `push` makes it of one."""
    recording, _ = push(turn=0.0, slip=0.004, tip=HAND)
    hand = np.zeros((40, 3))
    hand[:, :2] = np.array([0.1 + HAND.radius, 0.2]) + recording.time[:, None] * (0.03, 0.0)
    return replace(recording, **{"sensor_pose": hand, **changes})


def test_each_finger_of_a_hand_has_images_of_its_own(replayed):
    recording = hand_push()
    made = replayed(recording, "--fingers", "2", "--seed", "4")
    assert made.hand is not None and made.images is not None and made.contacts is not None
    assert dict(made.hand.mounts) == {"left": (0.0, 0.009, 0.0), "right": (0.0, -0.009, 0.0)}
    assert set(made.hand.fingers.values()) == {replace(DIGIT, rate=30.0)}
    np.testing.assert_array_equal(made.object_pose[REST:], recording.object_pose)
    depths = [made.extra[f"{name}/indentation"][REST:] for name in made.hand.fingers]
    assert np.ptp(depths, axis=0).max() > 1e-5 and np.min(depths) > 0.0
    # The hand moves as recorded, and on by what the gels give.
    on = planar.between(recording.sensor_pose, made.sensor_pose[REST:])
    np.testing.assert_allclose(on, np.column_stack((np.mean(depths, axis=0), np.zeros((40, 2)))), atol=1e-9)
    frames = list(made)
    for name, touches in made.contacts.items():
        assert touches.tolist() == [False] * REST + [True] * 40
        np.testing.assert_allclose(made.extra[f"{name}/pad_angle"][REST:], 0.0, atol=1e-9)
        np.testing.assert_allclose(made.extra[f"{name}/slip"][REST:], 0.004, atol=1e-9)
        images = np.array([frame.images[name] for frame in frames], dtype=float)
        change = np.maximum(np.abs(images - images[:15].mean(axis=0)) - 8.0, 0.0)  # more than noise
        assert change[REST + 4 :].sum(axis=(1, 2, 3)).min() > 10.0 * change[:REST].sum(axis=(1, 2, 3)).max()
    left, right = (frames[REST + 20].images[name].astype(float) for name in made.hand.fingers)
    assert np.abs(left - right).mean() > 1.0  # two units
    assert replayed(None, "--fingers", "2", "--seed", "4").file.read_bytes() == made.file.read_bytes()


@pytest.mark.parametrize(
    ("recording", "said"),
    [
        (push()[0], "a replay by 2 fingers needs a sensor of as many tips, 2 or 3; it has 1"),
        (
            hand_push(object_pose=hand_push().truth + np.array((0.0, 0.0, 0.2))),
            "frames 18 to 57 of the replay (0.60 to 1.90 s): the tips are",
        ),
    ],
)
def test_a_motion_whose_tips_do_not_share_a_side_is_refused(run_palpate, recording, said):
    write_recording(recording, "push.mcap")
    code, _, err = run_palpate("simulate", "out", "--replay", "push.mcap", "--fingers", "2")
    assert code in (2, 3) and "push.mcap: " in err and said in " ".join(err.split())


def test_rate_and_gaps_are_those_of_the_motion(replayed):
    fast, _ = push(121, rate=90.0, tip=replace(TIP, rate=90.0))
    there = np.ones(121, np.bool_)
    there[40:70] = False  # a third of a second without frames
    time, pose = fast.time[there], fast.object_pose[there]
    made = replayed(
        replace(fast, time=time, sensor_pose=fast.sensor_pose[there], object_pose=pose, contact=there[there])
    )
    assert made.sensor == replace(DIGIT, rate=90.0)
    rest = len(made) - len(time)
    np.testing.assert_allclose(made.time[rest:] - made.time[rest], time, atol=1e-9)
    np.testing.assert_array_equal(made.object_pose[rest:], pose)
    assert rest / 90.0 == pytest.approx(0.6)


def test_two_contacts_each_begin_near_the_apex(replayed):
    touched = np.ones(150, np.bool_)
    touched[60:95] = False
    made = replayed(push(150, turn=2.0, tip=replace(TIP, radius=0.015), contact=touched)[0])
    pad = made.extra["pad_angle"]
    assert np.isnan(pad[~made.contact]).all() and np.abs(pad[made.contact]).max() <= np.radians(20.0) + 1e-9
    assert np.abs(np.diff(made.sensor_pose[REST:, 2])).max() < 0.1  # no jump in between


SLOT = Polygon([(0, -0.05), (0.08, -0.05), (0.08, 0.05), (0, 0.05), (0, 0.01), (0.03, 0.01), (0.03, -0.01), (0, -0.01)])
"""A block with a slot, 20 mm wide and 30 mm deep, in which a tip fits and a gel does not."""
DROPPED = np.where((np.arange(40) // 10 == 1)[:, None], np.nan, np.asarray(push()[0].object_pose))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"object_pose": None}, "has no object poses"),
        ({"contact": np.zeros(40, np.bool_)}, "has no contact flags, or none that is set"),
        ({"object_pose": DROPPED}, "frames 10 to 19, in contact, have no known object pose: 0.37 s"),
        ({"turn": 1.0, "tip": replace(TIP, radius=0.06)}, "degrees from the middle of the gel"),
        (
            {"shape": SLOT, "sensor_pose": np.tile((0.03, 0.0, 0.0), (40, 1)), "object_pose": np.zeros((40, 3))},
            "frames 18 to 57 of the replay (0.60 to 1.90 s): the outline is hollow",
        ),
    ],
)
def test_a_motion_that_cannot_be_rendered_is_refused(run_palpate, changes, said):
    write_recording(push(**changes)[0], "push.mcap")
    code, _, err = run_palpate("simulate", "out", "--replay", "push.mcap")
    assert code == 3 and err.startswith("palpate: push.mcap: ") and said in " ".join(err.split())


def test_the_same_seed_gives_the_same_bytes(replayed):
    recording, _ = push(12)
    for name in ("push", "other"):
        write_recording(recording, f"{name}.mcap")
    given = [("push", 1), ("push", 1), ("push", 2), ("other", 1)]
    made = [replayed(None, "--seed", seed, name=name) for name, seed in given]
    a, b, c, d = (each.file.read_bytes() for each in made)
    assert a == b and len({a, c, d}) == 3
    assert replayed(None, "--unit", "7").source.endswith("images of unit 7")


def test_a_real_push_is_replayed_and_tracked(replayed, shared_data):
    name = "StraightLine_2016_10_23_StraightLineNoPerturbationsPlywoodNoLighting.json.gz"
    recording: Any = load_recording(shared_data / "mit_point_push" / name)
    made = replayed(recording)
    known = ~np.isnan(recording.object_pose[:, 0])
    np.testing.assert_array_equal(made.object_pose[REST:], recording.object_pose[known])
    assert made.sensor == DIGIT and made.contact.any()
