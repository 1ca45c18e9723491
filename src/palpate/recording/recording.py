"""Recording: what a sensor saw and where it was, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import FileError
from palpate.files import FLAGS, INTEGERS, NUMBERS, check_increasing, check_rows, checked_array
from palpate.geometry.shapes import Shape
from palpate.recording.frame import Frame
from palpate.recording.images import Codec, decode_image
from palpate.recording.sensor import SensorProfile
from palpate.recording.stored_images import StoredImages


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames of one sensor pushing one object; raises FileError on fields that do not fit together."""

    time: NDArray[np.float64]
    """(N,) [s], strictly increasing"""
    sensor_pose: NDArray[np.float64]
    """world_T_sensor, (N, 3) [m, m, rad]"""
    shape: Shape
    """outline of the object, in the object frame"""
    sensor: SensorProfile
    """what the sensor is like; images have its height and width"""
    object_pose: NDArray[np.float64] | None = None
    """world_T_object, (N, 3) [m, m, rad]: ground truth; a row is NaN where it is not known"""
    contact: NDArray[np.bool_] | None = None
    """(N,)"""
    episode: NDArray[np.int64] | None = None
    """(N,) number of the contact episode, -1 outside contact"""
    image: Sequence[bytes] | None = None
    """N encoded touch images, a tuple or read as they are asked for; iterating over the recording decodes them one by
    one"""
    codec: Codec = "jpeg"
    """how the images are encoded"""
    contact_derived: bool = False
    """the contact flags were computed from ground truth and geometry, not sensed"""
    source: str = ""
    """where the data come from, in words"""
    frames: dict[str, str] = field(default_factory=dict)
    """how each pose was obtained, in words, by field name"""
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)
    """what else is known of each frame, by name, (N, ...) numbers or booleans each, NaN where not known"""
    file: Path | None = None
    """the file it was read from; errors name it"""

    def __post_init__(self) -> None:
        def settle(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        time = checked_array("time", self.time, NUMBERS, ("N",)).astype(np.float64)
        if not len(time):
            raise FileError("time: found no frames, a recording needs at least one")
        check_increasing(time)
        settle("time", time)
        n = len(time)
        poses = checked_array("sensor_pose", self.sensor_pose, NUMBERS, (n, 3)).astype(np.float64)
        check_rows("sensor_pose", poses, np.isfinite(poses).all(axis=1), "three finite numbers")
        settle("sensor_pose", poses)
        if self.object_pose is not None:
            truth = checked_array("object_pose", self.object_pose, NUMBERS, (n, 3)).astype(np.float64)
            allowed = np.isfinite(truth).all(axis=1) | np.isnan(truth).all(axis=1)
            check_rows("object_pose", truth, allowed, "three finite numbers, or three NaN where not known")
            settle("object_pose", truth)
        if self.contact is not None:
            settle("contact", checked_array("contact", self.contact, FLAGS, (n,)).astype(np.bool_))
        if self.episode is not None:
            episode = checked_array("episode", self.episode, INTEGERS, (n,)).astype(np.int64)
            check_rows("episode", episode, episode >= -1, "0, 1, 2 ..., or -1 outside contact")
            settle("episode", episode)
        if self.codec not in ("jpeg", "png"):
            raise FileError(f"codec: found {self.codec!r}, allowed are 'jpeg' and 'png'")
        if self.image is not None:
            if not self.sensor.image_height:
                raise FileError(f"image: found images, but the sensor {self.sensor.name!r} has none")
            settle("image", self.image if isinstance(self.image, StoredImages) else tuple(self.image))
            if len(self.image) != n:
                raise FileError(f"image: found {len(self.image)} images for {n} times, expected one for each")
        settle("extra", {name: _checked_extra(name, value, n) for name, value in self.extra.items()})

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: int) -> Frame:
        """The frame at `index`, its image decoded. Raises FileError if the image is damaged."""
        truth = None if self.object_pose is None else self.object_pose[index]
        return Frame(
            time=float(self.time[index]),
            sensor_pose=self.sensor_pose[index],
            image=None if self.image is None else self._decode(index),
            contact=None if self.contact is None else bool(self.contact[index]),
            object_pose=None if truth is None or np.isnan(truth).any() else truth,
        )

    def __iter__(self) -> Iterator[Frame]:
        return (self[index] for index in range(len(self)))

    def _decode(self, index: int) -> NDArray[np.uint8]:
        assert self.image is not None
        data = self.image[index]
        try:
            return decode_image(data, self.codec, (self.sensor.image_height, self.sensor.image_width))
        except FileError as error:
            where = f"{self.file or 'recording'}: image of frame {index % len(self)}"
            raise FileError(f"{where}: {error}") from error


def _checked_extra(name: str, value: Any, n: int) -> NDArray[Any]:
    if not name or "/" in name or name == ".":
        raise FileError(f"extra: found the name {name!r}, allowed are names without a slash")
    size = value.shape[1:] if isinstance(value, np.ndarray) else ()
    return checked_array(f"extra/{name}", value, ("fiub", "numbers or booleans"), (n, *size))


def episode_numbers(contact: ArrayLike) -> NDArray[np.int64]:
    """Number the contact episodes 0, 1, ... of flags (N,); -1 outside contact.

    As in the published system, an episode ends after more than 10 frames without contact and counts from 5
    frames of contact on.
    """
    flags = np.asarray(contact, np.bool_)
    touching = np.flatnonzero(flags)
    starts = np.diff(touching, prepend=-(10**9)) > 11
    run = np.cumsum(starts) - 1
    counts = np.bincount(run) >= 5 if len(run) else np.zeros(0, np.bool_)
    number = np.where(counts, np.cumsum(counts) - 1, -1)
    episode = np.full(flags.shape, -1, np.int64)
    episode[touching] = number[run]
    return episode
