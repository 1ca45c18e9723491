"""Real motion with rendered touch, from motions that are known in closed form."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate import io as formats
from palpate.cli import main
from palpate.config import TrackerSettings
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Polygon, Rectangle
from palpate.io.recording_mcap import read_recording, write_recording
from palpate.lab.simulate.real_motion import real_contacts, real_motion
from palpate.lab.simulate.replay import replay_folder, replay_recording
from palpate.lab.simulate.unit import draw_unit
from palpate.pipeline.run import track
from palpate.touch.contact_detector import ContactDetector
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile

HALF = 0.045  # [m] of the square, whose edge x = -HALF is pushed
TIP = SensorProfile(name="tip", radius=0.005, rate=30.0)
HAND = SensorProfile(name="hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=30.0)
HEADING = 0.1  # [rad] of the tip, which does not turn
REST = 18  # frames, 0.6 s at 30 Hz


def push(frames=40, turn=0.3, slip=0.004, gap=0.0, tip=TIP, rate=30.0, **changes):
    """A tip moves at 30 mm/s along x while the object turns and slides over it.

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
    heading = np.full(frames, HEADING)
    apex = se2.compose(np.column_stack((center, heading)), np.array([tip.radius, 0.0, 0.0]))
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


def truth_of(recording) -> np.ndarray:
    """The object's poses (N, 3)."""
    assert recording.object_pose is not None
    return recording.object_pose


def touching(recording) -> np.ndarray:
    """The contact flags (N,)."""
    assert recording.contact is not None
    return recording.contact


def unit_of(replay):
    """The sensor unit that a replay's source names."""
    return draw_unit(DIGIT, int(replay.source.split("images of unit ")[1].split(";")[0]))


def gel_centers(replay, unit):
    """Centres of curvature of the gel in the object frame (N, 2)."""
    apex = se2.between(truth_of(replay), replay.sensor_pose)
    return se2.transform(apex, np.array([-unit.radius, 0.0]))


@pytest.mark.parametrize("gap", [0.0, 1.2e-3, -1.2e-3])
def test_the_gel_touches_where_the_tip_did(gap):
    recording, along = push(gap=gap)
    made = replay_recording(recording, seed=4)
    unit, depth = unit_of(made), made.extra["indentation"]
    center = gel_centers(made, unit)[REST:]
    # The edge is straight: the centre is R - d + gap from it, straight behind (-HALF, s).
    np.testing.assert_allclose(center[:, 0], -HALF - (unit.radius - depth[REST:] + gap), atol=1e-6)
    np.testing.assert_allclose(center[:, 1], along, atol=1e-6)
    surface = made.shape.signed_distance(center) - (unit.radius - depth[REST:] + gap)
    np.testing.assert_allclose(surface, 0.0, atol=1e-6)
    # Poses are as they were, and the real tip's are there.
    np.testing.assert_array_equal(truth_of(made)[REST:], truth_of(recording))
    np.testing.assert_array_equal(made.extra["real_sensor_pose"][REST:], recording.sensor_pose)
    assert np.isnan(made.extra["real_sensor_pose"][:REST]).all()


@pytest.mark.parametrize("slip", [0.0, 0.02, -0.02])
def test_the_gel_slides_and_rolls_as_the_tip_did(slip):
    recording, _ = push(slip=slip)
    made = replay_recording(recording, seed=4)
    unit = unit_of(made)
    np.testing.assert_allclose(
        made.extra["slip"][REST:], slip, atol=2e-5
    )  # chords for arcs: 0.5 x 10 mm x (0.23 rad/s)^2 / 30 Hz = 9e-6
    # Rolling by 0.3 rad moves the contact by 0.3 r over both surfaces: by 0.3 r / R as an angle of the gel.
    pad = made.extra["pad_angle"][REST:]
    np.testing.assert_allclose(pad - pad[0], TIP.radius / unit.radius * truth_of(recording)[:, 2], atol=1e-9)
    assert abs(pad[0]) <= np.radians(12.0)
    # The direction of the contact, seen in the sensor that was made.
    apex = se2.between(truth_of(made), made.sensor_pose)[REST:]
    np.testing.assert_allclose(se2.wrap(-apex[:, 2]), pad, atol=1e-9)  # the inward normal is the object's x
    # What slides over the gel itself, with the depth held: the same but for d / R of the rolling.
    steady = slice(REST + 4, -4)
    g = se2.between(truth_of(made), made.sensor_pose)[steady]
    touched = gel_centers(made, unit)[steady] + (unit.radius - made.extra["indentation"][steady, None]) * (1.0, 0.0)
    before = se2.transform(se2.compose(g[:-1], se2.inverse(g[1:])), touched[1:])
    rolling = TIP.radius * 0.3 / recording.time[-1]
    slid = (before - touched[1:])[:, 1] * 30.0
    np.testing.assert_allclose(slid, slip, atol=0.08 * rolling)
    assert 0.08 * rolling < 1e-4


