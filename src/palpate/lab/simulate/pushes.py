"""Sequences of pushes: the sensor's path, contact after contact, and the object's motion.

A sequence is steered like a robot by a person who sees the object; each contact is drawn for the object's present pose.

- Two to three contacts in 15 s, as in the paper: a contact for every 5 to 7.5 s. Between them the sensor goes round
  the object, clear of it, at the speed of a careful robot (0.25 m/s).
- Place: uniform along the outline of a disc, an ellipse or the edges. The contact patch on a gel of radius 21 mm is
  about 5 mm to either side of its middle (the square root of twice the radius times the indentation), so a corner shows
  up to 8 mm from it and not from 15 mm on: "near-corners" and "edges". At "corners" the sensor meets the corner
  itself, from between the normals of its two edges.
- Direction: up to 45 degrees off the normal. The object yields sideways by turning, which makes the cone of sticking
  motions wider than the friction cone: for a disc its half angle is the arc tangent of friction x (1 + (r / c)^2),
  39 to 63 degrees with the friction drawn. So some contacts stick and some slide.
- Speed: 10 to 40 mm/s, log-uniform. At 40 mm/s the object would coast 0.3 mm if left alone: all pushes are
  quasi-static, as the paper assumes.
- Path: half of them straight, half with a radius of 0.2 m and more, which over a push turns up to 30 degrees. The
  sensor turns with its path, and besides by up to 0.1 rad/s, at which it rolls over its pad once in a push.
- Pad: the contact begins within 12 degrees of the apex. Past 20 degrees the sensor turns after the contact, gently, and
  at 30 degrees, beyond the edge of a DIGIT's pad (26), the push ends.
- A flat pad is held flat to the object, for a round one soon rolls off it: the contact begins within 5 degrees, the
  sensor moves within 25 of the normal, turns after the contact past 5, and the push ends at 12 degrees, at which
  nearly all of the image shows no contact. The same holds for a hand of several fingers.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.knocks import PAUSE, Knocks
from palpate.lab.simulate.paths import Surroundings, Touch, draw_touch, kinds, unit_vector
from palpate.lab.simulate.scene import draw_settings
from palpate.lab.simulate.world import Motion, World, concatenated
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_AGAIN = 4.5  # [s] that must be left for another contact

SECONDS = (3.0, 600.0)
"""Shortest and longest sequence [s]."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """One object pushed by one sensor, N exact frames."""

    time: Array
    """(N,) [s], from 0."""
    sensor_pose: Array
    """world_T_sensor, (N, 3) [m, m, rad]."""
    motion: Motion
    """Motion of the object, and the contact."""


def draw_sequence(
    shape: Shape,
    kind: str,
    sensor: SensorProfile,
    rng: np.random.Generator,
    seconds: float = 15.0,
    knocks: np.random.Generator | None = None,
    gel_drift: tuple[float, float] = (0.0, 0.0),
) -> Sequence:
    """Draw a world and a sequence of pushes in it, at the sensor's rate; the same generator gives the same.

    `kind` is one of `kinds(shape)`. With a generator for `knocks` a finger shoves the object; until the first shove
    the sequence is the same as without. `gel_drift` is that of the world. Raises SettingError on a kind or duration
    that is not allowed.
    """
    if kind not in kinds(shape):
        raise SettingError(f"kind of contact is {kind!r}; a {type(shape).__name__.lower()} allows {kinds(shape)}")
    if not SECONDS[0] <= seconds <= SECONDS[1]:
        raise SettingError(f"seconds is {seconds:g}; allowed is {SECONDS[0]:g} to {SECONDS[1]:g} s")
    settings = replace(draw_settings(shape, rng), gel_drift=gel_drift)
    object_pose = rng.uniform((-0.1, -0.1, -np.pi), (0.1, 0.1, np.pi))
    contacts = max(1, round(seconds / rng.uniform(5.0, 7.5)))
    around = Surroundings(shape, sensor)
    touch = draw_touch(shape, kind, sensor, rng)
    world = World(settings, shape, sensor, object_pose, around.start(touch, object_pose))
    hand = Knocks(shape, sensor, knocks)
    robot = _Robot(world, sensor, round(seconds * sensor.rate), hand, rng)
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
            if robot.left > (_AGAIN + PAUSE) * sensor.rate and hand.in_pause(world):
                robot.go(np.tile(world.sensor_pose, (round(PAUSE * sensor.rate), 1)))
            touch = draw_touch(shape, kind, sensor, rng)
            start = around.start(touch, world.object_pose)
            robot.go(around.travel(world.sensor_pose, start, world.object_pose))
    sensor_pose = np.concatenate(robot.poses)
    sensor_pose[:, 2] = se2.wrap(sensor_pose[:, 2])
    return Sequence(np.arange(len(sensor_pose)) / sensor.rate, sensor_pose, concatenated(robot.motions))


def measured(poses: ArrayLike, rng: np.random.Generator) -> Array:
    """Return poses (N, 3) [m, m, rad] with the noise of motion capture.

    It is 0.1 mm in x and y and, drawn once for all N, 0.1 to 0.2 degrees in yaw.
    """
    poses = np.asarray(poses, dtype=np.float64)
    sigma = (1e-4, 1e-4, np.radians(rng.uniform(0.1, 0.2)))
    noisy = poses + rng.normal(size=poses.shape) * sigma
    noisy[..., 2] = se2.wrap(noisy[..., 2])
    return noisy


class _Robot:
    """A robot that moves the sensor in a world until its frames are used up, and records the motion."""

    def __init__(
        self, world: World, sensor: SensorProfile, frames: int, hand: Knocks, rng: np.random.Generator
    ) -> None:
        self.left = frames
        self.poses: list[Array] = []
        self.motions: list[Motion] = []
        self._world, self._hand, self._rng, self._rate = world, hand, rng, sensor.rate
        self._turn_after, self._pad_end = np.radians((5.0, 12.0) if sensor.width else (20.0, 30.0))

    def go(self, path: Array) -> Motion:
        """Follow a path (N, 3), as far as frames are left."""
        path = path[: self.left]
        self.left -= len(path)
        self.poses.append(path)
        self.motions.append(self._world.run(path))
        return self.motions[-1]

    def push(self, touch: Touch, frames: int, knocked: int | None) -> None:
        """Push for a number of frames, or until the contact is lost for 0.3 s or leaves the pad.

        The hand shoves the object at the frame `knocked`, or as the sensor stops if that is earlier.
        """
        rng, rate, ramp = self._rng, self._rate, round(0.3 * self._rate)  # frames to start and to stop
        speed = float(np.exp(rng.uniform(*np.log((0.010, 0.040)))))
        curvature = rng.uniform(-5.0, 5.0) if rng.uniform() < 0.5 else 0.0  # [1/m]
        turn = curvature * speed + rng.uniform(-0.1, 0.1)
        heading = float(self._world.object_pose[2]) + touch.heading
        pose, end, step = self._world.sensor_pose, frames, 0
        touched, lost, angle = False, 0, 0.0
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
            motion = self.go(pose[None])
            if motion.contact[0]:
                touched, lost, angle = True, 0, float(motion.pad_angle[0])
            else:
                lost, angle = lost + 1, 0.0
            if (touched and lost > 0.3 * rate) or abs(angle) > self._pad_end:
                end = min(end, step + ramp)
