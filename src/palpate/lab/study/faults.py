"""Faults of sensors and of the tracker's prior knowledge, each alone at stated strengths, and a few pairs.

A fault changes the stream of frames that a tracker gets, or the outline, first pose or calibration that it is given.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape, scaled
from palpate.lab.simulate.backdrop import scratch as gel_scratch
from palpate.pipeline.truth import flag_runs
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration
from palpate.types.measurements import Frame
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Stream:
    """N frames as they arrive, and the tracker's prior knowledge of object and sensor."""

    frames: tuple[Frame, ...]
    """Each with the truth at its own instant, for scores and faults only."""
    arrival: Array
    """Arrival of each frame (N,) [s]; a frame's own time may be wrong."""
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
        return len(self.frames)

    @property
    def touching(self) -> NDArray[np.bool_]:
        """True contact (N,)."""
        return np.array([bool(frame.contact) for frame in self.frames])

    @property
    def poses(self) -> Array:
        """Measured world_T_sensor (N, 3) [m, m, rad]."""
        return np.array([frame.sensor_pose for frame in self.frames])

    @property
    def times(self) -> Array:
        """Stamps (N,) [s]."""
        return np.array([frame.time for frame in self.frames])

    @property
    def image_size(self) -> tuple[int, int]:
        """Height and width of the images [px]."""
        image = self.frames[0].image
        assert image is not None
        return image.shape[0], image.shape[1]

    def of(self, indices: NDArray[np.int_]) -> "Stream":
        """Return the stream of these frames in this order."""
        arrival = np.maximum.accumulate(self.arrival[indices])
        return replace(self, frames=tuple(self.frames[index] for index in indices), arrival=arrival)

    def with_each(self, field: str, values: Any) -> "Stream":
        """Return the stream with a field of all frames replaced by N values."""
        frames = zip(self.frames, values, strict=True)
        return replace(self, frames=tuple(replace(frame, **{field: value}) for frame, value in frames))

    def with_images(self, where: NDArray[np.bool_], change: Callable[[int, Image], Image]) -> "Stream":
        """Return the stream with the images of some frames (N,) changed; `change` takes index and image."""
        images = [frame.image for frame in self.frames]
        return self.with_each(
            "image", [change(k, im) if where[k] and im is not None else im for k, im in enumerate(images)]
        )

    def from_frame(self, index: int) -> "Stream":
        """Return the stream with a fault that can be noticed from this frame on."""
        return replace(self, begin=float(self.arrival[index]))

    def from_contact(self) -> "Stream":
        """Return the stream with a fault that cannot be noticed before the first contact."""
        return self.from_frame(int(np.argmax(self.touching)))

    def in_contact(self) -> int:
        """Return a frame in the first half of the longest contact, at which faults in contact begin."""
        first, last = max(flag_runs(self.touching), key=lambda run: run[1] - run[0])
        return first + (last - first) // 3

    def rest(self) -> tuple[int, int]:
        """Return the first and last frame of the longest rest before a contact, between two contacts if possible."""
        rests = [run for run in flag_runs(~self.touching) if run[1] + 1 < len(self)]
        return max([run for run in rests if run[0] > 0] or rests, key=lambda run: run[1] - run[0])

    def during(self, first: int, seconds: float) -> NDArray[np.bool_]:
        """Return the frames (N,) that arrive within some seconds from a frame on."""
        begin = self.arrival[first]
        return (self.arrival >= begin) & (self.arrival < begin + seconds)


def stream_of(recording: Recording) -> Stream:
    """Return the frames of a recording that has ground truth at every frame, all images decoded."""
    assert recording.object_pose is not None
    shoved = tuple(np.flatnonzero(recording.extra.get("knocked", ())).tolist())
    arrival = recording.time - recording.time[0]
    first = recording.object_pose[0]
    return Stream(tuple(recording), arrival, recording.shape, recording.sensor, first, shoved=shoved)


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