def test_friction_follows_sliding():
    for slip in (0.02, -0.02):
        force = replay_recording(push(slip=slip)[0]).extra["tangential_force"][REST + 5 : -5]
        assert (np.sign(force) == np.sign(slip)).all()
        assert 0.2 < np.abs(force).max() < 4.2  # 0.25 x 2600 N/m x 0.36 mm to 0.6 x 6500 N/m x 1.1 mm
    assert np.abs(replay_recording(push(slip=0.0)[0]).extra["tangential_force"]).max() < 0.02


def test_a_run_that_begins_in_contact_is_preceded_by_rest():
    recording, _ = push()
    made = replay_recording(recording)
    assert len(made) == len(recording) + REST
    np.testing.assert_allclose(made.time[: REST + 1], np.arange(REST + 1) / 30.0, atol=1e-9)
    assert "0.6 s of rest added before" in made.source
    assert not touching(made)[:REST].any() and touching(made)[REST:].all()
    assert (truth_of(made)[:REST] == truth_of(recording)[0]).all()
    clear = made.shape.signed_distance(gel_centers(made, unit_of(made))[:REST]) - unit_of(made).radius
    assert clear[0] == pytest.approx(0.01, abs=1e-6)
    assert (clear > 0).all() and (np.diff(clear) < 0).all()
    assert (made.extra["indentation"][:REST] == 0).all() and (made.extra["indentation"][REST:] > 0).all()


def test_a_run_that_begins_untouched_stays_as_it_is():
    recording, _ = push(60)
    away = se2.compose(recording.sensor_pose, np.array([-0.02, 0.0, 0.0]))
    free = np.arange(60) < 20
    poses = np.where(free[:, None], away, recording.sensor_pose)
    still = np.where(free[:, None], truth_of(recording)[20], truth_of(recording))
    made = replay_recording(replace(recording, sensor_pose=poses, object_pose=still, contact=~free))
    assert len(made) == 60 and "rest" not in made.source
    np.testing.assert_array_equal(truth_of(made), still)


def test_images_show_the_contact():
    recording, _ = push()
    made = replay_recording(recording)
    images = [np.asarray(frame.image) for frame in made]
    detector = ContactDetector()
    assert [bool(detector.update(image)) for image in images] == touching(made).tolist()
    blank = np.mean(images[:15], axis=0)
    change = np.maximum(np.abs(images[REST + 20] - blank) - 8.0, 0.0).sum(axis=(0, 2))  # more than noise
    column = (change * np.arange(240)).sum() / change.sum()
    unit = unit_of(made)
    wanted = 119.5 + (unit.radius * np.sin(made.extra["pad_angle"][REST + 20]) - unit.offset[0]) / unit.pitch
    assert column == pytest.approx(wanted, abs=25.0)  # shadows draw it aside
    assert column < 119.5 - 15.0  # the contact is left of the middle


