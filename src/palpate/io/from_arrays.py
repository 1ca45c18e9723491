"""Times, poses and images as users have them, and the fields of a `Recording` in a plane that are made of them."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array, Flags, Image
from palpate.checks import NUMBERS, as_array, check_rows, checked_array, other_time_unit
from palpate.errors import FileError
from palpate.files import counting_order, existing_file
from palpate.io.time_order import UNKNOWN, are_few, in_order, without_step
from palpate.types import space
from palpate.types.choices import Placement
from palpate.types.images import (
    CameraView,
    Codec,
    camera_view,
    checked_pixels,
    decode_image,
    encode_image,
    fitted,
    turned_image,
)
from palpate.types.sensor import SensorProfile
from palpate.types.space import Placed, Plane, Times

logger = logging.getLogger(__name__)


def nanoseconds(name: str, time: ArrayLike, least: float = 2e-4) -> Times:
    """Return times (N,), seconds as floats or nanoseconds as integers, as nanoseconds; a few that are NaN are UNKNOWN.

    Raises FileError if they are no times, are rounded, or seem to be in another unit, as the median step is below
    `least` [s].
    """
    given = as_array(name, time)
    if given.dtype.kind == "O" and given.ndim == 1 and len(given):
        given = _of_calendar(name, given)
    if given.dtype.kind in "mM":  # NumPy's dates and durations
        given = given.astype(f"{given.dtype.kind}8[ns]").astype(np.int64)
    given = checked_array(name, given, NUMBERS, ("N",))
    if not len(given):
        raise FileError(f"{name}: found no times, expected one or more")
    is_whole = given.dtype.kind in "iu"
    is_known = np.isfinite(given)
    if not is_known.any() or not are_few(int((~is_known).sum()), len(given)):
        check_rows(name, given, is_known, "a finite number")
    found = np.full(len(given), UNKNOWN)
    given = given[is_known]
    exact = given.astype(np.int64 if is_whole else np.float64)
    steps = np.abs(np.diff(exact))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    latest = float(np.median(np.abs(given)))  # one that is far ahead costs itself
    _check_unit(name, step, latest, is_whole, least)
    if not is_whole:
        _check_resolution(name, given, step, latest)
        if len(steps) > 2 and (steps == 1.0).all() and (given == np.round(given)).all():
            logger.warning("%s: times are whole seconds, one apart; are these numbers of frames?", name)
    if (steps == 0).sum() > 0.5 * len(steps):
        raise FileError(
            f"{name}: {(steps == 0).sum()} of {len(given)} times are that before; were they rounded, as float32 rounds "
            "them, or are these of two bodies?"
        )
    found[is_known] = exact if is_whole else np.round(np.clip(exact, -9e9, 9e9) * 1e9)
    return found


def _of_calendar(name: str, time: NDArray[Any]) -> NDArray[Any]:
    """Return dates or durations of Python (N,) as those of NumPy, in UTC; anything else as it is."""
    if all(isinstance(each, timedelta) for each in time):
        return time.astype("m8[ns]")
    if not all(isinstance(each, datetime) for each in time):
        return time
    in_utc = [each.astimezone(UTC).replace(tzinfo=None) if each.tzinfo else each for each in time]
    return np.array(in_utc, "M8[ns]")


def _check_unit(name: str, step: float, latest: float, is_whole: bool, least: float) -> None:
    """Raise FileError if the median step or the latest time are implausible: integers are [ns], floats [s]."""
    unit = 1e-9 if is_whole else 1.0
    farthest = 2.0**62 if is_whole else 4e9  # after the year 2096
    if latest <= farthest and (not step or least <= step * unit <= 10.0):
        return
    kind = "integers, which are nanoseconds" if is_whole else "floats, which are seconds"
    questions = [other_time_unit(step, rate) for rate in (30.0, 500.0)]
    question = " ".join(text for text in questions if text) or "are all in one?"
    raise FileError(f"{name}: found {kind}, in the median {step:g} from one to the next; {question}")


def _check_resolution(name: str, time: NDArray[Any], step: float, latest: float) -> None:
    """Raise FileError if floats (N,) [s] are too coarse for their median step, also if they once were float32."""
    kind = time.dtype.type
    if kind is np.float64 and (time.astype(np.float32) == time).all():
        kind = np.float32
    resolution = float(np.spacing(kind(latest)))
    if resolution > max(0.1 * step, 1e-4):
        raise FileError(
            f"{name}: found times up to {latest:.10g} s as {kind.__name__} has them, exact to {resolution:.3g} s; "
            "give float64 from the start, or integers of nanoseconds"
        )


def encoded_images(
    name: str, images: Any, indices: Sequence[int], size: tuple[int, int], orientation: str, codec: Codec
) -> tuple[bytes, ...]:
    """Return some images, fitted to a size (rows, columns), as encoded bytes; bytes stay as they are.

    In place of an image there may be the error on it, or None. That, an encoded image that is damaged, and pixels that
    do not fit become empty bytes, a frame that tracking skips. Raises FileError, which names the image, if none of the
    images that are looked at can be used.
    """
    from palpate.touch.background import warn_if_bordered, warn_if_grey, warn_if_squeezed

    _warn_if_sorted_as_texts(name, images)
    view = camera_view(orientation)
    interval = len(indices) // 10 + 1  # about ten images are looked at
    encoded: list[bytes] = []
    damage: list[str] = []
    unencoded: dict[int, Image] = {}  # pixels by number, since JPEG removes the noise that shows squeezing
    for number, index in enumerate(indices):
        image = images[index]
        try:
            pixels = _upright_pixels(image, size, view)
            if pixels is None:
                encoded.append(turned_image(_bytes_of(image), size, view))
                continue
            encoded.append(encode_image(pixels, codec))
            if number % interval == 0:
                unencoded[number] = pixels
        except FileError as error:
            damage.append(f"image {index}: {error}")
            encoded.append(b"")
    samples: list[Image] = []
    numbers = [number for number, data in enumerate(encoded) if data] or [0]
    for number in numbers[::interval]:
        try:
            samples.append(unencoded[number] if number in unencoded else decode_image(encoded[number], size))
        except FileError as error:
            damage.append(f"image {indices[number]}: {error}")
    if not samples:
        raise FileError(f"{name}: {damage[0]}")
    empty = encoded.count(b"")
    if empty:
        first_damage = damage[0] if damage else "it is empty"
        logger.warning("%s: %d of %d images are left out: %s", name, empty, len(encoded), first_damage)
    warn_if_squeezed(samples, name)
    warn_if_bordered(samples, name)
    warn_if_grey(samples, name)
    return tuple(encoded)


def _warn_if_sorted_as_texts(name: str, images: Any) -> None:
    """Warn of a list of paths in which 10 comes before 2."""
    if not isinstance(images, list):
        return
    paths = [str(image) for image in images if isinstance(image, str | Path)]
    if paths == sorted(paths) and paths != sorted(paths, key=counting_order):
        logger.warning("%s: the paths are sorted as texts, in which 10 comes before 2; are the images in order?", name)


def _upright_pixels(image: Any, size: tuple[int, int], view: CameraView) -> Image | None:
    """Return an array of pixels, fitted to a size in a view; None for paths, errors and encoded images."""
    if image is None or isinstance(image, str | Path | bytes | FileError):
        return None
    array = as_array("pixels", image)
    if array.dtype == np.uint8 and array.size <= len(array):  # encoded bytes, as OpenCV and messages have them
        return None
    return fitted(checked_pixels(array), size, view)


def _bytes_of(image: Any) -> bytes:
    """Return the bytes of an encoded image, an array of them, or a file.

    Raises FileError, also if it is given one, or None.
    """
    if isinstance(image, FileError):
        raise image
    if image is None:
        raise FileError("is None")
    if isinstance(image, bytes):
        return image
    if isinstance(image, str | Path):
        return existing_file(image).read_bytes()
    return as_array("pixels", image).tobytes()


def placed_from(name: str, poses: ArrayLike, time_name: str, time: ArrayLike, wanted: Times) -> Placed:
    """Return poses, given with times of their own, at other times [ns]; poses with NaN are unknown."""
    given_time = nanoseconds(time_name, time)
    numbers = space.pose_numbers(name, poses)
    if len(given_time) != len(numbers):
        raise FileError(f"{name}: found {len(numbers)} poses for {len(given_time)} times, expected one for each")
    keep = in_order(time_name, given_time)
    return space.placed_at(name, without_step(time_name, given_time[keep], wanted), numbers[keep], wanted)


def truth_from(object_poses: ArrayLike | None, object_time: ArrayLike, wanted: Times) -> Placed | None:
    """Return true poses at times [ns]; None if there are none, or all are NaN."""
    if object_poses is None:
        return None
    given = as_array("object_poses", object_poses)
    if given.dtype.kind == "f" and np.isnan(given).all():
        return None
    try:
        return placed_from("object_poses", given, "object_time", object_time, wanted)
    except space.NoneKnown as error:
        logger.warning("%s; there is no ground truth", error)
        return None


@dataclass(frozen=True, eq=False)
class SpatialFrames:
    """N frames whose poses are given in space."""

    time: Times
    """(N,) [ns]"""
    sensor: Placed
    """Poses of the sensor."""
    truth: Placed | None = None
    """Poses of the object; None if they are unknown."""
    images: tuple[str, Any] | None = None
    """Name of the images for errors, and N images; None if there are none."""
    contact: Flags | None = None
    """(N,) contact flags; None if only images show contact."""

    def __getitem__(self, keep: Flags) -> "SpatialFrames":
        """Return the frames that are flagged (N,), with all images."""
        return replace(
            self,
            time=self.time[keep],
            sensor=self.sensor[keep],
            truth=None if self.truth is None else self.truth[keep],
            contact=None if self.contact is None else self.contact[keep],
        )


def planar_fields(
    name: str,
    frame: str,
    frames: SpatialFrames,
    placement: Placement,
    sensor: SensorProfile,
    codec: Codec = "jpeg",
) -> tuple[dict[str, Any], Plane]:
    """Return frames in space as fields of a `Recording` in a plane, all but its shape and names, and the plane.

    A warning says how many frames without a sensor pose are left out.

    The plane "fit" is fitted to the frames in contact, by their flags or as images show it. `name` stands for the
    recording in errors, and `frame` is that of the poses. Raises FileError.
    """
    is_known = frames.sensor.known
    _check_known(name, frames.time, is_known)
    orientation = placement.orientation or sensor.orientation
    sensor = replace(sensor, orientation="")  # the images of a recording are upright
    image = None
    if frames.images is not None:
        size = (sensor.image_height, sensor.image_width)
        image = encoded_images(*frames.images, np.flatnonzero(is_known).tolist(), size, orientation, codec)
    frames = frames[is_known]
    if isinstance(placement.plane, str) and placement.plane == "fit":
        plane = space.plane_through(name, frame, _positions_in_contact(frames, image, sensor))
    else:
        plane = space.plane_across(frame, placement.plane, frames.sensor.position)
    is_near = space.near_plane(plane, frames.sensor, placement.off_plane, frames.time)
    frames = frames[is_near]
    if image is not None:
        image = tuple(compress(image, is_near))
    sensor_pose = space.in_plane(plane, frames.sensor, placement.off_plane, frames.time)
    _warn_if_upside_down(name, plane, frames.sensor)
    object_pose = None
    if frames.truth is not None:
        object_pose = _planar_truth(frames.truth, plane, placement.off_plane, frames.time)
    fields = {
        "time": frames.time / 1e9,
        "sensor_pose": sensor_pose,
        "sensor": sensor,
        "object_pose": object_pose,
        "contact": frames.contact,
        "image": image,
        "is_view_known": camera_view(orientation).is_stated,
    }
    return fields, plane


def _check_known(name: str, time: Times, is_known: Flags) -> None:
    """Raise FileError if less than two sensor poses are known; warn of times (N,) [ns] without one."""
    if is_known.sum() < min(2, len(time)):
        raise FileError(
            f"a sensor pose is known at the time of {is_known.sum()} of {len(time)} images, {time[0] * 1e-9:.3f} to "
            f"{time[-1] * 1e-9:.3f} s; are both by one clock, and is time_offset in seconds?"
        )
    left_out = np.count_nonzero(~is_known)
    if left_out:
        words = "%s: %d of %d images have no sensor pose at their time and are left out"
        logger.warning(words, name, left_out, len(time))


def _warn_if_upside_down(name: str, plane: Plane, sensor: Placed) -> None:
    if space.upside_down(plane, sensor).all():
        logger.warning("%s: %s", name, space.UPSIDE_DOWN)


def _positions_in_contact(frames: SpatialFrames, image: Sequence[bytes] | None, sensor: SensorProfile) -> Array:
    """Return the positions (M, 3) [m] of the sensor in contact; all of them if there is no contact."""
    from palpate.touch.contact_detector import touched

    contact = touched(image or (), sensor) if frames.contact is None else frames.contact
    return frames.sensor.position[contact] if contact.any() else frames.sensor.position


def _planar_truth(truth: Placed, plane: Plane, off_plane: float, time: Times) -> Array:
    """Return true poses in a plane (N, 3), NaN where unknown or, with a warning, far from the height of the others."""
    height = truth.position @ plane.axes[:, 2]
    is_good = truth.known
    if is_good.any():
        is_good = is_good & (np.abs(height - np.median(height[is_good])) <= off_plane)
    off = np.count_nonzero(truth.known & ~is_good)
    if off:
        logger.warning("%s: %d true poses are off the plane of the others and taken as unknown", truth.name, off)
    object_pose = np.full((len(time), 3), np.nan)
    object_pose[is_good] = space.in_plane(plane, truth[is_good], off_plane, time[is_good])
    return object_pose
