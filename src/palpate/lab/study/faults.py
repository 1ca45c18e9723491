"""Faults of sensors and of the tracker's prior knowledge, each alone at stated strengths, and a few pairs.

A fault changes the stream of frames that a tracker gets, or the outline, first pose or calibration that it is given.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape, scaled
from palpate.pipeline.truth import flag_runs
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration
from palpate.types.measurements import Frame
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Image = NDArray[np.uint8]
Rng = np.random.Generator


@dataclass(eq=False)
class Stream:
    """N frames as they arrive, and the tracker's prior knowledge of object and sensor; faults change them in place."""

    time: Array
    """Stamps (N,) [s]."""
    arrival: Array
    """Time at which each frame really arrives (N,) [s]."""
    sensor_pose: Array
    """Measured world_T_sensor (N, 3) [m, m, rad]."""
    truth: Array
    """world_T_object (N, 3) [m, m, rad], for scores."""
    contact: Flags
    """True contact (N,)."""
    images: list[Image]
    shape: Shape
    sensor: SensorProfile
    first_pose: Array
    """world_T_object (3,) [m, m, rad] that the tracker is given."""
    calibration: Calibration | None = None
    begin: float = 0.0
    """Arrival from which on the fault can be noticed [s]."""
    shoved: tuple[int, ...] = ()
    """Recorded frames in which something else than the sensor pushes the object."""

    def __len__(self) -> int:
        return len(self.time)

    def frames(self) -> list[Frame]:
        """Return the frames for a tracker."""
        columns = self.time.tolist(), self.sensor_pose, self.images, self.contact.tolist(), self.truth
        return [Frame(*column) for column in zip(*columns, strict=True)]

    def take(self, frames: NDArray[np.int_]) -> None:
        """Leave these frames, in this order."""
        for name in ("time", "sensor_pose", "truth", "contact"):
            setattr(self, name, getattr(self, name)[frames])
        self.arrival = np.maximum.accumulate(self.arrival[frames])
        self.images = [self.images[frame] for frame in frames]

    def change_images(self, change: Callable[[int, Image], Any], where: Flags | None = None) -> None:
        """Change the images of all or some frames (N,); `change` takes frame and image, and returns grey levels."""
        for k in range(len(self)) if where is None else np.flatnonzero(where).tolist():
            self.images[k] = np.clip(np.rint(change(k, self.images[k])), 0, 255).astype(np.uint8)

    def begin_at(self, frame: int) -> int:
        """State that the fault can be noticed from this frame on; returns it."""
        self.begin = float(self.arrival[frame])
        return frame

    def first_contact(self) -> int:
        """Return the first frame in contact."""
        return int(np.argmax(self.contact))

    def in_contact(self) -> int:
        """Return a frame in the first half of the longest contact."""
        first, last = max(flag_runs(self.contact), key=lambda run: run[1] - run[0])
        return first + (last - first) // 3

    def rest(self) -> tuple[int, int]:
        """Return the first and last frame of the longest rest before a contact, between two contacts if possible."""
        rests = [run for run in flag_runs(~self.contact) if run[1] + 1 < len(self)]
        return max([run for run in rests if run[0] > 0] or rests, key=lambda run: run[1] - run[0])

    def during(self, first: int, seconds: float) -> Flags:
        """Return the frames (N,) that arrive within some seconds from a frame on."""
        begin = self.arrival[first]
        return (self.arrival >= begin) & (self.arrival < begin + seconds)


def stream_of(recording: Recording) -> Stream:
    """Return the frames of a recording that faults can be made of, all images decoded."""
    assert recording.object_pose is not None and recording.contact is not None
    arrays = recording.time, recording.time - recording.time[0], recording.sensor_pose, recording.object_pose
    images = [frame.image for frame in recording if frame.image is not None]
    shoved = tuple(np.flatnonzero(recording.extra.get("knocked", ())).tolist())
    first = recording.object_pose[0]
    return Stream(*arrays, recording.contact, images, recording.shape, recording.sensor, first, shoved=shoved)


def check_faults(recording: Recording) -> None:
    """Raise FileError unless all faults can be made of a recording."""
    contact, truth, name = recording.contact, recording.object_pose, recording.file or "the recording"
    if recording.image is None or contact is None or truth is None or not np.isfinite(truth).all():
        raise FileError(f"{name}: has no images, contact flags or ground truth at each frame, which faults need")
    if np.any(recording.extra.get("knocked", False)):
        return  # it has its fault already
    longest = max((last + 1 - first for first, last in flag_runs(contact)), default=0)
    if longest < 14:
        raise FileError(f"{name}: its longest contact has {longest} frames, and faults need one of 14 or more")
    if (begin := int(np.argmax(contact))) < 2:
        raise FileError(f"{name}: contact begins at frame {begin}, and faults need 2 or more frames before it")


