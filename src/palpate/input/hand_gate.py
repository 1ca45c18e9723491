"""Input of a hand: each finger has a gate and a reader of touch of its own, and the hand one pose and one time.

A finger that gives nothing for a while, or images that cannot be used, is left out and named; the others go on.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol

import numpy as np

from palpate.arrays import Array, Flags, Image
from palpate.errors import FrameError
from palpate.geometry import se2
from palpate.input.checked_frame import CheckedFrame, CorrectedFrame
from palpate.input.hand_values import with_checked_hand_values
from palpate.input.image_queue import PATIENCE, ImageQueue, Seen
from palpate.input.input_gate import InputGate
from palpate.status import InputEvidence
from palpate.touch.calibration import Calibration
from palpate.touch.reader import TouchReader
from palpate.types.estimate import Clearance
from palpate.types.hand import Hand
from palpate.types.measurements import Frame, Measurement


class PredictedFingers(Protocol):
    """Prediction of where a hand's fingers are to the object, by their numbers."""

    def clearance(self, sensor_pose: Array, finger: int = 0) -> Clearance:
        """Return the predicted distance of a finger at a pose (3,) from the object."""
        ...

    def withdrawal(self, sensor_pose: Array, finger: int = 0) -> float:
        """Return the motion of a finger out of the object since the last frame, if the object rests [m]."""
        ...


class _PredictedFinger:
    """Prediction of where one finger is to the object."""

    def __init__(self, predicted: PredictedFingers, finger: int) -> None:
        self._predicted = predicted
        self._finger = finger

    def clearance(self, sensor_pose: Array) -> Clearance:
        """Return the predicted distance of the finger at a pose (3,) from the object."""
        return self._predicted.clearance(sensor_pose, self._finger)

    def withdrawal(self, sensor_pose: Array) -> float:
        """Return its motion out of the object since the last frame, if the object rests [m]."""
        return self._predicted.withdrawal(sensor_pose, self._finger)


@dataclass(eq=False)
class Finger:
    """One finger of a hand, and what it has shown so far."""

    name: str
    number: int
    gate: InputGate
    touch: TouchReader
    mount: Array
    """hand_T_finger (3,) [m, m, rad], without the sideways error of its mounting."""
    sideways: float
    """Stated place less the true one along its y [m]."""
    delay: float
    """Delay of its images behind their stamps [s]."""
    queue: ImageQueue
    touches: bool = False
    """True while it touches, as far as is known."""
    interval: float = 0.0
    """Time between its last two images [s]."""
    seen_at: float | None = None
    """Time of the last image or flag that was used [s]."""
    in_hand: Array | None = None
    """Its place in the hand then, hand_T_finger (3,) [m, m, rad]."""

    def closed(self, mount: Array) -> float:
        """Return how far it has moved in the hand along its x since then [m], from there to hand_T_finger (3,)."""
        return 0.0 if self.in_hand is None else float(se2.between(self.in_hand, mount)[0])

    def holds(self, time: float) -> bool:
        """Return True if what it last showed still holds at a time [s]."""
        if self.seen_at is None:
            return False
        return time - self.seen_at <= max(PATIENCE.held, PATIENCE.held_intervals * self.interval)


@dataclass(frozen=True, eq=False)
class CheckedHand:
    """A frame of a hand that can be used, at the time of its latest camera."""

    frame: Frame
    """The frame at that time; its contact is True if any finger touches."""
    frame_time: float
    """Time of the frame itself [s]."""
    mounts: Array
    """hand_T_finger, (N, 3) [m, m, rad]."""
    touches: Flags
    """True for fingers that touch, (N,)."""
    seen: Mapping[int, CheckedFrame]
    """Frames of the fingers of which there is anything new, by their numbers."""
    is_first: bool
    ends_contact: bool
    """True if the contact of the frame before is over: none of the fingers that touched still does."""
    unobserved_push: float
    """Largest distance by which the object may have been pushed while it was not observed [m], if a contact ends."""
    motion_since: Array | None
    """Motion of the hand from the time that is estimated to the frame's, in the world, (3,); None if images are not
    late."""
    evidence: InputEvidence


def _holds(hand: Hand, name: str) -> bool:
    """Return True if another finger faces this one, so that both hold the object, and pull it as they push it."""
    yaws = [mount[2] for mount in hand.mounts.values()]
    return min(math.cos(yaw - hand.mounts[name][2]) for yaw in yaws) < 0.0


def _same_images(images: Mapping[str, Image]) -> list[str]:
    """Return a reason for each two fingers whose images are the same, which those of two cameras never are."""
    return [
        f"images of fingers {one} and {other} are the same to the last pixel: have both one camera or topic?"
        for one, other in combinations(images, 2)
        if np.array_equal(images[one], images[other])
    ]


