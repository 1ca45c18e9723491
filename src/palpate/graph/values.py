"""Values of all unknowns, and what follows from them that several factors need."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Array, compiled
from palpate.graph.contact_geometry import TOUCHING, ContactModel, pushing_angles
from palpate.graph.se2_kernels import between, exp_onto, log, position, rotation, wrap
from palpate.graph.variables import (
    FRICTION_CENTER,
    IN_SHARED,
    IN_STEP,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED_SIZE,
    STEP_SIZE,
    Unknown,
)

State = tuple[Array, Array, Array, Any, Array, float, complex, Array]
"""What a kernel takes of values: g and e (B, N, 3), what is shared (SHARED_SIZE, B), TOUCHING (B, N), the angle of
the pushing force (B, N) [rad], c [m] of the model and its centre of friction [m], and knocks (B, N, 2)."""


@dataclass(frozen=True)
class Knock:
    """That something else than the sensor may move the object in a step, so that nothing of pushing holds in it."""

    slid: float
    """How far the object is thought to slide over the sensor, counter-clockwise along the outline [m]."""
    spread: float
    """Standard deviation of that [m]; how far the object may turn goes with it, see `factors.balance`."""


SLID, SPREAD = 0, 1
"""Places of `Knock`'s numbers among knocks; the spread is 0 in a step in which only the sensor moves the object."""

_NO_TOUCHING, _NO_ANGLE = np.empty((0, 0), TOUCHING), np.empty((0, 0))
ANGLE_STEPS = 3
"""Steps before and after the one at which the angle of the pushing force is sought."""


