"""A world in which a sensor pushes an object: the sensor goes exactly where it is told, the rest is physics."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.scene import WARMS_FOR, WorldSettings, build_model, load_mujoco, set_gel
from palpate.lab.simulate.shove import Finger, Shove
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_SETTLING = 0.4  # [s] in which the object sinks onto its feet
_UPRIGHT = 0.999  # cosine of the largest tilt, 2.6 degrees: more than any load on the feet gives


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened, frame by frame; forces and slip are those of the last time step before the frame."""

    object_pose: Array
    """world_T_object, (N, 3) [m, m, rad]."""
    contact: NDArray[np.bool_]
    """Whether gel and object touch, (N,)."""
    normal_force: Array
    """Force that presses gel and object together, (N,) [N]."""
    tangential_force: Array
    """Friction on the gel within the plane, (N,) [N], positive towards the sensor's +y."""
    slip: Array
    """Speed at which the object slides over the gel at the contact, (N,) [m/s], positive towards the sensor's +y."""
    indentation: Array
    """Depth of the object in the gel, (N,) [m]; 0 outside contact."""
    pad_angle: Array
    """Where on the gel the contact is, (N,) [rad]: its angle from the apex seen from the centre of curvature, positive
    towards the sensor's +y; NaN outside contact. On a flat pad it is that of the normal where it is pressed deepest."""
    knocked: NDArray[np.bool_]
    """Whether a finger has pushed the object since the frame before, (N,)."""


def joined(motions: list[Motion]) -> Motion:
    """Return motions, one after the other, as one."""
    names = [field.name for field in fields(Motion)]
    return Motion(**{name: np.concatenate([getattr(motion, name) for motion in motions]) for name in names})