def test_short_unknown_truth_is_bridged_and_stays_unknown():
    recording, along = push(slip=0.0)
    truth = truth_of(recording).copy()
    truth[[10, 11], :] = np.nan
    truth[-3:] = np.nan
    with pytest.raises(
        SettingError, match=r"push\.json: frames 10 to 11, in contact, have no known object pose: 0\.13"
    ):
        replay_recording(replace(recording, object_pose=truth, time=recording.time * 1.3))
    truth[11] = truth_of(recording)[11]
    made = replay_recording(replace(recording, object_pose=truth))
    assert len(made) == REST + 40 - 3  # what ends unknown is left out
    assert np.flatnonzero(np.isnan(truth_of(made)[:, 0])).tolist() == [REST + 10]
    assert "1 frame bridged" in made.source
    # Turning evenly and sticking, the object goes as bridged.
    motion = real_motion(replace(recording, object_pose=truth), 30.0)
    np.testing.assert_allclose(motion.object_pose[REST + 10], truth_of(recording)[10], atol=5e-6)
    assert along[10] == pytest.approx(-0.01 + 0.005 * truth_of(recording)[10, 2])


def test_an_untouched_object_rests_where_it_is_seen_next():
    recording, _ = push(90)
    contact = np.ones(90, np.bool_)
    contact[40:60] = False
    truth = truth_of(recording).copy()
    truth[40:] = truth[39] + (truth_of(recording)[40:] - truth[39]) * (np.arange(40, 90) >= 60)[:, None]
    seen = truth.copy()
    seen[39:58] = np.nan
    motion = real_motion(replace(recording, object_pose=seen, contact=contact), 30.0)
    np.testing.assert_allclose(motion.object_pose[REST + 39 : REST + 58], np.repeat(truth[59:60], 19, axis=0))


def test_a_hand_of_two_fingers_keeps_its_yaw():
    recording, along = push(turn=0.0, slip=0.004, tip=HAND)
    hand = recording.sensor_pose.copy()
    hand[:, 2] = 0.0
    center = np.array([0.1, 0.2]) + recording.time[:, None] * (0.03, 0.0)
    hand[:, :2] = center
    hand[:, 0] += HAND.radius
    truth = truth_of(recording).copy()
    truth[5:34] = np.nan  # one second, in which two fingers hold the object
    made = replay_recording(replace(recording, sensor_pose=hand, object_pose=truth))
    assert (made.sensor_pose[REST:, 2] == 0.0).all()
    np.testing.assert_allclose(made.extra["pad_angle"][REST:], 0.0, atol=1e-9)
    np.testing.assert_allclose(made.extra["slip"][REST:], 0.004, atol=1e-9)
    g = se2.between(truth_of(recording), made.sensor_pose[REST:])
    np.testing.assert_allclose(g[:, 1], along, atol=1e-9)
    np.testing.assert_allclose(g[:, 0], -HALF + made.extra["indentation"][REST:], atol=1e-6)


def test_other_rates_become_the_sensors():
    fast, _ = push(121, rate=90.0)
    gone = np.ones(121, np.bool_)
    gone[40:70] = False  # a third of a second without frames
    fast = replace(
        fast,
        time=fast.time[gone],
        sensor_pose=fast.sensor_pose[gone],
        object_pose=truth_of(fast)[gone],
        contact=gone[gone],
    )
    motion = real_motion(fast, 30.0)
    step = np.diff(motion.time)
    assert np.isclose(step, 1 / 30).sum() == len(step) - 1
    assert step.max() == pytest.approx(70 / 90 - 39 / 90)
    same = np.isin(np.round(fast.time * 90), np.round((motion.time[REST:] - motion.time[REST]) * 90))
    np.testing.assert_allclose(motion.object_pose[REST:], truth_of(fast)[same], atol=1e-9)


def test_nothing_is_interpolated_where_frames_are_months_apart():
    slow, _ = push(3)
    motion = real_motion(replace(slow, time=np.array([0.0, 4e6, 8e6])), 30.0)
    assert len(motion.time) == REST + 3  # and not 240 million


def test_contacts_of_a_corner():
    # A tip of 5 mm at 4 + 3 mm off the corner (0.045, 0.045) touches it: 5 mm away, from direction (0.8, 0.6).
    pose = np.array([[0.045 + 0.004, 0.045 + 0.003, 0.0]])
    tip = replace(TIP, tips=((0.005, 0.0),))  # its centre is the origin of the sensor frame
    found = real_contacts(Rectangle(0.09, 0.09), tip, pose, np.zeros((1, 3)))
    np.testing.assert_allclose(found.point, [[0.045, 0.045]], atol=1e-9)
    np.testing.assert_allclose(found.normal, [[0.8, 0.6]], atol=1e-9)
    assert found.gap[0] == pytest.approx(0.0, abs=1e-12)
    assert found.angle[0] == pytest.approx(np.arctan2(-0.6, -0.8))


