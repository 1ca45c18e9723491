"""The settings of all factors, and the friction of the object on its support, as one record for compiled code."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings
from palpate.models.pushing.contact_geometry import ContactModel

_SUPPORT = np.dtype([("radius", np.float64), ("center", np.complex128), ("span", np.float64)], align=True)
"""Friction radius c [m], nominal centre of friction [m] in the object frame, span of the tips [m]."""


def settings_record(noise: NoiseSettings, model: ContactModel) -> NDArray[np.void]:
    """Return a record (1,) with a field `support`, and a field for each group of settings except the priors."""
    support = (model.friction_radius, model.friction_center, model.span)
    # Without a kernel, its scale is infinite.
    groups = [tuple(math.inf if number is None else number for number in group.values()) for group in _groups(noise)]
    return np.array([(support, *groups)], SETTINGS)


def _groups(noise: NoiseSettings) -> list[dict[str, Any]]:
    """Return the groups of settings that factors read, by the names of their fields."""
    return [group for name, group in asdict(noise).items() if name != "priors"]


def _settings_type() -> np.dtype:
    fields: list[Any] = [("support", _SUPPORT)]
    for name, group in asdict(NoiseSettings()).items():
        if name != "priors":
            fields.append((name, [(key, np.float64, np.shape(number)) for key, number in group.items()]))
    return np.dtype(fields, align=True)


SETTINGS = _settings_type()
"""Type of the record."""
