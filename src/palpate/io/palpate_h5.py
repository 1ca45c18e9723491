"""palpate's own recording file, HDF5 (`.h5`): everything that a Recording holds, in its units and frames."""

import hashlib
import json
import mmap
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import existing_file, json_object, whole_file
from palpate.geometry.shapes import shape_from_dict, shape_to_dict
from palpate.io.hdf5 import SIGNATURE, Contents, read_hdf5
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile, sensor_from_dict, sensor_to_dict
from palpate.types.stored_images import IN_MEMORY
from palpate.types.trajectory import Trajectory

NAME = "palpate"
DESCRIPTION = "palpate recording, HDF5 (.h5)"
FORMAT = "palpate-recording"
VERSION = 1
EXTRA = "extra/"

_OVERHEAD = 1.1
"""Size of a file over that of its images, at most."""


def detect(path: Path) -> bool:
    """Whether the file is HDF5 and somewhere says that it is one of these."""
    if not is_hdf5(path):
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data.find(FORMAT.encode()) >= 0


def read(path: Path) -> Recording:
    """Read it. Raises FileError."""
    return read_recording(path)


def write(data: Recording | Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write a recording. Raises FileError if the file exists and `overwrite` is not set."""
    if not isinstance(data, Recording):
        raise SettingError(f"{path}: a {NAME} file holds a recording, not a trajectory")
    write_recording(data, path, overwrite)


def write_recording(recording: Recording, path: Path | str, overwrite: bool = False) -> None:
    """Write the HDF5 file, whole or not at all; an existing one is replaced only if `overwrite`."""
    import h5py

    size = sum(map(len, recording.image or ()))
    with whole_file(path, overwrite) as temporary:
        # In memory first, as HDF5 cannot close a file on a full disk; what is large goes there as it comes, if it fits.
        if size <= IN_MEMORY:
            temporary.write_bytes(recording_to_bytes(recording))
        elif (free := shutil.disk_usage(temporary.parent).free) < _OVERHEAD * size:
            raise OSError(f"it takes {_OVERHEAD * size / 1e9:.1f} GB, {free / 1e9:.1f} are free")
        else:
            with h5py.File(temporary, "w", locking=False) as file:  # `whole_file` holds the lock
                _fill(file, recording)


def recording_to_bytes(recording: Recording) -> bytes:
    """What the HDF5 file of a recording holds."""
    import h5py

    with h5py.File("recording.h5", "w", driver="core", backing_store=False) as file:
        _fill(file, recording)
        file.flush()
        return file.id.get_file_image()


def recording_from_bytes(data: bytes, path: Path) -> Recording:
    """Return the recording of `recording_to_bytes`; errors name `path`. Raises FileError."""
    return _opened(data, path)


def _fill(file: Any, recording: Recording) -> None:
    import h5py

    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["shape"] = json.dumps(shape_to_dict(recording.shape))
    file.attrs["sensor"] = json.dumps(sensor_to_dict(recording.sensor))
    file.attrs["source"] = recording.source
    file.attrs["frames"] = json.dumps(recording.frames)
    file.attrs["contact_derived"] = recording.contact_derived
    names = ("time", "sensor_pose", "object_pose", "first_pose", "first_pose_sigma", "contact", "episode")
    arrays = {name: value for name in names if (value := getattr(recording, name)) is not None}
    arrays |= {EXTRA + name: value for name, value in recording.extra.items()}
    for name, value in arrays.items():
        file[name] = value
    if recording.image is not None:
        images = file.create_dataset("image", (len(recording),), h5py.vlen_dtype(np.uint8))
        for index, data in enumerate(recording.image):
            images[index] = np.frombuffer(data, np.uint8)
        images.attrs["codec"] = recording.codec
        images.attrs["height"] = recording.sensor.image_height
        images.attrs["width"] = recording.sensor.image_width
    file.attrs["checksum"] = _checksum(arrays, recording.image or ())


def _checksum(arrays: Mapping[str, NDArray[Any]], images: Iterable[bytes]) -> str:
    """The SHA-256 of all values and images; a recording has it as attribute checksum."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).data)
    for image in images:
        digest.update(f"image {len(image)}\n".encode())
        digest.update(image)
    return digest.hexdigest()


def read_recording(path: Path | str) -> Recording:
    """Read a file of `write_recording`. Raises FileError, in one sentence, on anything else."""
    path = existing_file(path)
    if not is_hdf5(path):
        raise FileError(f"{path}: is not an HDF5 file")
    return _opened(path, path)


def source_of(path: Path) -> str:
    """Where the data of a recording come from, in words. Raises FileError, also where they are not as written."""
    try:
        file = read_hdf5(path)
        now = _checksum(file.arrays, file.rows.get("image", ()))
        if file.attributes.get("checksum", now) != now:  # earlier versions wrote none
            raise FileError("is damaged: its values are not those that were written")
        return str(_attribute(file.attributes, "source"))
    except FileError as error:
        raise FileError(f"{path}: {error}") from error


def is_hdf5(path: Path) -> bool:
    """Whether a file begins as HDF5 does."""
    try:
        with path.open("rb") as file:
            return file.read(len(SIGNATURE)) == SIGNATURE
    except OSError:
        return False


def _opened(source: Path | bytes, path: Path) -> Recording:
    try:
        return _read(read_hdf5(source), path)
    except PalpateError as error:
        raise FileError(f"{path}: {error}") from error


def _read(file: Contents, path: Path) -> Recording:
    found = file.attributes.get("format", "none")
    if found != FORMAT:
        raise FileError(f"is an HDF5 file of another kind: attribute format is {found!r}, expected {FORMAT!r}")
    version = _attribute(file.attributes, "version")
    if type(version) is not int or version < 1:
        raise FileError(f"attribute version: found {version!r}, allowed is 1 to {VERSION}")
    if version > VERSION:
        raise FileError(f"has version {version}, this palpate reads up to version {VERSION}: update palpate")
    if "extra" in file.arrays:
        raise FileError("extra: found a dataset, expected a group of datasets")
    sensor = sensor_from_dict(_json(file, "sensor"))
    image, codec = _images(file, sensor)
    return Recording(
        time=_dataset(file, "time"),
        sensor_pose=_dataset(file, "sensor_pose"),
        shape=shape_from_dict(_json(file, "shape")),
        sensor=sensor,
        object_pose=file.arrays.get("object_pose"),
        first_pose=file.arrays.get("first_pose"),
        first_pose_sigma=file.arrays.get("first_pose_sigma"),
        contact=file.arrays.get("contact"),
        episode=file.arrays.get("episode"),
        image=image,
        codec=codec,
        contact_derived=bool(_attribute(file.attributes, "contact_derived")),
        source=str(_attribute(file.attributes, "source")),
        frames={str(key): str(value) for key, value in _json(file, "frames").items()},
        extra={name.removeprefix(EXTRA): value for name, value in file.arrays.items() if name.startswith(EXTRA)},
        file=path,
    )


def _images(file: Contents, sensor: SensorProfile) -> tuple[Sequence[bytes] | None, Any]:
    if "image" in file.arrays:
        raise FileError("image: expected one row of variable-length bytes for each frame")
    if "image" not in file.rows:
        return None, "jpeg"
    attached = file.attached["image"]
    size = (_attribute(attached, "height"), _attribute(attached, "width"))
    if size != (sensor.image_height, sensor.image_width):
        raise FileError(
            f"image: height and width are {size[0]} and {size[1]}, the sensor has "
            f"{sensor.image_height} and {sensor.image_width}"
        )
    return file.rows["image"], _attribute(attached, "codec")


def _dataset(file: Contents, name: str) -> Any:
    if name not in file.arrays:
        raise FileError(f"dataset {name} is missing")
    return file.arrays[name]


def _attribute(attributes: dict[str, Any], name: str) -> Any:
    if name not in attributes:
        raise FileError(f"attribute {name} is missing")
    return attributes[name]


def _json(file: Contents, name: str) -> dict[str, Any]:
    return json_object(str(_attribute(file.attributes, name)), f"attribute {name}")
