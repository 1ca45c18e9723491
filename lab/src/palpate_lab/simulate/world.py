"""A simulated world: the sensor follows its commanded path, the object moves by physics, a finger may shove it."""

from collections import deque
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Flags
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.sensor import SensorProfile
from palpate_lab import required
from palpate_lab.simulate.paths import minimum_jerk, unit_vector
from palpate_lab.simulate.scene import WARM_UP, WorldSettings, build_model, set_gel


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion and contact, frame by frame; forces and slip are those of the last time step of a frame."""

    sensor_pose: Array
    """world_T_sensor, (N, 3) [m, m, rad]."""
    object_pose: Array
    """world_T_object, (N, 3) [m, m, rad]."""
    contact: Flags
    """Contact between gel and object, (N,)."""
    normal_force: Array
    """Force that presses gel and object together, (N,) [N]."""
    tangential_force: Array
    """Friction on the gel within the plane, (N,) [N], positive towards the sensor's +y."""
    slip: Array
    """Speed of the object over the gel at the contact, (N,) [m/s], positive towards the sensor's +y."""
    indentation: Array
    """Depth of the object in the gel, (N,) [m]; 0 without contact."""
    pad_angle: Array
    """Angle of the contact from the gel's apex, (N,) [rad], seen from the centre of curvature and positive towards the
    sensor's +y; NaN without contact. On a flat pad it is the normal's at the deepest point."""
    knocked: Flags
    """Shove by a finger since the frame before, (N,)."""


def concatenated(motions: list[Motion]) -> Motion:
    """Return motions, one after the other, as one."""
    joined = {}
    for field in fields(Motion):
        joined[field.name] = np.concatenate([getattr(motion, field.name) for motion in motions])
    joined["sensor_pose"][:, 2] = se2.wrap(joined["sensor_pose"][:, 2])
    return Motion(**joined)


@dataclass(frozen=True, eq=False)
class Shove:
    """A push by a finger, from rest to rest with minimum jerk."""

    point: Array
    """Point of the object that the finger pushes, (2,) [m] in the object frame."""
    direction: float
    """Direction of the finger in the world [rad]."""
    length: float
    """Distance that the finger moves [m]."""
    seconds: float
    """Duration [s]."""

    def path(self, start: Array, time_step: float) -> list[tuple[float, float]]:
        """Return position [m] and speed [m/s] along the direction at each time step [s], from a point (2,) [m]."""
        way = self.length * minimum_jerk(max(round(self.seconds / time_step), 2))
        places = float(start @ unit_vector(self.direction)) + way
        return list(zip(places.tolist(), np.gradient(way, time_step).tolist(), strict=True))


