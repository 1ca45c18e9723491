"""Images of a hand's fingers, each with times of its own, as the frames of one recording.

Frames are the images of the finger that has most of them. Those of the others go with the first frame that is not
earlier, but for the few milliseconds by which cameras that are triggered together differ, and keep their own times.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.checks import FLAGS, checked_array
from palpate.errors import FileError
from palpate.files import in_file
from palpate.io.from_arrays import SpatialFrames, encoded_images, nanoseconds, planar_fields
from palpate.io.time_order import in_order
from palpate.types.choices import Placement
from palpate.types.hand import Hand, check_names
from palpate.types.images import Codec
from palpate.types.sensor import SensorProfile
from palpate.types.space import Placed, Plane, Times

logger = logging.getLogger(__name__)

_TOGETHER = 8_000_000  # [ns] by which an image may be later than the frame it goes with


@dataclass(frozen=True, eq=False)
class OfFinger:
    """Images and flags of one finger, in the order of time."""

    name: str
    """Name of its images for errors, as a topic."""
    time: Times
    """(M,) [ns]"""
    images: Any = None
    """M images as users have them; None if contact flags alone came."""
    contact: Flags | None = None
    """(M,) contact flags; None if only images show it."""


def hand_fields(
    name: str,
    frame: str,
    given: Mapping[str, OfFinger],
    poses_at: Callable[[Times], tuple[Placed, Placed | None]],
    placement: Placement,
    hand: Hand,
    codec: Codec = "jpeg",
) -> tuple[dict[str, Any], Plane]:
    """Return images and flags of fingers as fields of a `Recording`, all but its shape and names, and the plane.

    `poses_at` returns the hand's poses, and the object's if they are known, at times [ns]. Raises FileError.
    """
    for finger, profile in hand.fingers.items():
        if finger not in given or (profile.image_height and given[finger].images is None and _has_images(given)):
            wanted = "images" if profile.image_height else "contact flags"
            raise FileError(f"finger {finger!r} has no {wanted}; there are those of {', '.join(given) or 'none'}")
    most = max(hand.fingers, key=lambda finger: len(given[finger].time))
    time = given[most].time
    poses, truth = poses_at(time)
    fields, plane = planar_fields(name, frame, SpatialFrames(time, poses, truth), placement, hand.whole, codec)
    frames = np.round(fields["time"] * 1e9).astype(np.int64)
    by_finger: dict[str, dict[str, Any]] = {"images": {}, "contacts": {}, "image_times": {}}
    for finger, came in given.items():
        newest = _newest(frames, came, finger, given[most].name)
        if came.contact is not None:
            by_finger["contacts"][finger] = (newest >= 0) & came.contact[newest]
        if came.images is not None:
            profile = hand.fingers[finger]
            size = (profile.image_height, profile.image_width)
            is_new = np.diff(newest, prepend=-1) > 0
            taken = newest[is_new]
            encoded = iter(encoded_images(came.name, came.images, taken.tolist(), size, placement.orientation, codec))
            by_finger["images"][finger] = [next(encoded) if new else b"" for new in is_new.tolist()]
            stamps = fields["time"].copy()
            stamps[is_new] = came.time[taken] / 1e9
            if _are_other(stamps, fields["time"]):
                by_finger["image_times"][finger] = stamps
            _warn_of_left_out(came, len(taken))
    fields |= {field: values for field, values in by_finger.items() if values}
    return fields | {"hand": hand, "sensor": hand.whole}, plane


def _has_images(given: Mapping[str, OfFinger]) -> bool:
    """Return true if any finger gave images."""
    return any(came.images is not None for came in given.values())


def _newest(frames: Times, came: OfFinger, finger: str, name_of_frames: str) -> Integers:
    """Return the number of the newest that came by each frame (N,), -1 before the first. Raises FileError if none."""
    newest = np.searchsorted(came.time, frames + _TOGETHER, "right") - 1
    is_apart = came.time[-1] < frames[0] - _TOGETHER or newest[-1] < 0
    if is_apart:
        span = f"{came.time[0] * 1e-9:.3f} to {came.time[-1] * 1e-9:.3f} s"
        raise FileError(
            f"{came.name}: what came of finger {finger!r} is of {span}, {name_of_frames} of {frames[0] * 1e-9:.3f} to "
            f"{frames[-1] * 1e-9:.3f} s; allowed are times by one clock"
        )
    return newest


def _are_other(stamps: Array, time: Array) -> bool:
    """Return true if images were taken at other times than those of their frames (N,) [s]."""
    return bool((np.abs(stamps - time) > 1e-6).any())


def _warn_of_left_out(came: OfFinger, taken: int) -> None:
    """Warn of images that are in no frame, as two of them came between two frames."""
    left_out = len(came.time) - taken
    if left_out > 0.02 * len(came.time) + 1:
        logger.warning("%s: %d of %d images are in no frame", came.name, left_out, len(came.time))


def of_fingers(hand: Hand, image_time: Any, images: Any, contact: Any, time_offset: float) -> dict[str, OfFinger]:
    """Return arrays of a user by finger, each in the order of time; one array of times is of all fingers.

    `time_offset` [s] is added to all times. Raises FileError, which names argument and finger.
    """
    by_finger = {"image_time": image_time, "images": images, "contact": contact}
    for field, values in by_finger.items():
        if isinstance(values, Mapping):
            with in_file(field):
                check_names(field, values, hand.fingers)
        elif field != "image_time" and values is not None:
            raise FileError(f"{field}: found {type(values).__name__}, expected a dictionary by name of finger")
    given = {}
    for finger, profile in hand.fingers.items():
        its_images = (images or {}).get(finger)
        its_contact = (contact or {}).get(finger)
        its_time = image_time.get(finger) if isinstance(image_time, Mapping) else image_time
        if (its_images is None and its_contact is None) or its_time is None:
            continue
        given[finger] = _checked(finger, profile, its_time, its_images, its_contact, time_offset)
    return given


def _checked(
    finger: str, profile: SensorProfile, image_time: Any, images: Any, contact: Any, time_offset: float
) -> OfFinger:
    """Return the checked arrays of one finger."""
    name = f"images of finger {finger!r}"
    time = nanoseconds(f"image_time of finger {finger!r}", image_time, least=1e-3)
    if images is not None and not profile.image_height:
        raise FileError(f"{name}: found images, but the sensor {profile.name!r} has none")
    images = list(images) if images is not None and not hasattr(images, "__len__") else images
    if images is not None and len(images) != len(time):
        raise FileError(f"{name}: found {len(images)} images for {len(time)} times, expected one for each")
    flags = None
    if contact is not None:
        flags = checked_array(f"contact of finger {finger!r}", contact, FLAGS, (len(time),)).astype(bool)
    kept = np.flatnonzero(in_order(f"image_time of finger {finger!r}", time, is_strict=True))
    return OfFinger(
        name,
        time[kept] + round(time_offset * 1e9),
        None if images is None else [images[index] for index in kept.tolist()],
        None if flags is None else flags[kept],
    )
