"""What a user tells the node: its parameters, named like the options of `palpate live`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import SettingError
from palpate.live.ros2 import Ros2Node, message_type
from palpate.touch.modes import Tactile


@dataclass(frozen=True, eq=False)
class Parameters:
    """How to track what; each field is a parameter of the node."""

    shape: str
    """The object: a name, or a file of its outline."""
    first_pose: ArrayLike
    """world_T_object at the start, (3,) [m, m, rad], in the plane of the push."""
    first_pose_sigma: ArrayLike | None = None
    """Standard deviations of that pose, (3,) [m, m, rad]."""
    plane: ArrayLike = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the sensor's poses, (3,)."""
    tactile: Tactile = "learnt"
    """What touch says."""
    calibration: Path | None = None
    """What is known of the sensor unit, a file of `palpate calibrate`."""


def parameters_of(ros: Ros2Node) -> Parameters:
    """The node's parameters. Raises SettingError that names one that is missing or of another kind."""
    words = {name: _word(ros, name) for name in ("shape", "tactile", "calibration")}
    numbers = {name: _numbers(ros, name) for name in ("first_pose", "first_pose_sigma", "plane")}
    given: dict[str, Any] = {name: value for name, value in {**words, **numbers}.items() if value is not None}
    if not {"shape", "first_pose"} <= given.keys():
        raise SettingError(
            "the object is not known: the parameters shape and first_pose say it, "
            "-p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]'"
        )
    if "calibration" in given:
        given["calibration"] = Path(given["calibration"])
    return Parameters(**given)


def _word(ros: Ros2Node, name: str) -> str | None:
    """A parameter that is a word; None where it is not given, or empty."""
    value = _value(ros, name)
    if value is not None and not isinstance(value, str):
        raise SettingError(f"parameter {name} is {value!r}; allowed is a word")
    return value or None


def _numbers(ros: Ros2Node, name: str) -> ArrayLike | None:
    """A parameter that is three numbers; None where it is not given."""
    value = _value(ros, name)
    try:
        numbers = np.array([0.0] * 3 if value is None else value, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise SettingError(f"parameter {name} is {value!r}; allowed are three finite numbers: '[0.1, 0.0, 0.3]'")
    return None if value is None else numbers


def _value(ros: Ros2Node, name: str) -> Any:
    anything = message_type("rcl_interfaces/msg/ParameterDescriptor")(dynamic_typing=True)
    return ros.node.declare_parameter(name, None, anything).value
