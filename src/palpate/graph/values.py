"""Values of all variables of a window, and quantities derived from them that several factors use."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.graph.belief import Indices
from palpate.graph.compiled import Array, Records, compiled
from palpate.graph.contact_geometry import ContactModel, force_angles
from palpate.graph.se2_kernels import between, exp_onto, log, position, rotation, wrap
from palpate.graph.variables import FRICTION_CENTER, IN_SHARED, IN_STEP, SENSOR, SENSOR_IN_OBJECT, STEP_SIZE, Variable

SLIDE, SPREAD = 0, 1
"""Columns of a disturbance: mean [m] by which something else slides the object over the sensor in a step,
counter-clockwise along the outline, and its standard deviation [m]. The latter is 0 in a step without disturbance."""
ANGLE_STEPS = 3
"""Steps before and after a step over which the angle of the pushing force is computed."""


class State(NamedTuple):
    """Values as the kernels of factors take them, for B rows and N steps."""

    sensor_in_object: Array
    """Poses g (B, N, 3)."""
    sensor: Array
    """Poses e (B, N, 3)."""
    shared: Array
    """(B, SHARED_SIZE)"""
    contact: Records
    """CONTACT_GEOMETRY (B, N)."""
    force_angle: Array
    """Angle of the pushing force from the outline's inward normal (B, N) [rad]."""
    friction_radius: float
    """Nominal c [m]."""
    centroid: complex
    """Nominal centre of friction [m], object frame."""
    disturbance: Array
    """(B, N, 2), see SLIDE and SPREAD."""
    sign: Array
    """(B,) 1.0, or -1.0 where touch images are taken as mirrored."""


