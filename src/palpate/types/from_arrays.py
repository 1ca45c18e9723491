"""Times, poses and images in the forms that `Recording.from_arrays` takes them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import NUMBERS, TURNS, check_metres, check_rows, checked_array, other_time_unit
from palpate.errors import FileError
from palpate.files import existing_file
from palpate.types.images import Codec, codec_of, decode_image, encode_image
from palpate.types.space import STEEPEST, Placed, Plane, Times, always, at_times, poses_in_time, rotations

Array = NDArray[np.float64]


def nanoseconds(name: str, time: ArrayLike, least: float = 2e-4) -> Times:
    """Return times (N,), seconds as floats or nanoseconds as integers, as nanoseconds.

    Raises FileError where they are none, are rounded, or seem to be in another unit: steps are below `least` [s].
    """
    given = checked_array(name, time, NUMBERS, ("N",))
    if not len(given):
        raise FileError(f"{name}: found no times, expected one or more")
    is_whole = given.dtype.kind in "iu"
    check_rows(name, given, np.isfinite(given), "a finite number")
    exact = given.astype(np.int64 if is_whole else np.float64)
    steps, latest = np.abs(np.diff(exact)), np.abs(given).max()
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    is_late = not is_whole and latest > 4e9  # after the year 2096
    if is_late or (step and not least <= step * (1e-9 if is_whole else 1.0) <= 10.0):
        kind = "integers, which are nanoseconds" if is_whole else "floats, which are seconds"
        question = " ".join(filter(None, (other_time_unit(step, rate) for rate in (30.0, 500.0))))
        raise FileError(f"{name}: found {kind}, in the median {step:g} from one to the next; {question}")
    resolution = 0.0 if is_whole else float(np.spacing(latest))
    if resolution > max(0.1 * step, 1e-4):
        raise FileError(
            f"{name}: found times up to {latest:.10g} s in {given.dtype}, which is exact to {resolution:.3g} s there; "
            "give float64, or integers of nanoseconds"
        )
    if (steps == 0).sum() > 0.5 * len(steps):
        raise FileError(
            f"{name}: {(steps == 0).sum()} of {len(given)} times are that before; were they rounded, as float32 rounds "
            "them?"
        )
    return (exact if is_whole else np.round(exact * 1e9)).astype(np.int64)


def encoded_images(images: Sequence[Any], codec: Codec, size: tuple[int, int]) -> tuple[tuple[bytes, ...], Codec]:
    """Return images of this size (rows, columns) as encoded bytes, and their codec; bytes and files stay as they are.

    Raises FileError that names the first image that does not fit.
    """
    data = tuple(_encoded(index, image, codec, size) for index, image in enumerate(images))
    found = codec_of(data[0])
    for index, each in enumerate(data):
        if found is None or codec_of(each) != found:
            raise FileError(f"images: image {index} begins with {each[:8]!r}; expected JPEG or PNG, as the first is")
    assert found is not None
    try:
        decode_image(data[0], found, size)
    except FileError as error:
        raise FileError(f"images: image 0: {error}") from error
    return data, found


def _encoded(index: int, image: Any, codec: Codec, size: tuple[int, int]) -> bytes:
    if isinstance(image, str | Path):
        return existing_file(image).read_bytes()
    if isinstance(image, bytes):
        return image
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8 or pixels.shape != (*size, 3):
        found = f"images: image {index} is {pixels.dtype} of shape {pixels.shape}"
        raise FileError(f"{found}, the sensor's are uint8 of shape {(*size, 3)}: rows, columns, red green blue to 255")
    return encode_image(pixels, codec)


def placed_poses(
    name: str, time_name: str, poses: tuple[ArrayLike, ArrayLike], time: Times, may_be_unknown: bool = False
) -> Placed:
    """Return poses, given with times of their own, at times (N,) [ns]; unknown ones hold NaN."""
    known_at, numbers = nanoseconds(time_name, poses[0]), _numbers(name, poses[1])
    if len(known_at) != len(numbers):
        raise FileError(f"{name}: found {len(numbers)} poses for {len(known_at)} times, expected one for each")
    is_known = np.isfinite(numbers[:, 0])
    if not may_be_unknown:
        check_rows(name, numbers, is_known, "finite numbers")
    return at_times(poses_in_time(name, "world", known_at, numbers), time)


def on_the_gel(sensor: Placed, sensor_T_gel: ArrayLike) -> Placed:
    """Return the poses of the gel from those of the part that carries it."""
    gel = _numbers("sensor_T_gel", [sensor_T_gel])
    check_metres("sensor_T_gel", np.vstack([np.zeros(3), gel[:, :3]]))
    return sensor @ always(poses_in_time("sensor_T_gel", "sensor", np.zeros(1, np.int64), gel), len(sensor.known))


def check_upright(sensor: Placed, plane: Plane) -> None:
    """Raise FileError if a sensor's z axis is far off the plane's normal."""
    upright = np.abs(rotations(sensor.rotation).apply(plane.axes[:, 2], inverse=True)[:, 2])
    if (roll := np.arccos(min(upright.min(), 1.0))) > STEEPEST:
        raise FileError(
            f"poses: the sensor's z axis is up to {np.degrees(roll):.0f} degrees off the plane's normal, allowed are "
            f"{np.degrees(STEEPEST):.0f}: is w the last of each quaternion?"
        )


def _numbers(name: str, poses: ArrayLike | Sequence[ArrayLike]) -> Array:
    """Return poses of any kind as positions and quaternions x, y, z, w (N, 7); rows that hold NaN become NaN."""
    try:
        given = np.asarray(poses)
    except ValueError as error:
        raise FileError(f"{name}: rows have different lengths") from error
    given = checked_array(name, given, NUMBERS, given.shape).astype(np.float64)
    if given.shape[1:] not in ((3,), (7,), (4, 4)):
        allowed = "(N, 3) of x, y, theta, (N, 7) of x, y, z, qx, qy, qz, qw, or (N, 4, 4)"
        raise FileError(f"{name}: found shape {given.shape}, expected {allowed}")
    numbers = np.full((len(given), 7), np.nan)
    good = np.isfinite(given).reshape(len(given), -1).all(axis=1)
    some = given[good]
    if given.shape[1:] == (7,):
        numbers[good] = some
    elif given.shape[1:] == (3,):
        if len(some) and (largest := np.abs(some[:, 2]).max()) > TURNS:
            raise FileError(f"{name}: found angles up to {largest:.4g} rad: are these degrees? np.radians helps")
        half, zero = 0.5 * some[:, 2], np.zeros(len(some))
        numbers[good] = np.column_stack([some[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    else:
        from scipy.spatial.transform import Rotation

        turn = some[:, :3, :3]
        rigid = np.isclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=1e-3).all(axis=(1, 2))
        rigid &= (np.linalg.det(turn) > 0.0) & np.isclose(some[:, 3], [0.0, 0.0, 0.0, 1.0]).all(axis=1)
        check_rows(name, some, rigid, "a rotation and a translation, the last row 0, 0, 0, 1")
        numbers[good] = np.column_stack([some[:, :3, 3], Rotation.from_matrix(turn).as_quat()])
    return numbers
