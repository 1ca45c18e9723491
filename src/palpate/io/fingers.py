"""Fields of a recording that hold values by name of finger: they are checked, and one frame is taken from them."""

from collections.abc import Mapping
from typing import Any

from palpate import checks
from palpate.errors import FileError
from palpate.files import in_file
from palpate.types.hand import Hand, check_names
from palpate.types.images import decode_image
from palpate.types.sensor import SensorProfile

FIELDS = ("images", "contacts", "finger_poses", "image_times")
"""Names of the fields."""


def settled(hand: Hand | None, given: Mapping[str, Any], count: int) -> dict[str, dict[str, Any]]:
    """Return fields of `count` frames, each with its values by finger, in the order of a hand's fingers, once checked.

    Raises FileError on values that do not fit, and if there are any without a hand.
    """
    if hand is None:
        if given:
            raise FileError(f"{next(iter(given))}: found values by finger without a hand; allowed are those of one")
        return {}
    fields = {}
    for field, values in given.items():
        if not isinstance(values, Mapping):
            raise FileError(f"{field}: found {type(values).__name__}, expected a dictionary by name of finger")
        with in_file(field):
            check_names(field, values, hand.fingers)
        there = [name for name in hand.fingers if name in values]
        fields[field] = {name: _checked(field, name, hand.fingers[name], values[name], count) for name in there}
    for name, finger in hand.fingers.items():
        if "images" in fields and finger.image_height and name not in fields["images"]:
            raise FileError(f"images: found none of finger {name!r}; allowed are those of every finger that has images")
    return fields


def _checked(field: str, finger: str, sensor: SensorProfile, values: Any, count: int) -> Any:
    """Return the values of one finger."""
    name = f"{field} of finger {finger!r}"
    if field == "images":
        return checked_images(values, count, sensor, name)
    if field == "contacts":
        return checks.checked_array(name, values, checks.FLAGS, (count,)).astype(bool)
    if field == "finger_poses":
        return checks.checked_poses(name, values, count)
    times = checks.checked_array(name, values, checks.NUMBERS, (count,)).astype(float)
    checks.check_rows(name, times, checks.are_in_range(times - times[0]), "a time [s]")
    return times


def checked_images(images: Any, count: int, sensor: SensorProfile, name: str = "image") -> tuple[bytes, ...]:
    """Return encoded images of a sensor. Raises FileError, by their name, unless there is one for each frame."""
    if not sensor.image_height:
        raise FileError(f"{name}: found images, but the sensor {sensor.name!r} has none")
    encoded = tuple(images)
    if len(encoded) != count:
        raise FileError(f"{name}: found {len(encoded)} images for {count} times, expected one for each")
    for index, image in enumerate(encoded):
        if not isinstance(image, bytes):
            kind = type(image).__name__
            raise FileError(
                f"{name}: image {index} is of type {kind}, expected encoded bytes; Recording.from_arrays encodes arrays"
            )
    return encoded


def at_frame(hand: Hand, fields: Mapping[str, Mapping[str, Any]], index: int, where: str) -> dict[str, Any]:
    """Return the values of the fields at one frame, as `palpate.Frame` takes them; `where` is the recording in errors.

    Raises FileError if an image is damaged.
    """
    said: dict[str, dict[str, Any]] = {field: {} for field in fields}
    for field, values in fields.items():
        for name, each in values.items():
            value = each[index]
            if field == "images":
                if not value:  # no new one
                    continue
                finger = hand.fingers[name]
                with in_file(f"{where}: image of finger {name!r} of frame {index % len(each)}"):
                    value = decode_image(value, (finger.image_height, finger.image_width))
            said[field][name] = value.item() if field in ("contacts", "image_times") else value
    return said
