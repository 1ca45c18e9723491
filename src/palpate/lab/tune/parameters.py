"""What can be tuned, within which limits, and how a value of it is read from and put into settings."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from palpate.config.settings import NoiseSettings
from palpate.config.tracker_settings import TrackerSettings
from palpate.config.tunable import Tunable
from palpate.errors import SettingError
from palpate.touch.modes import TELL_DIRECTION, TELL_TURN

PRESSURE = "pressure"
"""c [m], for recordings of one object."""

_C = Tunable(1e-3, 1.0, usual=False)
_ONLY_IN = {
    "relative_pose.oracle": ("oracle",),
    "relative_pose.constant": ("constant",),
    "direction.share": TELL_DIRECTION,
    "turn.share": TELL_TURN,
}
"""Tactile modes in which a setting counts; the others count in all."""


def tunable() -> dict[str, Tunable]:
    """Return what can be tuned, by name: settings as `group.setting`, and `pressure`.

    Each factor says itself what tuning may do with its settings. Nothing is tuned by itself that the robot knows
    (`sensor_pose`) or the laboratory (`contact`, `priors.depth`): how well outline, gel and motion capture agree is
    what a simulation knows too well.
    """
    noise = NoiseSettings()
    found = {
        f"{group.name}.{setting.name}": setting.metadata["tune"]
        for group in fields(noise)
        for setting in fields(getattr(noise, group.name))
    }
    return {name: tune for name, tune in found.items() if tune is not None} | {PRESSURE: _C}


def check_parameters(settings: TrackerSettings, names: Sequence[str] = (), evaluations: int = 1) -> tuple[str, ...]:
    """Return what is tuned, by default what is usual in the tactile mode, where auto is
    learnt and oracle; a kernel that is off stays off.

    Raises SettingError on a parameter that is not known or off, and on fewer than 1 evaluations.
    """
    if evaluations < 1:
        raise SettingError(f"evaluations is {evaluations}; it must be at least 1")
    for name in names:
        if name != PRESSURE:
            value_of(settings, name)
    modes = {"learnt", "oracle"} if settings.tactile == "auto" else {settings.tactile}
    return tuple(dict.fromkeys(names)) or tuple(
        name
        for name, tune in tunable().items()
        if tune.usual and modes & set(_ONLY_IN.get(name, modes)) and _setting(settings, name) is not None
    )


def value_of(settings: TrackerSettings, name: str) -> float:
    """The value of a parameter; SettingError where it has none."""
    if name not in tunable():
        raise SettingError(f"parameter {name!r} cannot be tuned; allowed are {', '.join(tunable())}")
    value = _setting(settings, name)
    if value is None:
        raise SettingError(f"parameter {name!r} is off in the settings that tuning starts from; it stays so")
    components = tunable()[name].components
    return float(value[components[0]] if components else value)


def with_value(settings: TrackerSettings, name: str, value: float) -> TrackerSettings:
    """The settings with another value of a parameter, in four digits."""
    if name == PRESSURE:
        return replace(settings, pressure=_rounded(value))
    changed: Any = _rounded(value)
    if components := tunable()[name].components:
        factor = value / value_of(settings, name)
        changed = tuple(
            _rounded(v * factor) if index in components else v for index, v in enumerate(_setting(settings, name))
        )
    group, setting = name.split(".")
    changed_group = replace(getattr(settings.noise, group), **{setting: changed})
    return replace(settings, noise=replace(settings.noise, **{group: changed_group}))


def values_of(names: Sequence[str], start: TrackerSettings, now: TrackerSettings) -> dict[str, tuple[float, float]]:
    """Each parameter's value at the start and now."""
    return {name: (value_of(start, name), value_of(now, name)) for name in names}


def _setting(settings: TrackerSettings, name: str) -> Any:
    if name == PRESSURE:
        return settings.pressure
    group, setting = name.split(".")
    return getattr(getattr(settings.noise, group), setting)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
