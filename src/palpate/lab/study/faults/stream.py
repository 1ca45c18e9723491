"""What a tracker is given from its first frame to its last: what faults change."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry.shapes import Shape
from palpate.pipeline.truth import flag_runs
from palpate.touch.calibration import Calibration
from palpate.types.frame import Frame
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Stream:
    """N frames as they arrive, and what the tracker is told of object and sensor."""

    frames: tuple[Frame, ...]
    """Each with the truth at its own instant, which only scores and faults look at."""
    arrival: Array
    """When each arrives, (N,) [s]; a frame's own time may lie."""
    shape: Shape
    """Outline that the tracker is told."""
    sensor: SensorProfile
    """Sensor that the tracker is told."""
    first_pose: Array
    """world_T_object (3,) [m, m, rad] that the tracker is told."""
    calibration: Calibration | None = None
    """What the tracker is told of the unit."""
    begin: float = 0.0
    """Arrival from which on the fault can be seen [s]."""
    shoved: tuple[int, ...] = ()
    """Frames, of those that were recorded, in which something else than the sensor pushes the object."""

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Whether the object is touched, in truth (N,)."""
        return np.array([bool(frame.contact) for frame in self.frames])

    def of(self, indices: NDArray[np.int_]) -> "Stream":
        """Return the stream of these frames, which arrive when they did or, where that is earlier, in this order."""
        arrival = np.maximum.accumulate(self.arrival[indices])
        return replace(self, frames=tuple(self.frames[index] for index in indices), arrival=arrival)

    def from_frame(self, index: int) -> "Stream":
        """Return the stream with a fault that can be seen from this frame on."""
        return replace(self, begin=float(self.arrival[index]))

    def from_contact(self) -> "Stream":
        """Return the stream with a fault that cannot be seen before the object is touched."""
        return self.from_frame(int(np.argmax(self.touching)))

    def with_images(self, where: NDArray[np.bool_], change: Callable[[int, Image], Image]) -> "Stream":
        """Return the stream with the images of some frames (N,) changed; `change` takes index and image."""
        frames = tuple(
            replace(frame, image=change(index, frame.image)) if where[index] and frame.image is not None else frame
            for index, frame in enumerate(self.frames)
        )
        return replace(self, frames=frames)

    def with_poses(self, poses: Array) -> "Stream":
        """Return the stream with other sensor poses (N, 3)."""
        frames = zip(self.frames, poses, strict=True)
        return replace(self, frames=tuple(replace(frame, sensor_pose=pose) for frame, pose in frames))

    def with_times(self, times: Array) -> "Stream":
        """Return the stream with other stamps (N,) [s]."""
        frames = zip(self.frames, times.tolist(), strict=True)
        return replace(self, frames=tuple(replace(frame, time=time) for frame, time in frames))

    @property
    def poses(self) -> Array:
        """Measured world_T_sensor (N, 3) [m, m, rad]."""
        return np.array([frame.sensor_pose for frame in self.frames])

    @property
    def times(self) -> Array:
        """Stamps (N,) [s]."""
        return np.array([frame.time for frame in self.frames])


_LEAST = 14  # frames of the longest contact; some faults are in ten of its last two thirds
_BEFORE = 2  # untouched frames at the beginning, which calibrate a sensor


def check_faults(recording: Recording) -> None:
    """Raise FileError unless all faults can be made of a recording."""
    contact, truth, name = recording.contact, recording.object_pose, recording.file or "the recording"
    if recording.image is None or contact is None or truth is None or not np.isfinite(truth).all():
        raise FileError(f"{name}: has no images, contact flags or ground truth at each frame, which faults need")
    if np.any(recording.extra.get("knocked", False)):
        return  # it has its fault already
    longest = max((last + 1 - first for first, last in flag_runs(contact)), default=0)
    if longest < _LEAST:
        raise FileError(f"{name}: its longest contact has {longest} frames, and faults need one of {_LEAST} or more")
    if (begin := int(np.argmax(contact))) < _BEFORE:
        raise FileError(f"{name}: contact begins at frame {begin}, and faults need {_BEFORE} or more frames before it")


def stream_of(recording: Recording) -> Stream:
    """Return the frames of a recording with truth at every frame, all images decoded."""
    assert recording.object_pose is not None
    frames = tuple(recording)
    shoved = np.flatnonzero(recording.extra.get("knocked", ()))
    return Stream(
        frames,
        recording.time - recording.time[0],
        recording.shape,
        recording.sensor,
        recording.object_pose[0],
        shoved=tuple(shoved.tolist()),
    )


def in_contact(stream: Stream) -> int:
    """Return a frame in the first half of the longest contact, where faults in contact begin."""
    first, last = _longest(stream.touching)
    return first + (last - first) // 3


def before_contact(stream: Stream) -> tuple[int, int]:
    """Return the first and last frame of the longest rest that a contact follows, between two contacts if any is."""
    touching = stream.touching
    rests = [(first, last) for first, last in flag_runs(~touching) if last + 1 < len(touching)]
    between = [rest for rest in rests if rest[0] > 0]
    return max(between or rests, key=lambda rest: rest[1] - rest[0])


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    return max(flag_runs(flags), key=lambda run: run[1] - run[0])
