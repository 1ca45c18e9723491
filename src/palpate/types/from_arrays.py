"""A recording from arrays: each image with the pose that the sensor had when it was taken."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from palpate.checks import FLAGS, NUMBERS, checked_array
from palpate.errors import FileError, SettingError
from palpate.files import existing_file
from palpate.geometry.shapes import Shape
from palpate.types.images import Codec, codec_of, decode_image, encode_image
from palpate.types.motion import Placed, Times, always, at_times, poses_in_time
from palpate.types.plane import STEEPEST, Normal, Plane, checked_choices, chosen_plane, planar
from palpate.types.recording import Images, Recording
from palpate.types.sensor import SensorProfile
from palpate.types.units import check_degrees, check_metres, check_outline, nanoseconds

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


def recording_from_arrays(
    images: tuple[ArrayLike, Images | None],
    poses: tuple[ArrayLike, ArrayLike],
    shape: Shape,
    sensor: SensorProfile,
    sensor_T_gel: ArrayLike | None,
    time_offset: float,
    plane: Normal,
    off_plane: float,
    truth: tuple[ArrayLike, ArrayLike] | None,
    contact: ArrayLike | None,
    codec: Codec,
    source: str,
) -> Recording:
    """See `Recording.from_arrays`; images, poses and truth come with their times."""
    plane = checked_choices(plane, off_plane, time_offset)
    if not isinstance(shape, Shape):
        raise SettingError(f"shape is {shape!r}; it must be an outline, which palpate.load_shape reads from a file")
    check_outline(shape)
    taken = _image_times(images[0])
    given = _checked_images(images[1], len(taken), sensor)
    flags = None if contact is None else checked_array("contact", contact, FLAGS, (len(taken),))
    if given is None and flags is None:
        raise FileError("images: found None, and no contact; a recording needs one of them")

    time = taken + round(time_offset * 1e9)
    placed = _sensor_at(time, *poses, sensor_T_gel, np.array([0.0, 0.0, 1.0] if plane == "fit" else plane))
    keep = placed.known
    if left_out := int(np.count_nonzero(~keep)):
        logger.warning("from_arrays: %d of %d images have no pose at their time and are left out", left_out, len(time))
    time, placed = time[keep], placed[keep]
    flat = chosen_plane("from_arrays", plane, "world", placed)
    sensor_pose = planar("the sensor (poses)", flat, time, placed, off_plane)
    shifted = f", images shifted by {time_offset:+g} s" if time_offset else ""
    frames = {"sensor_pose": f"as given, interpolated; {flat}{shifted}"}
    object_pose = None
    if truth is not None:
        object_pose = _truth_at(time, *truth, flat, off_plane)
        frames["object_pose"] = "as given, likewise"
    kept = None
    if given is not None:
        chosen = [given[index] for index in np.flatnonzero(keep).tolist()]
        kept, codec = _encoded_images(chosen, codec, (sensor.image_height, sensor.image_width))
    return Recording(
        time=time / 1e9,
        sensor_pose=sensor_pose,
        shape=shape,
        sensor=sensor,
        object_pose=object_pose,
        contact=None if flags is None else flags[keep],
        image=kept,
        codec=codec,
        source=source,
        frames=frames,
    )


def _image_times(given: ArrayLike) -> Times:
    taken = nanoseconds("image_time", given)
    if (step := np.diff(taken) <= 0).any():
        again = int(np.argmax(step)) + 1
        raise FileError(
            f"image_time: image {again} is of {taken[again] * 1e-9:.3f} s, and the one before of "
            f"{taken[again - 1] * 1e-9:.3f} s; times must increase"
        )
    return taken


def _checked_images(images: Any, count: int, sensor: SensorProfile) -> Any:
    if isinstance(images, str | bytes | Path):
        if not isinstance(images, bytes) and Path(images).is_dir():
            files = f"sorted(Path({str(images)!r}).glob('*.png'))"
            raise FileError(f"images: {str(images)!r} is a folder; give its files, {files}")
        found = str(images)[:60]
        raise FileError(f"images: found {found!r} alone, expected N arrays, encoded images or paths of files")
    if images is not None and not sensor.image_height:
        raise FileError(f"images: found images, but the sensor {sensor.name!r} has none")
    if images is not None and len(images) != count:
        raise FileError(f"images: found {len(images)} images for {count} times, expected one for each")
    return images


def _encoded_images(images: Sequence[Any], codec: Codec, size: tuple[int, int]) -> tuple[tuple[bytes, ...], Codec]:
    """Return images of this size (rows, columns) as encoded bytes, and their codec; bytes and files stay as they are.

    Raises FileError that names the first image that does not fit.
    """
    data = tuple(_encoded(index, image, codec, size) for index, image in enumerate(images))
    for index, each in enumerate(data):
        if (kind := codec_of(each)) is None:
            raise FileError(f"images: image {index} is neither JPEG nor PNG; its bytes begin with {each[:8]!r}")
        if index and kind != codec:
            raise FileError(f"images: image {index} is {kind}, those before it are {codec}; expected one of them")
        codec = kind
    try:
        decode_image(data[0], codec, size)
    except FileError as error:
        raise FileError(f"images: image 0: {error}") from error
    return data, codec


def _encoded(index: int, image: Any, codec: Codec, size: tuple[int, int]) -> bytes:
    if isinstance(image, str | Path):
        return existing_file(image).read_bytes()
    if isinstance(image, bytes):
        return image
    pixels = np.asarray(image)
    if pixels.dtype == np.uint8 and pixels.shape == (*size, 3):
        return encode_image(pixels, codec)
    fits = ""
    if pixels.shape == (*size[::-1], 3):
        fits = "; turned by a quarter they fit, np.rot90(image) or np.rot90(image, -1)"
    elif pixels.shape == (3, *size):
        fits = "; colours come last, np.moveaxis(images, 1, -1)"
    elif pixels.dtype.kind == "f" and pixels.shape == (*size, 3):
        to_one = pixels.size and np.nanmax(pixels) <= 1.0
        fits = "; colours from 0 to " + ("1 fit as (255 * images)" if to_one else "255 fit as images")
        fits += ".astype(np.uint8)"
    found = f"images: image {index} is {pixels.dtype} of shape {pixels.shape}"
    raise FileError(f"{found}, the sensor's are uint8 of shape {(*size, 3)}{fits}")


def _sensor_at(
    time: Times, pose_time: ArrayLike, poses: ArrayLike, sensor_T_gel: ArrayLike | None, up: Array
) -> Placed:
    """Return the gel's poses at times (N,) [ns]; `up` (3,) is about the normal of the plane.

    Raises FileError where none is known at any time, or quaternions seem to have w first.
    """
    numbers, known_at = _timed("poses", poses, "pose_time", pose_time)
    if not (finite := np.isfinite(numbers).all(axis=1)).all():
        row = int(np.argmin(finite))
        raise FileError(f"poses: pose {row} is {np.asarray(poses)[row].tolist()}, allowed are finite numbers")
    gel = None
    if sensor_T_gel is not None:
        gel = _numbers("sensor_T_gel", [sensor_T_gel])
        check_metres("sensor_T_gel", np.vstack([np.zeros(3), gel[:, :3]]))

    def gel_at(numbers: Array) -> Placed:
        placed = at_times(poses_in_time("poses", "world", known_at, numbers), time)
        if gel is None:
            return placed
        return placed @ always(poses_in_time("sensor_T_gel", "sensor", np.zeros(1, np.int64), gel), len(time))

    placed = gel_at(numbers)
    if not placed.known.any():
        raise FileError(
            f"poses: no pose is known at the time of any image; images are from {time[0] * 1e-9:.3f} to "
            f"{time[-1] * 1e-9:.3f} s, poses from {known_at.min() * 1e-9:.3f} to {known_at.max() * 1e-9:.3f} s; are "
            "both by one clock, and is time_offset in seconds?"
        )
    if np.shape(poses)[1:] == (7,):
        rolled = _largest_roll(placed, up)
        other = _largest_roll(gel_at(numbers[:, [0, 1, 2, 4, 5, 6, 3]]), up)
        if rolled > STEEPEST >= other:
            raise FileError(
                f"poses: the sensor rolls by up to {np.degrees(rolled):.0f} degrees with quaternions as x, y, z, w, "
                f"and by {np.degrees(other):.0f} with them as w, x, y, z: is w first? It has to be last"
            )
    return placed


def _largest_roll(placed: Placed, up: Array) -> float:
    """Return the largest angle [rad] between the gel's z axis and the normal of the plane, upwards or downwards."""
    along = Rotation.from_quat(placed.rotation).apply([0.0, 0.0, 1.0]) @ up / np.linalg.norm(up)
    return float(np.arccos(np.clip(np.abs(along), 0.0, 1.0)).max())


