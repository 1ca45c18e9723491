"""What can be tuned, within which limits, and how a value of it is read from and put into settings."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, get_args

from palpate.errors import SettingError
from palpate.graph.noise import GraphNoise
from palpate.touch.modes import TELL_DIRECTION, Tactile
from palpate.tracker import TrackerSettings

_ALL = get_args(Tactile)
_BY_IMAGE = ("learnt", "learnt-turn", "learnt-direction")


@dataclass(frozen=True)
class Parameter:
    """A number that can be tuned."""

    lowest: float
    """Allowed from here."""
    highest: float
    """Allowed to here."""
    usual: tuple[str, ...] = _ALL
    """Tactile modes in which it is tuned if nothing else is asked for."""
    components: tuple[int, ...] = ()
    """Of a vector, those that one factor scales; its value is that of the first of them."""


PARAMETERS = {
    "tactile": Parameter(1e-4, 1.0, ("oracle",), (2,)),
    "constant": Parameter(1e-3, 10.0, ("constant",), (2,)),
    "sticking": Parameter(1e-7, 1e-2, ()),
    "sticking_share": Parameter(1e-3, 10.0),
    "sliding_share": Parameter(1e-3, 100.0),
    "cone_margin": Parameter(1e-3, 0.5),
    "cone_width": Parameter(1e-3, 0.5, ()),
    "cone_share": Parameter(1e-3, 10.0),
    "sticking_kernel": Parameter(0.1, 100.0),
    "turning": Parameter(1e-9, 1e-3, ()),
    "turning_share": Parameter(1e-3, 10.0),
    "turning_kernel": Parameter(0.1, 100.0, ()),
    "friction_ratio": Parameter(0.01, 2.0, _ALL, (1,)),
    "friction_center": Parameter(0.01, 1.0),
    "grip": Parameter(0.01, 1.0, _ALL, (1,)),
    "depth": Parameter(1e-5, 1e-2, (), (1,)),
    "direction_bias": Parameter(1e-4, 0.1, ()),
    "direction_share": Parameter(1e-2, 100.0, TELL_DIRECTION),
    "turn_share": Parameter(1e-2, 1000.0, tuple(set(_BY_IMAGE) - {"learnt-direction"})),
    "contact": Parameter(1e-5, 1e-2, ()),
    "contact_kernel": Parameter(0.1, 100.0, ()),
    "feeling_kernel": Parameter(0.1, 100.0, ()),
    "sensor": Parameter(1e-6, 1e-2, (), (0, 1, 2)),
    "rest": Parameter(1e-8, 1e-2, (), (0, 1, 2)),
    "pressure": Parameter(1e-3, 1.0, ()),
}
"""What can be tuned: fields of GraphNoise, and pressure, which is c [m], for one object. Not first_pose, which ground
truth gives exactly. The floors `sticking` and `turning` count while nothing moves, `rest` while nothing touches. What
`sensor` is the robot knows, and what `contact` and `depth` are the laboratory: how well outline, gel and motion capture
agree is what a simulation knows too well."""


def check_parameters(
    settings: TrackerSettings, parameters: Sequence[str] = (), evaluations: int = 1
) -> tuple[str, ...]:
    """Return what is tuned, by default what is usual in the tactile mode; a kernel that is off stays off.

    Raises SettingError on a parameter that is not known or off, and on fewer than 1 evaluations.
    """
    if evaluations < 1:
        raise SettingError(f"evaluations is {evaluations}; it must be at least 1")
    for name in parameters:
        if name != "pressure":
            value_of(settings, name)
    return tuple(dict.fromkeys(parameters)) or tuple(
        name
        for name in _allowed()
        if settings.tactile in PARAMETERS[name].usual and getattr(settings.noise, name) is not None
    )


def value_of(settings: TrackerSettings, name: str) -> float:
    """The value of a parameter; SettingError where it has none."""
    if name not in _allowed():
        raise SettingError(f"parameter {name!r} cannot be tuned; allowed are {', '.join(_allowed())}")
    value: Any = settings.pressure if name == "pressure" else getattr(settings.noise, name)
    if value is None:
        raise SettingError(f"parameter {name!r} is off in the settings that tuning starts from; it stays so")
    return float(value[PARAMETERS[name].components[0]] if PARAMETERS[name].components else value)


def with_value(settings: TrackerSettings, name: str, value: float) -> TrackerSettings:
    """The settings with another value of a parameter, in four digits."""
    if name == "pressure":
        return replace(settings, pressure=_rounded(value))
    changed: Any = _rounded(value)
    if components := PARAMETERS[name].components:
        factor = value / value_of(settings, name)
        vector = getattr(settings.noise, name)
        changed = tuple(_rounded(v * factor) if index in components else v for index, v in enumerate(vector))
    return replace(settings, noise=replace(settings.noise, **{name: changed}))


def values_of(names: Sequence[str], start: TrackerSettings, now: TrackerSettings) -> dict[str, tuple[float, float]]:
    """Each parameter's value at the start and now."""
    return {name: (value_of(start, name), value_of(now, name)) for name in names}


def _allowed() -> list[str]:
    noise = {field.name for field in fields(GraphNoise)}
    return [name for name in PARAMETERS if name in noise or name == "pressure"]


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