class Values:
    """Values of all unknowns of B smoothers at N steps of a contact, by unknown.

    Of an unknown of a step they are (B, N, dimension), of one that steps share (dimension, B). Beside them stand the
    knocks that each smoother takes to have happened.
    """

    def __init__(
        self, model: ContactModel, of_steps: Mapping[Unknown, Array], shared: Array, knocks: Array | None = None
    ) -> None:
        """Take what touches what, arrays of the steps' unknowns, what they share, (SHARED_SIZE, B), and knocks.

        These are (B, N, 2), see SLID; by default there is none.
        """
        self.model, self.shared = model, shared
        self._of_steps = of_steps
        self.knocks = np.zeros((*of_steps[SENSOR].shape[:2], 2)) if knocks is None else knocks

    def __getitem__(self, unknown: Unknown) -> Array:
        place = IN_SHARED.get(unknown)
        return self._of_steps[unknown] if place is None else self.shared[place]

    @property
    def smoothers(self) -> int:
        """B."""
        return self.shared.shape[1]

    @property
    def steps(self) -> int:
        """N."""
        return self._of_steps[SENSOR].shape[1]

    @cached_property
    def touching(self) -> NDArray[np.void]:
        """How the sensor touches the outline: TOUCHING (B, N)."""
        return self.model.touching(self[SENSOR_IN_OBJECT])

    @cached_property
    def pushing_angle(self) -> Array:
        """Angle of the pushing force from the outline's inward normal (B, N) [rad]; see `pushing_angles`."""
        model, angle = self.model, np.empty((self.smoothers, self.steps))
        c, center, besides = model.friction_radius, model.friction_center, self[FRICTION_CENTER]
        g, e = self[SENSOR_IN_OBJECT], self[SENSOR]
        pushing_angles(g, e, self.touching, c, center, besides, ANGLE_STEPS, angle)
        return angle

    @cached_property
    def state(self) -> State:
        """What kernels of factors take."""
        g, e, c, center = self[SENSOR_IN_OBJECT], self[SENSOR], self.model.friction_radius, self.model.friction_center
        return g, e, self.shared, self.touching, self.pushing_angle, c, center, self.knocks

    @cached_property
    def poses(self) -> State:
        """The same without what follows from the outline, for kernels that do not read it."""
        c, center = self.model.friction_radius, self.model.friction_center
        return self[SENSOR_IN_OBJECT], self[SENSOR], self.shared, _NO_TOUCHING, _NO_ANGLE, c, center, self.knocks

    @staticmethod
    def bank(chosen: Sequence[tuple["Values", int]]) -> "Values":
        """Return those of smoothers side by side; each is values and which of them, all at the same steps."""
        first = chosen[0][0]
        of_steps = {one: np.stack([at[one][b] for at, b in chosen]) for one in first._of_steps}
        shared = np.stack([at.shared[:, b] for at, b in chosen], axis=1)
        return Values(first.model, of_steps, shared, np.stack([at.knocks[b] for at, b in chosen]))

    def continued(self, sensor_pose: Array, knocks: Sequence[Knock | None]) -> "Values":
        """Return the values with one more step: the sensor, now here (3,), goes on turning on the object as it did.

        `knocks` are what each smoother thinks may have moved the object besides.
        """
        new = np.array([(one.slid, one.spread) if one else (0.0, 0.0) for one in knocks])
        g, e = (np.empty((self.smoothers, self.steps + 1, 3)) for _ in range(2))
        g[:, :-1], e[:, :-1], e[:, -1] = self[SENSOR_IN_OBJECT], self[SENSOR], sensor_pose
        _put_next(g)
        known = np.concatenate([self.knocks, new[:, None]], axis=1)
        return Values(self.model, {SENSOR_IN_OBJECT: g, SENSOR: e}, self.shared, known)

    def slid(self, first: int, knock: Knock) -> "Values":
        """Return the values with the object knocked in each step from `first` on."""
        g, knocks = self[SENSOR_IN_OBJECT].copy(), self.knocks.copy()
        knocks[:, first:, SLID], knocks[:, first:, SPREAD] = knock.slid, knock.spread
        # Seen from the object, the sensor goes the other way.
        lengths = -knock.slid * np.arange(1.0, self.steps - first + 1)
        for poses in g:
            poses[first:] = self.model.moved_along(poses[first:], lengths)
        return Values(self.model, {SENSOR_IN_OBJECT: g, SENSOR: self[SENSOR]}, self.shared, knocks)

    def without_oldest(self) -> "Values":
        """Return the values of all steps but the oldest."""
        return self.with_steps(lambda value: value[:, 1:])

    def with_steps(self, change: Callable[[Array], Array]) -> "Values":
        """Return the values at other steps: what `change` makes of the array (B, N, dimension) of each unknown."""
        of_steps = {one: np.ascontiguousarray(change(value)) for one, value in self._of_steps.items()}
        return Values(self.model, of_steps, self.shared, np.ascontiguousarray(change(self.knocks)))

    def with_value(self, unknown: Unknown, value: Array) -> "Values":
        """Return the values with another one (dimension, B) of what steps share."""
        shared = self.shared.copy()
        shared[IN_SHARED[unknown]] = value
        return Values(self.model, self._of_steps, shared, self.knocks)

    def moved(self, by_step: Array, by_shared: Array) -> "Values":
        """Return the values moved by changes of the steps (B, N, STEP_SIZE) and of what they share (B, SHARED_SIZE)."""
        of_steps = {one: _step_moved(value, by_step, one) for one, value in self._of_steps.items()}
        shared = np.add(self.shared, by_shared.T, out=np.empty_like(self.shared))
        return Values(self.model, of_steps, shared, self.knocks)

    def apart_from(self, before: "Values", steps: int) -> Array:
        """Return how far the first steps and what is shared moved from where they were.

        That is (B, steps STEP_SIZE + SHARED_SIZE), each step in turn and what is shared last.
        """
        end = STEP_SIZE * steps
        apart = np.empty((self.smoothers, end + SHARED_SIZE))
        for one, value in self._of_steps.items() if steps else ():
            _put_apart(before[one], value, steps, IN_STEP[one].start, apart)
        np.subtract(self.shared.T, before.shared.T, out=apart[:, end:])
        return apart


def _step_moved(value: Array, change: Array, unknown: Unknown) -> Array:
    moved = np.empty_like(value)
    _put_moved(value, change, IN_STEP[unknown].start, moved)
    return moved


@compiled
def _put_moved(values: Array, change: Array, first: int, out: Array) -> None:
    for b in range(values.shape[0]):
        for k in range(values.shape[1]):
            exp_onto(values[b, k], change[b, k, first : first + 3], out[b, k])


@compiled
def _put_apart(before: Array, now: Array, steps: int, first: int, out: Array) -> None:
    seen = np.empty(3)
    for b in range(now.shape[0]):
        for k in range(steps):
            start = STEP_SIZE * k + first
            between(before[b, k], now[b, k], seen)
            log(seen, out[b, start : start + 3])


@compiled
def _put_next(poses: Array) -> None:
    """Put the last pose where the two before it lead; copies of whole arrays would take seconds to compile."""
    last_step = poses.shape[1] - 1
    turned = np.empty(3)
    for b in range(len(poses)):
        last = poses[b, last_step - 1]
        between(poses[b, max(last_step - 2, 0)], last, turned)
        ahead = position(last) + rotation(last[2]) * position(turned)
        poses[b, last_step, 0], poses[b, last_step, 1] = ahead.real, ahead.imag
        poses[b, last_step, 2] = wrap(last[2] + turned[2])