def _truth_at(time: Times, object_time: ArrayLike, object_poses: ArrayLike, plane: Plane, off_plane: float) -> Array:
    """Return the object's poses in the plane (N, 3) at times (N,) [ns], NaN where those around them are not known."""
    numbers, known_at = _timed("object_poses", object_poses, "object_time", object_time)
    is_known = np.isfinite(numbers[:, 0])
    pose = np.full((len(time), 3), np.nan)
    if not is_known.any():
        return pose
    placed = at_times(poses_in_time("object_poses", "world", known_at[is_known], numbers[is_known]), time)
    order = np.argsort(known_at, kind="stable")
    known_at, is_known = known_at[order], is_known[order]
    last = np.clip(np.searchsorted(known_at, time, side="right") - 1, 0, len(is_known) - 1)
    next_ = np.clip(np.searchsorted(known_at, time), 0, len(is_known) - 1)
    placed = replace(placed, known=placed.known & is_known[last] & is_known[next_])
    pose[placed.known] = planar("the object (object_poses)", plane, time[placed.known], placed[placed.known], off_plane)
    return pose


def _timed(name: str, poses: ArrayLike, time_name: str, time: ArrayLike) -> tuple[Array, Times]:
    """Return poses as numbers (N, 7) with their times (N,) [ns]."""
    numbers, known_at = _numbers(name, poses), nanoseconds(time_name, time)
    if len(known_at) != len(numbers):
        raise FileError(f"{name}: found {len(numbers)} poses for {len(known_at)} times, expected one for each")
    return numbers, known_at