# Frames and their times


def _drop(s: Stream, rng: Rng, share: float) -> None:
    kept = rng.random(len(s)) >= share
    kept[0] = True
    s.take(np.flatnonzero(kept))


def _lose(s: Stream, rng: Rng, seconds: float) -> None:
    first = s.in_contact()
    s.take(np.flatnonzero(~s.during(first, seconds)))
    s.begin_at(min(first, len(s) - 1))


def _repeat(s: Stream, rng: Rng, share: float) -> None:
    s.take(np.repeat(np.arange(len(s)), 1 + (rng.random(len(s)) < share)))


def _exchange(s: Stream, rng: Rng, share: float) -> None:
    """Send a share of all frames, but never the first, after the one that follows them."""
    order = np.arange(len(s)) + 1.5 * (rng.random(len(s)) < share)
    order[0] = 0.0
    s.take(np.argsort(order, kind="stable"))


def _slow_down(s: Stream, rng: Rng, every: int) -> None:
    s.take(np.arange(0, len(s), every))


def _jitter(s: Stream, rng: Rng, deviation: float) -> None:
    s.time += rng.normal(0.0, deviation, len(s))


def _leap(s: Stream, rng: Rng, seconds: float, for_good: bool = False) -> None:
    first = s.begin_at(s.in_contact())
    s.time[first : None if for_good else first + 1] += seconds


def _stamp_in_nanoseconds(s: Stream, rng: Rng, is_late: bool = False) -> None:
    s.time[s.begin_at(s.in_contact() if is_late else 0) :] *= 1e9


# Poses, with lengths in metres


def _lose_pose(s: Stream, rng: Rng, seconds: float) -> None:
    s.sensor_pose[s.during(s.begin_at(s.in_contact()), seconds)] = np.nan


def _freeze_pose(s: Stream, rng: Rng, seconds: float = np.inf) -> None:
    first = s.begin_at(s.in_contact())
    s.sensor_pose[s.during(first, seconds)] = s.sensor_pose[first]


def _shift_poses(s: Stream, rng: Rng, length: float, count: int = 1) -> None:
    """Shift the sensor's pose, in any direction, at some frames in contact."""
    first = s.begin_at(s.in_contact())
    later = np.flatnonzero(s.contact & (np.arange(len(s)) >= first))
    hit = np.append(first, rng.choice(later[1:], count - 1, replace=False))
    angle = rng.uniform(-np.pi, np.pi, count)
    s.sensor_pose[hit, :2] += length * np.column_stack([np.cos(angle), np.sin(angle)])


def _add_pose_noise(s: Stream, rng: Rng, length: float, degrees: float) -> None:
    s.sensor_pose += rng.normal(size=(len(s), 3)) * (length, length, np.radians(degrees))


def _misplace_sensor(s: Stream, rng: Rng, length: float = 0.0, degrees: float = 0.0) -> None:
    s.sensor_pose = se2.compose(s.sensor_pose, _offset(rng, length, degrees))
    s.begin_at(s.first_contact())


def _move_untouched(s: Stream, rng: Rng, length: float = 0.0, degrees: float = 0.0) -> None:
    """Move the object between two contacts, in any direction; the sensor goes to its new place."""
    first, last = s.rest()
    motion = se2.compose(se2.compose(s.truth[last], _offset(rng, length, degrees)), se2.inverse(s.truth[last]))
    # The sensor's detour is spread over the rest, as that of a hand or of a planner.
    part = np.clip((np.arange(len(s)) - first) / max(last - first, 1), 0.0, 1.0)
    part = part * part * (3.0 - 2.0 * part)
    s.sensor_pose = se2.compose(se2.exp(part[:, None] * se2.log(motion)), s.sensor_pose)
    middle = (first + last) // 2
    s.truth[middle:] = se2.compose(motion, s.truth[middle:])
    s.begin_at(last + 1)


def _push_aside(s: Stream, rng: Rng) -> None:
    s.begin_at(next(frame for frame in s.shoved if s.contact[frame]))


def _misstate_first_pose(s: Stream, rng: Rng, length: float = 0.0, degrees: float = 0.0) -> None:
    s.first_pose = se2.compose(s.first_pose, _offset(rng, length, degrees))
    s.begin_at(s.first_contact())


def _misstate_outline(s: Stream, rng: Rng, share: float) -> None:
    s.shape = scaled(s.shape, 1.0 + share)
    s.begin_at(s.first_contact())


def _offset(rng: Rng, length: float, degrees: float) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.radians(degrees) * rng.choice([-1.0, 1.0])
    return np.array([length * np.cos(angle), length * np.sin(angle), turn])


