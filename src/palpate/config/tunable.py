"""One number or tuple of numbers that says how much a factor is believed: its allowed range, and what tuning may do.

A factor's settings are a frozen dataclass that derives from `Settings` and declares each field by `setting`.
"""

import math
from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any

from palpate.errors import SettingError


@dataclass(frozen=True)
class Tunable:
    """What `palpate tune` may do with a setting: scale it within limits."""

    lowest: float
    """Allowed from here."""
    highest: float
    """Allowed to here."""
    usual: bool = True
    """Whether it is tuned if nothing else is asked for."""
    components: tuple[int, ...] = ()
    """Of a tuple, those that one factor scales; its value is that of the first of them."""


@dataclass(frozen=True)
class Range:
    """What a setting may be."""

    at_least: float | None = None
    """Every number must be this or more; above 0 if None."""
    optional: bool = False
    """Whether None is allowed, which turns something off."""
    is_normal: bool = False
    """Whether it is a mean and a standard deviation; the range is that of the deviation."""


def setting(
    default: Any,
    at_least: float | None = None,
    optional: bool = False,
    is_normal: bool = False,
    tune: Tunable | None = None,
) -> Any:
    """Declare a field of settings with its default, its range and what tuning may do with it (nothing if None)."""
    return field(default=default, metadata={"range": Range(at_least, optional, is_normal), "tune": tune})


class Settings:
    """Base of a factor's settings: makes all numbers floats and raises SettingError on one that is not allowed."""

    def __post_init__(self) -> None:
        for each in fields(self):  # pyright: ignore[reportArgumentType]
            name = f"{settings_name(type(self))}.{each.name}"
            value = _checked(name, getattr(self, each.name), each.default, each.metadata["range"])
            object.__setattr__(self, each.name, value)


def settings_name(kind: type) -> str:
    """Return the name that messages call a settings class by: FrictionConeSettings is friction_cone."""
    words = kind.__name__.removesuffix("Settings")
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in words).lstrip("_")


def _checked(name: str, value: Any, default: Any, allowed: Range) -> Any:
    if value is None and allowed.optional:
        return None
    size = len(default) if isinstance(default, tuple) else None
    numbers: list[Any] = [value] if size is None else list(value) if isinstance(value, tuple | list) else []
    usable = len(numbers) == (size or 1) and all(_is_finite(number) for number in numbers)
    if usable:
        ranged = numbers[1:] if allowed.is_normal else numbers
        usable = all(number > 0.0 if allowed.at_least is None else number >= allowed.at_least for number in ranged)
    if not usable:
        raise SettingError(f"{name} is {value!r}; it must be {_wanted(size, allowed)}")
    return float(numbers[0]) if size is None else tuple(float(number) for number in numbers)


def _wanted(size: int | None, allowed: Range) -> str:
    limit = "above 0" if allowed.at_least is None else f"at least {allowed.at_least:g}"
    if allowed.is_normal:
        return f"a finite mean and a finite standard deviation {limit}"
    count = "a finite number" if size is None else f"{size} finite numbers"
    return f"{count} {limit}{', or None' if allowed.optional else ''}"


def _is_finite(number: Any) -> bool:
    try:
        return isinstance(number, Real) and not isinstance(number, bool) and math.isfinite(number)
    except OverflowError:  # a whole number that no float holds
        return False
