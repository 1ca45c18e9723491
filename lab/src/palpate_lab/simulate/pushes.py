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
from palpate.types.hand import Hand
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.hand_robot import HandRobot, draw_hand_touch
from palpate_lab.simulate.knocks import Knocks
from palpate_lab.simulate.paths import Surroundings, draw_touch, kinds
from palpate_lab.simulate.push_settings import ROBOT, PushSettings
from palpate_lab.simulate.robot import Robot
from palpate_lab.simulate.scene import draw_gels, draw_settings
from palpate_lab.simulate.world import Motion, World, concatenated

_AGAIN = 4.5  # [s] that must be left for another contact
_PAUSE = 1.0  # [s] for which the sensor stands still for a shove between contacts


def draw_sequence(
    shape: Shape,
    kind: str,
    sensor: SensorProfile | Hand,
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
    if isinstance(sensor, Hand):
        settings = replace(settings, more_gels=draw_gels(settings, len(sensor.fingers) - 1, rng))
    object_pose = rng.uniform((-0.1, -0.1, -np.pi), (0.1, 0.1, np.pi))
    contacts = max(1, round(seconds / rng.uniform(5.0, 7.5)))
    tip = sensor.whole if isinstance(sensor, Hand) else sensor
    around = Surroundings(shape, tip)
    draw = draw_hand_touch if isinstance(sensor, Hand) else draw_touch
    touch = draw(shape, kind, tip, rng, pushes)
    world = World(settings, shape, sensor, object_pose, around.start(touch, object_pose))
    hand = Knocks(shape, tip, knocks)
    frames = round(seconds * sensor.rate)
    if isinstance(sensor, Hand):
        robot = HandRobot(world, tip, frames, hand, rng, pushes, sensor, shape)
    else:
        robot = Robot(world, tip, frames, hand, rng, pushes)
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
            touch = draw(shape, kind, tip, rng, pushes)
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
