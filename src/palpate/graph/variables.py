"""Every unknown of the graph by name: what it is, its unit and prior, and the one place that lays them out.

An unknown belongs to a step, to a whole contact or to the object and all its contacts. Those of a step stand in the
vector of that step; the others, which all steps share, stand in one vector after them, first those of the contact, then
those of the object. A new unknown is one constant and one entry of UNKNOWNS.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.types.measurements import FARTHEST_BACK

Array = NDArray[np.float64]
Normal = tuple[float, float]
"""Mean and standard deviation."""

LAG = FARTHEST_BACK + 1
"""Steps that a sliding window holds: the last one, and all that touch compares it with."""


@dataclass(frozen=True, eq=False)
class Unknown:
    """One quantity that the graph estimates."""

    name: str
    """As settings and messages call it."""
    scope: Literal["step", "contact", "object"]
    """What has one: every step, every contact, or the object for as long as it is tracked. That of a step is a planar
    pose, which moves by right perturbations; the others are vectors, which move by sums."""
    dimension: int
    """How many numbers it is; of a pose, those of its tangent space."""
    unit: str
    """Of these numbers."""
    meaning: str
    """In a sentence."""
    prior: Normal | None = None
    """Mean and standard deviation of each number at the start of a contact; those of the object are in
    `config.Priors`, and a pose has none."""


SENSOR_IN_OBJECT = Unknown(
    "sensor_in_object", "step", 3, "m, m, rad", "The sensor's pose in the object frame, g = o^-1 e."
)
SENSOR = Unknown("sensor", "step", 3, "m, m, rad", "The sensor's pose in the world, e.")
TURN_OFFSET = Unknown(
    "turn_offset",
    "contact",
    1,
    "rad",
    "What the turns that touch tells in one contact are less than the sensor's yaw in the object frame.",
    # Three times pi says nothing of an angle, and the system is determined without a turn.
    prior=(0.0, 10.0),
)
DIRECTION_BIAS = Unknown(
    "direction_bias",
    "object",
    1,
    "rad",
    "What all contact directions of one sensor and object are too large by.",
)
DIRECTION_SCALE = Unknown(
    "direction_scale",
    "object",
    1,
    "1",
    "What share of themselves all contact directions of one sensor and object are too large by.",
)
PLACE_BIAS = Unknown(
    "place_bias",
    "object",
    1,
    "m",
    "What all contact places of one sensor and object are too large by.",
)
DEPTH = Unknown(
    "depth",
    "object",
    1,
    "m",
    "How deep the object lies in the gel, and what else outline, gel and mounting are apart by all the time.",
)
OUTLINE_SCALE = Unknown(
    "outline_scale",
    "object",
    1,
    "1",
    "What share of its size the object is larger by than its outline says.",
)
FRICTION_RATIO = Unknown(
    "friction_ratio",
    "object",
    1,
    "1",
    "Logarithm of the ratio of c^2 to that of the chosen pressure; from uniform to rim pressure it grows by 0.8.",
)
FRICTION_CENTER = Unknown(
    "friction_center",
    "object",
    2,
    "c",
    "Where the centre of friction is from the centroid, along x and y of the object, as a share of c.",
)
GRIP = Unknown(
    "grip",
    "object",
    1,
    "1",
    "Coulomb friction between sensor and object: the tangent of the friction cone's half angle.",
)

UNKNOWNS = (
    SENSOR_IN_OBJECT,
    SENSOR,
    TURN_OFFSET,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    PLACE_BIAS,
    DEPTH,
    OUTLINE_SCALE,
    FRICTION_RATIO,
    FRICTION_CENTER,
    GRIP,
)
"""All of them, in the order in which they stand in the vectors of a step and of what steps share."""

OBJECT_POSE = Unknown("object_pose", "step", 3, "m, m, rad", "The object's pose in the world, o = e g^-1.")
"""Follows from SENSOR and SENSOR_IN_OBJECT in contact and is an unknown by itself between contacts: a measurement may
be of it, but it has no place of its own in the graph of a contact."""


def _of(*scopes: str) -> tuple[Unknown, ...]:
    return tuple(unknown for scope in scopes for unknown in UNKNOWNS if unknown.scope == scope)


def _places(unknowns: tuple[Unknown, ...]) -> dict[Unknown, slice]:
    ends = np.cumsum([unknown.dimension for unknown in unknowns]).tolist()
    return {unknown: slice(end - unknown.dimension, end) for unknown, end in zip(unknowns, ends, strict=True)}


OF_STEP, OF_CONTACT, OF_OBJECT = _of("step"), _of("contact"), _of("object")
SHARED = OF_CONTACT + OF_OBJECT
"""Those that all steps of a contact share."""
IN_STEP, IN_SHARED, IN_OBJECT = _places(OF_STEP), _places(SHARED), _places(OF_OBJECT)
"""Where an unknown stands in the vector of a step, of what is shared, and of what belongs to the object."""
STEP_SIZE, SHARED_SIZE, OBJECT_SIZE = (
    sum(unknown.dimension for unknown in unknowns) for unknowns in (OF_STEP, SHARED, OF_OBJECT)
)
CONTACT_SIZE = SHARED_SIZE - OBJECT_SIZE


def named(name: str) -> Unknown:
    """Return the unknown of this name; raises SettingError where there is none."""
    known = {unknown.name: unknown for unknown in (OBJECT_POSE, *UNKNOWNS)}
    if name not in known:
        raise SettingError(f"unknown {name!r} is not known; known are {', '.join(known)}")
    return known[name]
