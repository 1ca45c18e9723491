"""Sequences of pushes: where the sensor goes, contact after contact, and what the object does.

A sequence is steered as a person would steer a robot who sees the object. Each contact is drawn for where the object
is by then. What is drawn, and why:

- Two to three contacts in 15 s, as in the paper: a contact for every 5 to 7.5 s. Between them the sensor goes round
  the object, clear of it, at the speed of a careful robot (0.25 m/s).
- Place: even along the outline of a disc, an ellipse or the edges. The patch on a gel of radius 21 mm is about 5 mm to
  either side of its middle (the square root of twice the radius times the indentation), so that a corner is felt
  up to 8 mm from it and not from 15 mm on: these are "near-corners" and "edges". At "corners" the sensor meets the
  corner itself, from between the normals of its two edges.
- Direction: up to 45 degrees off the normal. The object yields sideways by turning, which makes the cone of motions
  that stick wider than the friction cone: for a disc its half angle is the arc tangent of friction x (1 + (r / c)^2),
  39 to 63 degrees with the friction drawn. So some contacts stick and some slide.
- Speed: 10 to 40 mm/s, log-uniform. At 40 mm/s the object would coast 0.3 mm if left alone, so that all pushes are
  quasi-static, as the paper assumes.
- Path: half of them straight, half with a radius of 0.2 m and more, which over a push turns up to 30 degrees. The
  sensor turns with its path, and besides by up to 0.1 rad/s, at which it rolls over its pad once in a push.
- Pad: the contact begins within 12 degrees of the apex. Past 20 degrees the sensor turns after the contact, gently, and
  at 30 degrees, beyond the edge of a DIGIT's pad (26), the push ends.
- A flat pad is held flat to the object, for a round one soon rolls off it: the contact begins within 5 degrees, the
  sensor moves within 25 of the normal, turns after the contact past 5, and the push ends at 12 degrees, where nearly
  all of the image shows nothing. So is a hand of several fingers.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.knocks import PAUSE, Knocks
from palpate.lab.simulate.paths import Surroundings
from palpate.lab.simulate.places import Touch, draw_touch, kinds
from palpate.lab.simulate.scene import WorldSettings, draw_settings
from palpate.lab.simulate.world import Motion, World, joined
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_SPEED = (0.010, 0.040)  # [m/s]
_CURVATURE = 5.0  # [1/m]
_TURN = 0.1  # [rad/s]
_ROUND, _FLAT = np.radians((20.0, 30.0)), np.radians((5.0, 12.0))  # from where a sensor turns, and where a push ends
_AFTER_RATE = 2.0  # [1/s] at which the sensor turns after a contact beyond that
_RAMP = 0.3  # [s] to start and to stop
_LOST = 0.3  # [s] without contact that end a push
_LEAVE = 0.9  # [s] kept for leaving at the end
_SHORTEST = 1.5  # [s] of a push
_AGAIN = 4.5  # [s] that must be left for another contact

SECONDS = (3.0, 600.0)
"""Shortest and longest sequence [s]."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """One object pushed by one sensor, N frames, all of it exact."""

    time: Array
    """(N,) [s], from 0."""
    sensor_pose: Array
    """world_T_sensor, (N, 3) [m, m, rad]."""
    motion: Motion
    """What the object did, and the contact."""
    kind: str
    """Which kind of contact it is made of: one of `kinds` of its shape."""
    settings: WorldSettings
    """The world it took place in."""


def draw_sequence(
    shape: Shape,
    kind: str,
    sensor: SensorProfile,
    rng: np.random.Generator,
    seconds: float = 15.0,
    knocks: np.random.Generator | None = None,
    gel_drift: tuple[float, float] = (0.0, 0.0),
) -> Sequence:
    """Draw a world and a sequence of pushes in it, at the rate of the sensor; the same generator gives the same.

    `kind` is one of `kinds(shape)`. With a generator for `knocks` someone shoves the object; until the first time
    everything is as without. `gel_drift` is that of the world. Raises SettingError on a kind or duration that is not
    allowed.
    """
    if kind not in kinds(shape):
        raise SettingError(f"kind of contact is {kind!r}; a {type(shape).__name__.lower()} allows {kinds(shape)}")
    if not SECONDS[0] <= seconds <= SECONDS[1]:
        raise SettingError(f"a sequence of {seconds!r} s was asked for; allowed is {SECONDS[0]} to {SECONDS[1]} s")
    settings = replace(draw_settings(shape, rng), gel_drift=gel_drift)
    object_pose = rng.uniform((-0.1, -0.1, -np.pi), (0.1, 0.1, np.pi))
    contacts = max(1, round(seconds / rng.uniform(5.0, 7.5)))
    around = Surroundings(shape, sensor)
    touch = draw_touch(shape, kind, sensor, rng)
    world = World(settings, shape, sensor, object_pose, around.start(touch, object_pose))
    take = _Take(world, round(seconds * sensor.rate))
    hand = Knocks(shape, sensor, knocks)
    while contacts:
        share = take.left / contacts * (rng.uniform(0.85, 1.15) if contacts > 1 else 1.0)
        end = take.left - share + _LEAVE * sensor.rate
        take.go(around.approach(world.sensor_pose, touch, world.object_pose))
        frames = round(max(take.left - end, _SHORTEST * sensor.rate))
        knocked = hand.frame(frames, is_last=take.left - frames <= _AGAIN * sensor.rate)
        _push(take, touch, frames, sensor, rng, hand, knocked)
        contacts = max(contacts - 1, 1) if take.left > _AGAIN * sensor.rate else 0  # one more where one ended early
        take.go(around.leave(world.sensor_pose, world.object_pose, 0 if contacts else take.left))
        if contacts:
            if take.left > (_AGAIN + PAUSE) * sensor.rate and hand.in_pause(world):
                take.go(np.tile(world.sensor_pose, (round(PAUSE * sensor.rate), 1)))
            touch = draw_touch(shape, kind, sensor, rng)
            start = around.start(touch, world.object_pose)
            take.go(around.travel(world.sensor_pose, start, world.object_pose))
    sensor_pose = np.concatenate(take.poses)
    sensor_pose[:, 2] = se2.wrap(sensor_pose[:, 2])
    return Sequence(np.arange(len(sensor_pose)) / sensor.rate, sensor_pose, joined(take.motions), kind, settings)


def measured(poses: ArrayLike, rng: np.random.Generator) -> Array:
    """Return poses (N, 3) [m, m, rad] as motion capture sees them.

    Its noise is 0.1 mm in x and y and, drawn once for all N, 0.1 to 0.2 degrees in yaw, anew at every frame.
    """
    poses = np.asarray(poses, dtype=np.float64)
    sigma = (1e-4, 1e-4, np.radians(rng.uniform(0.1, 0.2)))
    noisy = poses + rng.normal(size=poses.shape) * sigma
    noisy[..., 2] = se2.wrap(noisy[..., 2])
    return noisy


class _Take:
    """A world that runs until its frames are used up, and what it did."""

    def __init__(self, world: World, frames: int) -> None:
        self.world = world
        self.left = frames
        self.poses: list[Array] = []
        self.motions: list[Motion] = []

    def go(self, path: Array) -> Motion:
        path = path[: self.left]
        self.left -= len(path)
        self.poses.append(path)
        self.motions.append(self.world.run(path))
        return self.motions[-1]


def _push(
    take: _Take,
    touch: Touch,
    frames: int,
    sensor: SensorProfile,
    rng: np.random.Generator,
    hand: Knocks,
    knocked: int | None,
) -> None:
    """Push for a number of frames, or until the contact is lost or at the end of the pad.

    The hand shoves the object at the frame `knocked`, or as the sensor stops where that is earlier; the sensor does not
    know.
    """
    rate, (turn_after, pad_end) = sensor.rate, _FLAT if sensor.width else _ROUND
    speed = float(np.exp(rng.uniform(*np.log(_SPEED))))
    curvature = rng.uniform(-_CURVATURE, _CURVATURE) if rng.uniform() < 0.5 else 0.0
    turn = curvature * speed + rng.uniform(-_TURN, _TURN)
    heading = float(take.world.object_pose[2]) + touch.heading
    ramp = round(_RAMP * rate)
    pose, end, step = take.world.sensor_pose, frames, 0
    touched, lost, angle = False, 0, 0.0
    while step < end and take.left:
        if knocked is not None and step >= min(knocked, end - ramp):
            hand.in_push(take.world)
            knocked = None
        step += 1
        pace = min(1.0, step / ramp, (end - step) / ramp)
        heading += curvature * speed * pace / rate
        after = _AFTER_RATE * np.sign(angle) * max(abs(angle) - turn_after, 0.0)
        way = speed * np.array([np.cos(heading), np.sin(heading)])
        pose = pose + pace / rate * np.append(way, turn + after)
        motion = take.go(pose[None])
        if motion.contact[0]:
            touched, lost, angle = True, 0, float(motion.pad_angle[0])
        else:
            lost, angle = lost + 1, 0.0
        if (touched and lost > _LOST * rate) or abs(angle) > pad_end:
            end = min(end, step + ramp)
