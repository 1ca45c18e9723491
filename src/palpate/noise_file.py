"""Noise settings in a JSON file, which `palpate tune` writes and `--noise FILE` reads."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from palpate.config import NoiseSettings
from palpate.errors import FileError, SettingError
from palpate.files import read_json, write_json
from palpate.types.choices import DEFAULT_NOISE

FORMAT = "palpate-noise"
VERSION = 4


def noise_of(name_or_path: Path | str) -> NoiseSettings:
    """Return the settings in a file, missing ones with their defaults; "palpate" is the defaults.

    Raises SettingError if there is no such file, FileError on a bad one.
    """
    defaults = NoiseSettings()
    if str(name_or_path) == DEFAULT_NOISE:
        return defaults
    path = Path(name_or_path)
    if not path.exists():
        raise SettingError(f"noise is {str(path)!r}; allowed are {DEFAULT_NOISE!r} or a file of palpate tune")
    content = read_json(path)
    found = (content.get("format"), content.get("version"))
    if found != (FORMAT, VERSION):
        expected = f"expected {(FORMAT, VERSION)}; make the file anew with palpate tune"
        raise FileError(f"{path}: format and version are {found}, {expected}")
    try:
        return _with_values(defaults, content.get("noise"))
    except SettingError as error:
        raise FileError(f"{path}: {error}") from error


def write_noise(noise: NoiseSettings, path: Path | str, tuned: dict[str, Any], overwrite: bool = False) -> None:
    """Write a settings file, whole or not at all; `tuned` is a JSON object on how they were found."""
    content = {"format": FORMAT, "version": VERSION, "noise": asdict(noise), "tuned": tuned}
    write_json(path, content, overwrite)


def _with_values(noise: NoiseSettings, given: Any) -> NoiseSettings:
    """Return the settings with values of a file, an object of groups. Raises SettingError on what is none."""
    groups = {}
    for name, values in _known("noise", given, noise).items():
        group = getattr(noise, name)
        groups[name] = replace(group, **_known(f"noise {name}", values, group))
    return replace(noise, **groups)


def _known(name: str, given: Any, settings: Any) -> dict[str, Any]:
    """Return an object of a file if all its keys are fields of the settings. Raises SettingError."""
    if not isinstance(given, dict):
        raise SettingError(f"{name} is {given!r}, expected an object of settings")
    known = [field.name for field in fields(settings)]
    unknown = [key for key in given if key not in known]
    if unknown:
        raise SettingError(f"{name} has no {unknown[0]!r}; known are {', '.join(known)}")
    return given
