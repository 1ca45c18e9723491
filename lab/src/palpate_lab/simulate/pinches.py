"""Pinches: a parallel gripper closes on an object between its two fingers, slides it over the table, and lets go.

The fingers face each other along the hand's y and close by the same way; each is held in its place and presses its gel
in by 0.4 to 1 mm. The grip is as good as friction and that press make it: it holds, or the fingers slip along the
object. Where the object is not between the fingers, the one that touches first pushes it there.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.hand import Hand
from palpate_lab.simulate.hand_robot import PAD_END
from palpate_lab.simulate.paths import TRIES, minimum_jerk, unit_vector
from palpate_lab.simulate.push_settings import PushSettings
from palpate_lab.simulate.scene import draw_gels, draw_settings
from palpate_lab.simulate.world import Motion, World, concatenated

OPEN = 0.015
"""Distance of each finger from the object before it closes [m]."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """Two places of an outline that face each other."""

    hand_pose: Array
    """object_T_hand, in the middle between them, its y from one to the other, (3,) [m, m, rad]."""
    half: float
    """Half of their distance [m]."""


def draw_grasp(shape: Shape, radius: float, rng: np.random.Generator) -> Grasp:
    """Draw a grasp that fingers with gels of a radius [m] can reach; raises SettingError if none is found."""
    outline = shape.outline(720)
    reach = 0.4 * shape.extent
    for _ in range(TRIES):
        yaw = rng.uniform(-np.pi, np.pi)
        along = rng.uniform(-reach, reach)
        turned = (outline - shape.centroid) @ se2.rotation(yaw)
        after = np.roll(turned, -1, axis=0)
        crosses = np.flatnonzero((turned[:, 0] < along) != (after[:, 0] < along))
        if len(crosses) != 2:
            continue
        step = after[crosses] - turned[crosses]
        if (np.abs(step[:, 1]) > np.tan(np.radians(8.0)) * np.abs(step[:, 0])).any():  # a side that leans
            continue
        share = (along - turned[crosses, 0]) / step[:, 0]
        low, high = np.sort(turned[crosses, 1] + share * step[:, 1])
        half = 0.5 * (high - low)
        middle = shape.centroid + se2.rotation(yaw) @ (along, 0.5 * (low + high))
        away = half + radius + np.linspace(0.0, OPEN, 10)
        centers = middle + np.concatenate((away, -away))[:, None] * unit_vector(yaw + 0.5 * np.pi)
        if (shape.signed_distance(centers) > radius - 1.5e-3).all():
            return Grasp(np.append(middle, yaw), float(half))
    raise SettingError("no two sides were found between which two fingers hold the object")


def draw_pinches(
    shape: Shape,
    grasp: Grasp,
    hand: Hand,
    rng: np.random.Generator,
    seconds: float,
    gel_drift: tuple[float, float],
    pushes: PushSettings,
) -> tuple[Motion, Array]:
    """Draw a world and pinches in it, and return the motion and by how much each finger has closed, (N,) [m].

    `hand` is the hand as it is, open. The same generator gives the same.
    """
    settings = draw_settings(shape, rng, pushes)
    settings = replace(settings, gel_drift=gel_drift, more_gels=draw_gels(settings, 1, rng))
    object_pose = rng.uniform((-0.1, -0.1, -np.pi), (0.1, 0.1, np.pi))
    world = World(settings, shape, hand, object_pose, _beside(object_pose, grasp, rng))
    gripper = _Gripper(world, hand, round(seconds * hand.rate))
    count = max(1, round(seconds / 7.0))
    gripper.move(np.repeat(world.sensor_pose[None], round(hand.rate), axis=0))
    for number in range(count):
        frames = gripper.left // (count - number) - round(3.6 * hand.rate)
        gripper.close(OPEN + rng.uniform(4e-4, 1e-3), 1.2)
        gripper.slide(_drawn_slide(world.sensor_pose, max(frames, 1), hand.rate, rng, pushes))
        gripper.close(0.0, 0.8)
        if number + 1 < count:
            goal = _beside(world.object_pose, grasp, rng)
            way = goal - world.sensor_pose
            way[2] = se2.wrap(float(way[2]))
            gripper.move(world.sensor_pose + minimum_jerk(round(hand.rate))[:, None] * way)
    gripper.move(np.repeat(world.sensor_pose[None], gripper.left, axis=0))
    return concatenated(gripper.motions), np.concatenate(gripper.closed)


def closed(mounts: Array, closing: Array) -> Array:
    """Return the poses of fingers in the hand (N, F, 3) that have left their mounts (F, 3) for the middle (N,) [m]."""
    poses = np.repeat(mounts[None], len(closing), axis=0)
    poses[:, :, 1] -= closing[:, None] * np.sign(mounts[:, 1])
    return poses


class _Gripper:
    """A gripper that moves in a world until its frames are used up, and records motion and closing."""

    def __init__(self, world: World, hand: Hand, frames: int) -> None:
        self.left = frames
        self.motions: list[Motion] = []
        self.closed: list[Array] = []
        self._world = world
        self._mounts = np.array(list(hand.mounts.values()))
        self._rate = hand.rate
        self._closing = 0.0

    def close(self, closing: float, seconds: float) -> None:
        """Close each finger to a distance from its mount [m], or open it, while the hand stands."""
        share = minimum_jerk(round(seconds * self._rate))
        way = self._closing + share * (closing - self._closing)
        self.move(np.repeat(self._world.sensor_pose[None], len(way), axis=0), way)

    def slide(self, path: Array) -> None:
        """Follow a path (N, 3) until a contact is beside its pad, where the hand stops."""
        for first in range(0, len(path), 3):
            if not self.left:
                return
            self.move(path[first : first + 3])
            angle = self.motions[-1].pad_angle
            if np.isfinite(angle).any() and np.nanmax(np.abs(angle)) > PAD_END:
                return

    def move(self, path: Array, closing: Array | None = None) -> None:
        """Follow a path (N, 3), as far as frames are left, closed as before or by some distances (N,) [m]."""
        path = path[: self.left]
        if not len(path):
            return
        way = np.full(len(path), self._closing)
        if closing is not None:
            way[:] = closing[: len(path)]
        self.left -= len(path)
        self._closing = float(way[-1])
        fingers = se2.compose(path[:, None], closed(self._mounts, way))
        self.motions.append(self._world.run(path, fingers))
        self.closed.append(np.array(way))


def _beside(object_pose: Array, grasp: Grasp, rng: np.random.Generator) -> Array:
    """Draw the pose of the open hand (3,) at a grasp, up to 5 mm beside it along and across, and 4 degrees."""
    beside = rng.uniform((-5e-3, -5e-3, -np.radians(4.0)), (5e-3, 5e-3, np.radians(4.0)))
    return se2.compose(se2.compose(object_pose, grasp.hand_pose), beside)


def _drawn_slide(start: Array, frames: int, rate: float, rng: np.random.Generator, pushes: PushSettings) -> Array:
    """Draw the path of a hand (N, 3) in any direction, half of them straight, with up to 0.3 rad/s of turning."""
    ramp = max(round(0.3 * rate), 1)
    index = np.arange(frames)
    pace = np.clip(np.minimum((index + 1) / ramp, (frames - index) / ramp), 0.0, 1.0) / rate
    speed = float(np.exp(rng.uniform(*np.log(pushes.speed))))
    bend = rng.uniform(-pushes.curvature, pushes.curvature) if rng.uniform() < 0.5 else 0.0
    heading = rng.uniform(-np.pi, np.pi) + np.cumsum(bend * speed * pace)
    steps = speed * pace[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
    turns = rng.uniform(-0.3, 0.3) * pace
    return start + np.cumsum(np.column_stack((steps, turns)), axis=0)
