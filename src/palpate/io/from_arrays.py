"""Times, poses and images as users have them, and the fields of a `Recording` in a plane that are made of them."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Flags, Image
from palpate.checks import NUMBERS, as_array, check_rows, checked_array, other_time_unit
from palpate.errors import FileError
from palpate.files import counting_order, existing_file, in_file
from palpate.types import space
from palpate.types.choices import Placement
from palpate.types.images import Codec, camera_view, checked_pixels, decode_image, encode_image, fitted, turned_image
from palpate.types.sensor import SensorProfile
from palpate.types.space import Placed, Plane, Times

logger = logging.getLogger(__name__)


def nanoseconds(name: str, time: ArrayLike, least: float = 2e-4) -> Times:
    """Return times (N,), seconds as floats or nanoseconds as integers, as nanoseconds.

    Raises FileError where they are none, are rounded, or seem to be in another unit: steps are below `least` [s].
    """
    given = as_array(name, time)
    given = given.astype(f"{given.dtype.kind}8[ns]").astype(np.int64) if given.dtype.kind in "mM" else given
    given = checked_array(name, given, NUMBERS, ("N",))
    if not len(given):
        raise FileError(f"{name}: found no times, expected one or more")
    is_whole = given.dtype.kind in "iu"
    check_rows(name, given, np.isfinite(given), "a finite number")
    exact = given.astype(np.int64 if is_whole else np.float64)
    steps, latest = np.abs(np.diff(exact)), float(np.abs(given).max())
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    is_late = latest > (2.0**62 if is_whole else 4e9)  # after the year 2096
    if is_late or (step and not least <= step * (1e-9 if is_whole else 1.0) <= 10.0):
        kind = "integers, which are nanoseconds" if is_whole else "floats, which are seconds"
        question = " ".join(filter(None, (other_time_unit(step, rate) for rate in (30.0, 500.0)))) or "are all in one?"
        raise FileError(f"{name}: found {kind}, in the median {step:g} from one to the next; {question}")
    kind = given.dtype.type  # that of floats that went through float32 is float32
    if kind is np.float64 and (given.astype(np.float32) == given).all():
        kind = np.float32
    resolution = 0.0 if is_whole else float(np.spacing(kind(latest)))
    if resolution > max(0.1 * step, 1e-4):
        raise FileError(
            f"{name}: found times up to {latest:.10g} s as {kind.__name__} has them, exact to {resolution:.3g} s; "
            "give float64 from the start, or integers of nanoseconds"
        )
    if (steps == 0).sum() > 0.5 * len(steps):
        raise FileError(
            f"{name}: {(steps == 0).sum()} of {len(given)} times are that before; were they rounded, as float32 rounds "
            "them?"
        )
    return (exact if is_whole else np.round(exact * 1e9)).astype(np.int64)


def encoded_images(
    name: str, images: Any, indices: Sequence[int], size: tuple[int, int], orientation: str, codec: Codec
) -> tuple[bytes, ...]:
    """Return some images, fitted to a size (rows, columns), as encoded bytes; bytes stay as they are.

    An encoded image that is damaged, or the error on it, is a frame that tracking skips. Raises FileError, which names
    the image, if pixels do not fit, or none of the encoded images that are looked at is one of this size.
    """
    from palpate.touch.background import warn_if_squeezed

    view, data, damage, seen = camera_view(orientation), list[bytes](), list[str](), list[Image]()
    looked_at, plain = range(0, len(indices), len(indices) // 10 + 1), dict[int, Image]()
    names = [str(each) for each in images if isinstance(each, str | Path)] if isinstance(images, list) else []
    if names == sorted(names) != sorted(names, key=counting_order):
        logger.warning("%s: the paths are sorted as texts, in which 10 comes before 2; are the images in order?", name)
    for place, index in enumerate(indices):
        image = images[index]
        if not isinstance(image, str | Path | bytes | FileError):
            with in_file(f"{name}: image {index}"):
                pixels = as_array("pixels", image)
                if pixels.dtype != np.uint8 or pixels.size > len(pixels):
                    upright = fitted(checked_pixels(pixels), size, view)
                    data.append(encode_image(upright, codec))
                    if place in looked_at:  # before JPEG removes the noise that shows squeezing
                        plain[place] = upright
                    continue
            image = pixels.tobytes()  # encoded, as OpenCV and messages have it
        try:
            if isinstance(image, FileError):
                raise image
            image = image if isinstance(image, bytes) else existing_file(image).read_bytes()
            data.append(turned_image(image, size, view))
        except FileError as error:
            damage.append(f"image {index}: {error}")
            data.append(b"")
    for place in ([at for at, each in enumerate(data) if each] or [0])[:: len(data) // 10 + 1]:
        try:
            seen.append(plain[place] if place in plain else decode_image(data[place], size))
        except FileError as error:
            damage.append(f"image {indices[place]}: {error}")
    if not seen:
        raise FileError(f"{name}: {damage[0]}")
    if lost := data.count(b""):
        logger.warning("%s: %d of %d images are left out: %s", name, lost, len(data), *damage[:1] or ["it is empty"])
    warn_if_squeezed(seen, name)
    return tuple(data)


def placed_from(name: str, poses: ArrayLike, time_name: str, time: ArrayLike, wanted: Times) -> Placed:
    """Return poses, given with times of their own, at other times [ns]; NaN is unknown."""
    known_at, numbers = nanoseconds(time_name, time), space.pose_numbers(name, poses)
    if len(known_at) != len(numbers):
        raise FileError(f"{name}: found {len(numbers)} poses for {len(known_at)} times, expected one for each")
    return space.placed_at(name, known_at, numbers, wanted)


def planar_fields(
    what: str,
    frame: str,
    time: Times,
    placement: Placement,
    placed: Placed,
    truth: Placed | None,
    images: tuple[str, Any] | None,
    contact: Flags | None,
    sensor: SensorProfile,
    codec: Codec = "jpeg",
) -> tuple[dict[str, Any], Plane]:
    """Return frames at times (N,) [ns] as fields of a `Recording`, all but its shape and names, and their plane.

    A warning says how many frames without a sensor pose are left out.

    The plane that fits is that of frames in contact, by its flags or as images show it. The images have their name in
    errors, `what` is that of the recording. Raises FileError.
    """
    keep = placed.known
    if keep.sum() < min(2, len(time)):
        raise FileError(
            f"a sensor pose is known at the time of {keep.sum()} of {len(time)} images, {time[0] * 1e-9:.3f} to "
            f"{time[-1] * 1e-9:.3f} s; are both by one clock, and is time_offset in seconds?"
        )
    if left_out := np.count_nonzero(~keep):
        words = "%s: %d of %d images have no sensor pose at their time and are left out"
        logger.warning(words, what, left_out, len(time))
    size, image = (sensor.image_height, sensor.image_width), None
    if images is not None:
        image = encoded_images(*images, np.flatnonzero(keep).tolist(), size, placement.orientation, codec)
    placed, time, contact = placed[keep], time[keep], None if contact is None else contact[keep]
    if isinstance(placement.plane, str) and placement.plane == "fit":
        from palpate.touch.contact_detector import touched

        touching = touched(image or (), sensor) if contact is None else contact
        plane = space.plane_through(what, frame, placed.position[touching if touching.any() else ...])
    else:
        plane = space.plane_across(frame, placement.plane, placed.position)
    sensor_pose = space.in_plane(plane, placed, placement.off_plane, time)
    if space.upside_down(plane, placed).all():
        logger.warning(
            "%s: the sensor's z axis points against the plane's normal: if its images are not upside down with it, "
            "turn its frame, by sensor_T_gel (--sensor-T-gel 0 0 0 1 0 0 0), unless the quaternions have w first",
            what,
        )
    object_pose = None
    if truth is not None:
        seen, object_pose = truth[keep], np.full((len(time), 3), np.nan)
        height, good = seen.position @ plane.axes[:, 2], seen.known
        if good.any():
            good = good & (np.abs(height - np.median(height[good])) <= placement.off_plane)
        if off := np.count_nonzero(seen.known & ~good):
            logger.warning("%s: %d true poses are off the plane of the others and taken as unknown", seen.name, off)
        object_pose[good] = space.in_plane(plane, seen[good], placement.off_plane, time[good])
    fields = {
        "time": time / 1e9,
        "sensor_pose": sensor_pose,
        "sensor": sensor,
        "object_pose": object_pose,
        "contact": contact,
        "image": image,
        "is_view_known": camera_view(placement.orientation).is_stated,
    }
    return fields, plane
