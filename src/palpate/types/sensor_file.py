"""Sensor profiles by name and in files (`.toml`): shape of the gel, size of images, pitch, rate and orientation.

Lengths are in metres, as everywhere in palpate.
"""

import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from palpate.checks import other_unit
from palpate.errors import FileError, SettingError
from palpate.files import in_file, read_text, whole_file
from palpate.types.sensor import ALIASES, SENSORS, SensorProfile

SUFFIX = ".toml"
NEEDED = ("name", "radius", "image_height", "image_width")
_COMMENTS = {
    "name": "of your own; a touch model belongs to a name",
    "radius": "[m] of the dome, of a flat pad that of its edges",
    "flat_width": "[m] flat part along y; 0 for a dome",
    "half_width": "[m] half the width of the pad along y",
    "image_height": "[px] rows of an upright image",
    "image_width": "[px] columns, along y of the sensor",
    "pixel_pitch": "[m] width of a pixel on the gel: 6.25e-5 are 16 px/mm",
    "pixel_pitch_sigma": "share of it, from unit to unit",
    "rate": "[Hz]",
    "orientation": "steps that make images upright: 90, 180, 270, mirrored, bgr",
}
"""Fields of a file, in their order, and what they are."""


def read_sensor(path: Path | str) -> SensorProfile:
    """Read a profile. Raises FileError, which names file and field, on anything else."""
    text = read_text(path)
    with in_file(path):
        try:
            found = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise FileError(f"is not valid TOML ({error})") from error
        allowed = [field.name for field in fields(SensorProfile)]
        for name in NEEDED:
            if name not in found:
                raise FileError(f"{name}: is missing; needed are {', '.join(NEEDED)}")
        for name in found:
            if name not in allowed:
                raise FileError(f"{name}: is no field of a sensor; allowed are {', '.join(allowed)}")
        _check_metres(found)
        known = [sensor.name for sensor in SENSORS.values()]
        if found["name"] in known:
            raise FileError(f"name: found {found['name']!r}, which is palpate's own profile; give it another name")
        try:
            return SensorProfile(**found)
        except SettingError as error:
            raise FileError(str(error)) from error


def _check_metres(found: dict[str, Any]) -> None:
    """Raise FileError, which names the field, if a length in a file is in another unit than metres."""
    widest = 0.3  # [m] largest length of a gel; a greater one is in another unit
    for name in ("radius", "flat_width", "half_width"):
        value = found.get(name, 0.0)
        if isinstance(value, int | float) and value > widest:
            hint = other_unit(value, 1e-3, 0.1)
            raise FileError(f"{name}: found {value:g}; expected a length of at most {widest} m{hint}")
    pitch = found.get("pixel_pitch")
    columns = found["image_width"]
    if isinstance(pitch, int | float) and isinstance(columns, int) and pitch * columns > widest:
        hint = f": are these {pitch:g} px/mm? They are {1e-3 / pitch:.3g} m" if pitch > 1.0 else ": is it in mm?"
        raise FileError(f"pixel_pitch: found {pitch:g}; expected the width of a pixel on the gel in metres{hint}")


def write_sensor(sensor: SensorProfile, path: Path | str, overwrite: bool = False) -> None:
    """Write a profile of one tip, whole or not at all. Raises FileError if the file exists, unless `overwrite`."""
    lines = []
    for name, comment in _COMMENTS.items():
        value = getattr(sensor, name)
        if value is None:
            continue
        escaped = str(value).replace("\\", "\\\\").replace('"', '\\"')
        written = f'"{escaped}"' if isinstance(value, str) else f"{value:.6g}"
        lines.append(f"{name} = {written}  # {comment}")
    with whole_file(path, overwrite) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def known_sensor(sensor: SensorProfile | str) -> SensorProfile:
    """Return the profile itself, that of a known name, or that in a file. Raises SettingError on another name."""
    if isinstance(sensor, SensorProfile):
        return sensor
    if isinstance(sensor, str) and sensor.lower().endswith(SUFFIX):
        return read_sensor(sensor)
    name = re.sub(r"[\W_]+", "-", sensor.lower()) if isinstance(sensor, str) else ""
    name = ALIASES.get(name, name)
    if name not in SENSORS:
        raise SettingError(
            f"sensor is {sensor!r}; allowed are {', '.join(SENSORS)}, a file such as my_sensor.toml, or a SensorProfile"
        )
    return SENSORS[name]