# Images


def _change_all(s: Stream, rng: Rng, change: Callable[[Image], Any]) -> None:
    s.change_images(lambda _, image: change(image))
    s.begin_at(s.first_contact())


def _change_in_contact(s: Stream, rng: Rng, change: Callable[[Image], Any], seconds: float = np.inf) -> None:
    s.change_images(lambda _, image: change(image), s.during(s.begin_at(s.in_contact()), seconds))


def _delay_images(s: Stream, rng: Rng, frames: int) -> None:
    s.images = [s.images[max(k - frames, 0)] for k in range(len(s))]
    s.begin_at(s.first_contact())


def _freeze_image(s: Stream, rng: Rng, seconds: float = np.inf) -> None:
    image = s.images[s.in_contact()]
    _change_in_contact(s, rng, lambda _: image, seconds)


def _show_noise(s: Stream, rng: Rng, seconds: float = np.inf) -> None:
    _change_in_contact(s, rng, lambda image: rng.integers(0, 256, image.shape, np.uint8), seconds)


def _exchange_red_and_blue(s: Stream, rng: Rng) -> None:
    s.change_images(lambda _, image: image[..., ::-1])


def _calibrate(s: Stream, rng: Rng) -> None:
    s.calibration = Calibration(background_of(s.images[: s.first_contact()]))


def _drift_light(s: Stream, rng: Rng, share: float) -> None:
    s.change_images(lambda k, image: image * (1.0 + share * k / (len(s) - 1)))


def _switch_off_light(s: Stream, rng: Rng) -> None:
    """Switch off one of three lights in a contact; the others leave a tenth of its channel."""
    factor = np.ones(3)
    factor[rng.integers(3)] = 0.1
    _change_in_contact(s, rng, partial(np.multiply, factor))


def _show_others(s: Stream, rng: Rng, share: float) -> None:
    """Give a share of frames in contact the image of another of them."""
    touched = np.flatnonzero(s.contact)
    images = [s.images[frame] for frame in touched]
    where = s.contact & (rng.random(len(s)) < share)
    s.change_images(lambda *_: images[rng.integers(len(images))], where)
    s.begin_at(s.first_contact())


