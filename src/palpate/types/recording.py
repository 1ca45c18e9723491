"""Recording: images and poses of a sensor, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import FARTHEST, FLAGS, INTEGERS, NUMBERS, check_increasing, check_rows, checked_array, is_near
from palpate.errors import FileError
from palpate.geometry.shapes import Shape
from palpate.types.frame import Frame
from palpate.types.images import Codec, SpooledImages, decode_image
from palpate.types.sensor import SensorProfile, known_sensor

if TYPE_CHECKING:
    from palpate.types.plane import Normal


Images = NDArray[np.uint8] | Sequence[NDArray[np.uint8] | bytes | str | Path]
"""Images as a user has them: arrays (N, height, width, 3), encoded bytes, or paths of files."""


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
    """size and form of the sensor's tip, its rate, and the height and width of its images"""
    object_pose: NDArray[np.float64] | None = None
    """world_T_object, (N, 3) [m, m, rad]: ground truth; a row is NaN where it is not known"""
    contact: NDArray[np.bool_] | None = None
    """(N,) true while the sensor touches the object; None where only images show it"""
    episode: NDArray[np.int64] | None = None
    """(N,) number of the contact episode, -1 outside contact"""
    image: Sequence[bytes] | None = None
    """N encoded touch images; iterating over the recording decodes them one by one"""
    codec: Codec = "jpeg"
    """encoding of the images"""
    contact_derived: bool = False
    """the contact flags were computed from ground truth and geometry, not sensed"""
    source: str = ""
    """origin of the data, for people"""
    frames: dict[str, str] = field(default_factory=dict)
    """origin of each pose by field name, for people"""
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)
    """further data of each frame by name, (N, ...) numbers or booleans each, NaN where not known"""
    first_pose: NDArray[np.float64] | None = None
    """world_T_object at the start (3,) [m, m, rad] as the object was placed; None takes it from ground truth"""
    first_pose_sigma: NDArray[np.float64] | None = None
    """its standard deviations (3,) [m, m, rad] in the object's frame"""
    file: Path | None = None
    """the file it was read from; errors name it"""

    def __post_init__(self) -> None:
        def settle(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        if not isinstance(self.shape, Shape):
            raise FileError(f"shape: found {self.shape!r}, expected an outline, which palpate.load_shape reads")
        settle("sensor", known_sensor(self.sensor))
        time = checked_array("time", self.time, NUMBERS, ("N",)).astype(np.float64)
        if not len(time):
            raise FileError("time: found no frames, a recording needs at least one")
        check_increasing(time)
        settle("time", time)
        n = len(time)
        settle("sensor_pose", _poses("sensor_pose", self.sensor_pose, n))
        if self.object_pose is not None:
            settle("object_pose", _poses("object_pose", self.object_pose, n, allow_unknown=True))
        if self.first_pose is not None:
            settle("first_pose", _three("first_pose", self.first_pose))
        if self.first_pose_sigma is not None:
            sigma = _three("first_pose_sigma", self.first_pose_sigma)
            if self.first_pose is None or not (sigma > 0.0).all():
                raise FileError(f"first_pose_sigma: found {sigma.tolist()}, allowed is above 0, with a first_pose")
            settle("first_pose_sigma", sigma)
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
            settle("image", self.image if isinstance(self.image, SpooledImages) else _checked_images(self.image))
            if len(self.image) != n:
                raise FileError(f"image: found {len(self.image)} images for {n} times, expected one for each")
        settle("extra", {name: _checked_extra(name, value, n) for name, value in self.extra.items()})

    @classmethod
    def from_arrays(
        cls,
        image_time: ArrayLike,
        images: Images | None,
        pose_time: ArrayLike,
        poses: ArrayLike,
        shape: Shape,
        sensor: SensorProfile | str,
        *,
        sensor_T_gel: ArrayLike | None = None,
        time_offset: float = 0.0,
        plane: "Normal" = (0.0, 0.0, 1.0),
        off_plane: float = 0.01,
        object_poses: ArrayLike | None = None,
        object_time: ArrayLike | None = None,
        contact: ArrayLike | None = None,
        codec: Codec = "jpeg",
        source: str = "arrays",
    ) -> "Recording":
        """Return a recording made from images and poses that have times of their own.

        Frames are the images, with the sensor's pose interpolated between those before and after; a warning says how
        many are left out because no pose is known at their time. Times are seconds (floats) or nanoseconds (integers).
        Poses are rows (x, y, theta) [m, m, rad], (x, y, z, qx, qy, qz, qw) with the quaternion's w last, or 4x4
        matrices, in one frame of the world. Raises FileError or SettingError that names the argument, what was found
        and what would fit.

        Parameters
        ----------
        image_time
            (N,) Times of the images, increasing.
        images
            An array (N, height, width, 3) of uint8, RGB; or N such arrays, N encoded images (bytes, JPEG or PNG) or N
            paths of image files; None if there are none, and `contact` is given.
        pose_time
            (M,) Times of the poses, by the same clock.
        poses
            (M, 3), (M, 7) or (M, 4, 4) Poses of the sensor, or of the part of a robot that carries it.
        shape
            Outline of the object in the object frame; `palpate.load_shape` reads one from a file.
        sensor
            A profile, or a known name: "digit", "gelsight-mini" or "point".
        sensor_T_gel
            (3,), (7,) or (4, 4) The gel's frame in the frame of `poses`: origin at the apex of the gel, x out of it, y
            along the columns of an image. None if `poses` are the gel's own.
        time_offset
            Added to the times of the images [s]: negative if they are stamped late.
        plane
            Normal of the plane of the push in the frame of the poses, or "fit" for the plane through the sensor's path.
        off_plane
            Largest distance of poses from that plane [m].
        object_poses
            (K, 3), (K, 7) or (K, 4, 4) Poses of the object: ground truth, NaN where it is not known.
        object_time
            (K,) Their times; by default `pose_time`.
        contact
            (N,) True for each image in which the sensor touches the object.
        codec
            Encoding of arrays: "jpeg" at quality 95, or "png", lossless.
        source
            Origin of the data, for people.
        """
        from palpate.types.from_arrays import recording_from_arrays

        truth = None if object_poses is None else (pose_time if object_time is None else object_time, object_poses)
        return recording_from_arrays(
            (image_time, images),
            (pose_time, poses),
            shape,
            known_sensor(sensor),
            sensor_T_gel,
            time_offset,
            plane,
            off_plane,
            truth,
            contact,
            codec,
            source,
        )

    @property
    def is_simulated(self) -> bool:
        """True if palpate rendered its images, as its source then says."""
        return " by palpate: " in self.source

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


def _checked_images(images: Any) -> tuple[bytes, ...]:
    kept = tuple(images)
    for index, image in enumerate(kept):
        if not isinstance(image, bytes):
            found = f"an array of shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise FileError(
                f"image: image {index} is {found}, expected encoded bytes; Recording.from_arrays encodes arrays"
            )
    return kept


def _poses(name: str, given: Any, n: int, allow_unknown: bool = False) -> NDArray[np.float64]:
    poses = checked_array(name, given, NUMBERS, (n, 3)).astype(np.float64)
    good = is_near(poses).all(axis=1)
    if allow_unknown:
        good |= np.isnan(poses).all(axis=1)
    allowed = f"three numbers up to {FARTHEST:g}{', or three NaN' if allow_unknown else ''}"
    check_rows(name, poses, good, allowed)
    return poses


def _three(name: str, value: Any) -> NDArray[np.float64]:
    numbers = checked_array(name, value, NUMBERS, (3,)).astype(np.float64)
    if not is_near(numbers).all():
        raise FileError(f"{name}: found {numbers.tolist()}, allowed are three numbers up to {FARTHEST:g}")
    return numbers


def _checked_extra(name: str, value: Any, n: int) -> NDArray[Any]:
    if not name or "/" in name or name == ".":
        raise FileError(f"extra: found the name {name!r}, allowed are names without a slash")
    size = value.shape[1:] if isinstance(value, np.ndarray) else ()
    return checked_array(f"extra/{name}", value, ("fiub", "numbers or booleans"), (n, *size))