def dropped(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Lose a share of all frames, but never the first."""
    kept = rng.random(len(stream)) >= share
    kept[0] = True
    return stream.of(np.flatnonzero(kept))


def burst(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Lose all frames of some seconds of a contact."""
    first = stream.in_contact()
    changed = stream.of(np.flatnonzero(~stream.during(first, seconds)))
    return changed.from_frame(min(first, len(changed) - 1))


def repeated(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Send a share of all frames twice."""
    return stream.of(np.repeat(np.arange(len(stream)), 1 + (rng.random(len(stream)) < share)))


def exchanged(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Send a share of all frames after the one that follows them."""
    order = np.arange(len(stream)) + 1.5 * (rng.random(len(stream)) < share)
    order[0] = 0.0
    return stream.of(np.argsort(order, kind="stable"))


def slower(stream: Stream, rng: np.random.Generator, every: int) -> Stream:
    """Send only every second frame, or every third."""
    return stream.of(np.arange(0, len(stream), every))


def jittered(stream: Stream, rng: np.random.Generator, deviation: float) -> Stream:
    """Add normal noise to the stamps [s]."""
    return stream.with_each("time", (stream.times + rng.normal(0.0, deviation, len(stream))).tolist())


def leapt(stream: Stream, rng: np.random.Generator, seconds: float, for_good: bool) -> Stream:
    """Let the clock leap in a contact, for one frame or for good."""
    first, times = stream.in_contact(), stream.times
    times[first : None if for_good else first + 1] += seconds
    return stream.with_each("time", times.tolist()).from_frame(first)


def nanoseconds(stream: Stream, rng: np.random.Generator, late: bool) -> Stream:
    """Give stamps in nanoseconds, from the first frame or from a contact on."""
    first, times = stream.in_contact() if late else 0, stream.times
    times[first:] *= 1e9
    return stream.with_each("time", times.tolist()).from_frame(first)


# Sensor poses


def pose_lost(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Give NaN for the pose during some seconds of a contact."""
    first, poses = stream.in_contact(), stream.poses
    poses[stream.during(first, seconds)] = np.nan
    return stream.with_each("sensor_pose", poses).from_frame(first)


def pose_frozen(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Repeat a pose during some seconds of a contact while the sensor moves on."""
    first, poses = stream.in_contact(), stream.poses
    poses[stream.during(first, seconds)] = poses[first]
    return stream.with_each("sensor_pose", poses).from_frame(first)


def pose_spikes(stream: Stream, rng: np.random.Generator, length: float, count: int = 1) -> Stream:
    """Shift the pose by a length [m], in any direction, at some frames in contact."""
    first, poses = stream.in_contact(), stream.poses
    later = np.flatnonzero(stream.touching & (np.arange(len(stream)) >= first))
    hit = np.append(first, rng.choice(later[1:], count - 1, replace=False))
    angle = rng.uniform(-np.pi, np.pi, count)
    poses[hit, :2] += length * np.column_stack([np.cos(angle), np.sin(angle)])
    return stream.with_each("sensor_pose", poses).from_frame(first)


def pose_noise(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Add normal noise to the poses of all frames [m], [deg]."""
    deviation = (length, length, np.radians(degrees))
    return stream.with_each("sensor_pose", stream.poses + rng.normal(size=(len(stream), 3)) * deviation)


def misplaced(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Give poses with wrong extrinsics, off by a length [m] in any direction and an angle [deg]."""
    return stream.with_each("sensor_pose", se2.compose(stream.poses, _offset(rng, length, degrees))).from_contact()


def moved_untouched(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Move the object between two contacts, in any direction; the sensor goes to its new place.

    It cannot be noticed before the next contact.
    """
    first, last = stream.rest()
    truth = np.array([frame.object_pose for frame in stream.frames])
    motion = se2.compose(se2.compose(truth[last], _offset(rng, length, degrees)), se2.inverse(truth[last]))
    # The sensor's detour is spread over the rest, as that of a hand or of a planner.
    part = np.clip((np.arange(len(stream)) - first) / max(last - first, 1), 0.0, 1.0)
    part = part * part * (3.0 - 2.0 * part)
    poses = se2.compose(se2.exp(part[:, None] * se2.log(motion)), stream.poses)
    middle = (first + last) // 2
    truth[middle:] = se2.compose(motion, truth[middle:])
    return stream.with_each("object_pose", truth).with_each("sensor_pose", poses).from_frame(last + 1)


def pushed_aside(stream: Stream, rng: np.random.Generator) -> Stream:
    """Let something else push the object while the sensor touches it, as it was recorded."""
    return stream.from_frame(next(frame for frame in stream.shoved if stream.touching[frame]))


# Images


def images_late(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Give each frame the image of some frames before."""
    images = [frame.image for frame in stream.frames]
    return stream.with_each("image", [images[max(k - frames, 0)] for k in range(len(images))]).from_contact()


def image_frozen(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Repeat an image during some seconds of a contact."""
    image = stream.frames[stream.in_contact()].image
    return _in_contact(stream, seconds, lambda _, shown: shown if image is None else image)


def image_flat(stream: Stream, rng: np.random.Generator, level: int, seconds: float) -> Stream:
    """Show one grey level, 0 to 255, during some seconds of a contact."""
    return _in_contact(stream, seconds, lambda _, image: np.full_like(image, level))


def image_noise(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Show noise during some seconds of a contact."""
    return _in_contact(stream, seconds, lambda _, image: rng.integers(0, 256, image.shape, np.uint8))


def red_blue_exchanged(stream: Stream, rng: np.random.Generator) -> Stream:
    """Exchange red and blue, from the first image on."""
    return _in_all(stream, lambda _, image: np.ascontiguousarray(image[..., ::-1]))


def turned(stream: Stream, rng: np.random.Generator, quarters: int) -> Stream:
    """Turn all images by quarters, counter-clockwise."""
    return _in_all(stream, lambda _, image: np.ascontiguousarray(np.rot90(image, quarters))).from_contact()


def mirrored(stream: Stream, rng: np.random.Generator) -> Stream:
    """Exchange left and right in all images."""
    return _in_all(stream, lambda _, image: np.ascontiguousarray(image[:, ::-1])).from_contact()


def calibrated(stream: Stream, rng: np.random.Generator) -> Stream:
    """Give the tracker a calibration from the images before the first contact: no fault."""
    images = [frame.image for frame in stream.frames[: int(np.argmax(stream.touching))] if frame.image is not None]
    return replace(stream, calibration=Calibration(background_of(images)))


def light_drift(stream: Stream, rng: np.random.Generator, change: float) -> Stream:
    """Change the light evenly, by this share at the end."""
    return _in_all(stream, lambda k, image: _clipped(image * (1.0 + change * k / (len(stream) - 1))))


def light_step(stream: Stream, rng: np.random.Generator, change: float) -> Stream:
    """Change the light by this share at once, in a contact."""
    return _in_contact(stream, np.inf, lambda _, image: _clipped(image * (1.0 + change)))


def light_out(stream: Stream, rng: np.random.Generator) -> Stream:
    """Switch off one of the three lights in a contact; the others leave a tenth of its channel."""
    factor = np.ones(3)
    factor[rng.integers(3)] = 0.1
    return _in_contact(stream, np.inf, lambda _, image: _clipped(image * factor))


def wear(stream: Stream, rng: np.random.Generator, levels: float) -> Stream:
    """Let a smooth pattern grow on the gel, up to so many grey levels at the end."""
    height, width = stream.image_size
    rows, columns = np.indices((height, width))
    pattern = np.zeros((height, width))
    for _ in range(12):
        row, column, size = rng.uniform(0, height), rng.uniform(0, width), rng.uniform(0.05, 0.2) * width
        pattern += rng.uniform(-1.0, 1.0) * np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2.0 * size**2))
    pattern = pattern[..., None]
    pattern *= levels / np.abs(pattern).max()
    return _in_all(stream, lambda k, image: _clipped(image + pattern * (k / (len(stream) - 1))))


def scratch(stream: Stream, rng: np.random.Generator) -> Stream:
    """Draw a dark line, 3 px wide and 60 grey levels deep, over the gel from a frame in a contact on."""
    height, width = stream.image_size
    angle, off = rng.uniform(0.0, np.pi), rng.uniform(-0.2, 0.2) * width
    at = (0.5 * height + off * np.sin(angle), 0.5 * width + off * np.cos(angle))
    line = -60.0 * gel_scratch((height, width), at, angle, 3)[..., None]
    return _in_contact(stream, np.inf, lambda _, image: _clipped(image + line))


def outliers(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Give a share of frames in contact the image of another of them, drawn at random."""
    touching = np.flatnonzero(stream.touching)
    images = [stream.frames[index].image for index in touching]
    where = stream.touching & (rng.random(len(stream)) < share)

    def other(_: int, image: Image) -> Image:
        drawn = images[rng.integers(len(images))]
        return image if drawn is None else drawn

    return stream.with_images(where, other).from_frame(int(touching[0]))


def false_contact(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Show images of a contact in the middle of a rest, so many in a row."""
    first, last = stream.rest()
    start, shown = (first + last) // 2, stream.in_contact()
    changed = list(stream.frames)
    for k in range(start, min(start + frames, last)):
        changed[k] = replace(changed[k], image=stream.frames[shown + k - start].image)
    return replace(stream, frames=tuple(changed)).from_frame(start)


def missed_contact(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Show the untouched gel in a contact, so many frames in a row."""
    start, changed = stream.in_contact(), list(stream.frames)
    for k in range(start, min(start + frames, len(stream))):
        changed[k] = replace(changed[k], image=stream.frames[stream.rest()[0]].image)
    return replace(stream, frames=tuple(changed)).from_frame(start)


# Prior knowledge


def first_pose_off(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Give a first pose that is off by a length [m] in any direction and an angle [deg]."""
    first = se2.compose(stream.first_pose, _offset(rng, length, degrees))
    return replace(stream, first_pose=first).from_contact()


def outline_off(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Give an outline whose lengths are all too large by this share."""
    return replace(stream, shape=scaled(stream.shape, 1.0 + share)).from_contact()


def _in_all(stream: Stream, change: Callable[[int, Image], Image]) -> Stream:
    return stream.with_images(np.ones(len(stream), np.bool_), change)


def _in_contact(stream: Stream, seconds: float, change: Callable[[int, Image], Image]) -> Stream:
    first = stream.in_contact()
    return stream.with_images(stream.during(first, seconds), change).from_frame(first)


def _clipped(levels: NDArray[np.floating]) -> Image:
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def _offset(rng: np.random.Generator, length: float, degrees: float) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.radians(degrees) * rng.choice([-1.0, 1.0])
    return np.array([length * np.cos(angle), length * np.sin(angle), turn])


Fault = Callable[[Stream, np.random.Generator], Stream]
"""It leaves the stream as it was; the same generator makes the same changes."""


def _pair(*faults: Fault) -> Fault:
    return lambda stream, rng: reduce(lambda changed, fault: fault(changed, rng), faults, stream)


CLEAN = "none"
PUSHED_ASIDE = "pushed aside while touched"
"""The one fault that is recorded, by `palpate simulate --knocks`, and not made of a stream."""
FAULTS: dict[str, Fault] = {
    CLEAN: lambda stream, rng: stream,
    **{f"frames dropped, {share} %": partial(dropped, share=share / 100) for share in (5, 20, 50)},
    **{f"frames lost for {seconds} s": partial(burst, seconds=seconds) for seconds in (1, 2)},
    "frames repeated, 10 %": partial(repeated, share=0.1),
    "frames exchanged, 10 %": partial(exchanged, share=0.1),
    **{f"every {word} frame only": partial(slower, every=n) for n, word in ((2, "second"), (3, "third"))},
    **{f"stamps jitter, {ms} ms": partial(jittered, deviation=ms / 1e3) for ms in (5, 20)},
    **{f"one stamp {s:+} s": partial(leapt, seconds=s, for_good=False) for s in (1000, -1000)},
    **{f"stamps {s:+} s for good": partial(leapt, seconds=s, for_good=True) for s in (1000, -1000)},
    "stamps in ns": partial(nanoseconds, late=False),
    "stamps in ns from a contact on": partial(nanoseconds, late=True),
    **{f"pose NaN for {seconds} s": partial(pose_lost, seconds=seconds) for seconds in (0.2, 1)},
    "pose frozen for 1 s": partial(pose_frozen, seconds=1.0),
    "pose frozen for good": partial(pose_frozen, seconds=np.inf),
    "pose off by 20 mm once": partial(pose_spikes, length=0.02),
    "pose off by 20 mm 10 times": partial(pose_spikes, length=0.02, count=10),
    "pose off by 1 m once": partial(pose_spikes, length=1.0),
    "pose off by 1e200 m once": partial(pose_spikes, length=1e200),
    "pose noise 0.5 mm, 0.3 deg": partial(pose_noise, length=5e-4, degrees=0.3),
    "pose noise 2 mm, 1 deg": partial(pose_noise, length=2e-3, degrees=1.0),
    **{f"image late by {n} frames": partial(images_late, frames=n) for n in (1, 2, 3)},
    "image frozen for 1 s": partial(image_frozen, seconds=1.0),
    "image frozen for good": partial(image_frozen, seconds=np.inf),
    "image black for 5 frames": partial(image_flat, level=0, seconds=0.16),
    "image black for 1 s": partial(image_flat, level=0, seconds=1.0),
    "image black for good": partial(image_flat, level=0, seconds=np.inf),
    "image saturated for 1 s": partial(image_flat, level=255, seconds=1.0),
    "image noise for 1 s": partial(image_noise, seconds=1.0),
    "image noise for good": partial(image_noise, seconds=np.inf),
    "red and blue exchanged": red_blue_exchanged,
    "red and blue exchanged, calibrated": _pair(calibrated, red_blue_exchanged),
    "turned by 90 degrees": partial(turned, quarters=1),
    "turned by 180 degrees": partial(turned, quarters=2),
    "mirrored": mirrored,
    "turned by 180 degrees, calibrated": _pair(calibrated, partial(turned, quarters=2)),
    **{f"light drifts {n:+} %": partial(light_drift, change=n / 100) for n in (-40, -20, -10, 10, 20, 40)},
    **{f"light steps {n:+} %": partial(light_step, change=n / 100) for n in (-40, -20, -10, 10, 20, 40)},
    "one light out": light_out,
    **{f"wear, up to {n} levels": partial(wear, levels=n) for n in (7, 14)},
    "a scratch": scratch,
    **{f"outlier images, {n} %": partial(outliers, share=n / 100) for n in (10, 30)},
    "false contact of 1 frame": partial(false_contact, frames=1),
    "false contact of 10 frames": partial(false_contact, frames=10),
    "missed contact of 1 frame": partial(missed_contact, frames=1),
    "missed contact of 10 frames": partial(missed_contact, frames=10),
    **{f"first pose off {n} mm": partial(first_pose_off, length=n / 1e3, degrees=0.0) for n in (5, 10, 20)},
    **{f"first pose off {n} deg": partial(first_pose_off, length=0.0, degrees=n) for n in (5, 10, 15)},
    **{f"outline {n:+} %": partial(outline_off, share=n / 100) for n in (-2, 2, 5)},
    "extrinsics off 1 mm": partial(misplaced, length=1e-3, degrees=0.0),
    "extrinsics off 2 deg": partial(misplaced, length=0.0, degrees=2.0),
    **{f"moved untouched, {n} mm": partial(moved_untouched, length=n / 1e3, degrees=0.0) for n in (10, 20, 30)},
    "moved untouched, 20 deg": partial(moved_untouched, length=0.0, degrees=20.0),
    PUSHED_ASIDE: pushed_aside,
    "dropped 20 % and image late by 1": _pair(partial(dropped, share=0.2), partial(images_late, frames=1)),
    "light drifts -20 % and outliers 10 %": _pair(partial(light_drift, change=-0.2), partial(outliers, share=0.1)),
    "first pose off 10 mm and extrinsics 1 mm": _pair(
        partial(first_pose_off, length=0.01, degrees=0.0), partial(misplaced, length=1e-3, degrees=0.0)
    ),
    "outline +2 % and moved untouched 10 mm": _pair(
        partial(outline_off, share=0.02), partial(moved_untouched, length=0.01, degrees=0.0)
    ),
    "false contact of 1 frame and moved 20 mm": _pair(
        partial(false_contact, frames=1), partial(moved_untouched, length=0.02, degrees=0.0)
    ),
}
"""All faults by their names in tables."""


def applies(fault: str, stream: Stream) -> bool:
    """Return true if a fault can be tried: PUSHED_ASIDE if something else pushes the object, all others if not."""
    if not stream.shoved:
        return fault != PUSHED_ASIDE
    return fault == PUSHED_ASIDE and any(stream.touching[frame] for frame in stream.shoved)
