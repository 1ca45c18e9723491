"""Parameters of tuning: their ranges, and their values in settings."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from palpate.config import TrackerSettings
from palpate.errors import SettingError
from palpate.touch.pipeline import MEASURE_DIRECTION, MEASURE_TURN


class Tunable(NamedTuple):
    """Range of a setting that can be tuned."""

    lowest: float
    highest: float
    by_default: bool = False
    """Tuned if nothing else is asked for."""
    components: tuple[int, ...] = ()
    """Components of a tuple that are scaled together; the setting's value is the first of them."""


TUNABLE = {
    "sensor_pose.deviation": Tunable(1e-6, 1e-2, components=(0, 1, 2)),
    "first_pose.rest": Tunable(1e-8, 1e-2, components=(0, 1, 2)),
    "contact.deviation": Tunable(1e-5, 1e-2),
    "contact.kernel": Tunable(0.1, 100.0),
    "direction.share": Tunable(1e-2, 100.0, by_default=True),
    "direction.kernel": Tunable(0.1, 100.0),
    "place.share": Tunable(1e-2, 100.0),
    "place.kernel": Tunable(0.1, 100.0),
    "turn.share": Tunable(1e-2, 1000.0, by_default=True),
    "turn.kernel": Tunable(0.1, 100.0),
    "sticking.still": Tunable(1e-7, 1e-2),
    "sticking.share": Tunable(1e-3, 10.0, by_default=True),
    "sticking.sliding_share": Tunable(1e-3, 100.0, by_default=True),
    "sticking.margin": Tunable(1e-3, 0.5, by_default=True),
    "sticking.width": Tunable(1e-3, 0.5),
    "sticking.kernel": Tunable(0.1, 100.0, by_default=True),
    "balance.still": Tunable(1e-9, 1e-3),
    "balance.share": Tunable(1e-3, 10.0, by_default=True),
    "balance.load": Tunable(1e-2, 10.0),
    "balance.kernel": Tunable(0.1, 100.0),
    "friction_cone.still": Tunable(1e-7, 1e-2),
    "friction_cone.share": Tunable(1e-3, 10.0, by_default=True),
    "friction_cone.width": Tunable(1e-3, 0.5),
    "friction_cone.kernel": Tunable(0.1, 100.0),
    "priors.direction_bias": Tunable(1e-4, 0.1, components=(1,)),
    "priors.direction_scale": Tunable(1e-4, 0.5, components=(1,)),
    "priors.place_bias": Tunable(1e-5, 1e-2, components=(1,)),
    "priors.depth": Tunable(1e-5, 1e-2, components=(1,)),
    "priors.outline_scale": Tunable(1e-4, 0.5, components=(1,)),
    "priors.friction_ratio": Tunable(0.01, 2.0, True, (1,)),
    "priors.friction_center": Tunable(0.01, 1.0, True, (1,)),
    "priors.grip": Tunable(0.01, 1.0, True, (1,)),
}
"""By default nothing is tuned that the robot knows (`sensor_pose`) or that a simulation knows too well (`contact`,
`priors.depth`)."""

_ONLY_IN = {
    "direction.share": MEASURE_DIRECTION,
    "turn.share": (*MEASURE_TURN, "oracle"),
}
"""Modes of touch in which a setting matters; the others matter in all."""


def check_parameters(settings: TrackerSettings, names: Sequence[str] = (), evaluations: int = 1) -> tuple[str, ...]:
    """Return the parameters to tune: these, or by default those that matter with this touch and are not off.

    Raises SettingError on a parameter that is unknown or off, and on fewer than 1 evaluations.
    """
    if evaluations < 1:
        raise SettingError(f"evaluations is {evaluations}; it must be at least 1")
    for name in names:
        value_of(settings, name)
    modes = {"learnt", "oracle"} if settings.tactile == "auto" else {settings.tactile}
    return tuple(dict.fromkeys(names)) or tuple(
        name
        for name, tunable in TUNABLE.items()
        if tunable.by_default and modes & set(_ONLY_IN.get(name, modes)) and _setting(settings, name) is not None
    )


def value_of(settings: TrackerSettings, name: str) -> float:
    """Return the value of a parameter; SettingError if it is unknown or off."""
    if name not in TUNABLE:
        raise SettingError(f"parameter {name!r} cannot be tuned; allowed are {', '.join(TUNABLE)}")
    value = _setting(settings, name)
    if value is None:
        raise SettingError(f"parameter {name!r} is off in the settings that tuning starts from; it stays so")
    components = TUNABLE[name].components
    return float(value[components[0]] if components else value)


def with_value(settings: TrackerSettings, name: str, value: float) -> TrackerSettings:
    """Return settings with another value of a parameter, rounded to four digits."""

    def rounded(number: float) -> float:
        return float(f"{number:.4g}")

    new: Any = rounded(value)
    if components := TUNABLE[name].components:
        old, factor = _setting(settings, name), value / value_of(settings, name)
        new = tuple(rounded(number * factor) if k in components else number for k, number in enumerate(old))
    group, setting = name.split(".")
    changed = replace(getattr(settings.noise, group), **{setting: new})
    return replace(settings, noise=replace(settings.noise, **{group: changed}))


def _setting(settings: TrackerSettings, name: str) -> Any:
    group, setting = name.split(".")
    return getattr(getattr(settings.noise, group), setting)