class HandGate:
    """Checks the frames of a hand: `check` returns one as it can be used, `accept` makes it the last one."""

    def __init__(
        self,
        hand: Hand,
        calibrations: Mapping[str, Calibration],
        readers: Mapping[str, TouchReader],
        seek_markers: bool = True,
    ) -> None:
        """Take the hand, calibrations of some fingers, and a reader of touch for each finger."""
        self.hand = hand
        self._seek_markers = seek_markers
        self.fingers: list[Finger] = []
        for number, (name, sensor) in enumerate(hand.fingers.items()):
            calibration = calibrations.get(name)
            set_up = calibration.set_up if calibration else None
            sideways = set_up.sideways[0] if set_up else 0.0
            mount = se2.compose(np.array(hand.mounts[name]), (0.0, -sideways, 0.0))
            delay = set_up.delay[0] if set_up else 0.0
            gate = InputGate(sensor, calibration, seek_markers, only_pushes=not _holds(hand, name))
            self.fingers.append(Finger(name, number, gate, readers[name], mount, sideways, delay, ImageQueue()))
        self.last: Frame | None = None
        """The last frame that was used."""
        self._path: list[tuple[float, Array]] = []  # times [s] and poses of the last second
        self._path_with_frame: list[tuple[float, Array]] = []  # with those of the frame that is checked

    def reset(self) -> None:
        """Start again at any time; untouched gels stay known."""
        for finger in self.fingers:
            finger.gate.reset()
            finger.touch.end_contact()
            finger.queue = ImageQueue()
            finger.touches = False
            finger.seen_at = None
            finger.in_hand = None
        self.last = None
        self._path = []

    def check(self, frame: Frame, measurements: Sequence[Measurement], predicted: PredictedFingers) -> CheckedHand:
        """Return a frame as it can be used, and what was found; raises FrameError if it cannot."""
        given = with_checked_hand_values(frame, measurements, self.hand)
        reasons = _same_images(given.images or {})
        self._queue(given, reasons)
        time, hand_pose, motion = self._at_images(given)
        mounts = self._mounts(given)
        seen = self._seen(replace(given, time=time, sensor_pose=hand_pose), mounts, predicted, reasons)
        touches = self._touches(time, seen, reasons)
        before = np.array([finger.touches for finger in self.fingers])
        goes_on = [finger.touches and touches[finger.number] for finger in self.fingers]
        for number, checked in seen.items():
            goes_on[number] = goes_on[number] and not checked.ends_contact
        ends_contact = bool(before.any() and not any(goes_on))
        pushes = [checked.unobserved_push for number, checked in seen.items() if before[number]]
        used = replace(
            given,
            time=time,
            sensor_pose=hand_pose,
            contact=bool(touches.any()),
            images={self.fingers[k].name: one.frame.image for k, one in seen.items() if one.frame.image is not None},
            contacts={finger.name: bool(touches[finger.number]) for finger in self.fingers},
        )
        return CheckedHand(
            frame=used,
            frame_time=given.time,
            mounts=mounts,
            touches=touches,
            seen=seen,
            is_first=self.last is None,
            ends_contact=ends_contact,
            unobserved_push=max(pushes, default=0.0),
            motion_since=motion,
            evidence=self._evidence(seen, touches, reasons),
        )

    @property
    def sunk(self) -> Array:
        """Indentation beyond the usual one of each finger, as its images show it, (N,) [m]."""
        return np.array([finger.touch.sunk for finger in self.fingers])

    def accept(self, checked: CheckedHand, measured: Mapping[int, Sequence[Measurement]]) -> None:
        """Make a checked frame the last one, with what each finger measured in it."""
        time = checked.frame.time
        for finger in self.fingers:
            one = checked.seen.get(finger.number)
            finger.touches = bool(checked.touches[finger.number])
            if one is None:
                continue
            finger.gate.accept(one, measured.get(finger.number, ()))
            if finger.seen_at is not None:
                finger.interval = time - finger.seen_at
            finger.seen_at = time
            finger.in_hand = checked.mounts[finger.number]
        self.last = checked.frame
        self._path = self._path_with_frame

    def _queue(self, given: Frame, reasons: list[str]) -> None:
        """Take the images and flags of a frame into the queues of their fingers."""
        images = given.images or {}
        flags = given.contacts or {}
        stamps = given.image_times or {}
        for finger in self.fingers:
            name = finger.name
            if name not in images and name not in flags:
                continue
            time = (stamps.get(name, given.time) - finger.delay) if name in images else given.time
            if time > given.time + PATIENCE.late:
                raise FrameError(
                    f"frame at {given.time:.3f} s has an image of finger {name} from {time:.3f} s, which is to come; "
                    "its time must be that of the frame or before"
                )
            if given.time - time > PATIENCE.most_delay:
                reasons.append(f"images of finger {name} are {given.time - time:.1f} s old and are left out")
                continue
            finger.queue.add(Seen(time, images.get(name), flags.get(name)), given.time)

    def _at_images(self, given: Frame) -> tuple[float, Array, Array | None]:
        """Return time and pose of the hand at the latest camera's image, and the motion since then."""
        before = self._path
        if before and given.time <= before[-1][0]:
            raise FrameError(f"frame at {given.time:.3f} s follows one at {before[-1][0]:.3f} s; times must increase")
        recent = [(time, pose) for time, pose in before if time > given.time - 1.5 * PATIENCE.most_delay]
        self._path_with_frame = [*recent, (given.time, given.sensor_pose)]
        alive = [finger.queue.delay for finger in self.fingers if finger.queue.is_alive(given.time)]
        time = given.time - max(alive, default=0.0)
        if self.last is not None:
            time = max(time, self.last.time + PATIENCE.least_step)
        if time >= given.time:
            return given.time, given.sensor_pose, None
        times = np.array([each for each, _ in self._path_with_frame])
        poses = np.array([pose for _, pose in self._path_with_frame])
        at_image = se2.interpolated(time, times, poses)
        motion = se2.compose(given.sensor_pose, se2.inverse(at_image))
        return time, at_image, motion if motion.any() else None

    def _mounts(self, given: Frame) -> Array:
        """Return hand_T_finger (N, 3) at a frame: as mounted, or where the frame has the finger."""
        poses = given.finger_poses or {}
        mounts = [finger.mount for finger in self.fingers]
        for finger in self.fingers:
            if finger.name in poses:
                at = se2.between(given.sensor_pose, poses[finger.name])
                mounts[finger.number] = se2.compose(at, (0.0, -finger.sideways, 0.0))
        return np.array(mounts)

    def _seen(
        self, frame: Frame, mounts: Array, predicted: PredictedFingers, reasons: list[str]
    ) -> dict[int, CheckedFrame]:
        """Return the frames that the gates of the fingers make of the images and flags whose time has come.

        A finger that cannot be used is left out, with a reason; raises FrameError if that is true of all that came.
        """
        seen: dict[int, CheckedFrame] = {}
        errors: list[FrameError] = []
        for finger in self.fingers:
            came = finger.queue.take(frame.time)
            if came is None:
                continue
            pose = se2.compose(frame.sensor_pose, mounts[finger.number])
            own = Frame(frame.time, pose, came.image, came.contact, frame.object_pose)
            reader = finger.touch
            try:
                seen[finger.number] = finger.gate.check(
                    CorrectedFrame(own, pose),
                    _PredictedFinger(predicted, finger.number),
                    reader.reads_images,
                    reader.needs_colours,
                    finger.closed(mounts[finger.number]),
                )
            except FrameError as error:
                errors.append(error)
                reasons.append(f"finger {finger.name} is left out: {error}")
        if errors and not seen:
            raise FrameError("; ".join(reasons)) from errors[0]
        return seen

    def _touches(self, time: float, seen: Mapping[int, CheckedFrame], reasons: list[str]) -> Flags:
        """Return True for the fingers that touch (N,), with a reason for each finger of which too long nothing came."""
        touches = np.zeros(len(self.fingers), np.bool_)
        for finger in self.fingers:
            if finger.number in seen:
                touches[finger.number] = bool(seen[finger.number].frame.contact)
            elif finger.holds(time):
                touches[finger.number] = finger.touches
            elif finger.seen_at is not None:
                reasons.append(f"finger {finger.name} has given nothing to use for {time - finger.seen_at:.1f} s")
            else:
                reasons.append(f"finger {finger.name} has given neither an image nor a contact flag")
        return touches

    def _evidence(self, seen: Mapping[int, CheckedFrame], touches: Flags, reasons: list[str]) -> InputEvidence:
        """Return the signs that the stream is faulty or weak, of all fingers."""
        evidence = {self.fingers[k].name: one.evidence for k, one in seen.items()}
        for finger in self.fingers:
            if finger.queue.delay > PATIENCE.late:
                reasons.append(
                    f"images of finger {finger.name} are {1e3 * finger.queue.delay:.0f} ms behind the frames"
                )
        doubts = [f"finger {name}: {each.doubt}" for name, each in evidence.items() if each.doubt]
        weak = [f"finger {name}: {each.weakness}" for name, each in evidence.items() if each.weakness]
        blind = [one.evidence.touches_since_start for k, one in seen.items() if touches[k]]
        return InputEvidence(
            hidden_motion=max((each.hidden_motion for each in evidence.values()), default=0.0),
            touches_since_start=bool(blind) and all(blind),
            doubt="; ".join(doubts),
            weakness="; ".join([*reasons, *weak]),
        )
