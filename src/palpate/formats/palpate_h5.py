"""palpate's own recording file, HDF5 (`.h5`): everything that a Recording holds, in its units and frames."""

import io
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import existing_file, whole_file
from palpate.formats.h5_images import H5Images
from palpate.geometry.shapes import shape_from_dict, shape_to_dict
from palpate.recording.recording import Recording
from palpate.recording.sensor import SensorProfile, sensor_from_dict, sensor_to_dict
from palpate.recording.stored_images import IN_MEMORY
from palpate.recording.trajectory import Trajectory

NAME = "palpate"
DESCRIPTION = "palpate recording, HDF5 (.h5)"
FORMAT = "palpate-recording"
VERSION = 1

_OVERHEAD = 1.1
"""Size of a file over that of its images, at most."""


def detect(path: Path) -> bool:
    """Whether the file is HDF5 and says that it is one of these."""
    import h5py

    try:
        if not h5py.is_hdf5(path):
            return False
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format", "") == FORMAT)
    except (OSError, RuntimeError, ValueError, KeyError):
        return False


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
            with h5py.File(temporary, "w") as file:
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
    return _opened(io.BytesIO(data), path)


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
    return _opened(path, path)


def _opened(source: Path | io.BytesIO, path: Path) -> Recording:
    import h5py

    try:
        with h5py.File(source, "r") as file:
            return _read(file, path, lazily=source is path)
    except PalpateError as error:
        raise FileError(f"{path}: {error}") from error
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        raise FileError(f"{path}: is truncated or damaged ({' '.join(str(error).split())})") from error


def _read(file: Any, path: Path, lazily: bool) -> Recording:
    found = file.attrs.get("format", "none")
    if found != FORMAT:
        raise FileError(f"is an HDF5 file of another kind: attribute format is {found!r}, expected {FORMAT!r}")
    version = _attribute(file, "version")
    if not isinstance(version, np.integer) or version < 1:
        raise FileError(f"attribute version: found {version!r}, allowed is 1 to {VERSION}")
    if version > VERSION:
        raise FileError(f"has version {version}, this palpate reads up to version {VERSION}: update palpate")
    sensor = sensor_from_dict(_json(file, "sensor"))
    image, codec = _read_images(file, sensor, path if lazily else None)
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


def _read_images(file: Any, sensor: SensorProfile, path: Path | None) -> tuple[Sequence[bytes] | None, Any]:
    """The images and how they are encoded; those of a file with a path are read when they are asked for."""
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
    images = tuple(row.tobytes() for row in data[:]) if path is None else H5Images(path, "image", len(data))
    return images, _attribute(data, "codec")


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
