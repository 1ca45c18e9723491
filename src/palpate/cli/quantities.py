"""Options as people write them: lengths, angles and times with their units, and options that may be left out."""

import math
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Union, get_args, get_origin

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    UnsupportedTypeAnnotationError,
)

from palpate.errors import SettingError

Units = Mapping[str, float]
"""Factors to SI units by the names of units; the first is that of a number alone."""
LENGTH: Units = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
ANGLE: Units = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}
TIME: Units = {"s": 1.0, "ms": 1e-3}
PURE: Units = {"": 1.0}
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(.*)", re.IGNORECASE)


def quantity(word: str, units: Units) -> float:
    """Return a number in SI units, such as 17deg as radians. Raises SettingError, without the option's name."""
    match = _NUMBER.fullmatch(word.strip())
    name = match[2].lower() if match else ""
    unit = name or next(iter(units))
    if match is None or unit not in units:
        known = ", ".join(name for name in units if name)
        raise SettingError(f"found {word!r}; allowed is a number" + (f", also with its unit: {known}" if known else ""))
    return float(match[1]) * units[unit]


def quantities(
    option: str, metavar: str, *kinds: Units, word: str | None = None
) -> "PrimitiveConstructorSpec[tuple[float, ...] | float | str]":
    """Return the reader of an option of numbers with units: one number, or a tuple of several.

    `word` is allowed in the place of all numbers.
    """

    def read(words: Sequence[str]) -> Any:
        if word is not None and list(words) == [word]:
            return word
        if len(words) != len(kinds):
            raise SettingError(f"{option}: found {' '.join(words)}; allowed is {metavar.replace('|', ' or ')}")
        try:
            numbers = tuple(quantity(each, units) for each, units in zip(words, kinds, strict=True))
        except SettingError as error:
            raise SettingError(f"{option}: {error}") from error
        return numbers if len(kinds) > 1 else numbers[0]

    return PrimitiveConstructorSpec(
        nargs="*" if word else len(kinds),
        metavar=metavar,
        instance_from_str=read,
        is_instance=lambda value: True,
        str_from_instance=lambda value: [str(value)],
    )


def with_optional(registry: ConstructorRegistry) -> ConstructorRegistry:
    """Return a registry in which an option that may be left out has the metavar and the errors of its type alone."""

    @registry.primitive_rule
    def _(type_info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        members = get_args(type_info.type)
        if get_origin(type_info.type) not in (Union, types.UnionType) or type(None) not in members:
            return None
        given: Any = Union[tuple(member for member in members if member is not type(None))]  # noqa: UP007
        spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(given, type_info.markers))
        if isinstance(spec, UnsupportedTypeAnnotationError):
            return None
        return replace(
            spec,
            is_instance=lambda value: value is None or spec.is_instance(value),
            str_from_instance=lambda value: ["none"] if value is None else spec.str_from_instance(value),
        )

    return registry


REGISTRY = with_optional(tyro.constructors.ConstructorRegistry())
"""How this command line reads its options."""
