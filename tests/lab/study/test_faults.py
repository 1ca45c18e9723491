"""Each fault on twelve frames, and scores of runs with faults, worked out by hand."""

import csv
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate import DIGIT, Disc, Estimate, Frame, FrameError, Polygon, Rectangle, Shape, TrackerSettings
from palpate.geometry import se2
from palpate.lab.study import fault_bench, faults
from palpate.lab.study.fault_bench import FaultRun, rows_of, run_stream, write_table
from palpate.lab.study.faults import CLEAN, FAULTS, PUSHED_ASIDE, Stream, applies, stream_of

TOUCHING = np.array([0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1], np.bool_)
"""Two contacts; faults in contact begin at frame 9, in the longer one, and the longer rest before one is 4 to 7."""


@pytest.fixture
def stream() -> Stream:
    """Twelve frames, 0.1 s apart; image and the sensor's x hold their number, the object stands at (1, 0)."""
    frames = tuple(
        Frame(
            time=number / 10,
            sensor_pose=np.array([number * 1e-3, 0.0, 0.0]),
            image=np.full((8, 6, 3), (number, 100 + number, 200), np.uint8),
            contact=bool(touched),
            object_pose=np.array([1.0, 0.0, 0.0]),
        )
        for number, touched in enumerate(TOUCHING)
    )
    return Stream(frames, np.arange(12) / 10, Disc(0.1), DIGIT, np.array([1.0, 0.0, 0.0]))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def numbers(of: Stream) -> list[int]:
    """Return the number in each frame's pose."""
    return np.rint(1e3 * of.poses[:, 0]).astype(int).tolist()


def shown(of: Stream) -> list[int]:
    """Return the number in each frame's image."""
    return [int(image(frame)[0, 0, 0]) for frame in of.frames]


def image(frame: Frame) -> Any:
    return frame.image


def test_a_fault_is_the_same_for_the_same_seed_and_leaves_the_stream_alone(stream):
    long = stream.of(np.repeat(np.arange(12), 4))
    before = (long.poses.copy(), long.times.copy(), shown(long))
    for name, fault in FAULTS.items():
        if not applies(name, long):
            continue
        one, other = (fault(long, np.random.default_rng(3)) for _ in range(2))
        assert np.array_equal(one.poses, other.poses, equal_nan=True), name
        assert np.array_equal(one.times, other.times) and shown(one) == shown(other), name
        assert len(one) == len(one.arrival) and (np.diff(one.arrival) >= 0.0).all(), name
    assert np.array_equal(before[0], long.poses) and np.array_equal(before[1], long.times)
    assert before[2] == shown(long)


def test_frames_are_lost_repeated_and_exchanged(stream, rng):
    assert numbers(faults.dropped(stream, rng, 1.0)) == [0]
    assert numbers(faults.dropped(stream, rng, 0.0)) == list(range(12))
    lost = faults.burst(stream, rng, 0.2)
    assert numbers(lost) == [*range(9), 11] and lost.begin == pytest.approx(1.1)
    assert numbers(faults.repeated(stream, rng, 1.0)) == [number for number in range(12) for _ in range(2)]
    assert numbers(faults.slower(stream, rng, 3)) == [0, 3, 6, 9]
    exchanged = numbers(faults.exchanged(stream, np.random.default_rng(5), 0.3))
    assert sorted(exchanged) == list(range(12)) and exchanged[0] == 0
    assert np.abs(np.array(exchanged) - np.arange(12)).max() == 1


def test_stamps_leap_and_change_their_unit(stream, rng):
    once = faults.leapt(stream, rng, 1000.0, for_good=False)
    assert np.flatnonzero(once.times > 100).tolist() == [9] and once.begin == pytest.approx(0.9)
    assert np.flatnonzero(faults.leapt(stream, rng, 1000.0, for_good=True).times > 100).tolist() == [9, 10, 11]
    assert faults.nanoseconds(stream, rng, late=False).times[1] == pytest.approx(1e8)
    assert faults.nanoseconds(stream, rng, late=True).times[[8, 9]] == pytest.approx([0.8, 9e8])
    assert np.std(faults.jittered(stream, rng, 0.01).times - stream.times) == pytest.approx(0.01, rel=0.5)


def test_poses_are_lost_frozen_and_off(stream, rng):
    lost = faults.pose_lost(stream, rng, 0.2)
    assert np.flatnonzero(np.isnan(lost.poses).all(axis=1)).tolist() == [9, 10]
    assert numbers(faults.pose_frozen(stream, rng, 0.2)) == [*range(10), 9, 11]
    assert numbers(faults.pose_frozen(stream, rng, np.inf)) == [*range(10), 9, 9]
    off = faults.pose_spikes(stream, rng, 0.02, count=2).poses - stream.poses
    far = np.hypot(off[:, 0], off[:, 1])
    assert far[9] == pytest.approx(0.02) and np.count_nonzero(far) == 2
    beside = se2.between(stream.poses, faults.misplaced(stream, rng, 1e-3, 2.0).poses)
    assert np.hypot(beside[:, 0], beside[:, 1]) == pytest.approx(1e-3)
    assert np.degrees(np.abs(beside[:, 2])) == pytest.approx(2.0)
    noisy = faults.pose_noise(stream, rng, 1e-3, 1.0).poses - stream.poses
    assert noisy.std(axis=0) == pytest.approx((1e-3, 1e-3, np.radians(1.0)), rel=0.5)