@dataclass(frozen=True, eq=False)
class Values:
    """Values of B rows at N steps."""

    model: ContactModel
    """Outline, friction and sensor."""
    sensor_in_object: Array
    """(B, N, 3) [m, m, rad]."""
    sensor: Array
    """(B, N, 3) [m, m, rad]."""
    shared: Array
    """(B, SHARED_SIZE)"""
    disturbance: Array
    """(B, N, 2), see SLIDE and SPREAD."""
    sign: Array
    """(B,) 1.0, or -1.0 where touch images are taken as mirrored."""

    def __getitem__(self, variable: Variable) -> Array:
        """Return a variable: (B, N, 3) of steps, else (B, dimension)."""
        of_step = {SENSOR_IN_OBJECT: self.sensor_in_object, SENSOR: self.sensor}
        return of_step[variable] if variable in of_step else self.shared[:, IN_SHARED[variable]]

    @property
    def rows(self) -> int:
        """B."""
        return len(self.shared)

    @property
    def steps(self) -> int:
        """N."""
        return self.sensor.shape[1]

    @cached_property
    def contact(self) -> NDArray[np.void]:
        """CONTACT_GEOMETRY (B, N)."""
        return self.model.touching(self.sensor_in_object)

    @cached_property
    def state(self) -> State:
        """Input of the kernels."""
        model, g, e = self.model, self.sensor_in_object, self.sensor
        c, center, angle = model.friction_radius, model.friction_center, np.empty(g.shape[:2])
        shift = np.ascontiguousarray(self[FRICTION_CENTER])
        force_angles(g, e, self.contact, c, center, shift, ANGLE_STEPS, angle)
        return State(g, e, self.shared, self.contact, angle, c, center, self.disturbance, self.sign)

    def take(self, rows: Indices) -> "Values":
        """Return these rows."""
        return Values(
            self.model,
            self.sensor_in_object[rows],
            self.sensor[rows],
            self.shared[rows],
            self.disturbance[rows],
            self.sign[rows],
        )

    def where(self, rows: NDArray[np.bool_], other: "Values") -> "Values":
        """Return these rows (B,) of the values and the others of `other`."""
        return Values(
            self.model,
            np.where(rows[:, None, None], self.sensor_in_object, other.sensor_in_object),
            np.where(rows[:, None, None], self.sensor, other.sensor),
            np.where(rows[:, None], self.shared, other.shared),
            np.where(rows[:, None, None], self.disturbance, other.disturbance),
            np.where(rows, self.sign, other.sign),
        )

    def from_step(self, first: int) -> "Values":
        """Return the values of the steps from `first` on; negative numbers count from the end."""

        def cut(array: Array) -> Array:
            return np.ascontiguousarray(array[:, first:])

        g, e = cut(self.sensor_in_object), cut(self.sensor)
        return Values(self.model, g, e, self.shared, cut(self.disturbance), self.sign)

    def continued(self, sensor_pose: Array, disturbance: Array) -> "Values":
        """Return the values with one more step: the sensor, now at (3,), keeps turning on the object as before.

        `disturbance` (B, 2) is that of the new step.
        """
        g, e = (np.empty((self.rows, self.steps + 1, 3)) for _ in range(2))
        g[:, :-1], e[:, :-1], e[:, -1] = self.sensor_in_object, self.sensor, sensor_pose
        _extrapolate(g)
        disturbances = np.concatenate([self.disturbance, disturbance[:, None]], axis=1)
        return Values(self.model, g, e, self.shared, disturbances, self.sign)

    def disturbed(self, rows: Indices, first: int, slide: Array, spread: float) -> "Values":
        """Return the values with a disturbance in each step of some rows from `first` on.

        In each of these steps the object slides by `slide` (len(rows),) and its deviation is `spread`, both [m].
        """
        g, disturbance = self.sensor_in_object.copy(), self.disturbance.copy()
        for row, length in zip(np.arange(self.rows)[rows], slide, strict=True):
            disturbance[row, first:, SLIDE], disturbance[row, first:, SPREAD] = length, spread
            # Seen from the object, the sensor moves the other way.
            g[row, first:] = self.model.moved_along(g[row, first:], -length * np.arange(1.0, self.steps - first + 1))
        return replace(self, sensor_in_object=g, disturbance=disturbance)

    def with_shared(self, rows: Indices, variable: Variable, value: Array | float) -> "Values":
        """Return the values with another value (B, dimension) of a shared variable in some rows."""
        shared = self.shared.copy()
        shared[rows, IN_SHARED[variable]] = value
        return replace(self, shared=shared)

    def moved(self, by_step: Array, by_shared: Array) -> "Values":
        """Return the values changed by tangent vectors (B, N, STEP_SIZE) and (B, SHARED_SIZE)."""
        g, e = np.empty_like(self.sensor_in_object), np.empty_like(self.sensor)
        _move(self.sensor_in_object, by_step, IN_STEP[SENSOR_IN_OBJECT].start, g)
        _move(self.sensor, by_step, IN_STEP[SENSOR].start, e)
        return Values(self.model, g, e, self.shared + by_shared, self.disturbance, self.sign)

    def change_since(self, before: "Values") -> Array:
        """Return the change of the first step and of the shared variables, (B, STEP_SIZE + SHARED_SIZE)."""
        change = np.empty((self.rows, STEP_SIZE + self.shared.shape[1]))
        _difference(before.sensor_in_object, self.sensor_in_object, IN_STEP[SENSOR_IN_OBJECT].start, change)
        _difference(before.sensor, self.sensor, IN_STEP[SENSOR].start, change)
        np.subtract(self.shared, before.shared, out=change[:, STEP_SIZE:])
        return change


@compiled
def _move(poses: Array, change: Array, first: int, out: Array) -> None:
    for b in range(poses.shape[0]):
        for k in range(poses.shape[1]):
            exp_onto(poses[b, k], change[b, k, first : first + 3], out[b, k])


@compiled
def _difference(before: Array, now: Array, first: int, out: Array) -> None:
    seen = np.empty(3)
    for b in range(now.shape[0]):
        between(before[b, 0], now[b, 0], seen)
        log(seen, out[b, first : first + 3])


@compiled
def _extrapolate(poses: Array) -> None:
    """Set the last pose by constant motion from the two before it."""
    last_step = poses.shape[1] - 1
    turned = np.empty(3)
    for b in range(len(poses)):
        last = poses[b, last_step - 1]
        between(poses[b, max(last_step - 2, 0)], last, turned)
        ahead = position(last) + rotation(last[2]) * position(turned)
        poses[b, last_step, 0], poses[b, last_step, 1] = ahead.real, ahead.imag
        poses[b, last_step, 2] = wrap(last[2] + turned[2])
