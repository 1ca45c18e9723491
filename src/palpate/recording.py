"""Frame and Recording: what a sensor saw and where it was, and the HDF5 file (`.h5`) that keeps it."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import FileError, PalpateError
from palpate.files import (
    FLAGS,
    INTEGERS,
    NUMBERS,
    check_increasing,
    check_rows,
    checked_array,
    existing_file,
    whole_file,
)
from palpate.images import Codec, decode_image
from palpate.sensor import SensorProfile, sensor_from_dict, sensor_to_dict
from palpate.shapes import Shape, shape_from_dict, shape_to_dict

FORMAT = "palpate-recording"
VERSION = 1


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of a recording: all that the estimator is given."""

    time: float
    """[s]"""
    sensor_pose: NDArray[np.float64]
    """world_T_sensor, (3,) [m, m, rad]"""
    image: NDArray[np.uint8] | None = None
    """touch image, (height, width, 3), RGB"""
    contact: bool | None = None
    """whether the sensor touches the object, where the recording knows"""
    object_pose: NDArray[np.float64] | None = None
    """world_T_object, (3,) [m, m, rad]: ground truth, used for scoring and by oracle touch only"""


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
    image: tuple[bytes, ...] | None = None
    """N encoded touch images; iterating over the recording decodes them one by one"""
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
            settle("image", tuple(self.image))
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
        try:
            return decode_image(self.image[index], self.codec, (self.sensor.image_height, self.sensor.image_width))
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


def write_recording(recording: Recording, path: Path | str, overwrite: bool = False) -> None:
    """Write the HDF5 file, whole or not at all; an existing one is replaced only if `overwrite`."""
    import h5py

    with whole_file(path, overwrite) as temporary:
        # In memory first: HDF5 cannot close a file on a full disk.
        with h5py.File(temporary, "w", driver="core", backing_store=False) as file:
            _fill(file, recording)
            file.flush()
            content = file.id.get_file_image()
        temporary.write_bytes(content)


def _fill(file: Any, recording: Recording) -> None:
    import h5py

    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["shape"] = json.dumps(shape_to_dict(recording.shape))
    file.attrs["sensor"] = json.dumps(sensor_to_dict(recording.sensor))
    file.attrs["source"] = recording.source
    file.attrs["frames"] = json.dumps(recording.frames)
    file.attrs["contact_derived"] = recording.contact_derived
    for name in ("time", "sensor_pose", "object_pose", "contact", "episode"):
        if (value := getattr(recording, name)) is not None:
            file[name] = value
    for name, value in recording.extra.items():
        file[f"extra/{name}"] = value
    if recording.image is not None:
        images = file.create_dataset("image", (len(recording),), h5py.vlen_dtype(np.uint8))
        for index, data in enumerate(recording.image):
            images[index] = np.frombuffer(data, np.uint8)
        images.attrs["codec"] = recording.codec
        images.attrs["height"] = recording.sensor.image_height
        images.attrs["width"] = recording.sensor.image_width


def read_recording(path: Path | str) -> Recording:
    """Read a file of `write_recording`. Raises FileError, in one sentence, on anything else."""
    import h5py

    path = existing_file(path)
    if not h5py.is_hdf5(path):
        raise FileError(f"{path}: is not an HDF5 file")
    try:
        with h5py.File(path, "r") as file:
            return _read(file, path)
    except PalpateError as error:
        raise FileError(f"{path}: {error}") from error
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        raise FileError(f"{path}: is truncated or damaged ({' '.join(str(error).split())})") from error


def _read(file: Any, path: Path) -> Recording:
    found = file.attrs.get("format", "none")
    if found != FORMAT:
        raise FileError(f"is an HDF5 file of another kind: attribute format is {found!r}, expected {FORMAT!r}")
    version = _attribute(file, "version")
    if not isinstance(version, np.integer) or version < 1:
        raise FileError(f"attribute version: found {version!r}, allowed is 1 to {VERSION}")
    if version > VERSION:
        raise FileError(f"has version {version}, this palpate reads up to version {VERSION}: update palpate")
    sensor = sensor_from_dict(_json(file, "sensor"))
    image, codec = _read_images(file, sensor)
    return Recording(
        time=_dataset(file, "time"),
        sensor_pose=_dataset(file, "sensor_pose"),
        shape=shape_from_dict(_json(file, "shape")),
        sensor=sensor,
        object_pose=_dataset(file, "object_pose") if "object_pose" in file else None,
        contact=_dataset(file, "contact") if "contact" in file else None,
        episode=_dataset(file, "episode") if "episode" in file else None,
        image=image,
        codec=codec,
        contact_derived=bool(_attribute(file, "contact_derived")),
        source=str(_attribute(file, "source")),
        frames={str(key): str(value) for key, value in _json(file, "frames").items()},
        extra=_read_extra(file),
        file=path,
    )


def _read_extra(file: Any) -> dict[str, Any]:
    import h5py

    if "extra" not in file:
        return {}
    group = file["extra"]
    if not isinstance(group, h5py.Group):
        raise FileError("extra: found a dataset, expected a group of datasets")
    return {str(name): _dataset(group, str(name)) for name in group}


def _read_images(file: Any, sensor: SensorProfile) -> tuple[tuple[bytes, ...] | None, Any]:
    import h5py

    if "image" not in file:
        return None, "jpeg"
    data = file["image"]
    if not isinstance(data, h5py.Dataset) or data.ndim != 1 or h5py.check_vlen_dtype(data.dtype) != np.uint8:
        raise FileError("image: expected one row of variable-length bytes for each frame")
    size = (_attribute(data, "height"), _attribute(data, "width"))
    if size != (sensor.image_height, sensor.image_width):
        raise FileError(
            f"image: height and width are {size[0]} and {size[1]}, the sensor has "
            f"{sensor.image_height} and {sensor.image_width}"
        )
    return tuple(row.tobytes() for row in data[:]), _attribute(data, "codec")


def _dataset(file: Any, name: str) -> Any:
    import h5py

    if not isinstance(file.get(name), h5py.Dataset):
        raise FileError(f"dataset {name} is missing")
    return file[name][()]


def _attribute(node: Any, name: str) -> Any:
    if name not in node.attrs:
        raise FileError(f"attribute {name} is missing")
    return node.attrs[name]


def _json(file: Any, name: str) -> dict[str, Any]:
    try:
        value = json.loads(_attribute(file, name))
    except (ValueError, TypeError) as error:
        raise FileError(f"attribute {name}: is not valid JSON ({error})") from error
    if not isinstance(value, dict):
        raise FileError(f"attribute {name}: found a JSON {type(value).__name__}, expected an object")
    return value