def test_two_contacts_each_begin_near_the_apex():
    recording, _ = push(150, turn=2.0, tip=replace(TIP, radius=0.015))
    contact = np.ones(150, np.bool_)
    contact[60:95] = False
    made = replay_recording(replace(recording, contact=contact))
    pad = made.extra["pad_angle"]
    assert np.isnan(pad[~touching(made)]).all()
    assert np.abs(pad[touching(made)]).max() <= np.radians(20.0) + 1e-9
    assert np.abs(np.diff(made.sensor_pose[REST:, 2])).max() < 0.1  # no jump in between


def notch():
    """A block with a slot, 20 mm wide and 30 mm deep, into which a tip fits and a gel does not."""
    return Polygon(
        [(0, -0.05), (0.08, -0.05), (0.08, 0.05), (0, 0.05), (0, 0.01), (0.03, 0.01), (0.03, -0.01), (0, -0.01)]
    )


def test_what_cannot_be_rendered_is_refused():
    recording, _ = push()
    unseen = np.full((40, 3), np.nan)
    for changes, said in (
        ({"object_pose": None}, "has no object poses"),
        ({"object_pose": unseen}, "has no object poses"),
        ({"contact": None}, "has no contact flags"),
        ({"contact": np.zeros(40, np.bool_)}, "has no contact flags, or none that is set"),
    ):
        with pytest.raises(SettingError, match=f"^push.json: {said}"):
            replay_recording(replace(recording, **changes))
    dropped = truth_of(recording).copy()
    dropped[10:20] = np.nan
    with pytest.raises(SettingError, match=r"frames 10 to 19, in contact, .*: 0\.37 s .*up to 0\.12 s can be bridged"):
        replay_recording(replace(recording, object_pose=dropped))
    flat = replace(TIP, radius=0.06)
    with pytest.raises(SettingError, match=r"push\.json: frames 18 to 57 of the replay .*degrees from the middle of"):
        replay_recording(push(turn=1.0, tip=flat)[0])
    in_slot = np.column_stack((np.full(40, 0.03), np.zeros(40), np.zeros(40)))
    with pytest.raises(
        SettingError, match=r"push\.json: frames 18 to 57 .*hollow.*does not reach where the tip touched"
    ):
        replay_recording(replace(recording, shape=notch(), sensor_pose=in_slot, object_pose=np.zeros((40, 3))))


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    recording, _ = push(12)
    first, again, other = (replay_recording(recording, seed=seed) for seed in (1, 1, 2))
    renamed = replay_recording(replace(recording, file=Path("other.json")), seed=1)
    for name, made in (("a", first), ("b", again), ("c", other), ("d", renamed)):
        write_recording(made, tmp_path / f"{name}.mcap")
    a, b, c, d = ((tmp_path / f"{name}.mcap").read_bytes() for name in "abcd")
    assert a == b
    assert len({a, c, d}) == 3
    fixed = replay_recording(recording, seed=1, unit=7)
    assert "images of unit 7;" in fixed.source
    recordings = {"x.mcap": recording, "y.mcap": replace(recording, file=Path("other.json"))}
    replay_folder(tmp_path / "two", recordings, seed=1, workers=2)
    assert (tmp_path / "two/x.mcap").read_bytes() == a
    assert (tmp_path / "two/y.mcap").read_bytes() == d


def palpate(*words):
    try:
        return main.main(["simulate", *words])
    except SystemExit as stop:
        return int(stop.code or 0)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """One recording that can be replayed, one that cannot, and one that is none."""
    monkeypatch.chdir(tmp_path)
    good, _ = push(12)
    write_recording(good, "good.mcap")
    write_recording(replace(good, contact=None), "mute.mcap")
    Path("words.json").write_text("no recording")


