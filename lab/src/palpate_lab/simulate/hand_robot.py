"""Pushes by the tips of a hand, which point the same way: all of them touch, and one may leave and join again.

The robot turns the hand so that its tips stay on the object, as a person who sees it would, and not more: a hand that
is not quite flat to a side touches first with one tip. It turns with the object, more or less; in half of the pushes it
leans to one side for a second or two, so that one tip leaves. Two in three pushes go towards the middle of the object,
which then follows without turning; in the others a tip often slides and leaves by itself.
"""

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.hand import Hand
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.knocks import Knocks
from palpate_lab.simulate.paths import TRIES, Touch, draw_touch, unit_vector
from palpate_lab.simulate.push_settings import PushSettings
from palpate_lab.simulate.robot import Robot
from palpate_lab.simulate.world import World

_GAIN = 3.0
"""Rate at which the hand turns towards the object, relative to the angle that is left [1/s]."""
PAD_END = float(np.radians(24.0))
"""Angle from a tip's apex past which a push ends [rad]: the side of a DIGIT's pad is at 26 degrees."""


class HandRobot(Robot):
    """A robot that pushes with several tips."""

    def __init__(
        self,
        world: World,
        whole: SensorProfile,
        frames: int,
        knocks: Knocks,
        rng: np.random.Generator,
        pushes: PushSettings,
        fingers: Hand,
        shape: Shape,
    ) -> None:
        """Take what every robot takes, for the hand as one sensor; then the hand as it is, and the object."""
        super().__init__(world, whole, frames, knocks, rng, pushes)
        self._fingers = fingers
        self._shape = shape

    def push(self, touch: Touch, frames: int, knocked: int | None) -> None:
        """Push for a number of frames, or until no tip touches for 0.3 s or a contact leaves its pad.

        The hand shoves the object at the frame `knocked`, or as the sensor stops if that is earlier.
        """
        rng = self._rng
        rate = self._rate
        ramp = round(0.3 * rate)  # frames to start and to stop
        speed = float(np.exp(rng.uniform(*np.log(self._pushes.speed))))
        bend = self._pushes.curvature
        curvature = rng.uniform(-bend, bend) if rng.uniform() < 0.5 else 0.0  # [1/m]
        lean = _drawn_lean(frames, rate, rng)
        follows = rng.uniform(0.5, 1.0)
        yaw = float(self._world.object_pose[2])
        turned = 0.0  # of the object in the last frame
        heading = yaw + touch.heading
        pose = self._world.sensor_pose
        end = frames
        step = 0
        lost = 0
        has_touched = False
        while step < end and self.left:
            if knocked is not None and step >= min(knocked, end - ramp):
                self._hand.in_push(self._world)
                knocked = None
            pace = min(1.0, (step + 1) / ramp, (end - step - 1) / ramp)
            heading += curvature * speed * pace / rate
            turn = float(np.clip(_GAIN * (self._skew() - lean[step]), -0.6, 0.6)) if has_touched else 0.0
            pose = pose + pace / rate * np.append(speed * unit_vector(heading), turn)
            pose[2] += follows * turned
            step += 1
            motion = self.go(pose[None])
            turned = se2.wrap(float(self._world.object_pose[2]) - yaw)
            yaw = float(self._world.object_pose[2])
            touches = motion.contact[0]
            has_touched |= bool(touches.any())
            lost = 0 if touches.any() else lost + 1
            is_off_pad = touches.any() and np.nanmax(np.abs(motion.pad_angle[0])) > PAD_END
            if (has_touched and lost > 0.3 * rate) or is_off_pad:
                end = min(end, step + ramp)

    def _skew(self) -> float:
        """Return the angle [rad] by which the hand would turn until all of its tips are as near to the object.

        A tip beside the object counts as 5 mm from it.
        """
        hand = self._fingers
        gaps = hand.gaps(self._world.sensor_pose[None], self._world.object_pose[None], self._shape)
        gap = np.clip([float(each[0]) for each in gaps.values()], None, 0.005)
        across = np.array([y for _, y, _ in hand.mounts.values()])
        across = across - across.mean()
        return -float(np.arctan2(across @ gap, across @ across))


def draw_hand_touch(
    shape: Shape, kind: str, whole: SensorProfile, rng: np.random.Generator, pushes: PushSettings
) -> Touch:
    """Draw a contact of a hand as one sensor, as `draw_touch` does; two in three head for the object's middle."""
    is_aimed = rng.uniform() < 2.0 / 3.0
    for _ in range(TRIES):
        touch = draw_touch(shape, kind, whole, rng, pushes)
        arm = shape.centroid - se2.transform(touch.sensor_pose, whole.center)
        forward = unit_vector(touch.heading)
        if not is_aimed or abs(arm[0] * forward[1] - arm[1] * forward[0]) < 0.3 * whole.width:
            return touch
    raise SettingError(f"no place was found where {whole.name} push the object towards its middle at its {kind}")


def _drawn_lean(frames: int, rate: float, rng: np.random.Generator) -> Array:
    """Draw the angle at which a hand leans against the object, (frames,) [rad]: 0, but for a while in half of them."""
    lean = np.zeros(frames)
    angle = rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(3.0, 7.0))
    first = round(rng.uniform(0.25, 0.6) * frames)
    length = round(rng.uniform(1.0, 2.0) * rate)
    if rng.uniform() < 0.5:
        lean[first : first + length] = angle
    return lean
