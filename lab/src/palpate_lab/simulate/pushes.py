"""Sequences of pushes: the sensor's path, contact after contact, the object's motion, and knocks.

A sequence is steered like a robot by a person who sees the object; each contact is drawn for the object's present pose.

- Two to three contacts in 15 s, as in the paper. Between them the sensor goes round the object, clear of it.

Ranges are those of `PushSettings`, by default of a robot:

- Place: uniform along the outline of a disc, an ellipse or the edges. The contact patch on a DIGIT is about 5 mm to
  either side of its middle, so a corner shows up to 8 mm from it and not from 15 mm on: "near-corners" and "edges".
- Direction: up to 45 degrees off the normal. The object yields sideways by turning, so some contacts stick and some
  slide.
- Speed: 10 to 40 mm/s, at which pushes are quasi-static, as the paper assumes. Half of the paths are straight, half
  have a radius of 0.2 m and more; the sensor turns with its path, and besides by up to 0.1 rad/s.
- Pad: the contact begins within 12 degrees of the apex. Past 20 degrees the sensor turns after the contact, and at 30,
  beyond the edge of a DIGIT's pad, the push ends. A flat pad or a hand of several fingers is held flat to the object.
- Knocks: a finger shoves the object, unknown to the sensor, in 60 % of pushes and 30 % of the pauses between them, by 8
  to 50 mm in 0.15 to 0.4 s, at a place beside the sensor where it turns the object.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.paths import TRIES, Surroundings, Touch, draw_place, draw_touch, kinds, unit_vector
from palpate_lab.simulate.push_settings import ROBOT, PushSettings
from palpate_lab.simulate.scene import draw_settings
from palpate_lab.simulate.world import Motion, Shove, World, concatenated

_AGAIN = 4.5  # [s] that must be left for another contact
_PAUSE = 1.0  # [s] for which the sensor stands still for a shove between contacts


def draw_sequence(
    shape: Shape,
    kind: str,
    sensor: SensorProfile,
    rng: np.random.Generator,
    seconds: float = 15.0,
    knocks: np.random.Generator | None = None,
    gel_drift: tuple[float, float] = (0.0, 0.0),
    pushes: PushSettings = ROBOT,
) -> Motion:
    """Draw a world and a sequence of pushes in it, at the sensor's rate; the same generator gives the same.

    `kind` is one of `kinds(shape)`. With a generator for `knocks` a finger shoves the object; until the first shove
    the sequence is the same as without. Raises SettingError on a kind that is not allowed.
    """
    if kind not in kinds(shape):
        raise SettingError(f"kind of contact is {kind!r}; a {type(shape).__name__.lower()} allows {kinds(shape)}")
    settings = replace(draw_settings(shape, rng, pushes), gel_drift=gel_drift)
    object_pose = rng.uniform((-0.1, -0.1, -np.pi), (0.1, 0.1, np.pi))
    contacts = max(1, round(seconds / rng.uniform(5.0, 7.5)))
    around = Surroundings(shape, sensor)
    touch = draw_touch(shape, kind, sensor, rng, pushes)
    world = World(settings, shape, sensor, object_pose, around.start(touch, object_pose))
    hand = _Knocks(shape, sensor, knocks)
    robot = _Robot(world, sensor, round(seconds * sensor.rate), hand, rng, pushes)
    again = _AGAIN * sensor.rate
    while contacts:
        share = robot.left / contacts * (rng.uniform(0.85, 1.15) if contacts > 1 else 1.0)
        end = robot.left - share + 0.9 * sensor.rate  # 0.9 s are kept for leaving
        robot.go(around.approach(world.sensor_pose, touch, world.object_pose))
        frames = round(max(robot.left - end, 1.5 * sensor.rate))
        robot.push(touch, frames, hand.draw_frame(frames, is_last=robot.left - frames <= again))
        contacts = max(contacts - 1, 1) if robot.left > again else 0  # one more if one ended early
        robot.go(around.leave(world.sensor_pose, world.object_pose, 0 if contacts else robot.left))
        if contacts:
            if robot.left > (_AGAIN + _PAUSE) * sensor.rate and hand.in_pause(world):
                robot.go(np.tile(world.sensor_pose, (round(_PAUSE * sensor.rate), 1)))
            touch = draw_touch(shape, kind, sensor, rng, pushes)
            start = around.start(touch, world.object_pose)
            robot.go(around.travel(world.sensor_pose, start, world.object_pose))
    return concatenated(robot.motions)


def measured(poses: ArrayLike, rng: np.random.Generator) -> Array:
    """Return poses (N, 3) [m, m, rad] with the noise of motion capture.

    It is 0.1 mm in x and y and, drawn once for all N, 0.1 to 0.2 degrees in yaw.
    """
    poses = np.asarray(poses, dtype=np.float64)
    sigma = (1e-4, 1e-4, np.radians(rng.uniform(0.1, 0.2)))
    noisy = poses + rng.normal(size=poses.shape) * sigma
    noisy[..., 2] = se2.wrap(noisy[..., 2])
    return noisy


class _Knocks:
    """Draws the knocks of a sequence of pushes; without a generator there are none."""

    def __init__(self, shape: Shape, sensor: SensorProfile, rng: np.random.Generator | None) -> None:
        self._shape = shape
        self._sensor = sensor
        self._rng = rng
        self._kind = kinds(shape)[0]  # anywhere round it, or on its edges: a finger slips off a corner
        self._lever = 0.3 * np.sqrt(shape.area / np.pi)
        self._count = 0

    def draw_frame(self, frames: int, is_last: bool) -> int | None:
        """Draw the frame at which a push of `frames` is knocked, surely the last one if none was; None for no knock."""
        if self._rng is None:
            return None
        part = self._rng.uniform(0.3, 0.6)
        is_knocked = self._rng.uniform() < 0.6 or (is_last and not self._count)
        return round(part * frames) if is_knocked else None

    def in_push(self, world: World) -> None:
        """Begin a shove of an object in contact: sideways, away or against the gel."""
        self._begin(world, float(world.sensor_pose[2]), np.radians(110.0))

    def in_pause(self, world: World) -> bool:
        """Begin a shove of an object without contact, no nearer to the sensor, in some pauses; True if there is one."""
        if self._rng is None or self._rng.uniform() >= 0.3:
            return False
        x, y = se2.transform(world.object_pose, self._shape.centroid) - self._gel(world)
        self._begin(world, float(np.arctan2(y, x)), np.radians(90.0))
        return True

    def _begin(self, world: World, away: float, limit: float) -> None:
        """Begin a shove in a direction within a limit [rad] of the direction away from the sensor [rad]."""
        assert self._rng is not None
        self._count += 1
        length = self._rng.uniform(0.008, 0.050)
        seconds = self._rng.uniform(0.15, 0.4)
        for _ in range(TRIES):
            direction = away + self._rng.uniform(-limit, limit)
            point, normal = draw_place(self._shape, self._kind, self._rng)
            if self._can_push(world, point, normal, direction):
                world.shove(Shove(point, direction, length, seconds))
                return
        raise SettingError("no place was found where a finger can shove the object beside the sensor")

    def _can_push(self, world: World, point: Array, normal: float, direction: float) -> bool:
        """Check that a finger of radius 8 mm fits at a point of the outline, 15 mm off the gel, and turns it."""
        heading = direction - float(world.object_pose[2])
        forward = unit_vector(heading)
        arm = point - self._shape.centroid
        finger = point - 0.008 * forward
        gel = self._sensor.radius + 0.5 * self._sensor.width
        room = float(np.hypot(*(se2.transform(world.object_pose, finger) - self._gel(world)))) - gel
        return bool(
            abs(se2.wrap(heading - normal - np.pi)) < np.radians(50.0)
            and abs(arm[0] * forward[1] - arm[1] * forward[0]) > self._lever
            and self._shape.signed_distance(finger) > 0.0
            and room > 0.015
        )

    def _gel(self, world: World) -> Array:
        """Return the middle of the gel (2,) [m] in the world."""
        return se2.transform(world.sensor_pose, self._sensor.center)


class _Robot:
    """A robot that moves the sensor in a world until its frames are used up, and records the motion."""

    def __init__(
        self,
        world: World,
        sensor: SensorProfile,
        frames: int,
        hand: _Knocks,
        rng: np.random.Generator,
        pushes: PushSettings,
    ) -> None:
        self.left = frames
        self.motions: list[Motion] = []
        self._world = world
        self._hand = hand
        self._rng = rng
        self._rate = sensor.rate
        self._pushes = pushes
        self._turn_after, self._pad_end = np.radians((5.0, 12.0) if sensor.width else (pushes.turns_after, pushes.ends))

    def go(self, path: Array) -> Motion:
        """Follow a path (N, 3), as far as frames are left."""
        path = path[: self.left]
        self.left -= len(path)
        self.motions.append(self._world.run(path))
        return self.motions[-1]

    def push(self, touch: Touch, frames: int, knocked: int | None) -> None:
        """Push for a number of frames, or until the contact is lost for 0.3 s or leaves the pad.

        The hand shoves the object at the frame `knocked`, or as the sensor stops if that is earlier.
        """
        rng = self._rng
        rate = self._rate
        ramp = round(0.3 * self._rate)  # frames to start and to stop
        speed = float(np.exp(rng.uniform(*np.log(self._pushes.speed))))
        bend = self._pushes.curvature
        curvature = rng.uniform(-bend, bend) if rng.uniform() < 0.5 else 0.0  # [1/m]
        turn = curvature * speed + rng.uniform(-0.1, 0.1)
        follows = rng.uniform(*self._pushes.follows) if self._pushes.follows else 0.0
        yaw = float(self._world.object_pose[2])
        followed = 0.0
        heading = yaw + touch.heading
        pose = self._world.sensor_pose
        end = frames
        step = 0
        touched = False
        lost = 0
        angle = 0.0
        while step < end and self.left:
            if knocked is not None and step >= min(knocked, end - ramp):
                self._hand.in_push(self._world)
                knocked = None
            step += 1
            pace = min(1.0, step / ramp, (end - step) / ramp)
            heading += curvature * speed * pace / rate
            after = 2.0 * np.sign(angle) * max(abs(angle) - self._turn_after, 0.0)
            velocity = speed * unit_vector(heading)
            pose = pose + pace / rate * np.append(velocity, turn + after)
            pose[2] += followed
            motion = self.go(pose[None])
            before = yaw
            yaw = float(self._world.object_pose[2])
            followed = follows * se2.wrap(yaw - before)
            if motion.contact[0]:
                touched = True
                lost = 0
                angle = float(motion.pad_angle[0])
            else:
                lost += 1
                angle = 0.0
            if (touched and lost > 0.3 * rate) or abs(angle) > self._pad_end:
                end = min(end, step + ramp)
