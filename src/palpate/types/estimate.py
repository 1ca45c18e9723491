"""Output of the tracker: the object's pose at one frame with its covariance, and its trajectory over time."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from palpate.arrays import Array, Flags
from palpate.types.outline import Outline

Status = Literal["resting", "tracking", "ambiguous", "strained", "uncertain", "displaced", "indeterminate", "faulty"]
"""Reliability of an estimate, which `docs/guide/status.md` describes; `palpate.status` decides it."""
Origin = Literal["as before", "first contact", "shove", "mirrored images", "rough start"]
"""Event that added a hypothesis.

- as before: nothing unusual has happened to the pose that was given or found before.
- first contact: another place of the outline at which a contact may have begun.
- shove: something else may have moved the object while it was touched.
- mirrored images: touch images may lie the other way round than the best hypothesis takes them.
- rough start: a place of the outline at which the first contact may have begun, as the first pose is known roughly.
"""


class Clearance(NamedTuple):
    """Predicted distance of the sensor from the object."""

    distance: float
    """[m], negative inside the outline."""
    deviation: float
    """Its standard deviation [m]."""


@dataclass(frozen=True, eq=False)
class Answer:
    """One of several poses that the object may have while touch cannot decide between them."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    weight: float
    """Probability among all answers, from 0 to 1."""
    origin: Origin = "as before"
    """Event that added it, if there are several answers."""


Answers = tuple[tuple[Answer, ...], ...]
"""All answers at each of N frames, the estimate first; none at frames with one, which is the estimate."""


def count_origins(answers: Iterable[Answer]) -> dict[Origin, int]:
    """Return the number of answers of each origin, in the order of the answers."""
    return dict(Counter(answer.origin for answer in answers))


def origins_text(answers: Sequence[Answer]) -> str:
    """Return the origins of several answers in words, as "as before 1; shove 4"; empty for a single one."""
    if len(answers) < 2:
        return ""
    return "; ".join(f"{origin} {count}" for origin, count in count_origins(answers).items())


@dataclass(frozen=True, eq=False)
class Estimate:
    """The object's pose at one frame, with its uncertainty and status."""

    time: float
    """[s]"""
    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta; it spans all answers."""
    contact: bool
    """True while the sensor touches the object."""
    status: Status
    """Degree of trust; see `palpate.types.estimate.Status`."""
    reason: str = ""
    """Reason of the status, or a fault of the input stream; empty if there is none."""
    answers: tuple[Answer, ...] = ()
    """All poses that the object may have: the estimate, which stays until another one is five times as likely, then the
    others by weight; one where nothing is ambiguous."""
    friction: tuple[float, float] = (math.nan, math.nan)
    """Coulomb friction between sensor and object as learnt so far, with its standard deviation; by the best answer."""
    contact_point: Array | None = None
    """Contact point on the outline, (2,) [m], world frame, by the best answer; None between contacts. For a wide pad or
    several tips it is the middle of the loaded part."""
    contact_normal: Array | None = None
    """Outward normal of the outline there, (2,), world frame; None between contacts, and of fingers that press the
    object between them."""
    innovations: Array | None = None
    """Innovations of the factors `palpate.models.pushing.layout.NAMES`, by the best answer, (F, 6, 3): for each row
    difference of measured and predicted before it was fused, variance of the prediction, and stated one, which is 0
    where there is none. Of sticking and balance, what is left once all is fused. None between contacts."""
    outline: Outline | None = None
    """The outline as learnt so far, with its band, if it is unknown or a sketch; None for a known one."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N poses of one object."""

    time: Array
    """(N,) [s], strictly increasing."""
    pose: Array
    """world_T_object, (N, 3) [m, m, rad]."""
    covariance: Array
    """(N, 3, 3) [m, m, rad], of the tangent vector at the estimate (right, body frame), order x, y, theta."""
    contact: Flags
    """(N,) true while the sensor touched the object."""
    status: tuple[str, ...]
    """(N,) status of each estimate."""
    reason: tuple[str, ...]
    """(N,) reason of each status, empty if there is none."""

    def __len__(self) -> int:
        return len(self.time)
