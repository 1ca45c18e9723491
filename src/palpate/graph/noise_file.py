"""Noise settings by the name of a preset or from a file (JSON), as `palpate tune` writes it."""

import json
import sys
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeGuard

from palpate.errors import FileError, SettingError
from palpate.files import read_json, whole_file
from palpate.graph.noise import PRESETS, GraphNoise

FORMAT = "palpate-noise"
VERSION = 1


def noise_of(name_or_path: str) -> GraphNoise:
    """Return a preset or what a file holds; SettingError where it is neither, FileError where the file is bad."""
    if name_or_path in PRESETS:
        return PRESETS[name_or_path]
    if not Path(name_or_path).exists():
        presets = ", ".join(repr(name) for name in PRESETS)
        raise SettingError(f"noise is {name_or_path!r}; allowed are {presets} or a file of palpate tune")
    return read_noise(name_or_path)


def read_noise(path: Path | str) -> GraphNoise:
    """Read a file; fields of GraphNoise that it leaves out have their defaults. FileError where it is not right."""
    content = read_json(path)
    if (found := content.get("format")) != FORMAT:
        raise FileError(f"{path}: format is {found!r}, expected {FORMAT!r}, as palpate tune writes it")
    version = content.get("version")
    if not (type(version) is int and 1 <= version <= VERSION):
        raise FileError(f"{path}: version is {version!r}, this palpate reads up to version {VERSION}")
    noise = content.get("noise")
    if not isinstance(noise, dict):
        raise FileError(f"{path}: noise is {noise!r}, expected an object of settings")
    known = asdict(GraphNoise())
    if unknown := [name for name in noise if name not in known]:
        raise FileError(f"{path}: noise {unknown[0]!r} is not known; known are {', '.join(known)}")
    try:
        return GraphNoise(**{name: _checked(name, value, known[name]) for name, value in noise.items()})
    except SettingError as error:
        raise FileError(f"{path}: {error}") from error


def write_noise(noise: GraphNoise, path: Path | str, tuned: dict[str, Any], overwrite: bool = False) -> None:
    """Write a file, whole or not at all; `tuned` says in plain data how the settings were found."""
    content = {"format": FORMAT, "version": VERSION, "noise": asdict(noise), "tuned": tuned}
    with whole_file(path, overwrite) as part:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _checked(name: str, value: Any, like: Any) -> Any:
    """The value in the type of the default; SettingError where it is of another. GraphNoise checks its range."""
    if isinstance(like, tuple):
        if not isinstance(value, list) or len(value) != len(like) or not all(_is_number(each) for each in value):
            raise SettingError(f"noise {name} is {value!r}; it must be {len(like)} finite numbers")
        return tuple(float(each) for each in value)
    if value is None and name in _MAY_BE_NONE:
        return None
    if not _is_number(value):
        or_null = " or null" if name in _MAY_BE_NONE else ""
        raise SettingError(f"noise {name} is {value!r}; it must be a finite number{or_null}")
    return float(value)


def _is_number(value: Any) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


_MAY_BE_NONE = {field.name for field in fields(GraphNoise) if "None" in str(field.type)}