def _show_contact(s: Stream, rng: Rng, frames: int) -> None:
    """Show images of a contact in the middle of a rest."""
    first, last = s.rest()
    start, shown = s.begin_at((first + last) // 2), s.in_contact()
    count = min(frames, last - start)
    s.images[start : start + count] = s.images[shown : shown + count]


def _hide_contact(s: Stream, rng: Rng, frames: int) -> None:
    """Show the untouched gel in a contact."""
    start = s.begin_at(s.in_contact())
    count = min(frames, len(s) - start)
    s.images[start : start + count] = [s.images[s.rest()[0]]] * count


Fault = Callable[[Stream, Rng], None]
CLEAN = "none"
PUSHED_ASIDE = "pushed aside while touched"
"""The one fault that is recorded, by `palpate simulate --knocks`, and not made of a stream."""
_BLACK, _WHITE = (partial(np.full_like, fill_value=level) for level in (0, 255))
_HALF_TURN = partial(_change_all, change=partial(np.rot90, k=2))
FAULTS: dict[str, tuple[Fault, ...]] = {
    CLEAN: (),
    **{f"frames dropped, {n} %": (partial(_drop, share=n / 100),) for n in (5, 20, 50)},
    **{f"frames lost for {n} s": (partial(_lose, seconds=n),) for n in (1, 2)},
    "frames repeated, 10 %": (partial(_repeat, share=0.1),),
    "frames exchanged, 10 %": (partial(_exchange, share=0.1),),
    **{f"every {name} frame only": (partial(_slow_down, every=n),) for n, name in ((2, "second"), (3, "third"))},
    **{f"stamps jitter, {n} ms": (partial(_jitter, deviation=n / 1e3),) for n in (5, 20)},
    **{f"one stamp {n:+} s": (partial(_leap, seconds=n),) for n in (1000, -1000)},
    **{f"stamps {n:+} s for good": (partial(_leap, seconds=n, for_good=True),) for n in (1000, -1000)},
    "stamps in ns": (_stamp_in_nanoseconds,),
    "stamps in ns from a contact on": (partial(_stamp_in_nanoseconds, is_late=True),),
    **{f"pose NaN for {n} s": (partial(_lose_pose, seconds=n),) for n in (0.2, 1)},
    "pose frozen for 1 s": (partial(_freeze_pose, seconds=1.0),),
    "pose frozen for good": (_freeze_pose,),
    "pose off by 20 mm once": (partial(_shift_poses, length=0.02),),
    "pose off by 20 mm 10 times": (partial(_shift_poses, length=0.02, count=10),),
    "pose off by 1 m once": (partial(_shift_poses, length=1.0),),
    "pose off by 1e200 m once": (partial(_shift_poses, length=1e200),),
    "pose noise 0.5 mm, 0.3 deg": (partial(_add_pose_noise, length=5e-4, degrees=0.3),),
    "pose noise 2 mm, 1 deg": (partial(_add_pose_noise, length=2e-3, degrees=1.0),),
    **{f"image late by {n} frames": (partial(_delay_images, frames=n),) for n in (1, 2, 3)},
    "image frozen for 1 s": (partial(_freeze_image, seconds=1.0),),
    "image frozen for good": (_freeze_image,),
    "image black for 5 frames": (partial(_change_in_contact, change=_BLACK, seconds=0.16),),
    "image black for 1 s": (partial(_change_in_contact, change=_BLACK, seconds=1.0),),
    "image black for good": (partial(_change_in_contact, change=_BLACK),),
    "image saturated for 1 s": (partial(_change_in_contact, change=_WHITE, seconds=1.0),),
    "image noise for 1 s": (partial(_show_noise, seconds=1.0),),
    "image noise for good": (_show_noise,),
    "red and blue exchanged": (_exchange_red_and_blue,),
    "red and blue exchanged, calibrated": (_calibrate, _exchange_red_and_blue),
    "turned by 90 degrees": (partial(_change_all, change=np.rot90),),
    "turned by 180 degrees": (_HALF_TURN,),
    "mirrored": (partial(_change_all, change=np.fliplr),),
    "turned by 180 degrees, calibrated": (_calibrate, _HALF_TURN),
    **{f"light drifts {n:+} %": (partial(_drift_light, share=n / 100),) for n in (-40, -20, -10, 10, 20, 40)},
    **{
        f"light steps {n:+} %": (partial(_change_in_contact, change=partial(np.multiply, 1.0 + n / 100)),)
        for n in (-40, -20, -10, 10, 20, 40)
    },
    "one light out": (_switch_off_light,),
    **{f"outlier images, {n} %": (partial(_show_others, share=n / 100),) for n in (10, 30)},
    **{f"false contact of {n} frame{s}": (partial(_show_contact, frames=n),) for n, s in ((1, ""), (10, "s"))},
    **{f"missed contact of {n} frame{s}": (partial(_hide_contact, frames=n),) for n, s in ((1, ""), (10, "s"))},
    **{f"first pose off {n} mm": (partial(_misstate_first_pose, length=n / 1e3),) for n in (5, 10, 20)},
    **{f"first pose off {n} deg": (partial(_misstate_first_pose, degrees=n),) for n in (5, 10, 15)},
    **{f"outline {n:+} %": (partial(_misstate_outline, share=n / 100),) for n in (-2, 2, 5)},
    "extrinsics off 1 mm": (partial(_misplace_sensor, length=1e-3),),
    "extrinsics off 2 deg": (partial(_misplace_sensor, degrees=2.0),),
    **{f"moved untouched, {n} mm": (partial(_move_untouched, length=n / 1e3),) for n in (10, 20, 30)},
    "moved untouched, 20 deg": (partial(_move_untouched, degrees=20.0),),
    PUSHED_ASIDE: (_push_aside,),
}
FAULTS |= {
    pair: tuple(change for fault in faults for change in FAULTS[fault])
    for pair, faults in {
        "dropped 20 % and image late by 1": ("frames dropped, 20 %", "image late by 1 frames"),
        "light drifts -20 % and outliers 10 %": ("light drifts -20 %", "outlier images, 10 %"),
        "first pose off 10 mm and extrinsics 1 mm": ("first pose off 10 mm", "extrinsics off 1 mm"),
        "outline +2 % and moved untouched 10 mm": ("outline +2 %", "moved untouched, 10 mm"),
        "false contact of 1 frame and moved 20 mm": ("false contact of 1 frame", "moved untouched, 20 mm"),
    }.items()
}
"""The changes of all faults by their names in tables; the same generator makes the same changes."""


def with_fault(stream: Stream, fault: str, rng: Rng) -> Stream:
    """Return a stream with a fault; the given one stays as it was."""
    arrays = ("time", "arrival", "sensor_pose", "truth", "contact")
    changed = replace(stream, images=list(stream.images), **{name: getattr(stream, name).copy() for name in arrays})
    for change in FAULTS[fault]:
        change(changed, rng)
    return changed


def applies(fault: str, stream: Stream) -> bool:
    """Return true if a fault can be tried: PUSHED_ASIDE if something else pushes the object, all others if not."""
    if not stream.shoved:
        return fault != PUSHED_ASIDE
    return fault == PUSHED_ASIDE and any(stream.contact[frame] for frame in stream.shoved)
