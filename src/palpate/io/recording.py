"""Recording: images and poses of a sensor, frame by frame; and contact flags from the gaps of its ground truth."""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate import checks
from palpate.arrays import Array, Flags, Image
from palpate.config import FirstPoseSettings
from palpate.errors import FileError, kept_warnings
from palpate.files import in_file
from palpate.geometry import se2
from palpate.geometry.shapes import Shape, check_outline
from palpate.io import fingers
from palpate.io.from_arrays import SpatialFrames, nanoseconds, placed_from, planar_fields, truth_from
from palpate.io.hand_frames import hand_fields, of_fingers
from palpate.io.time_order import in_order, without_step
from palpate.types.choices import Normal, Placement
from palpate.types.hand import Hand
from palpate.types.images import Codec, camera_view, decode_image, turned_image
from palpate.types.measurements import Frame
from palpate.types.sensor import SensorProfile
from palpate.types.sensor_file import known_sensor
from palpate.types.space import Placed, Times, gel_pose, onto_gel

Images = Image | Sequence[Image | bytes | str | Path]
"""Images as a user has them: arrays (N, height, width, 3), encoded bytes, or paths of files."""


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames of one sensor, or of a hand, pushing one object; raises FileError on fields that do not fit together."""

    time: Array
    """(N,) [s], strictly increasing"""
    sensor_pose: Array
    """world_T_sensor, of a hand world_T_hand, (N, 3) [m, m, rad]"""
    shape: Shape
    """outline of the object, in the object frame"""
    sensor: SensorProfile
    """size and form of the sensor's tip, its rate, and the height and width of its images; of a hand `hand.whole`"""
    object_pose: Array | None = None
    """world_T_object, (N, 3) [m, m, rad]: ground truth; a row is NaN where it is not known"""
    contact: Flags | None = None
    """(N,) true while the sensor touches the object; None if only images show it"""
    image: Sequence[bytes] | None = None
    """N encoded touch images; iterating over the recording decodes them one by one"""
    source: str = ""
    """origin of the data, for people"""
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)
    """further data of each frame by name, (N, ...) numbers or booleans each, NaN where not known"""
    first_pose: Array | None = None
    """world_T_object at the start (3,) [m, m, rad] as the object was placed, by default the first of ground truth; None
    if neither is known"""
    first_pose_sigma: Array | None = None
    """standard deviations of the first pose (3,) [m, m, rad] in the object's frame"""
    set_up_sigma: Array | None = None
    """standard deviations of the constant offset between sensor, world and outline (3,) [m, m, rad], zeros if they are
    exact; None stands for those of a usual set-up, `noise.sensor_pose.calibration`"""
    is_view_known: bool = False
    """true if `orientation` said how images lay, so that they are upright for sure; otherwise tracking doubts it"""
    warnings: tuple[str, ...] = ()
    """warnings of its import, which `palpate info` and the summary of a run repeat"""
    file: Path | None = None
    """the file it was read from; errors name it"""
    hand: Hand | None = None
    """the hand, None for one sensor; its `image` is None, and what follows is by name of finger"""
    images: Mapping[str, Sequence[bytes]] | None = None
    """N encoded touch images of each finger, of no bytes in frames without a new one"""
    contacts: Mapping[str, Flags] | None = None
    """(N,) true while a finger touches the object; `contact` is true while any does"""
    finger_poses: Mapping[str, Array] | None = None
    """world_T_finger, (N, 3) [m, m, rad], of fingers that move in the hand, in place of their mounts"""
    image_times: Mapping[str, Array] | None = None
    """(N,) times [s] at which images were taken, where they are not those of the frames"""
    is_shape_known: bool = True
    """false if `shape` only takes the place of an outline that nobody knows"""

    def __post_init__(self) -> None:
        if not isinstance(self.shape, Shape):
            raise FileError(f"shape: found {self.shape!r}, expected an outline, which palpate.load_shape reads")
        self._settle("sensor", known_sensor(self.sensor) if self.hand is None else self.hand.whole)
        self._settle("time", checks.checked_times(self.time))
        n = len(self.time)
        self._settle("sensor_pose", checks.checked_poses("sensor_pose", self.sensor_pose, n))
        if self.object_pose is not None:
            self._settle("object_pose", checks.checked_poses("object_pose", self.object_pose, n, may_be_unknown=True))
        self._settle("warnings", tuple(map(str, self.warnings)))
        self._settle_start()
        self._settle_fingers(n)
        if self.contact is not None:
            contact = checks.checked_array("contact", self.contact, checks.FLAGS, (n,))
            self._settle("contact", contact.astype(np.bool_))
        if self.image is not None:
            self._settle("image", fingers.checked_images(self.image, n, self.sensor))
        for name, value in self.extra.items():
            size = value.shape[1:] if isinstance(value, np.ndarray) else ()
            checks.checked_array(f"extra/{name}", value, ("fiub", "numbers or booleans"), (n, *size))
        self._settle("extra", {name: np.asarray(value) for name, value in self.extra.items()})

    def _settle(self, name: str, value: Any) -> None:
        """Set a field of this frozen class, once it is checked."""
        object.__setattr__(self, name, value)

    def _settle_fingers(self, count: int) -> None:
        """Check what belongs to the fingers of a hand, for `count` frames."""
        if self.hand is not None and self.image is not None:
            raise FileError("image: found images of one sensor for a hand; allowed are images by name of finger")
        for name, values in fingers.settled(self.hand, self._of_fingers, count).items():
            self._settle(name, values)
        if self.contact is None and self.contacts:
            self._settle("contact", np.any(list(self.contacts.values()), axis=0))

    @property
    def _of_fingers(self) -> dict[str, Mapping[str, Any]]:
        """Fields that hold values by name of finger, without those that are not known."""
        return {name: vars(self)[name] for name in fingers.FIELDS if vars(self)[name] is not None}

    def _settle_start(self) -> None:
        """Check the first pose and the standard deviations; the default of the first pose is ground truth."""
        for name, least in (("first_pose", -checks.FARTHEST), ("first_pose_sigma", 1e-9), ("set_up_sigma", 0.0)):
            given = getattr(self, name)
            if given is None:
                continue
            numbers = checks.checked_array(name, given, checks.NUMBERS, (3,)).astype(np.float64)
            if not (numbers >= least).all() or not checks.are_in_range(numbers).all():
                raise FileError(f"{name}: found {numbers.tolist()}, allowed are {least:g} to {checks.FARTHEST:g}")
            self._settle(name, numbers)
        if self.first_pose_sigma is not None and self.first_pose is None:
            raise FileError("first_pose_sigma: found one without a first_pose; allowed is one with it")
        is_known = np.isfinite(self.truth[:, 0])
        if self.first_pose is None and is_known.any():
            self._settle("first_pose", self.truth[np.argmax(is_known)].copy())
            self._settle("first_pose_sigma", np.array(FirstPoseSettings().truth))

    @classmethod
    def from_arrays(
        cls,
        image_time: ArrayLike | Mapping[str, ArrayLike],
        images: Images | Mapping[str, Images] | None,
        pose_time: ArrayLike,
        poses: ArrayLike,
        shape: Shape,
        sensor: SensorProfile | str | Hand,
        *,
        orientation: str = Placement.orientation,
        sensor_T_gel: ArrayLike | None = Placement.sensor_T_gel,
        time_offset: float = Placement.time_offset,
        plane: Normal = Placement.plane,
        off_plane: float = Placement.off_plane,
        object_poses: ArrayLike | None = None,
        object_time: ArrayLike | None = None,
        contact: ArrayLike | Mapping[str, ArrayLike] | None = None,
        codec: Codec = "jpeg",
        source: str = "arrays",
    ) -> "Recording":
        """Return a recording made from images and poses that have times of their own.

        Each image makes a frame, with the sensor's pose interpolated between the poses before and after it; a warning
        says how many images are left out because no pose is known at their time. Times are seconds (floats) or
        nanoseconds (integers), all by one clock. Poses are rows (x, y, theta) [m, m, rad], (x, y, z, qx, qy, qz, qw) or
        4x4 matrices, in one frame of the world, NaN where unknown. Raises FileError or SettingError that names the
        argument.

        - image_time, images: times (N,), increasing, and arrays of uint8 (N, height, width, 3), RGB, encoded JPEG or
          PNG (bytes), or paths of files. Without images (None), `contact` is needed. Multiples of the sensor's size are
          scaled down.
        - orientation: words with commas on how images lie: upright, or 90, 180 or 270, the degrees counter-clockwise
          that make them upright; mirrored; and the order of channels, such as bgr. Without it tracking doubts it.
        - pose_time, poses: times (M,) and poses of the sensor, or of the part of a robot that carries it.
        - sensor_T_gel: pose of the gel's frame in the frame of `poses`: origin at the apex of the gel, x out of it, y
          along the columns of an image. None if `poses` are the gel's own.
        - time_offset: added to the times of the images [s]: negative if they are stamped late.
        - plane, off_plane: normal of the plane of the push in the frame of the poses, or "fit" for the plane through
          the sensor's path; largest distance of poses from it [m].
        - object_poses, object_time: ground truth (K, ...), NaN where unknown, and its times, by default `pose_time`.
        - contact: (N,) True for each image in which the sensor touches the object.
        - sensor: a `palpate.Hand` makes a recording of its fingers. Then `images`, and `contact` if it is given, are
          dictionaries by finger, `image_time` may be one, and `poses` and `sensor_T_gel` are those of the hand's frame.
          Frames are the images of the finger that has most, at the times of which all others are sought.
        - codec, source: encoding of arrays, "jpeg" at quality 95 or "png", lossless; origin of the data, for people.
        """
        placement = Placement(orientation, sensor_T_gel, time_offset, plane, off_plane)  # pyright: ignore[reportArgumentType]
        poses_of_gel = onto_gel(placement)
        check_outline(shape)
        name = "from_arrays" if source == "arrays" else source

        def placed(time: Times) -> tuple[Placed, Placed | None]:
            sensor_poses = poses_of_gel(placed_from("poses", poses, "pose_time", pose_time, time))
            return sensor_poses, truth_from(object_poses, pose_time if object_time is None else object_time, time)

        if isinstance(sensor, Hand):
            with kept_warnings() as warnings:
                given = of_fingers(sensor, image_time, images, contact, time_offset)
                fields, _ = hand_fields(name, "world", given, placed, placement, sensor, codec)
            return cls(**fields, shape=shape, source=source, warnings=tuple(warnings))
        if isinstance(image_time, Mapping) or isinstance(images, Mapping) or isinstance(contact, Mapping):
            raise FileError("images: found values by finger for one sensor; allowed are those of a palpate.Hand")
        sensor = known_sensor(sensor)
        time = nanoseconds("image_time", image_time, least=1e-3)
        given_images, flags = _images_and_contact(images, contact, len(time), sensor)
        with kept_warnings() as warnings:
            is_in_order = in_order("image_time", time, is_strict=True)
            time[is_in_order] = without_step("image_time", time[is_in_order], nanoseconds("pose_time", pose_time))
            time = time + round(time_offset * 1e9)
            sensor_poses, truth = placed(time)
            sensor_poses = replace(sensor_poses, known=sensor_poses.known & is_in_order)
            named_images = None if given_images is None else ("images", given_images)
            frames = SpatialFrames(time, sensor_poses, truth, named_images, flags)
            fields, _ = planar_fields(name, "world", frames, placement, sensor, codec)
        return cls(**fields, shape=shape, source=source, warnings=tuple(warnings))

    def oriented(self, orientation: str) -> "Recording":
        """Return the recording with its images turned; see `from_arrays`. Raises FileError and SettingError."""
        view = camera_view(orientation)
        size = (self.sensor.image_height, self.sensor.image_width)
        images = self.image and tuple(turned_image(image, size, view) for image in self.image)
        return replace(self, image=images, is_view_known=self.is_view_known or view.is_stated)

    def moved_onto_gel(self, sensor_T_gel: ArrayLike) -> "Recording":
        """Return the recording with the gel at a pose in the frame of its sensor poses; see `from_arrays`."""
        return replace(self, sensor_pose=se2.compose(self.sensor_pose, gel_pose(np.zeros(3), sensor_T_gel)))

    def warned(self, warnings: Sequence[str]) -> "Recording":
        """Return the recording with further warnings of its import, each once."""
        return replace(self, warnings=tuple(dict.fromkeys([*self.warnings, *warnings])))

    def until(self, count: int) -> "Recording":
        """Return the first `count` frames."""
        names = ("time", "sensor_pose", "object_pose", "contact", "image")
        fields: dict[str, Any] = {name: vars(self)[name][:count] for name in names if vars(self)[name] is not None}
        for name, values in self._of_fingers.items():
            fields[name] = {finger: each[:count] for finger, each in values.items()}
        extra = {name: value[:count] for name, value in self.extra.items()}
        return replace(self, **fields, extra=extra)

    @property
    def truth(self) -> Array:
        """Ground truth, (N, 3) [m, m, rad]; NaN where it is not known."""
        if self.object_pose is None:
            return np.full((len(self), 3), np.nan)
        return self.object_pose

    def tips(self) -> list[tuple[SensorProfile, Array]]:
        """Return the sensor with its poses (N, 3), or each finger of a hand with its own, as stated."""
        if self.hand is None:
            return [(self.sensor, self.sensor_pose)]
        poses = self.hand.poses(self.sensor_pose, self.finger_poses)
        return [(finger, poses[name]) for name, finger in self.hand.fingers.items()]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: int) -> Frame:
        """The frame at `index`, its image decoded. Raises FileError if the image is damaged."""
        truth = None
        if self.object_pose is not None and not np.isnan(self.object_pose[index]).any():
            truth = self.object_pose[index]
        image = None
        if self.image is not None:
            with in_file(f"{self.file or 'recording'}: image of frame {index % len(self)}"):
                image = decode_image(self.image[index], (self.sensor.image_height, self.sensor.image_width))
        said = {}
        if self.hand is not None:
            said = fingers.at_frame(self.hand, self._of_fingers, index, str(self.file or "recording"))
        return Frame(
            time=float(self.time[index]),
            sensor_pose=self.sensor_pose[index],
            image=image,
            contact=None if self.contact is None or self.hand is not None else bool(self.contact[index]),
            object_pose=truth,
            **said,
        )

    def __iter__(self) -> Iterator[Frame]:
        return (self[index] for index in range(len(self)))


