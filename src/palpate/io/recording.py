"""Recording: images and poses of a sensor, frame by frame, and flags that follow from its ground truth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate import checks
from palpate.arrays import Array, Flags, Image
from palpate.config import FirstPoseSettings
from palpate.errors import FileError
from palpate.files import in_file
from palpate.geometry.shapes import Shape, check_outline
from palpate.io.from_arrays import nanoseconds, placed_from, planar_fields
from palpate.types.choices import Normal, Placement
from palpate.types.images import Codec, camera_view, decode_image, turned_image
from palpate.types.measurements import Frame
from palpate.types.sensor import SensorProfile, known_sensor
from palpate.types.space import onto_gel

Images = Image | Sequence[Image | bytes | str | Path]
"""Images as a user has them: arrays (N, height, width, 3), encoded bytes, or paths of files."""


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames of one sensor pushing one object; raises FileError on fields that do not fit together."""

    time: Array
    """(N,) [s], strictly increasing"""
    sensor_pose: Array
    """world_T_sensor, (N, 3) [m, m, rad]"""
    shape: Shape
    """outline of the object, in the object frame"""
    sensor: SensorProfile
    """size and form of the sensor's tip, its rate, and the height and width of its images"""
    object_pose: Array | None = None
    """world_T_object, (N, 3) [m, m, rad]: ground truth; a row is NaN where it is not known"""
    contact: Flags | None = None
    """(N,) true while the sensor touches the object; None where only images show it"""
    image: Sequence[bytes] | None = None
    """N encoded touch images; iterating over the recording decodes them one by one"""
    source: str = ""
    """origin of the data, for people"""
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)
    """further data of each frame by name, (N, ...) numbers or booleans each, NaN where not known"""
    first_pose: Array | None = None
    """world_T_object at the start (3,) [m, m, rad] as the object was placed, by default the first of ground truth; None
    where neither is known"""
    first_pose_sigma: Array | None = None
    """its standard deviations (3,) [m, m, rad] in the object's frame"""
    set_up_sigma: Array | None = None
    """standard deviations of the constant offset between sensor, world and outline (3,) [m, m, rad], zeros if they are
    exact; None is that of a usual set-up, `noise.sensor_pose.calibration`"""
    is_view_known: bool = False
    """images are upright for sure, since `orientation` says how they lay; otherwise tracking doubts it"""
    file: Path | None = None
    """the file it was read from; errors name it"""

    def __post_init__(self) -> None:
        def settle(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        if not isinstance(self.shape, Shape):
            raise FileError(f"shape: found {self.shape!r}, expected an outline, which palpate.load_shape reads")
        settle("sensor", known_sensor(self.sensor))
        settle("time", checks.checked_times(self.time))
        n = len(self.time)
        settle("sensor_pose", checks.checked_poses("sensor_pose", self.sensor_pose, n))
        if self.object_pose is not None:
            settle("object_pose", checks.checked_poses("object_pose", self.object_pose, n, may_be_unknown=True))
        for name, least in (("first_pose", -checks.FARTHEST), ("first_pose_sigma", 1e-9), ("set_up_sigma", 0.0)):
            if (given := getattr(self, name)) is not None:
                settle(name, checks.checked_array(name, given, checks.NUMBERS, (3,)).astype(np.float64))
                if not ((given := getattr(self, name)) >= least).all() or not checks.is_near(given).all():
                    raise FileError(f"{name}: found {given.tolist()}, allowed are {least:g} to {checks.FARTHEST:g}")
        if self.first_pose_sigma is not None and self.first_pose is None:
            raise FileError("first_pose_sigma: found one without a first_pose; allowed is one with it")
        if self.first_pose is None and (known := np.isfinite(self.truth[:, 0])).any():
            settle("first_pose", self.truth[np.argmax(known)].copy())
            settle("first_pose_sigma", np.array(FirstPoseSettings().truth))
        if self.contact is not None:
            settle("contact", checks.checked_array("contact", self.contact, checks.FLAGS, (n,)).astype(np.bool_))
        if self.image is not None:
            if not self.sensor.image_height:
                raise FileError(f"image: found images, but the sensor {self.sensor.name!r} has none")
            settle("image", tuple(self.image))
            if len(self.image) != n:
                raise FileError(f"image: found {len(self.image)} images for {n} times, expected one for each")
            for index, image in enumerate(self.image):
                if not isinstance(image, bytes):
                    found = f"image {index} is of type {type(image).__name__}"
                    raise FileError(f"image: {found}, expected encoded bytes; Recording.from_arrays encodes arrays")
        for name, value in self.extra.items():
            size = value.shape[1:] if isinstance(value, np.ndarray) else ()
            checks.checked_array(f"extra/{name}", value, ("fiub", "numbers or booleans"), (n, *size))
        settle("extra", {name: np.asarray(value) for name, value in self.extra.items()})

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
        orientation: str = Placement.orientation,
        sensor_T_gel: ArrayLike | None = Placement.sensor_T_gel,
        time_offset: float = Placement.time_offset,
        plane: Normal = Placement.plane,
        off_plane: float = Placement.off_plane,
        object_poses: ArrayLike | None = None,
        object_time: ArrayLike | None = None,
        contact: ArrayLike | None = None,
        codec: Codec = "jpeg",
        source: str = "arrays",
    ) -> "Recording":
        """Return a recording made from images and poses that have times of their own.

        Frames are the images, with the sensor's pose interpolated between those before and after; a warning says how
        many are left out because no pose is known at their time. Times are seconds (floats) or nanoseconds (integers),
        all by one clock. Poses are rows (x, y, theta) [m, m, rad], (x, y, z, qx, qy, qz, qw) or 4x4 matrices, in one
        frame of the world, NaN where unknown. Raises FileError or SettingError that names the argument.

        - image_time, images: times (N,), increasing, and arrays of uint8 (N, height, width, 3), RGB, encoded JPEG or
          PNG (bytes), or paths of files. Without images (None), `contact` is needed. Multiples of the sensor's size are
          scaled down.
        - orientation: how images lie, as words with commas: upright, or 90, 180 or 270, the degrees counter-clockwise
          that make them so, mirrored, and the order of channels, such as bgr. Without it tracking doubts how they lie.
        - pose_time, poses: times (M,) and poses of the sensor, or of the part of a robot that carries it.
        - sensor_T_gel: pose of the gel's frame in the frame of `poses`: origin at the apex of the gel, x out of it, y
          along the columns of an image. None if `poses` are the gel's own.
        - time_offset: added to the times of the images [s]: negative if they are stamped late.
        - plane, off_plane: normal of the plane of the push in the frame of the poses, or "fit" for the plane through
          the sensor's path; largest distance of poses from it [m].
        - object_poses, object_time: ground truth (K, ...), NaN where unknown, and its times, by default `pose_time`.
        - contact: (N,) True for each image in which the sensor touches the object.
        - codec, source: encoding of arrays, "jpeg" at quality 95 or "png", lossless; origin of the data, for people.
        """
        placement = Placement(orientation, sensor_T_gel, time_offset, plane, off_plane)  # pyright: ignore[reportArgumentType]
        of_gel = onto_gel(placement)
        sensor = known_sensor(sensor)
        check_outline(shape)
        time = nanoseconds("image_time", image_time, least=1e-3)
        checks.check_rows("image_time", time, np.diff(time, prepend=time[0] - 1) > 0, "a time after the one before")
        if isinstance(images, str | bytes | Path):
            raise FileError(f"images: found {str(images)[:60]!r}, expected N arrays, encoded images or paths of files")
        if images is not None and not sensor.image_height:
            raise FileError(f"images: found images, but the sensor {sensor.name!r} has none")
        given = images if images is None or hasattr(images, "__len__") else list(images)  # also of a generator
        if given is not None and len(given) != len(time):
            raise FileError(f"images: found {len(given)} images for {len(time)} times, expected one for each")
        flags = None if contact is None else checks.checked_array("contact", contact, checks.FLAGS, (len(time),))
        if given is None and flags is None:
            raise FileError("images: found None, and no contact; a recording needs one of them")

        time = time + round(time_offset * 1e9)
        placed = of_gel(placed_from("poses", poses, "pose_time", pose_time, time))
        truth, known = None, checks.as_array("object_poses", np.nan if object_poses is None else object_poses)
        if known.dtype.kind != "f" or not np.isnan(known).all():
            seen_at = pose_time if object_time is None else object_time
            truth = placed_from("object_poses", known, "object_time", seen_at, time)
        fields, _ = planar_fields(
            "from_arrays",
            "world",
            time,
            placement,
            placed,
            truth,
            None if given is None else ("images", given),
            flags,
            sensor,
            codec,
        )
        return cls(**fields, shape=shape, source=source)

    def oriented(self, orientation: str) -> "Recording":
        """Return the recording with its images turned; see `from_arrays`. Raises FileError and SettingError."""
        view, size = camera_view(orientation), (self.sensor.image_height, self.sensor.image_width)
        image = self.image and tuple(turned_image(each, size, view) for each in self.image)
        return replace(self, image=image, is_view_known=self.is_view_known or view.is_stated)

    def until(self, count: int) -> "Recording":
        """Return the first `count` frames."""
        names = "time", "sensor_pose", "object_pose", "contact", "image"
        cut = {name: vars(self)[name][:count] for name in names if vars(self)[name] is not None}
        return replace(self, **cut, extra={name: value[:count] for name, value in self.extra.items()})

    @property
    def truth(self) -> Array:
        """Ground truth, (N, 3) [m, m, rad]; NaN where it is not known."""
        return np.full((len(self), 3), np.nan) if self.object_pose is None else self.object_pose

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: int) -> Frame:
        """The frame at `index`, its image decoded. Raises FileError if the image is damaged."""
        truth, image = None if self.object_pose is None else self.object_pose[index], None
        if self.image is not None:
            with in_file(f"{self.file or 'recording'}: image of frame {index % len(self)}"):
                image = decode_image(self.image[index], (self.sensor.image_height, self.sensor.image_width))
        return Frame(
            time=float(self.time[index]),
            sensor_pose=self.sensor_pose[index],
            image=image,
            contact=None if self.contact is None else bool(self.contact[index]),
            object_pose=None if truth is None or np.isnan(truth).any() else truth,
        )

    def __iter__(self) -> Iterator[Frame]:
        return (self[index] for index in range(len(self)))


def contact_flags(gap: Array, touch: float, release: float) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m]: contact begins below `touch` and ends above `release`.

    Where the gap is in between or NaN the last flag stays; the first is false until something is known.
    """
    begins, ends = gap < touch, gap > release
    last = np.maximum.accumulate(np.where(begins | ends, np.arange(len(gap)), -1))
    return begins[last] & (last >= 0)
