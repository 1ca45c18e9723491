"""Each fault on twelve frames, with what comes out worked out by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Polygon, Rectangle
from palpate.lab.study.faults import images, poses, timing, told
from palpate.lab.study.faults.faults import CLEAN, FAULTS, PUSHED_ASIDE, is_of
from palpate.lab.study.faults.stream import Stream, stream_of
from palpate.types.frame import Frame
from palpate.types.sensor import DIGIT

TOUCHING = np.array([0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1], np.bool_)
"""Two contacts; the longer one is faulty from its frame 9 on, and the longer rest before one is 4 to 7."""
SECOND, REST = 9, (4, 7)


def stream() -> Stream:
    """Twelve frames, a tenth of a second apart; image and sensor's x tell their number, the object stands at 1, 0."""
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


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def numbers(of: Stream) -> list[int]:
    """The number that each frame's pose tells."""
    return np.rint(1e3 * of.poses[:, 0]).astype(int).tolist()


def shown(of: Stream) -> list[int]:
    """The number that each frame's image tells."""
    return [int(image(frame)[0, 0, 0]) for frame in of.frames]


def image(frame: Frame) -> Any:
    assert frame.image is not None
    return frame.image


def test_a_fault_is_the_same_for_the_same_seed_and_leaves_the_stream_alone():
    long = stream().of(np.repeat(np.arange(12), 4))  # nothing is chosen that is not there
    before = (long.poses.copy(), long.times.copy(), shown(long))
    for name, fault in FAULTS.items():
        if not is_of(name, long):
            continue
        one, other = (fault(long, np.random.default_rng(3)) for _ in range(2))
        assert np.array_equal(one.poses, other.poses, equal_nan=True), name
        assert np.array_equal(one.times, other.times), name
        assert shown(one) == shown(other), name
        assert len(one) == len(one.arrival) and (np.diff(one.arrival) >= 0.0).all(), name
    assert np.array_equal(before[0], long.poses) and np.array_equal(before[1], long.times)
    assert before[2] == shown(long)


def test_frames_are_lost_repeated_and_exchanged():
    assert numbers(timing.dropped(stream(), rng(), 1.0)) == [0]
    assert numbers(timing.dropped(stream(), rng(), 0.0)) == list(range(12))
    lost = timing.burst(stream(), rng(), 0.2)
    assert numbers(lost) == [*range(9), 11]
    assert lost.begin == pytest.approx(1.1)
    assert numbers(timing.repeated(stream(), rng(), 1.0)) == [number for number in range(12) for _ in range(2)]
    assert numbers(timing.slower(stream(), rng(), 3)) == [0, 3, 6, 9]
    exchanged = timing.exchanged(stream(), rng(), 0.3)
    assert sorted(numbers(exchanged)) == list(range(12)) and numbers(exchanged) != list(range(12))
    assert numbers(exchanged)[0] == 0 and np.abs(np.array(numbers(exchanged)) - np.arange(12)).max() == 1


def test_stamps_leap_and_change_their_unit():
    once = timing.leapt(stream(), rng(), 1000.0, for_good=False)
    assert np.flatnonzero(once.times > 100).tolist() == [SECOND] and once.times[SECOND] == pytest.approx(1000.9)
    assert once.begin == pytest.approx(0.9)
    assert np.flatnonzero(timing.leapt(stream(), rng(), 1000.0, for_good=True).times > 100).tolist() == [9, 10, 11]
    assert timing.nanoseconds(stream(), rng(), late=False).times[1] == pytest.approx(1e8)
    assert timing.nanoseconds(stream(), rng(), late=True).times[SECOND] == pytest.approx(9e8)
    assert np.std(timing.jittered(stream(), rng(), 0.01).times - stream().times) == pytest.approx(0.01, rel=0.5)


def test_poses_are_lost_frozen_and_off():
    lost = poses.not_numbers(stream(), rng(), 0.2)
    assert np.flatnonzero(np.isnan(lost.poses).all(axis=1)).tolist() == [9, 10]
    assert numbers(poses.frozen(stream(), rng(), 0.2)) == [*range(10), 9, 11]
    assert numbers(poses.frozen(stream(), rng(), np.inf)) == [*range(10), 9, 9]
    off = poses.spike(stream(), rng(), 0.02, count=2).poses - stream().poses
    far = np.hypot(off[:, 0], off[:, 1])
    assert far[SECOND] == pytest.approx(0.02) and np.count_nonzero(far) == 2
    beside = se2.between(stream().poses, poses.misplaced(stream(), rng(), 1e-3, 2.0).poses)
    assert np.hypot(beside[:, 0], beside[:, 1]) == pytest.approx(1e-3)
    assert np.degrees(np.abs(beside[:, 2])) == pytest.approx(2.0)
    noisy = poses.noisy(stream(), rng(), 1e-3, 1.0).poses - stream().poses
    assert noisy.std(axis=0) == pytest.approx((1e-3, 1e-3, np.radians(1.0)), rel=0.5)