def _images_and_contact(
    images: Images | None, contact: ArrayLike | None, count: int, sensor: SensorProfile
) -> tuple[Any, Flags | None]:
    """Return the images of `from_arrays` as a sequence, and contact flags (N,), each None if not given.

    Raises FileError unless there are `count` of each that is given, and at least one of both.
    """
    if isinstance(images, str | bytes | Path):
        raise FileError(f"images: found {str(images)[:60]!r}, expected N arrays, encoded images or paths of files")
    if images is not None and not sensor.image_height:
        raise FileError(f"images: found images, but the sensor {sensor.name!r} has none")
    if isinstance(images, Set):
        raise FileError("images: found a set, which has no order, expected N images in that of their times")
    is_indexed = hasattr(images, "__len__") and hasattr(images, "__getitem__") and not hasattr(images, "iloc")
    if images is not None and not is_indexed:  # a generator, or a column of pandas, which has numbers of its own
        images = list(images)
    if images is not None and len(images) != count:
        raise FileError(f"images: found {len(images)} images for {count} times, expected one for each")
    flags = None if contact is None else checks.checked_array("contact", contact, checks.FLAGS, (count,))
    if images is None and flags is None:
        raise FileError("images: found None, and no contact; a recording needs one of them")
    return images, flags


def contact_flags(gap: Array, touch: float, release: float) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m]: contact begins below `touch` and ends above `release`.

    While a gap is in between or NaN the flag stays as it was; it is false until a gap is outside of both.
    """
    begins = gap < touch
    ends = gap > release
    last_change = np.maximum.accumulate(np.where(begins | ends, np.arange(len(gap)), -1))
    return begins[last_change] & (last_change >= 0)