def test_an_object_that_is_moved_untouched_is_met_at_its_new_place(stream, rng):
    moved = faults.moved_untouched(stream, rng, 0.02, 0.0)
    way = np.array([frame.object_pose for frame in moved.frames])[:, :2] - (1.0, 0.0)
    assert np.hypot(*way.T) == pytest.approx([0.0] * 5 + [0.02] * 7)
    for before, after in zip(stream.frames[8:], moved.frames[8:], strict=True):
        met, was = (se2.between(np.asarray(each.object_pose), each.sensor_pose) for each in (after, before))
        assert met == pytest.approx(was)
    assert numbers(moved)[:5] == list(range(5)) and moved.begin == pytest.approx(0.8)


def test_a_second_pusher_is_a_fault_of_its_own(stream, rng):
    assert applies(CLEAN, stream) and not applies(PUSHED_ASIDE, stream)
    shoved = replace(stream, shoved=(0, 2, 3))
    assert applies(PUSHED_ASIDE, shoved) and not applies(CLEAN, shoved)
    assert FAULTS[PUSHED_ASIDE](shoved, rng).begin == shoved.arrival[2]
    untouched = replace(stream, shoved=(0,))
    assert not applies(PUSHED_ASIDE, untouched) and not applies(CLEAN, untouched)
    assert stream_of(replace(pushed(20), extra={"knocked": np.eye(20)[7]})).shoved == (7,)


def test_images_are_late_frozen_flat_and_others(stream, rng):
    assert shown(faults.images_late(stream, rng, 2)) == [0, 0, *range(10)]
    assert shown(faults.image_frozen(stream, rng, np.inf)) == [*range(10), 9, 9]
    assert shown(faults.image_flat(stream, rng, 255, 0.2)) == [*range(9), 255, 255, 11]
    assert image(faults.red_blue_exchanged(stream, rng).frames[3])[0, 0].tolist() == [200, 103, 3]
    assert image(faults.turned(stream, rng, 1).frames[0]).shape == (6, 8, 3)
    pixels = rng.integers(0, 256, (8, 6, 3), np.uint8)
    mirrored = faults.mirrored(stream.with_each("image", [pixels] * 12), rng)
    assert np.array_equal(image(mirrored.frames[5]), pixels[:, ::-1])
    assert shown(faults.false_contact(stream, rng, 2)) == [0, 1, 2, 3, 4, 9, 10, 7, 8, 9, 10, 11]
    assert shown(faults.missed_contact(stream, rng, 2)) == [*range(9), 4, 4, 11]
    others = np.array(shown(faults.outliers(stream, rng, 1.0)))
    assert TOUCHING[others[TOUCHING]].all() and others[~TOUCHING].tolist() == [0, 1, 4, 5, 6, 7]


def test_light_and_gel_change(stream, rng):
    drifted = faults.light_drift(stream, rng, -0.2)
    assert [int(image(frame)[0, 0, 2]) for frame in (drifted.frames[0], drifted.frames[-1])] == [200, 160]
    stepped = faults.light_step(stream, rng, 0.4)
    assert [int(image(frame)[0, 0, 2]) for frame in stepped.frames] == [200] * 9 + [255] * 3
    out = image(faults.light_out(stream, rng).frames[-1])[0, 0] / image(stream.frames[-1])[0, 0]
    assert sorted(np.round(out, 1).tolist()) == [0.1, 1.0, 1.0]
    worn = faults.wear(stream, rng, 14.0)
    assert np.abs(image(worn.frames[-1]).astype(int) - image(stream.frames[-1])).max() == 14
    assert np.array_equal(image(worn.frames[0]), image(stream.frames[0]))
    scratched = image(faults.scratch(stream, rng).frames[-1]).astype(int) - image(stream.frames[-1])
    assert scratched[..., 2].min() == -60 and (scratched[..., 2] == 0).any()
    unit = faults.calibrated(stream, rng).calibration
    assert unit is not None and unit.background.mean[0, 0].tolist() == [0.5, 100.5, 200.0]


