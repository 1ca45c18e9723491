"""Each fault on sixty frames, and scores of runs with faults, worked out by hand."""

import csv
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed, seen

from palpate import DIGIT, Disc, Estimate, Frame, FrameError, Polygon, Rectangle, Shape, TrackerSettings
from palpate.geometry import se2
from palpate.lab.study import fault_bench
from palpate.lab.study.fault_bench import FaultRun, rows_of, run_stream, write_table
from palpate.lab.study.faults import CLEAN, FAULTS, PUSHED_ASIDE, Stream, applies, stream_of, with_fault

TOUCHING = np.zeros(60, np.bool_)
TOUCHING[4:10] = TOUCHING[20:50] = True
"""Two contacts; faults in contact begin at frame 29, in the longer one, and the longer rest before one is 10 to 19."""


@pytest.fixture
def stream() -> Stream:
    """Sixty frames, 0.1 s apart; image and the sensor's x hold their number, the object stands at (1, 0)."""
    number: Any = np.arange(60.0)
    poses = np.column_stack([1e-3 * number, 0.0 * number, 0.0 * number])
    truth = np.tile([1.0, 0.0, 0.0], (60, 1))
    images = [np.full((8, 6, 3), (k, 100 + k, 200), np.uint8) for k in range(60)]
    return Stream(number / 10, number / 10, poses, truth, TOUCHING, images, Disc(0.1), DIGIT, truth[0])


@pytest.fixture
def faulty(stream) -> Any:
    return lambda fault, **changes: with_fault(replace(stream, **changes), fault, np.random.default_rng(5))


def numbers(of: Stream) -> list[int]:
    return np.rint(1e3 * of.sensor_pose[:, 0]).astype(int).tolist()


def shown(of: Stream, channel: int = 0) -> list[int]:
    return [int(image[0, 0, channel]) for image in of.images]


def test_a_fault_is_the_same_for_the_same_seed_and_leaves_the_stream_alone(stream, faulty):
    before = stream.sensor_pose.copy(), stream.truth.copy(), stream.time.copy(), shown(stream)
    for name in FAULTS:
        if not applies(name, stream):
            continue
        one, other = faulty(name), faulty(name)
        assert np.array_equal(one.sensor_pose, other.sensor_pose, equal_nan=True), name
        assert np.array_equal(one.time, other.time) and shown(one) == shown(other), name
        assert len(one) == len(one.arrival) == len(one.frames()) and (np.diff(one.arrival) >= 0.0).all(), name
    after = stream.sensor_pose, stream.truth, stream.time, shown(stream)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_frames_are_lost_repeated_and_exchanged(faulty):
    dropped = numbers(faulty("frames dropped, 50 %"))
    assert dropped[0] == 0 and 20 < len(dropped) < 40 and (np.diff(dropped) > 0).all()
    lost = faulty("frames lost for 1 s")
    assert numbers(lost) == [*range(29), *range(39, 60)] and lost.begin == pytest.approx(3.9)
    count = np.bincount(numbers(faulty("frames repeated, 10 %")))
    assert set(count) == {1, 2} and np.count_nonzero(count == 2) < 15
    assert numbers(faulty("every third frame only")) == list(range(0, 60, 3))
    exchanged = numbers(faulty("frames exchanged, 10 %"))
    assert sorted(exchanged) == list(range(60)) and exchanged[0] == 0
    assert np.abs(np.array(exchanged) - np.arange(60)).max() == 1


def test_stamps_leap_and_change_their_unit(stream, faulty):
    once = faulty("one stamp +1000 s")
    assert np.flatnonzero(once.time > 100).tolist() == [29] and once.begin == pytest.approx(2.9)
    assert np.flatnonzero(faulty("stamps +1000 s for good").time > 100).tolist() == list(range(29, 60))
    assert faulty("stamps in ns").time[1] == pytest.approx(1e8)
    assert faulty("stamps in ns from a contact on").time[[28, 29]] == pytest.approx([2.8, 2.9e9])
    assert np.std(faulty("stamps jitter, 20 ms").time - stream.time) == pytest.approx(0.02, rel=0.3)