def _numbers(name: str, poses: ArrayLike | Sequence[ArrayLike]) -> Array:
    """Return poses of any kind as positions and quaternions x, y, z, w (N, 7); rows that hold NaN become NaN."""
    try:
        given = np.asarray(poses)
    except ValueError as error:
        raise FileError(f"{name}: rows have different lengths") from error
    given = checked_array(name, given, NUMBERS, given.shape).astype(np.float64)
    if given.shape[1:] not in ((3,), (7,), (4, 4)):
        raise FileError(
            f"{name}: found shape {given.shape}, expected (N, 3) of x, y, theta, (N, 7) of x, y, z, qx, qy, qz, qw, or "
            "(N, 4, 4)"
        )
    numbers = np.full((len(given), 7), np.nan)
    good = np.isfinite(given).reshape(len(given), -1).all(axis=1)
    some = given[good]
    if given.shape[1:] == (7,):
        numbers[good] = some
    elif given.shape[1:] == (3,):
        check_degrees(name, some[:, 2])
        half, zero = 0.5 * some[:, 2], np.zeros(len(some))
        numbers[good] = np.column_stack([some[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    else:
        turn = some[:, :3, :3]
        rigid = np.isclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=1e-3).all(axis=(1, 2))
        rigid &= (np.linalg.det(turn) > 0.0) & np.isclose(some[:, 3], [0.0, 0.0, 0.0, 1.0]).all(axis=1)
        if not rigid.all():
            wrong = int(np.argmin(rigid))
            raise FileError(
                f"{name}: matrix {np.flatnonzero(good)[wrong]} is {some[wrong].tolist()}, allowed are a rotation and a "
                "translation, the last row 0, 0, 0, 1"
            )
        numbers[good] = np.column_stack([some[:, :3, 3], Rotation.from_matrix(turn).as_quat()])
    return numbers
