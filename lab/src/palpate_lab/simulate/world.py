"""A simulated world: sensors follow their commanded paths, the object moves by physics, a finger may shove it."""

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Flags
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.hand import Hand
from palpate.types.sensor import SensorProfile
from palpate_lab import required
from palpate_lab.simulate.paths import minimum_jerk, unit_vector
from palpate_lab.simulate.scene import WARM_UP, WorldSettings, build_model, set_gel


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion and contact, frame by frame; forces and slip are those of the last time step of a frame.

    Of a hand, contact and what follows but `knocked` have an axis of its fingers after N.
    """

    sensor_pose: Array
    """world_T_sensor, of a hand world_T_hand, (N, 3) [m, m, rad]."""
    finger_pose: Array
    """world_T_finger of a hand's fingers, (N, F, 3) [m, m, rad]; of one sensor it is that sensor's."""
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

    def of_finger(self, finger: int) -> "Motion":
        """Return the motion of one finger of a hand, as the sensor, and of the object."""
        shared = ("sensor_pose", "finger_pose", "object_pose", "knocked")
        own: dict[str, Any] = {"sensor_pose": self.finger_pose[:, finger]}
        for field in fields(self):
            if field.name not in shared:
                own[field.name] = getattr(self, field.name)[:, finger]
        return replace(self, **own)


def concatenated(motions: list[Motion]) -> Motion:
    """Return motions, one after the other, as one."""
    joined = {}
    for field in fields(Motion):
        joined[field.name] = np.concatenate([getattr(motion, field.name) for motion in motions])
    for name in ("sensor_pose", "finger_pose"):
        joined[name][..., 2] = se2.wrap(joined[name][..., 2])
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
    """One object, and one sensor or the fingers of a hand; time advances with every `run`."""

    def __init__(
        self,
        settings: WorldSettings,
        shape: Shape,
        sensor: SensorProfile | Hand,
        object_pose: ArrayLike,
        sensor_pose: ArrayLike,
    ) -> None:
        """Place object and sensor, (3,) [m, m, rad] each in the world, and let the object settle on its feet.

        Of a hand, whose fingers have one rate, `sensor_pose` is world_T_hand.
        """
        self._mujoco = required("simulation", "sim", "mujoco")
        self._hand = sensor if isinstance(sensor, Hand) else None
        self._fingers = list(sensor.fingers.values()) if isinstance(sensor, Hand) else [sensor]
        self._rate = self._fingers[0].rate
        self._model, self._data = build_model(settings, shape, self._fingers, object_pose)
        self._steps = int(np.ceil(1.0 / self._rate / 0.002 - 1e-9))  # of 2 ms at most
        self._model.opt.timestep = 1.0 / self._rate / self._steps
        names = [self._model.geom(i).name for i in range(self._model.ngeom)]
        count = len(self._fingers)
        self._is_gel = [np.array([name.startswith(f"gel{k}-") for name in names]) for k in range(count)]
        self._driven = [4 * k + joint for k in range(count) for joint in range(3)]
        self._object = 4 * count  # place of the object's joint
        self._settings = settings
        self._age = 0
        self._middle = self._model.body("object").ipos[:2]
        self._applied = self._data.body("object").xfrc_applied
        self._shove = Shove(np.zeros(2), 0.0, 0.0, 0.0)
        self._finger = deque[tuple[float, float]]()
        self.sensor_pose = np.asarray(sensor_pose, dtype=np.float64)
        """world_T_sensor now, of a hand world_T_hand, (3,) [m, m, rad]."""
        self._finger_pose = self._mounted(self.sensor_pose)
        self._velocity = np.zeros_like(self._finger_pose)
        self.run(np.repeat(self.sensor_pose[None], int(0.4 * self._rate), axis=0))  # 0.4 s to settle

    @property
    def object_pose(self) -> Array:
        """world_T_object now, (3,) [m, m, rad]."""
        x, y, _, w, i, j, k = self._data.qpos[self._object :].tolist()
        return np.array([x, y, np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))])

    def shove(self, shove: Shove) -> None:
        """Begin a shove of the object at its present pose; it goes on during `run`, independent of the sensor."""
        start = se2.transform(self.object_pose, shove.point)
        self._shove = shove
        self._finger = deque(shove.path(start, self._model.opt.timestep))

    def _mounted(self, sensor_pose: Array) -> Array:
        """Return the poses of all fingers (..., F, 3) of a sensor or hand at poses (..., 3)."""
        if self._hand is None:
            return sensor_pose[..., None, :]
        return np.stack(list(self._hand.poses(sensor_pose).values()), axis=-2)

    def run(self, sensor_poses: ArrayLike, finger_poses: Array | None = None) -> Motion:
        """Move the sensor from its present pose through poses (N, 3) [m, m, rad], one per frame; return the motion.

        A hand's fingers are at their mounts, or at `finger_poses` (N, F, 3). Between frames the sensor follows cubics
        without a jump in velocity. Raises SettingError if the object topples or the simulation breaks down.
        """
        poses = np.asarray(sensor_poses, dtype=np.float64)
        of_fingers = self._mounted(poses) if finger_poses is None else finger_poses
        path, velocity = self._interpolated(of_fingers)
        yaws = np.unwrap(np.append(self.sensor_pose[2], poses[:, 2]))
        self.sensor_pose = np.append(np.vstack((self.sensor_pose, poses))[-1, :2], yaws[-1])
        data = self._data
        model = self._model
        step = self._mujoco.mj_step
        qpos = data.qpos
        qvel = data.qvel
        upright_at = self._object + 4
        gels = range(len(self._fingers))
        rows = np.zeros((len(path) // self._steps, 4))
        touches = np.zeros((len(rows), len(gels), 6))
        for frame in range(len(rows)):
            self._drift()
            for index in range(frame * self._steps, (frame + 1) * self._steps):
                qpos[self._driven] = path[index]
                qvel[self._driven] = velocity[index]
                rows[frame, 3] += self._push()
                step(model, data)
            rows[frame, :3] = self.object_pose
            touches[frame] = [self._touch(finger) for finger in gels]
            i, j = qpos[upright_at : upright_at + 2].tolist()
            upright = 1.0 - 2.0 * (i * i + j * j)
            # Its feet can tilt the object by 2.6 degrees.
            if not upright > 0.999 or data.warning.number.any():
                broke = f"the simulation broke down at frame {frame} of a run"
                raise SettingError(f"{broke}: the object's axis is at {upright:.4f} of upright")
        found = touches[:, 0] if self._hand is None else touches
        contact, normal, tangential, slip, indentation, angle = np.moveaxis(found, -1, 0)
        knocked = rows[:, 3] > 0
        touch = (contact > 0, normal, tangential, slip, indentation, angle)
        return Motion(poses, of_fingers, rows[:, :3], *touch, knocked)

    def _drift(self) -> None:
        """Set friction and stiffness of the gels for the next frame."""
        settings = self._settings
        seconds = self._age / self._rate
        self._age += 1
        if any(settings.gel_drift) and seconds <= WARM_UP:
            friction, stiffness = (1.0 + rate * seconds for rate in settings.gel_drift)
            for finger, sensor in enumerate(self._fingers):
                of_gel = settings.gel(finger)
                set_gel(self._model, finger, sensor, of_gel[0] * friction, of_gel[1] * stiffness)

    def _interpolated(self, poses: Array) -> tuple[Array, Array]:
        """Return position and velocity (M, 3 F) of the pushers' joints at every time step, to poses (N, F, 3)."""
        knots = np.concatenate((self._finger_pose[None], poses))
        knots[..., 2] = np.unwrap(knots[..., 2], axis=0)
        if len(knots) == 1:
            return np.empty((0, len(self._driven))), np.empty((0, len(self._driven)))
        slopes = np.gradient(knots, 1.0 / self._rate, axis=0)
        slopes[0] = self._velocity
        self._finger_pose = knots[-1]
        self._velocity = slopes[-1]
        each = [self._joints(sensor, knots[:, k], slopes[:, k]) for k, sensor in enumerate(self._fingers)]
        paths, velocities = zip(*each, strict=True)
        return np.hstack(paths), np.hstack(velocities)

    def _joints(self, sensor: SensorProfile, knots: Array, slopes: Array) -> tuple[Array, Array]:
        """Return position and velocity (M, 3) of a pusher's joints, from poses and velocities (n, 3) of its sensor."""
        at = np.arange((len(knots) - 1) * self._steps) * self._model.opt.timestep
        pose, rate = _on_cubics(np.arange(len(knots)) / self._rate, knots, slopes, at)
        # The joints move the gel's centre of curvature.
        arm = sensor.center * np.ones((len(at), 1))
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

    def _touch(self, finger: int) -> tuple[float, float, float, float, float, float]:
        """Return contact, normal and tangential force, slip, indentation and pad angle of a finger."""
        data = self._data
        contacts = self._data.contact
        is_gel = self._is_gel[finger]
        joint = 4 * finger
        touching = np.flatnonzero(is_gel[contacts.geom].any(axis=1) & (contacts.efc_address >= 0))
        if not len(touching):
            return 0.0, 0.0, 0.0, 0.0, 0.0, np.nan
        depth = -np.inf
        slip = 0.0
        angle = np.nan
        normal_sum = 0.0
        tangent_sum = 0.0
        yaw = float(data.qpos[joint + 2])
        force = np.zeros(6)
        for i in touching:
            contact = contacts[int(i)]
            self._mujoco.mj_contactForce(self._model, data, int(i), force)
            frame = contact.frame.reshape(3, 3)
            sign = 1.0 if is_gel[contact.geom[0]] else -1.0  # the normal points from the first geom to the second
            into = sign * frame[0]  # from the gel into the object
            bearing = np.arctan2(into[1], into[0]) - yaw
            tangent = np.array([-into[1], into[0], 0.0]) / np.hypot(into[0], into[1])
            on_gel = -sign * (frame.T @ force[:3])
            normal_sum += float(force[0])
            tangent_sum += float(on_gel @ tangent)
            if -contact.dist > depth:
                depth = -contact.dist
                angle = float(np.arctan2(np.sin(bearing), np.cos(bearing)))
                x, y = contact.pos[:2] - data.qpos[joint : joint + 2]
                of_gel = data.qvel[joint : joint + 3]
                over_gel = self._velocity_at(contact.pos) - of_gel[:2] - of_gel[2] * np.array([-y, x])
                slip = float(tangent[:2] @ over_gel)
        return 1.0, normal_sum, tangent_sum, slip, max(depth, 0.0), angle

    def _velocity_at(self, point: Array) -> Array:
        """Return the velocity of the object (2,) [m/s] at a point."""
        qvel = self._data.qvel[self._object :]
        x, y = point[:2] - self._data.qpos[self._object : self._object + 2]
        return qvel[:2] + qvel[5] * np.array([-y, x])


def _on_cubics(time: Array, values: Array, slopes: Array, at: Array) -> tuple[Array, Array]:
    """Return values and slopes (M, k), at times (M,), of the cubics through values (N, k) with slopes (N, k).

    SciPy's splines give the same to the last bit, but making one takes a third of the time that MuJoCo needs a frame.
    """
    first = np.searchsorted(time, at, side="right") - 1
    step = np.diff(time)[:, None]
    mean = np.diff(values, axis=0) / step
    bend = (slopes[:-1] + slopes[1:] - 2.0 * mean) / step
    cubic = (bend / step)[first]
    square = ((mean - slopes[:-1]) / step - bend)[first]
    since = (at - time[first])[:, None]
    start = slopes[first]
    value = values[first] + start * since + square * (since * since) + cubic * (since * since * since)
    return value, start + square * since * 2.0 + cubic * (since * since) * 3.0
