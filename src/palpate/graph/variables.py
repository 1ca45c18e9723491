"""Every unknown of the graph by name: what it is, its unit and prior, and the one place that lays them out.

An unknown belongs to a step, to a whole contact or to the object and all its contacts. Those of a step stand in the
vector of that step; the others, which all steps share, stand in one vector after them, first those of the contact, then
those of the object. A new unknown is one constant and one entry of UNKNOWNS.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.config.tunable import Settings, Tunable, setting
from palpate.errors import SettingError
from palpate.types.measurements import FARTHEST_BACK

Array = NDArray[np.float64]
Normal = tuple[float, float]
"""Mean and standard deviation."""

_FRICTION_CHANGES = (0.44, 0.003)
"""See Unknown.changes: friction is not the same at every place and time, and what a contact teaches may be wrong."""

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
    """Of each number, before anything is measured; None where a measurement is what brings it into being."""
    changes: tuple[float, float] = (0.0, 0.0)
    """By how much it may change from one contact to the next and in each step of a contact, as shares of its prior's
    standard deviation."""


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
    prior=(0.0, 2e-2),
)
DIRECTION_SCALE = Unknown(
    "direction_scale",
    "object",
    1,
    "1",
    "What share of themselves all contact directions of one sensor and object are too large by.",
    prior=(0.0, 0.06),
)
PLACE_BIAS = Unknown(
    "place_bias",
    "object",
    1,
    "m",
    "What all contact places of one sensor and object are too large by.",
    prior=(0.0, 1.2e-3),
)
DEPTH = Unknown(
    "depth",
    "object",
    1,
    "m",
    "How deep the object lies in the gel, and what else outline, gel and mounting are apart by all the time.",
    prior=(3e-4, 4e-4),
)
OUTLINE_SCALE = Unknown(
    "outline_scale",
    "object",
    1,
    "1",
    "What share of its size the object is larger by than its outline says.",
    prior=(0.0, 0.007),
)
FRICTION_RATIO = Unknown(
    "friction_ratio",
    "object",
    1,
    "1",
    "Logarithm of the ratio of c^2 to that of the chosen pressure; from uniform to rim pressure it grows by 0.8.",
    prior=(0.2, 0.66),
    changes=_FRICTION_CHANGES,
)
FRICTION_CENTER = Unknown(
    "friction_center",
    "object",
    2,
    "c",
    "Where the centre of friction is from the centroid, along x and y of the object, as a share of c.",
    prior=(0.0, 0.06),
    changes=_FRICTION_CHANGES,
)
GRIP = Unknown(
    "grip",
    "object",
    1,
    "1",
    "Coulomb friction between sensor and object: the tangent of the friction cone's half angle.",
    prior=(0.4, 0.1),
    changes=_FRICTION_CHANGES,
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


def _prior(unknown: Unknown, tune: Tunable) -> Any:
    return setting(unknown.prior, is_normal=True, tune=tune)


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


@dataclass(frozen=True)
class Priors(Settings):
    """What is believed of the object's unknowns before it is first touched: mean and standard deviation of each."""

    direction_bias: Normal = _prior(DIRECTION_BIAS, Tunable(1e-4, 0.1, usual=False, components=(1,)))
    """See DIRECTION_BIAS [rad]."""
    direction_scale: Normal = _prior(DIRECTION_SCALE, Tunable(1e-4, 0.5, usual=False, components=(1,)))
    """See DIRECTION_SCALE."""
    place_bias: Normal = _prior(PLACE_BIAS, Tunable(1e-5, 1e-2, usual=False, components=(1,)))
    """See PLACE_BIAS [m]."""
    depth: Normal = _prior(DEPTH, Tunable(1e-5, 1e-2, usual=False, components=(1,)))
    """See DEPTH [m]."""
    outline_scale: Normal = _prior(OUTLINE_SCALE, Tunable(1e-4, 0.5, usual=False, components=(1,)))
    """See OUTLINE_SCALE."""
    friction_ratio: Normal = _prior(FRICTION_RATIO, Tunable(0.01, 2.0, components=(1,)))
    """See FRICTION_RATIO."""
    friction_center: Normal = _prior(FRICTION_CENTER, Tunable(0.01, 1.0, components=(1,)))
    """See FRICTION_CENTER [c]; the same along x and y."""
    grip: Normal = _prior(GRIP, Tunable(0.01, 1.0, components=(1,)))
    """See GRIP."""

    @property
    def mean(self) -> Array:
        """Means (OBJECT_SIZE,) of what belongs to the object."""
        return self._spread(0)

    @property
    def deviation(self) -> Array:
        """Standard deviations (OBJECT_SIZE,) of the same."""
        return self._spread(1)

    def changes(self, part: int) -> Array:
        """Variances (OBJECT_SIZE,) of the changes from one contact to the next (part 0), or in a step of one (1)."""
        shares = np.concatenate([np.full(one.dimension, one.changes[part]) for one in OF_OBJECT])
        return np.square(shares * self.deviation)

    def _spread(self, part: int) -> Array:
        return np.concatenate([np.full(one.dimension, getattr(self, one.name)[part]) for one in OF_OBJECT])