class World:
    """One object and one sensor; time advances with every `run`."""

    def __init__(
        self,
        settings: WorldSettings,
        shape: Shape,
        sensor: SensorProfile,
        object_pose: ArrayLike,
        sensor_pose: ArrayLike,
    ) -> None:
        """Place object and sensor, (3,) [m, m, rad] each in the world, and let the object settle on its feet."""
        self._mujoco = required("simulation", "sim", "mujoco")
        self._model, self._data = build_model(settings, shape, sensor, object_pose)
        self._steps = int(np.ceil(1.0 / sensor.rate / 0.002 - 1e-9))  # of 2 ms at most
        self._model.opt.timestep = 1.0 / sensor.rate / self._steps
        names = [self._model.geom(i).name for i in range(self._model.ngeom)]
        self._is_gel = np.array([name.startswith("gel") for name in names])
        self._settings = settings
        self._age = 0
        self._middle = self._model.body("object").ipos[:2]
        self._applied = self._data.body("object").xfrc_applied
        self._shove = Shove(np.zeros(2), 0.0, 0.0, 0.0)
        self._finger = deque[tuple[float, float]]()
        self._sensor = sensor
        self._rate = sensor.rate
        self._velocity = np.zeros(3)
        self.sensor_pose = np.asarray(sensor_pose, dtype=np.float64)
        """world_T_sensor now, (3,) [m, m, rad]."""
        self.run(np.repeat(self.sensor_pose[None], int(0.4 * sensor.rate), axis=0))  # 0.4 s to settle

    @property
    def object_pose(self) -> Array:
        """world_T_object now, (3,) [m, m, rad]."""
        x, y, _, w, i, j, k = self._data.qpos[4:].tolist()
        return np.array([x, y, np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))])

    def shove(self, shove: Shove) -> None:
        """Begin a shove of the object at its present pose; it goes on during `run`, independent of the sensor."""
        start = se2.transform(self.object_pose, shove.point)
        self._shove = shove
        self._finger = deque(shove.path(start, self._model.opt.timestep))

    def run(self, sensor_poses: ArrayLike) -> Motion:
        """Move the sensor from its present pose through poses (N, 3) [m, m, rad], one per frame; return the motion.

        Between frames the sensor follows cubics without a jump in velocity. Raises SettingError if the object topples
        or the simulation breaks down.
        """
        poses = np.asarray(sensor_poses, dtype=np.float64)
        path, velocity = self._interpolated(poses)
        data = self._data
        model = self._model
        step = self._mujoco.mj_step
        qpos = data.qpos
        qvel = data.qvel
        rows = np.zeros((len(path) // self._steps, 10))
        for frame in range(len(rows)):
            self._drift()
            for index in range(frame * self._steps, (frame + 1) * self._steps):
                qpos[:3] = path[index]
                qvel[:3] = velocity[index]
                rows[frame, 9] += self._push()
                step(model, data)
            rows[frame, :3] = self.object_pose
            rows[frame, 3:9] = self._touch()
            i, j = qpos[8:10].tolist()
            upright = 1.0 - 2.0 * (i * i + j * j)
            # Its feet can tilt the object by 2.6 degrees.
            if not upright > 0.999 or data.warning.number.any():
                broke = f"the simulation broke down at frame {frame} of a run"
                raise SettingError(f"{broke}: the object's axis is at {upright:.4f} of upright")
        contact, normal, tangential, slip, indentation, angle, pushes = rows[:, 3:].T
        return Motion(poses, rows[:, :3], contact > 0, normal, tangential, slip, indentation, angle, pushes > 0)

    def _drift(self) -> None:
        """Set friction and stiffness of the gel for the next frame."""
        settings = self._settings
        seconds = self._age / self._rate
        self._age += 1
        if any(settings.gel_drift) and seconds <= WARM_UP:
            friction, stiffness = (1.0 + rate * seconds for rate in settings.gel_drift)
            set_gel(self._model, self._sensor, settings.gel_friction * friction, settings.gel_stiffness * stiffness)

    def _interpolated(self, poses: Array) -> tuple[Array, Array]:
        """Return position and velocity of the pusher's joints at every time step, (M, 3) each."""
        from scipy.interpolate import CubicHermiteSpline

        knots = np.concatenate((self.sensor_pose[None], poses))
        knots[:, 2] = np.unwrap(knots[:, 2])
        if len(knots) == 1:
            return np.empty((0, 3)), np.empty((0, 3))
        slopes = np.gradient(knots, 1.0 / self._rate, axis=0)
        slopes[0] = self._velocity
        self.sensor_pose = knots[-1]
        self._velocity = slopes[-1]
        spline = CubicHermiteSpline(np.arange(len(knots)) / self._rate, knots, slopes)
        at = np.arange((len(knots) - 1) * self._steps) * self._model.opt.timestep
        pose = spline(at)
        rate = spline(at, 1)
        # The joints move the gel's centre of curvature.
        arm = self._sensor.center * np.ones((len(at), 1))
        lever = se2.transform(np.column_stack((np.zeros((len(at), 2)), pose[:, 2])), arm)
        path = np.column_stack((pose[:, :2] + lever, pose[:, 2]))
        turn = rate[:, 2:] * np.column_stack((-lever[:, 1], lever[:, 0]))
        return path, np.column_stack((rate[:, :2] + turn, rate[:, 2]))

    def _push(self) -> bool:
        """Apply the finger's force, level with the centre of mass, for the next time step; True if it pushes.

        The finger is a spring that only pushes, with up to 15 N; at 2000 N/m and 40 N s/m the object lags it by 1 to
        2 mm.
        """
        self._applied[:] = 0.0
        if not self._finger:
            return False
        place, speed = self._finger.popleft()
        direction = unit_vector(self._shove.direction)
        point = se2.transform(self.object_pose, self._shove.point)
        ahead = place - float(point @ direction)
        faster = speed - float(self._velocity_at(point) @ direction)
        force = min(max(2000.0 * ahead + 40.0 * faster, 0.0), 15.0) * direction
        x, y = point - se2.transform(self.object_pose, self._middle)
        self._applied[:2] = force
        self._applied[5] = x * force[1] - y * force[0]
        return bool(force.any())

    def _touch(self) -> tuple[float, float, float, float, float, float]:
        """Return contact, normal and tangential force, slip, indentation and pad angle."""
        data = self._data
        contacts = self._data.contact
        touching = np.flatnonzero(self._is_gel[contacts.geom].any(axis=1) & (contacts.efc_address >= 0))
        if not len(touching):
            return 0.0, 0.0, 0.0, 0.0, 0.0, np.nan
        depth = -np.inf
        slip = 0.0
        angle = np.nan
        normal_sum = 0.0
        tangent_sum = 0.0
        yaw = float(data.qpos[2])
        force = np.zeros(6)
        for i in touching:
            contact = contacts[int(i)]
            self._mujoco.mj_contactForce(self._model, data, int(i), force)
            frame = contact.frame.reshape(3, 3)
            sign = 1.0 if self._is_gel[contact.geom[0]] else -1.0  # the normal points from the first geom to the second
            into = sign * frame[0]  # from the gel into the object
            bearing = np.arctan2(into[1], into[0]) - yaw
            tangent = np.array([-into[1], into[0], 0.0]) / np.hypot(into[0], into[1])
            on_gel = -sign * (frame.T @ force[:3])
            normal_sum += float(force[0])
            tangent_sum += float(on_gel @ tangent)
            if -contact.dist > depth:
                depth = -contact.dist
                angle = float(np.arctan2(np.sin(bearing), np.cos(bearing)))
                x, y = contact.pos[:2] - data.qpos[:2]
                over_gel = self._velocity_at(contact.pos) - data.qvel[:2] - data.qvel[2] * np.array([-y, x])
                slip = float(tangent[:2] @ over_gel)
        return 1.0, normal_sum, tangent_sum, slip, max(depth, 0.0), angle

    def _velocity_at(self, point: Array) -> Array:
        """Return the velocity of the object (2,) [m/s] at a point."""
        qpos = self._data.qpos
        qvel = self._data.qvel
        x, y = point[:2] - qpos[4:6]
        return qvel[4:6] + qvel[9] * np.array([-y, x])
