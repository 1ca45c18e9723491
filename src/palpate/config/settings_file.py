"""Noise settings by the name of a preset or from a file (JSON), as `palpate tune` writes it."""

import json
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from palpate.config.settings import PRESETS, NoiseSettings
from palpate.errors import FileError, SettingError
from palpate.files import read_json, whole_file

FORMAT = "palpate-noise"
VERSION = 2
"""1 had one flat list of settings, and is still read."""

_FLAT = {
    "tactile": ("relative_pose.oracle",),
    "constant": ("relative_pose.constant",),
    "sticking": ("sticking.still", "friction_cone.still"),
    "sticking_share": ("sticking.share",),
    "sliding_share": ("sticking.sliding_share",),
    "cone_margin": ("sticking.margin",),
    "cone_width": ("sticking.width", "friction_cone.width"),
    "cone_share": ("friction_cone.share",),
    "sticking_kernel": ("sticking.kernel",),
    "turning": ("balance.still",),
    "turning_share": ("balance.share",),
    "turning_kernel": ("balance.kernel", "friction_cone.kernel"),
    "friction_ratio": ("priors.friction_ratio",),
    "friction_center": ("priors.friction_center",),
    "grip": ("priors.grip",),
    "depth": ("priors.depth",),
    "direction_bias": ("priors.direction_bias",),
    "direction_share": ("direction.share",),
    "turn_share": ("turn.share",),
    "contact": ("contact.deviation",),
    "contact_kernel": ("contact.kernel",),
    "feeling_kernel": ("direction.kernel", "turn.kernel"),
    "sensor": ("sensor_pose.deviation",),
    "first_pose": ("first_pose.deviation", "first_pose.truth"),
    "rest": ("first_pose.rest",),
}
"""What the settings of version 1 are now."""
_NOW_WITH_MEAN = ("friction_center", "direction_bias")  # in version 1 a deviation alone, the mean being 0


def noise_of(name_or_path: str) -> NoiseSettings:
    """Return a preset or what a file holds; SettingError where it is neither, FileError where the file is bad."""
    if name_or_path in PRESETS:
        return PRESETS[name_or_path]
    if not Path(name_or_path).exists():
        presets = ", ".join(repr(name) for name in PRESETS)
        raise SettingError(f"noise is {name_or_path!r}; allowed are {presets} or a file of palpate tune")
    return read_noise(name_or_path)


def read_noise(path: Path | str) -> NoiseSettings:
    """Read a file; settings that it leaves out have their defaults. FileError where it is not right."""
    content = read_json(path)
    if (found := content.get("format")) != FORMAT:
        raise FileError(f"{path}: format is {found!r}, expected {FORMAT!r}, as palpate tune writes it")
    version = content.get("version")
    if not (type(version) is int and 1 <= version <= VERSION):
        raise FileError(f"{path}: version is {version!r}, this palpate reads up to version {VERSION}")
    noise = content.get("noise")
    if not isinstance(noise, dict):
        raise FileError(f"{path}: noise is {noise!r}, expected an object of settings")
    try:
        return noise_from_dict(_from_flat(noise) if version == 1 else noise)
    except SettingError as error:
        raise FileError(f"{path}: {error}") from error


def write_noise(noise: NoiseSettings, path: Path | str, tuned: dict[str, Any], overwrite: bool = False) -> None:
    """Write a file, whole or not at all; `tuned` says in plain data how the settings were found."""
    content = {"format": FORMAT, "version": VERSION, "noise": asdict(noise), "tuned": tuned}
    with whole_file(path, overwrite) as part:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def noise_from_dict(given: dict[str, Any]) -> NoiseSettings:
    """Return the settings that plain data hold, a group a factor; SettingError on what is not allowed."""
    noise = NoiseSettings()
    _check_names("noise", given, noise)
    groups = {}
    for name, values in given.items():
        group = getattr(noise, name)
        if not isinstance(values, dict):
            raise SettingError(f"noise {name} is {values!r}, expected an object of settings")
        _check_names(f"noise {name}", values, group)
        groups[name] = replace(group, **values)
    return replace(noise, **groups)


def _check_names(what: str, given: dict[str, Any], like: Any) -> None:
    known = [field.name for field in fields(like)]
    if unknown := [name for name in given if name not in known]:
        raise SettingError(f"{what} has no {unknown[0]!r}; known are {', '.join(known)}")


def _from_flat(flat: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The settings of version 1 in groups."""
    if unknown := [name for name in flat if name not in _FLAT]:
        raise SettingError(f"noise {unknown[0]!r} is not known; known are {', '.join(_FLAT)}")
    grouped: dict[str, dict[str, Any]] = {}
    for name, value in flat.items():
        for place in _FLAT[name]:
            group, setting = place.split(".")
            grouped.setdefault(group, {})[setting] = [0.0, value] if name in _NOW_WITH_MEAN else value
    return grouped