def test_poses_are_lost_frozen_and_off(stream, faulty):
    lost = faulty("pose NaN for 1 s")
    assert np.flatnonzero(np.isnan(lost.sensor_pose).all(axis=1)).tolist() == list(range(29, 39))
    assert numbers(faulty("pose frozen for 1 s")) == [*range(30), *[29] * 9, *range(39, 60)]
    assert numbers(faulty("pose frozen for good")) == [*range(30), *[29] * 30]
    off = faulty("pose off by 20 mm 10 times").sensor_pose - stream.sensor_pose
    far = np.hypot(off[:, 0], off[:, 1])
    assert far[29] == pytest.approx(0.02) and np.count_nonzero(far) == 10 and not far[~TOUCHING].any()
    shifted, turned = (
        se2.between(stream.sensor_pose, faulty(f"extrinsics off {by}").sensor_pose) for by in ("1 mm", "2 deg")
    )
    assert np.hypot(shifted[:, 0], shifted[:, 1]) == pytest.approx(1e-3) and not shifted[:, 2].any()
    assert np.degrees(np.abs(turned[:, 2])) == pytest.approx(2.0) and not turned[:, :2].any()
    noisy = faulty("pose noise 2 mm, 1 deg").sensor_pose - stream.sensor_pose
    assert noisy.std(axis=0) == pytest.approx((2e-3, 2e-3, np.radians(1.0)), rel=0.3)


def test_an_object_that_is_moved_untouched_is_met_at_its_new_place(stream, faulty):
    moved = faulty("moved untouched, 20 mm")
    way = moved.truth[:, :2] - (1.0, 0.0)
    assert np.hypot(*way.T) == pytest.approx([0.0] * 14 + [0.02] * 46)
    met, before = se2.between(moved.truth, moved.sensor_pose), se2.between(stream.truth, stream.sensor_pose)
    assert met[20:] == pytest.approx(before[20:])
    assert numbers(moved)[:11] == list(range(11)) and moved.begin == pytest.approx(2.0)


def test_a_second_pusher_is_a_fault_of_its_own(stream, faulty):
    assert applies(CLEAN, stream) and not applies(PUSHED_ASIDE, stream)
    shoved = replace(stream, shoved=(0, 5, 6))
    assert applies(PUSHED_ASIDE, shoved) and not applies(CLEAN, shoved)
    assert faulty(PUSHED_ASIDE, shoved=(0, 5, 6)).begin == stream.arrival[5]
    untouched = replace(stream, shoved=(0,))
    assert not applies(PUSHED_ASIDE, untouched) and not applies(CLEAN, untouched)
    assert stream_of(replace(seen(pushed(20)), extra={"knocked": np.eye(20)[7]})).shoved == (7,)


def test_images_are_late_frozen_flat_and_others(faulty):
    assert shown(faulty("image late by 2 frames")) == [0, 0, *range(58)]
    assert shown(faulty("image frozen for good")) == [*range(30), *[29] * 30]
    assert shown(faulty("image saturated for 1 s")) == [*range(29), *[255] * 10, *range(39, 60)]
    assert faulty("red and blue exchanged").images[3][0, 0].tolist() == [200, 103, 3]
    assert faulty("turned by 90 degrees").images[0].shape == (6, 8, 3)
    pixels = np.random.default_rng(0).integers(0, 256, (8, 6, 3), np.uint8)
    assert np.array_equal(faulty("mirrored", images=[pixels] * 60).images[5], pixels[:, ::-1])
    assert shown(faulty("false contact of 10 frames")) == [*range(14), *range(29, 34), *range(19, 60)]
    assert shown(faulty("missed contact of 10 frames")) == [*range(29), *[10] * 10, *range(39, 60)]
    others = np.array(shown(faulty("outlier images, 30 %")))
    assert TOUCHING[others[TOUCHING]].all() and (others[~TOUCHING] == np.flatnonzero(~TOUCHING)).all()
    assert 3 < np.count_nonzero(others != np.arange(60)) < 18


def test_light_and_gel_change(stream, faulty):
    drifted = shown(faulty("light drifts -20 %"), 2)
    assert (drifted[0], drifted[-1]) == (200, 160)
    assert shown(faulty("light steps +40 %"), 2) == [200] * 29 + [255] * 31
    out = faulty("one light out").images[-1][0, 0] / stream.images[-1][0, 0]
    assert sorted(np.round(out, 1).tolist()) == [0.1, 1.0, 1.0]
    unit = faulty("turned by 180 degrees, calibrated").calibration
    assert unit is not None and unit.background.mean[0, 0].tolist() == [1.5, 101.5, 200.0]