def test_an_object_that_is_moved_untouched_is_met_where_it_is_then():
    moved = poses.moved_untouched(stream(), rng(), 0.02, 0.0)
    way = np.array([frame.object_pose for frame in moved.frames])[:, :2] - (1.0, 0.0)
    first, last = REST
    middle = (first + last) // 2
    assert np.hypot(*way.T) == pytest.approx([0.0] * middle + [0.02] * (12 - middle))
    for before, after in zip(stream().frames[last + 1 :], moved.frames[last + 1 :], strict=True):
        assert before.object_pose is not None and after.object_pose is not None
        met = se2.between(after.object_pose, after.sensor_pose)
        assert met == pytest.approx(se2.between(before.object_pose, before.sensor_pose))
    assert numbers(moved)[: first + 1] == list(range(first + 1))
    assert moved.begin == pytest.approx(0.8)


def test_a_second_pusher_is_a_fault_of_its_own():
    first = int(np.flatnonzero(stream().touching)[0])
    untouched = int(np.flatnonzero(~stream().touching)[0])
    assert is_of(CLEAN, stream()) and not is_of(PUSHED_ASIDE, stream())
    shoved = replace(stream(), shoved=(untouched, first, first + 1))
    assert is_of(PUSHED_ASIDE, shoved) and not is_of(CLEAN, shoved)
    assert FAULTS[PUSHED_ASIDE](shoved, rng()).begin == shoved.arrival[first]
    between = replace(stream(), shoved=(untouched,))
    assert not is_of(PUSHED_ASIDE, between) and not is_of(CLEAN, between)
    knocked = replace(pushed(20), extra={"knocked": np.eye(20)[7]})
    assert stream_of(knocked).shoved == (7,)


def test_images_are_late_frozen_flat_and_others():
    assert shown(images.late(stream(), rng(), 2)) == [0, 0, *range(10)]
    assert shown(images.frozen(stream(), rng(), np.inf)) == [*range(10), 9, 9]
    assert shown(images.flat(stream(), rng(), 255, 0.2)) == [*range(9), 255, 255, 11]
    red_last = images.exchanged_channels(stream(), rng())
    assert image(red_last.frames[3])[0, 0].tolist() == [200, 103, 3]
    assert image(images.turned(stream(), rng(), 1).frames[0]).shape == (6, 8, 3)
    wide, narrow = (image(of.frames[0])[..., 2] for of in (images.mirrored(stream(), rng()), stream()))
    assert np.array_equal(wide, narrow[:, ::-1])
    assert shown(images.false_contact(stream(), rng(), 2)) == [0, 1, 2, 3, 4, 9, 10, 7, 8, 9, 10, 11]
    assert shown(images.missed_contact(stream(), rng(), 2)) == [*range(9), 4, 4, 11]
    others = shown(images.outliers(stream(), rng(), 1.0))
    assert all(other in (2, 3, 8, 9, 10, 11) for other, touched in zip(others, TOUCHING, strict=True) if touched)
    assert [others[number] for number in np.flatnonzero(~TOUCHING)] == [0, 1, 4, 5, 6, 7]


@pytest.mark.parametrize(
    "name", ["first pose off 5 mm", "outline +2 %", "extrinsics off 1 mm", "image late by 1 frames", "mirrored"]
)
def test_what_a_contact_shows_cannot_be_told_before(name):
    first = int(np.argmax(TOUCHING))
    assert first > 0 and FAULTS[name](stream(), rng()).begin == stream().arrival[first]


def test_light_and_gel_change():
    drifted = images.drifting_light(stream(), rng(), -0.2)
    assert [int(image(frame)[0, 0, 2]) for frame in (drifted.frames[0], drifted.frames[-1])] == [200, 160]
    stepped = images.light_step(stream(), rng(), 0.4)
    assert [int(image(frame)[0, 0, 2]) for frame in stepped.frames] == [200] * 9 + [255] * 3
    out = image(images.light_out(stream(), rng()).frames[-1])[0, 0] / image(stream().frames[-1])[0, 0]
    assert sorted(np.round(out, 1).tolist()) == [0.1, 1.0, 1.0]
    worn = images.wear(stream(), rng(), 14.0)
    change = image(worn.frames[-1]).astype(int) - image(stream().frames[-1])
    assert np.abs(change).max() == 14 and np.array_equal(image(worn.frames[0]), image(stream().frames[0]))
    scratched = image(images.scratch(stream(), rng()).frames[-1]).astype(int) - image(stream().frames[-1])
    assert scratched[..., 2].min() == -60 and (scratched[..., 2] == 0).any()
    unit = images.calibrated(stream(), rng()).calibration
    assert unit is not None and unit.background.mean[0, 0].tolist() == [0.5, 100.5, 200.0]


@pytest.mark.parametrize(
    ("shape", "larger"),
    [
        (Disc(0.1), Disc(0.102)),
        (Rectangle(0.1, 0.2), Rectangle(0.102, 0.204)),
        (Polygon([(0, 0), (0.1, 0), (0, 0.1)]), Polygon([(0, 0), (0.102, 0), (0, 0.102)])),
    ],
)
def test_what_is_told_is_off(shape, larger):
    told_shape: Any = told.outline_off(replace(stream(), shape=shape), rng(), 0.02).shape
    assert told_shape.outline() == pytest.approx(larger.outline())
    first = told.first_pose_off(stream(), rng(), 0.01, 5.0).first_pose - stream().first_pose
    assert np.hypot(*first[:2]) == pytest.approx(0.01) and abs(np.degrees(first[2])) == pytest.approx(5.0)
