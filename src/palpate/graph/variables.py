"""Variables of the graph: name, size, unit and prior of each, and their places in the state vectors.

A variable belongs to a step, to a whole contact, or to the object and all its contacts. Variables of a step form that
step's vector. All others are shared by the steps of a contact and form one vector: first those of the contact, then
those of the object. A new variable is one constant here and, if it belongs to the object, one prior in
`palpate.config.Priors`.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.config import Normal
from palpate.errors import SettingError


@dataclass(frozen=True, eq=False)
class Variable:
    """One quantity that the graph estimates."""

    name: str
    """Name in settings, messages and `OwnMeasurement.on`."""
    scope: Literal["step", "contact", "object"]
    """Lifetime. Variables of a step are planar poses with right perturbations; the others are vectors."""
    dimension: int
    """Size; of a pose, that of its tangent space."""
    prior: Normal = (0.0, math.inf)
    """Prior of a variable of a contact, which is one number, before any measurement."""


SENSOR_IN_OBJECT = Variable("sensor_in_object", "step", 3)
"""Sensor pose in the object frame, g = o^-1 e [m, m, rad]."""
SENSOR = Variable("sensor", "step", 3)
"""Sensor pose in the world, e [m, m, rad]."""
TURN_OFFSET = Variable("turn_offset", "contact", 1, prior=(0.0, 10.0))
"""Sensor yaw in the object frame minus the measured turn [rad]. The wide prior keeps it determined without any turn."""
CORNER_BIAS = Variable("corner_bias", "contact", 1, prior=(0.0, 0.16))
"""Common error of the angles of a contact's corner [rad]."""
DIRECTION_BIAS = Variable("direction_bias", "object", 1)
"""Common error of all contact directions [rad]."""
DIRECTION_SCALE = Variable("direction_scale", "object", 1)
"""Relative scale error of contact directions."""
PLACE_BIAS = Variable("place_bias", "object", 1)
"""Common error of all contact places [m]."""
DEPTH = Variable("depth", "object", 1)
"""Indentation of the gel, including any constant offset between outline, gel and mounting [m]."""
OUTLINE_SCALE = Variable("outline_scale", "object", 1)
"""Relative size error of the outline."""
FRICTION_RATIO = Variable("friction_ratio", "object", 1)
"""Logarithm of c^2 over the c^2 of an even pressure on the table."""
FRICTION_CENTER = Variable("friction_center", "object", 2)
"""Centre of friction relative to the centroid, along x and y of the object, in units of c."""
GRIP = Variable("grip", "object", 1)
"""Logarithm of the Coulomb friction coefficient between sensor and object."""

VARIABLES = tuple(one for one in tuple(globals().values()) if isinstance(one, Variable))
"""All of these, in their order, which is that of the state vectors."""

OBJECT_POSE = Variable("object_pose", "step", 3)
"""Object pose in the world, o = e g^-1 [m, m, rad]: a derived quantity in contact, a variable of its own at rest."""


def _of(*scopes: str) -> tuple[Variable, ...]:
    return tuple(variable for scope in scopes for variable in VARIABLES if variable.scope == scope)


def _places(variables: tuple[Variable, ...]) -> dict[Variable, slice]:
    ends = np.cumsum([variable.dimension for variable in variables]).tolist()
    return {variable: slice(end - variable.dimension, end) for variable, end in zip(variables, ends, strict=True)}


OF_STEP, OF_CONTACT, OF_OBJECT = _of("step"), _of("contact"), _of("object")
SHARED = OF_CONTACT + OF_OBJECT
"""Variables shared by all steps of a contact."""
IN_SHARED, IN_OBJECT = _places(SHARED), _places(OF_OBJECT)
"""Places of a variable in the vector of the shared variables, and of the object's variables."""
STEP_SIZE, SHARED_SIZE, OBJECT_SIZE = (
    sum(variable.dimension for variable in variables) for variables in (OF_STEP, SHARED, OF_OBJECT)
)
CONTACT_SIZE = SHARED_SIZE - OBJECT_SIZE
LAST_SIZE, WIDTH = STEP_SIZE + SHARED_SIZE, 2 * STEP_SIZE + SHARED_SIZE
"""Numbers of one step and the shared variables, and of two steps and the shared variables."""


def column(variable: Variable) -> int:
    """Return the first column of a shared variable in a Jacobian, after those of two steps."""
    return 2 * STEP_SIZE + IN_SHARED[variable].start


def named(name: str) -> Variable:
    """Return the variable of this name; raises SettingError if there is none."""
    known = {variable.name: variable for variable in (OBJECT_POSE, *VARIABLES)}
    if name not in known:
        raise SettingError(f"variable {name!r} is not known; known are {', '.join(known)}")
    return known[name]