@pytest.mark.parametrize(
    ("shape", "larger"),
    [
        (Disc(0.1), Disc(0.102)),
        (Rectangle(0.1, 0.2), Rectangle(0.102, 0.204)),
        (Polygon([(0, 0), (0.1, 0), (0, 0.1)]), Polygon([(0, 0), (0.102, 0), (0, 0.102)])),
    ],
)
def test_prior_knowledge_is_off(stream, rng, shape, larger):
    wrong: Any = faults.outline_off(replace(stream, shape=shape), rng, 0.02)
    assert wrong.shape.outline() == pytest.approx(larger.outline())
    assert wrong.begin == stream.arrival[2]  # nothing shows before the first contact
    first = faults.first_pose_off(stream, rng, 0.01, 5.0).first_pose - stream.first_pose
    assert np.hypot(*first[:2]) == pytest.approx(0.01) and abs(np.degrees(first[2])) == pytest.approx(5.0)


# Scores


class Scripted:
    """A tracker that answers as a test says: error [m], status and yaw, or an error to raise."""

    script: list[Any]

    def __init__(self, *_: Any, **__: Any) -> None:
        self._next = iter(self.script)

    def update(self, frame: Frame) -> Estimate:
        answer = next(self._next)
        if isinstance(answer, Exception):
            raise answer
        error, status, *yaw = answer
        return Estimate(frame.time, np.array([error, 0.0, *(yaw or [0.0])]), 1e-6 * np.eye(3), True, status)


@pytest.fixture
def scored(monkeypatch):
    """Track frames half a second apart, all in contact, with the object at the origin."""

    def run(script: list[Any], begin: float = 0.0, shape: Shape | None = None) -> FaultRun:
        monkeypatch.setattr(fault_bench, "Tracker", Scripted)
        monkeypatch.setattr(Scripted, "script", script, raising=False)
        frames = tuple(Frame(0.5 * n, np.zeros(3), contact=True, object_pose=np.zeros(3)) for n in range(len(script)))
        arrival = np.array([frame.time for frame in frames])
        return run_stream(
            Stream(frames, arrival, shape or Disc(0.1), DIGIT, np.zeros(3), begin=begin), TrackerSettings()
        )

    return run


def test_a_run_is_silently_wrong_while_it_is_far_off_with_a_good_status(scored):
    run = scored([(0.0, "tracking"), *[(0.011, "tracking")] * 3, (0.011, "strained"), (0.002, "tracking")])
    assert (run.silent_s, run.noticed_after, run.final_mm) == (1.5, 2.0, pytest.approx(2.0))
    assert run.inside_share == pytest.approx(2 / 6)  # 2 mm are 2 standard deviations
    assert scored([(0.009, "tracking")] * 4).silent_s == 0.0


def test_the_yaw_of_a_disc_does_not_count(scored):
    script = [(0.001, "tracking", 1.0)] * 4
    disc, other = scored(script), scored(script, shape=Rectangle(0.1, 0.05))
    assert (disc.silent_s, disc.inside_share, disc.final_deg) == (0.0, 1.0, 0.0)
    assert (other.silent_s, other.inside_share, other.final_deg) == (1.5, 0.0, pytest.approx(np.degrees(1.0)))


def test_only_frames_since_the_fault_count(scored):
    run = scored([(0.02, "strained"), (0.02, "tracking"), (0.0, "tracking"), (0.0, "uncertain")], 1.0)
    assert (run.silent_s, run.noticed_after, run.inside_share) == (0.0, 0.5, 1.0)


def test_a_refusal_is_a_notice_and_another_error_an_exception(scored):
    run = scored([(0.0, "tracking"), FrameError("too bright"), (0.001, "tracking")])
    assert (run.refused, run.first_refusal, run.exception, run.noticed_after) == (1, "too bright", "", 0.5)
    assert scored([(0.0, "tracking"), ValueError("oh"), (0.0, "tracking")]).exception == "ValueError: oh"


def test_a_row_is_the_median_of_its_runs(tmp_path):
    def made(fault: str, final_mm: float, silent_s: float = 0.0, noticed_after: float = np.nan) -> FaultRun:
        return FaultRun(fault, "r", final_mm, 1.0, 0.9, noticed_after, silent_s, 3, "", "", 30, 0.06)

    runs = [*(made("none", mm) for mm in (1.0, 2.0, 9.0)), made("x", 3.0, 1.1, 0.5), made("x", 5.0, 0.9, 1.5)]
    clean, row = rows_of(runs)
    assert (clean.final_mm, clean.worst_mm, clean.times_clean, clean.told_percent) == (2.0, 9.0, 1.0, 0.0)
    assert (row.final_mm, row.times_clean, row.silent_percent, row.told_percent) == (4.0, 2.0, 50.0, 50.0)
    assert (row.inside_percent, row.refused_percent, row.step_ms) == pytest.approx((90.0, 10.0, 2.0))
    write_table(tmp_path, runs)
    (_, written) = csv.DictReader((tmp_path / "faults.csv").read_text().splitlines())
    assert (written["fault"], written["final_mm"], written["runs"]) == ("x", "4", "2")
    assert len((tmp_path / "fault_runs.csv").read_text().splitlines()) == 6