class World:
    """One object and one sensor; time goes on with every `run`."""

    def __init__(
        self,
        settings: WorldSettings,
        shape: Shape,
        sensor: SensorProfile,
        object_pose: ArrayLike,
        sensor_pose: ArrayLike,
    ) -> None:
        """Place object and sensor, (3,) [m, m, rad] each in the world, and let the object settle on its feet."""
        self._mujoco = load_mujoco()
        self._model, self._data = build_model(settings, shape, sensor, object_pose)
        self._steps = int(np.ceil(1.0 / sensor.rate / settings.time_step - 1e-9))
        self._model.opt.timestep = 1.0 / sensor.rate / self._steps
        self._gel = [i for i in range(self._model.ngeom) if self._model.geom(i).name.startswith("gel")]
        self._settings, self._age = settings, 0
        self._middle = self._model.body("object").ipos[:2]
        self._applied = self._data.body("object").xfrc_applied
        self._finger: Finger | None = None
        self._sensor, self._center = sensor, sensor.center
        self._sensor_pose = np.asarray(sensor_pose, dtype=np.float64)
        self._rate = sensor.rate
        self._velocity = np.zeros(3)
        still = np.repeat(self._sensor_pose[None], int(_SETTLING * sensor.rate) + 1, axis=0)
        self.run(still[1:])

    @property
    def object_pose(self) -> Array:
        """world_T_object now, (3,) [m, m, rad]."""
        x, y, _, w, i, j, k = self._data.qpos[4:].tolist()
        return np.array([x, y, np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))])

    @property
    def sensor_pose(self) -> Array:
        """world_T_sensor now, (3,) [m, m, rad]."""
        return self._sensor_pose

    def shove(self, shove: Shove) -> None:
        """Begin a shove of the object from where it is now; it goes on with `run`, whatever the sensor does."""
        start = se2.transform(self.object_pose, shove.point)
        self._finger = Finger(shove, start, self._model.opt.timestep)

    def run(self, sensor_poses: ArrayLike) -> Motion:
        """Move the sensor from where it is through poses (N, 3) [m, m, rad], one a frame, and return what happened.

        Between frames the sensor follows cubics without a jump in velocity. Raises SettingError where the object
        topples or the simulation breaks down, which no world of `draw_settings` should make happen.
        """
        poses = np.asarray(sensor_poses, dtype=np.float64)
        if poses.shape[1:] != (3,) or not np.isfinite(poses).all():
            raise SettingError(f"sensor poses have shape {poses.shape}; they must be finite, (N, 3)")
        path, velocity = self._between_frames(poses)
        data, model, step = self._data, self._model, self._mujoco.mj_step
        qpos, qvel = data.qpos, data.qvel
        frames = len(path) // self._steps
        rows = np.zeros((frames, 10))
        index = 0
        for frame in range(frames):
            self._wear()
            for _ in range(self._steps):
                qpos[:3] = path[index]
                qvel[:3] = velocity[index]
                rows[frame, 9] += self._push()
                step(model, data)
                index += 1
            rows[frame, :3] = self.object_pose
            rows[frame, 3:9] = self._touch()
            self._check(frame)
        contact, normal, tangential, slip, indentation, angle, pushes = rows[:, 3:].T
        return Motion(rows[:, :3], contact > 0, normal, tangential, slip, indentation, angle, pushes > 0)

    def _wear(self) -> None:
        """Let the gel become what it is at the next frame."""
        settings, seconds = self._settings, self._age / self._rate
        self._age += 1
        if any(settings.gel_drift) and seconds <= WARMS_FOR:
            friction, stiffness = (1.0 + rate * seconds for rate in settings.gel_drift)
            set_gel(self._model, self._sensor, settings.gel_friction * friction, settings.gel_stiffness * stiffness)

    def _between_frames(self, poses: Array) -> tuple[Array, Array]:
        """Return position and velocity of the pusher's joints at every time step (M, 3)."""
        from scipy.interpolate import CubicHermiteSpline

        knots = np.concatenate((self._sensor_pose[None], poses))
        knots[:, 2] = np.unwrap(knots[:, 2])
        if len(knots) == 1:
            return np.empty((0, 3)), np.empty((0, 3))
        slopes = np.gradient(knots, 1.0 / self._rate, axis=0)
        slopes[0] = self._velocity
        self._sensor_pose, self._velocity = knots[-1], slopes[-1]
        times = np.arange(len(knots)) / self._rate
        curve = CubicHermiteSpline(times, knots, slopes)
        at = np.arange((len(knots) - 1) * self._steps) * self._model.opt.timestep
        pose, rate = curve(at), curve(at, 1)
        # The joints carry the centre of curvature, about which the gel is round.
        arm = self._center * np.ones((len(at), 1))
        lever = se2.transform(np.column_stack((np.zeros((len(at), 2)), pose[:, 2])), arm)
        path = np.column_stack((pose[:, :2] + lever, pose[:, 2]))
        turn = rate[:, 2:] * np.column_stack((-lever[:, 1], lever[:, 0]))
        return path, np.column_stack((rate[:, :2] + turn, rate[:, 2]))

    def _push(self) -> bool:
        """Let the finger push the object in the next time step, and say whether it does.

        It pushes at the height of the centre of mass, so that nothing is tilted.
        """
        self._applied[:] = 0.0
        if self._finger is None or self._finger.is_done:
            return False
        point = se2.transform(self.object_pose, self._finger.point)
        x, y = point - se2.transform(self.object_pose, self._middle)
        force = self._finger.force(point, self._velocity_at(point))
        self._applied[:2], self._applied[5] = force, x * force[1] - y * force[0]
        return bool(force.any())

    def _touch(self) -> tuple[float, float, float, float, float, float]:
        """Return contact, normal and tangential force, slip, indentation and pad angle."""
        data, contacts = self._data, self._data.contact
        touching = np.flatnonzero(np.isin(contacts.geom, self._gel).any(axis=1) & (contacts.efc_address >= 0))
        if not len(touching):
            return 0.0, 0.0, 0.0, 0.0, 0.0, np.nan
        depth, slip, angle, normal_sum, tangent_sum = -np.inf, 0.0, np.nan, 0.0, 0.0
        yaw = float(data.qpos[2])
        force = np.zeros(6)
        for i in touching:
            contact = contacts[int(i)]
            self._mujoco.mj_contactForce(self._model, data, int(i), force)
            frame = contact.frame.reshape(3, 3)
            sign = 1.0 if contact.geom[0] in self._gel else -1.0  # the normal points from the first geom to the second
            into = sign * frame[0]  # from the gel into the object
            place = np.arctan2(into[1], into[0]) - yaw
            tangent = np.array([-into[1], into[0], 0.0]) / np.hypot(into[0], into[1])
            on_gel = -sign * (frame.T @ force[:3])
            normal_sum += float(force[0])
            tangent_sum += float(on_gel @ tangent)
            if -contact.dist > depth:
                depth = -contact.dist
                angle = float(np.arctan2(np.sin(place), np.cos(place)))
                slip = float(tangent[:2] @ self._sliding(contact.pos))
        return 1.0, normal_sum, tangent_sum, slip, max(depth, 0.0), angle

    def _sliding(self, point: Array) -> Array:
        """Return the velocity of the object over the gel (2,) [m/s] at a point of both."""
        qpos, qvel = self._data.qpos, self._data.qvel
        x, y = point[:2] - qpos[:2]
        return self._velocity_at(point) - qvel[:2] - qvel[2] * np.array([-y, x])

    def _velocity_at(self, point: Array) -> Array:
        """Return the velocity of the object (2,) [m/s] at a point."""
        qpos, qvel = self._data.qpos, self._data.qvel
        x, y = point[:2] - qpos[4:6]
        return qvel[4:6] + qvel[9] * np.array([-y, x])

    def _check(self, frame: int) -> None:
        i, j = self._data.qpos[8:10].tolist()
        upright = 1.0 - 2.0 * (i * i + j * j)
        if not upright > _UPRIGHT or any(warning.number for warning in self._data.warning):
            found = f"the upward part of the object's axis is {upright:.4f}; allowed is {_UPRIGHT} to 1"
            raise SettingError(f"the simulation broke down at frame {frame} of a run: {found}")