@pytest.mark.usefixtures("files")
def test_command_line(capsys):
    words = ("out", "--replay", "good.mcap", "--replay", "mute.mcap", "--replay", "words.json", "--seed", "3")
    assert palpate(*words, "--json") == 3
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert (found["made"], found["kept"]) == (["good.mcap"], [])
    assert sorted(failed["file"] for failed in found["failed"]) == ["mute.mcap", "words.mcap"]
    assert err.count("\n") == 2 and "palpate: mute.mcap: has no contact flags" in err and "palpate: words.json: " in err
    made = read_recording("out/good.mcap")
    assert (made.sensor, len(made)) == (DIGIT, REST + 12)
    assert made.source.startswith("motion of a push; touch rendered by palpate: seed 3, drawn images of unit ")
    assert made.frames["sensor_pose"].startswith("made: ") and made.frames["object_pose"].startswith("real: ")
    assert made.frames["image"].startswith("rendered")
    assert palpate("out", "--replay", "good.mcap", "--seed", "3", "--resume") == 0
    assert "0 made, 1 kept, 0 failed" in capsys.readouterr().out
    Path("out/good.mcap").write_bytes(Path("out/good.mcap").read_bytes()[:5000])
    assert palpate("out", "--replay", "good.mcap", "--seed", "3", "--resume") == 0
    assert "1 made, 0 kept, 0 failed" in capsys.readouterr().out


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--shape", "disc"), "--replay takes object and motion from its file; --shape cannot go with it"),
        (("--count", "3", "--seconds", "5"), "its file; --count, --seconds cannot go with it"),
        (("--no-images",), "--no-images cannot go with it"),
        (("--replay", "good.mcap"), "--replay good.mcap and --replay good.mcap would both be good.mcap"),
        (("--seed", "-1"), "seed is -1; allowed is 0 or more"),
        (("--unit", "-1"), "unit is -1; allowed is 0 or more"),
        (("--workers", "0"), "workers is 0; allowed is 1 or more"),
    ],
)
def test_bad_options_are_one_line(capsys, words, said):
    assert palpate("out", "--replay", "good.mcap", *words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and said in err
    assert not list(Path().glob("out/*"))


@pytest.mark.usefixtures("files")
def test_folders_are_spared(capsys):
    assert palpate("out", "--replay", "good.mcap") == 0
    assert palpate("out", "--replay", "good.mcap") == 2
    assert palpate("out", "--replay", "good.mcap", "--seed", "1", "--resume") == 2
    assert palpate("good.mcap", "--replay", "good.mcap") == 2
    _, err = capsys.readouterr()
    again, other, file = err.splitlines()
    assert "holds 1 recordings already; --resume" in again
    assert "out/good.mcap: was made with other options" in other
    assert "good.mcap: cannot be a folder of recordings" in file


def test_a_real_push_is_replayed_and_felt(shared_data):
    name = "StraightLine_2016_10_23_StraightLineNoPerturbationsPlywoodNoLighting.json.gz"
    recording = formats.load_recording(shared_data / "mit_point_push" / name)
    made = replay_recording(recording)
    known = ~np.isnan(truth_of(recording)[:, 0])
    np.testing.assert_array_equal(truth_of(made)[REST:], truth_of(recording)[known])
    run = track(made, TrackerSettings("learnt"))
    assert run.summary["final_translation_error_mm"] < 6.0
    assert run.summary["final_rotation_error_deg"] < 3.0


def test_real_runs_that_drop_out_are_refused(shared_data):
    refused = 0
    for path in sorted((shared_data / "mit_point_push").glob("*.json.gz")):
        recording = formats.load_recording(path)
        try:
            motion = real_motion(recording, DIGIT.rate)
        except SettingError as error:
            assert str(error).startswith(f"{path}: frames ")
            refused += 1
        else:
            assert motion.known[REST:].mean() > 0.95
    assert refused == 5
    for path in sorted((shared_data / "cmu_two_finger").glob("*.txt")):
        motion = real_motion(formats.load_recording(path), DIGIT.rate)
        assert motion.contact.any() and motion.known[motion.contact].mean() > 0.75