@pytest.mark.parametrize(
    ("shape", "larger"),
    [
        (Disc(0.1), Disc(0.102)),
        (Rectangle(0.1, 0.2), Rectangle(0.102, 0.204)),
        (Polygon([(0, 0), (0.1, 0), (0, 0.1)]), Polygon([(0, 0), (0.102, 0), (0, 0.102)])),
    ],
)
def test_prior_knowledge_is_off(stream, faulty, shape, larger):
    wrong: Any = faulty("outline +2 %", shape=shape)
    assert wrong.shape.outline() == pytest.approx(larger.outline())
    assert wrong.begin == stream.arrival[4]  # nothing shows before the first contact
    assert np.hypot(*(faulty("first pose off 10 mm").first_pose - stream.first_pose)[:2]) == pytest.approx(0.01)
    assert abs(np.degrees(faulty("first pose off 5 deg").first_pose[2])) == pytest.approx(5.0)


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
        count = len(script)
        time: Any = 0.5 * np.arange(count)
        poses, contact = np.zeros((count, 3)), np.ones(count, np.bool_)
        images = [np.zeros((8, 6, 3), np.uint8)] * count
        stream = Stream(time, time, poses, poses, contact, images, shape or Disc(0.1), DIGIT, poses[0], begin=begin)
        return run_stream(stream, TrackerSettings())

    return run


def test_a_run_is_silently_wrong_while_it_is_far_off_with_a_good_status(scored):
    run = scored([(0.0, "tracking"), *[(0.011, "tracking")] * 3, (0.011, "strained"), (0.002, "tracking")])
    assert (run.silent_s, run.noticed_after, run.final_mm) == (1.5, 2.0, pytest.approx(2.0))
    assert run.inside_share == pytest.approx(2 / 6)  # 2 mm are 2 standard deviations
    assert scored([(0.009, "tracking")] * 4).silent_s == 0.0
    since = scored([(0.02, "strained"), (0.02, "tracking"), (0.0, "tracking"), (0.0, "uncertain")], 1.0)
    assert (since.silent_s, since.noticed_after, since.inside_share) == (0.0, 0.5, 1.0)  # only since the fault


def test_the_yaw_of_a_disc_does_not_count(scored):
    script = [(0.001, "tracking", 1.0)] * 4
    disc, other = scored(script), scored(script, shape=Rectangle(0.1, 0.05))
    assert (disc.silent_s, disc.inside_share, disc.final_deg) == (0.0, 1.0, 0.0)
    assert (other.silent_s, other.inside_share, other.final_deg) == (1.5, 0.0, pytest.approx(np.degrees(1.0)))


def test_a_refusal_is_a_notice_and_another_error_an_exception(scored):
    run = scored([(0.0, "tracking"), FrameError("too bright"), (0.001, "tracking")])
    assert (run.refused, run.exception, run.noticed_after) == (1, "", 0.5)
    assert scored([(0.0, "tracking"), ValueError("oh"), (0.0, "tracking")]).exception == "ValueError: oh"


def test_a_row_is_the_median_of_its_runs(tmp_path):
    def made(fault: str, final_mm: float, silent_s: float = 0.0, noticed_after: float = np.nan) -> FaultRun:
        return FaultRun(fault, "r", 30, 3, "", 0.06, noticed_after, final_mm, 1.0, 0.9, silent_s)

    runs = [*(made("none", mm) for mm in (1.0, 2.0, 9.0)), made("x", 3.0, 1.1, 0.5), made("x", 5.0, 0.9, 1.5)]
    clean, row = rows_of(runs)
    assert [clean[key] for key in ("final_mm", "worst_mm", "times_clean", "told_percent")] == [2.0, 9.0, 1.0, 0.0]
    assert [row[key] for key in ("final_mm", "times_clean", "silent_percent", "told_percent")] == [4.0, 2.0, 50.0, 50.0]
    shares = [row[key] for key in ("inside_percent", "refused_percent", "step_ms")]
    assert shares == pytest.approx([90.0, 10.0, 2.0])
    write_table(tmp_path, runs)
    (_, written) = csv.DictReader((tmp_path / "faults.csv").read_text().splitlines())
    assert (written["fault"], written["final_mm"], written["runs"]) == ("x", "4", "2")
    assert len((tmp_path / "fault_runs.csv").read_text().splitlines()) == 6
