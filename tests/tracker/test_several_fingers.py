"""A hand of two fingers, each a sensor of its own, pushes a rectangle flat with both of them, or a disc with one."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpate
from palpate import DIGIT, ContactDirection, Disc, Frame, FrameError, Rectangle, SensorProfile, SettingError, Tracker

TIP = SensorProfile("round tip", radius=0.02)
CAMERA = SensorProfile("small", radius=0.01, half_width=0.006, image_height=40, image_width=30)
MOUNTS = {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, 0.0)}
BOX = Rectangle(0.12, 0.1)
SIGMA = (3e-3, 3e-3, 0.05)
OFF = np.array([2e-3, -2e-3, 0.05])
"""Error of the first pose [m, m, rad]."""


class Directions:
    """Touch that measures the direction it is told."""

    def __init__(self, angle: float = 0.0) -> None:
        self.angle = angle

    def measure(self, frame: Frame) -> list[ContactDirection]:
        return [ContactDirection(self.angle, 0.03**2)]

    def end_contact(self) -> None:
        pass


def hand(
    shape: palpate.Shape = BOX, first: Any = OFF, names: tuple[str, ...] = ("left", "right"), **more: Any
) -> Tracker:
    more = {"first_pose_sigma": SIGMA, "is_view_known": True, **more}
    return Tracker(shape, dict.fromkeys(names, TIP), first, mounts={name: MOUNTS[name] for name in names}, **more)


def push(count: int = 60, turn: float = 0.0) -> list[tuple[Frame, np.ndarray]]:
    """Frames with the true pose of the box, which both fingers push along x and turn by `turn` [rad] in all.

    Ten frames before, the hand comes up; the box lies flat against both tips from then on.
    """
    frames = []
    for k in range(count):
        pushed = max(k - 10, 0)
        before = 8e-4 * max(10 - k, 0)
        yaw = turn * pushed / (count - 11)
        box = np.array([8e-4 * pushed, 0.0, yaw])
        out = -0.06 - before
        pose = np.array([box[0] + out * math.cos(yaw), box[1] + out * math.sin(yaw), yaw])
        touches = k >= 10
        frames.append((Frame(k / 30.0, pose, contacts={"left": touches, "right": touches}), box))
    return frames


def updated(tracker: Tracker, frames: list[Frame]) -> list[palpate.Estimate]:
    return [tracker.update(frame) for frame in frames]


def test_two_fingers_on_one_side_see_its_yaw_at_once():
    tracker = hand(set_up_sigma=np.zeros(3))
    frames = push(16)
    first = tracker.update(frames[0][0])
    assert not first.contact
    estimates = [tracker.update(frame) for frame, _ in frames[1:]]
    assert estimates[-1].contact
    assert abs(estimates[-1].pose[2]) < 0.4 * OFF[2]  # no touch measures a direction here
    assert math.sqrt(estimates[-1].covariance[2, 2]) < 0.5 * SIGMA[2]
    assert abs(estimates[-1].pose[0] - frames[-1][1][0]) < 1.2e-3


def test_a_finger_beside_its_mount_turns_the_object_less_than_directions_allow():
    beside = {"left": (0.0, 0.02, 0.0), "right": (1.5e-3, -0.02, 0.0)}  # but the right one is beside the left one
    yaws = []
    for set_up in (None, np.zeros(3)):
        touch = {"left": Directions(), "right": Directions()}
        tracker = Tracker(
            BOX,
            dict.fromkeys(beside, TIP),
            np.zeros(3),
            first_pose_sigma=SIGMA,
            mounts=beside,
            touch=touch,
            set_up_sigma=set_up,
            is_view_known=True,
        )
        last = updated(tracker, [frame for frame, _ in push(40)])[-1]
        yaws.append((abs(last.pose[2]), math.sqrt(last.covariance[2, 2])))
    (doubted, sigma), (believed, least_sigma) = yaws
    assert doubted < 0.6 * believed
    assert doubted < 2.0 * sigma
    assert least_sigma < sigma


def test_the_object_turns_with_fingers_that_hold_it():
    tracker = hand(first=np.zeros(3))
    frames = push(70, turn=0.3)
    for frame, box in frames:
        estimate = tracker.update(frame)
        off = estimate.pose - box
        assert np.hypot(off[0], off[1]) < 4e-3
        assert abs(off[2]) < 0.02
    assert frames[-1][1][2] == pytest.approx(0.3)


def test_the_order_of_the_fingers_changes_nothing():
    one = hand()
    other = hand(names=("right", "left"))
    for frame, _ in push(30):
        pose = one.update(frame).pose
        assert other.update(frame).pose == pytest.approx(pose, abs=1e-6)


def test_each_finger_has_variables_of_its_own():
    tracker = hand(first=np.zeros(3), touch={"left": Directions(0.04)})
    for frame, _ in push(40):
        tracker.update(frame)
    left, left_sigma = tracker.variable("direction_bias.left")
    right, right_sigma = tracker.variable("direction_bias.right")
    assert left[0] > 0.005
    assert left_sigma[0] < right_sigma[0]
    assert (right[0], right_sigma[0]) == pytest.approx((0.0, 0.02), abs=2e-3)
    with pytest.raises(SettingError, match="thumb"):
        tracker.variable("depth.thumb")


def test_a_finger_that_joins_later_and_comes_back_is_taken_in():
    frames = []
    for k, (frame, _) in enumerate(push(60)):
        joins = 20 <= k < 30 or k >= 40
        frames.append(Frame(frame.time, frame.sensor_pose, contacts={"left": k >= 10, "right": joins}))
    estimates = updated(hand(), frames)
    assert [estimate.contact for estimate in estimates] == [k >= 10 for k in range(60)]
    assert abs(estimates[-1].pose[2]) < 0.4 * OFF[2]
    assert abs(estimates[-1].pose[0] - push(60)[-1][1][0]) < 1.5e-3


def test_a_finger_that_drops_out_is_named_and_the_other_goes_on():
    frames = []
    for k, (frame, _) in enumerate(push(60)):
        contacts = {"left": k >= 10} if k > 30 else {"left": k >= 10, "right": k >= 10}
        frames.append(Frame(frame.time, frame.sensor_pose, contacts=contacts))
    estimates = updated(hand(), frames)
    reasons = [estimate.reason for estimate in estimates]
    assert not any("right" in reason for reason in reasons[1:31])
    assert all("right" in reason for reason in reasons[40:])
    last = estimates[-1]
    assert last.contact
    off = last.pose - push(60)[-1][1]  # which is hardly turned
    assert off @ np.linalg.solve(last.covariance, off) < 11.3


def push_of_disc(left: bool) -> list[Frame]:
    """Frames of the left finger, as it meets a disc off its middle; stated as those of the right one unless `left`."""
    start = 0.02 - math.sqrt(0.07**2 - 0.02**2)
    frames = []
    for k in range(40):
        pose = np.array([start + 1e-4 * max(k - 10, 0), 0.0, 0.0])
        frames.append(Frame(k / 30.0, pose, contacts={"left": left and k >= 10, "right": not left and k >= 10}))
    return frames


def test_fingers_that_are_exchanged_are_found_out_by_what_they_see():
    touch = {"right": Directions(-math.asin(0.02 / 0.07))}
    tracker = hand(Disc(0.05), np.zeros(3), touch=touch, is_view_known=False)
    last = updated(tracker, push_of_disc(left=False))[-1]
    assert tracker.mirrored
    assert "exchanged" in last.reason


def test_fingers_that_are_not_exchanged_raise_no_doubt():
    touch = {"left": Directions(-math.asin(0.02 / 0.07))}
    tracker = hand(Disc(0.05), np.zeros(3), touch=touch, is_view_known=False)
    last = updated(tracker, push_of_disc(left=True))[-1]
    assert not tracker.mirrored
    assert "exchanged" not in last.reason


def test_images_that_come_late_are_named():
    gel = np.random.default_rng(1).integers(90, 110, (320, 240, 3)).astype(np.uint8)
    tracker = Tracker(BOX, {"left": DIGIT, "right": DIGIT}, np.zeros(3), mounts=MOUNTS)
    frames = []
    for k in range(12):
        stamps = {"left": k / 30.0 - 0.2, "right": k / 30.0}
        images = {"left": gel + k % 2, "right": gel[::-1] + k % 2}
        frames.append(Frame(k / 30.0, np.array([-0.2, 0.0, 0.0]), images=images, image_times=stamps))
    reason = updated(tracker, frames)[-1].reason
    assert "left" in reason
    assert "200 ms" in reason
    assert "right" not in reason


def test_one_camera_for_two_fingers_is_named():
    gel = np.random.default_rng(1).integers(90, 110, (320, 240, 3)).astype(np.uint8)
    tracker = Tracker(BOX, {"left": DIGIT, "right": DIGIT}, np.zeros(3), mounts=MOUNTS)
    last = updated(
        tracker,
        [
            Frame(k / 30.0, np.array([-0.2, 0.0, 0.0]), images={"left": gel + k % 2, "right": gel + k % 2})
            for k in range(3)
        ],
    )[-1]
    assert "left" in last.reason and "right" in last.reason and "the same" in last.reason


def test_a_rough_start_keeps_its_likely_places_with_fingers_as_stated_and_exchanged():
    rough = {"first_pose_sigma": (0.03, 0.03, 1.8), "is_view_known": False}
    tracker = hand(first=np.zeros(3), touch={"left": Directions()}, **rough)
    frames = [
        Frame(frame.time, frame.sensor_pose, contacts={"left": k >= 10, "right": False})
        for k, (frame, _) in enumerate(push(12))
    ]
    last = updated(tracker, frames)[-1]
    assert len(last.answers) > 40  # of a hundred of much the same weight, of which the right one is any
    assert last.status in ("ambiguous", "uncertain")


def pinching(way: np.ndarray, rate: float = 30.0, **of_finger: Any) -> list[Frame]:
    """Frames of a gripper around a box, moved by `way` (N,) [m] along x and y, so many a second."""
    frames = []
    for k, moved in enumerate(way):
        given: Any = {name: {"left": values[k], "right": values[k]} for name, values in of_finger.items()}
        frames.append(Frame(k / rate, np.array([moved, moved, 0.0]), **given))
    return frames


GRIPPER = {"left": (0.0, 0.05, -0.5 * np.pi), "right": (0.0, -0.05, 0.5 * np.pi)}
WAY = np.concatenate([np.zeros(30), np.linspace(0.0, 0.03, 40)])


def test_fingers_that_face_each_other_may_move_back_and_sideways():
    rng = np.random.default_rng(8)
    images = rng.normal(90.0, 1.0, (len(WAY), 40, 30, 3))
    images[20:, 10:30, 8:22] += 60.0
    tracker = Tracker(
        BOX, dict.fromkeys(GRIPPER, CAMERA), np.zeros(3), palpate.TrackerSettings(tactile="none"), mounts=GRIPPER
    )
    estimates = updated(tracker, pinching(WAY, images=images.clip(0, 255).astype(np.uint8)))
    assert [estimate.contact for estimate in estimates] == [k >= 20 for k in range(len(WAY))]
    assert not any("of its own frame" in estimate.reason for estimate in estimates)
    np.testing.assert_allclose(estimates[-1].pose[:2], 0.03, atol=4e-3)  # it comes along


def test_fingers_that_open_touch_no_more_whatever_their_images_show():
    rng = np.random.default_rng(8)
    images = rng.normal(90.0, 1.0, (len(WAY), 40, 30, 3))
    images[20:, 10:30, 8:22] += 60.0  # and it stays on the gel
    opened = np.concatenate([np.zeros(40), np.linspace(0.0, 0.012, 30)])
    frames = []
    for k, frame in enumerate(pinching(np.zeros(len(WAY)), images=images.clip(0, 255).astype(np.uint8))):
        poses = {name: (0.0, math.copysign(0.05 + opened[k], y), yaw) for name, (_, y, yaw) in GRIPPER.items()}
        frames.append(replace(frame, finger_poses=poses))
    tracker = Tracker(
        BOX, dict.fromkeys(GRIPPER, CAMERA), np.zeros(3), palpate.TrackerSettings(tactile="none"), mounts=GRIPPER
    )
    estimates = updated(tracker, frames)
    assert [estimate.contact for estimate in estimates[:50]] == [k >= 20 for k in range(50)]
    assert not any(estimate.contact for estimate in estimates[60:])


@pytest.mark.parametrize("rate", [30, 60])
def test_an_object_between_two_fingers_may_come_along_or_slide_at_any_rate_of_frames(rate: int):
    way = np.concatenate([np.zeros(rate), np.linspace(0.0, 0.03, 2 * rate)])
    tracker = Tracker(BOX, dict.fromkeys(GRIPPER, TIP), np.zeros(3), first_pose_sigma=SIGMA, mounts=GRIPPER)
    last = updated(tracker, pinching(way, rate, contacts=np.arange(len(way)) >= rate // 2))[-1]
    for along in (0.03, 0.0):
        off = last.pose - (along, 0.03, 0.0)
        assert off @ np.linalg.solve(last.covariance, off) < 7.8
    assert 8e-3 < math.sqrt(last.covariance[0, 0]) < 18e-3  # along the pads
    assert math.sqrt(last.covariance[1, 1]) < 1.5e-3  # across the fingers
    assert last.status == "uncertain"
    assert last.contact_point is not None
    assert last.contact_normal is None  # the two of them cancel


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"images": {"thumb": np.zeros((320, 240, 3), np.uint8)}}, ["thumb", "left, right"]),
        ({"contacts": {"thumb": True}}, ["thumb", "left, right"]),
        ({"contacts": {"left": "yes"}}, ["left", "yes"]),
        ({"images": {"left": np.zeros((320, 240))}}, ["left", "float64"]),
        ({"finger_poses": {"left": [0.0, np.nan, 0.0]}, "contacts": {"left": True}}, ["left", "nan"]),
        ({"contacts": {"left": True}, "image_times": {"left": "now"}}, ["left", "now"]),
        ({"image": np.zeros((320, 240, 3), np.uint8)}, ["image", "left, right"]),
    ],
)
def test_values_that_cannot_be_used_are_named_with_their_finger(values: dict[str, Any], names: list[str]):
    tracker = hand()
    with pytest.raises(FrameError) as error:
        tracker.update(Frame(0.0, np.array([-0.2, 0.0, 0.0]), **values))
    for name in names:
        assert name in str(error.value)


def test_one_sensor_takes_no_frames_of_a_hand():
    tracker = Tracker(BOX, TIP, np.zeros(3))
    with pytest.raises(FrameError, match="contacts by finger"):
        tracker.update(Frame(0.0, np.array([-0.2, 0.0, 0.0]), contact=False, contacts={"left": True}))


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"mounts": {"left": (0.0, 0.02, 0.0)}}, "right"),
        ({"mounts": None}, "left"),
        ({"touch": {"thumb": Directions()}}, "thumb"),
        ({"touch": Directions()}, "left, right"),
        ({"calibration": {"left": "unit.npz"}}, "left"),
    ],
)
def test_arguments_of_fingers_that_are_not_there_are_named(more: dict[str, Any], named: str):
    given = {"mounts": MOUNTS, **more}
    with pytest.raises(SettingError, match=named):
        Tracker(BOX, {"left": TIP, "right": TIP}, np.zeros(3), **given)
