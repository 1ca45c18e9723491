"""A robot that pushes an object with one sensor, steered by a person who sees the object."""

import numpy as np

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.knocks import Knocks
from palpate_lab.simulate.paths import Touch, unit_vector
from palpate_lab.simulate.push_settings import PushSettings
from palpate_lab.simulate.world import Motion, World


class Robot:
    """A robot that moves the sensor in a world until its frames are used up, and records the motion."""

    def __init__(
        self,
        world: World,
        sensor: SensorProfile,
        frames: int,
        hand: Knocks,
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
