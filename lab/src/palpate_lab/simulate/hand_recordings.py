"""Simulated recordings of a hand: each finger is a drawn unit with images of its own, and has its own mounting errors.

- Pushes: the fingers point the same way, 35 to 50 mm apart, and push with their tips; the hand's frame is between them.
- Pinches: two fingers face each other along the hand's y and close on the object; frames have the pose of each finger.
- Units: gel, camera and light of each finger are drawn, and its friction and stiffness are its own.
- Mounting: each finger is 1 mm and 1 degree off its stated mount, as in `set_up_errors`; the hand's pose is exact but
  for its noise. Images of each finger are late by a frame in every second recording, and its gel wears by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import scaled
from palpate.io.recording import Recording
from palpate.types.hand import Hand
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.gel import draw_side
from palpate_lab.simulate.pinches import OPEN, closed, draw_grasp, draw_pinches
from palpate_lab.simulate.pushes import draw_sequence, measured
from palpate_lab.simulate.recordings import Simulation
from palpate_lab.simulate.set_up_errors import SetUpErrors, draw_errors, worn
from palpate_lab.simulate.unit import SensorUnit, draw_unit
from palpate_lab.simulate.world import Motion

NAMES = {2: ("left", "right"), 3: ("left", "middle", "right")}
"""Names of the fingers of a hand, by their number."""
_OF_FINGER = ("normal_force", "tangential_force", "slip", "indentation", "pad_angle")


@dataclass(frozen=True)
class _Drawn:
    """Draws of one finger."""

    unit: SensorUnit
    errors: SetUpErrors | None
    camera: np.random.Generator


@dataclass(frozen=True)
class HandSimulation(Simulation):
    """One recording of a hand to simulate; it is drawn from the same as that of one sensor."""

    fingers: int = 2
    """Number of fingers, 2 or 3."""
    pinch: bool = False
    """Two fingers hold the object between them and slide it, in place of pushing with their tips."""
    avoids: ClassVar[tuple[str, ...]] = ("-corners",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fingers not in NAMES:
            raise SettingError(f"fingers is {self.fingers}; allowed are 1 to 3")
        if self.marks is not None or self.kind.endswith(self.avoids):
            raise SettingError("marks and contacts at corners are simulated for one finger alone")
        if self.pinch and (self.fingers != 2 or self.knocks):
            raise SettingError("a pinch has two fingers and no knocks")

    @property
    def source(self) -> str:
        """Description of the recording's origin, with all that is needed to make it again."""
        return f"{super().source}, {self.fingers} fingers{' that pinch' if self.pinch else ''}"

    def run(self, progress: Callable[[int], None] | None = None) -> Recording:
        """Return the recording; `progress` is called with the number of images made, which take most of the time.

        Profiles and mounts of the recording's hand are the nominal ones, as stated.
        """
        unit_seed, *seeds = self._seeds()
        pushes, noise, camera, shoves, systematic = (np.random.default_rng(each) for each in seeds)
        drawn = self._drawn(unit_seed, systematic, camera)
        first = next(iter(drawn.values())).errors
        drift = first.gel_drift if first else (0.0, 0.0)
        closing = None
        if self.pinch:
            grasp = draw_grasp(self.shape, max(each.unit.radius for each in drawn.values()), pushes)
            stated = _gripper(dict.fromkeys(drawn, self.sensor), grasp.half + OPEN)
            true = _as_built(stated, drawn)
            motion, closing = draw_pinches(self.shape, grasp, true, pushes, self.seconds, drift, self.pushes)
        else:
            stated = self._stated(np.random.default_rng([unit_seed, 2]).uniform(0.035, 0.05))
            true = _as_built(stated, drawn)
            knocks = shoves if self.knocks else None
            motion = draw_sequence(self.shape, self.kind, true, pushes, self.seconds, knocks, drift, self.pushes)
        time = np.arange(len(motion.contact)) / self.sensor.rate
        hand_pose = measured(motion.sensor_pose, noise)
        exact = Recording(
            time=time,
            sensor_pose=hand_pose,
            shape=self.shape,
            sensor=stated.whole,
            object_pose=measured(motion.object_pose, noise),
            source=self.source,
            extra=self._truth(motion, drawn),
            set_up_sigma=None if first else np.zeros(3),
            hand=stated,
            images=self._images(motion, drawn, time, camera, progress) if self.images else None,
            contacts={name: motion.contact[:, index] for index, name in enumerate(drawn)},
            finger_poses=None if closing is None else _finger_poses(stated, hand_pose, closing),
        )
        return _with_errors(exact, drawn)

    def _drawn(self, unit_seed: int, systematic: np.random.Generator, camera: np.random.Generator) -> dict[str, _Drawn]:
        """Draw units and errors of all fingers by name; those of a robot with a `unit` are always the same."""
        drawn = {}
        for index, name in enumerate(NAMES[self.fingers]):
            seed = seed_of_finger(unit_seed, index)
            errors = None if self.ideal else draw_errors(systematic, None if self.unit is None else seed)
            drawn[name] = _Drawn(draw_unit(self.sensor, seed), errors, camera.spawn(1)[0])
        return drawn

    def _stated(self, spacing: float) -> Hand:
        """Return the nominal hand, whose fingers are so far apart [m]; the first is on its left."""
        names = NAMES[self.fingers]
        places = spacing * (0.5 * (len(names) - 1) - np.arange(len(names)))
        mounts = {name: (0.0, float(y), 0.0) for name, y in zip(names, places, strict=True)}
        return Hand(dict.fromkeys(names, self.sensor), mounts)

    def _truth(self, motion: Motion, drawn: dict[str, _Drawn]) -> dict[str, Any]:
        """Return forces, angles and exact poses of each frame, of each finger by NAME/VALUE: see `Simulation`."""
        extra: dict[str, Any] = {}
        for index, (name, finger) in enumerate(drawn.items()):
            own = motion.of_finger(index)
            extra |= {f"{name}/{value}": getattr(own, value) for value in _OF_FINGER}
            extra[f"{name}/shown_angle"] = finger.unit.shown_angle(own.pad_angle)
            extra[f"{name}/sensor_pose_clean"] = own.sensor_pose
        extra |= {"sensor_pose_clean": motion.sensor_pose, "object_pose_clean": motion.object_pose}
        return extra | ({"knocked": motion.knocked.astype(np.float64)} if self.knocks else {})

    def _images(
        self,
        motion: Motion,
        drawn: dict[str, _Drawn],
        time: Array,
        camera: np.random.Generator,
        progress: Callable[[int], None] | None,
    ) -> dict[str, list[bytes]]:
        """Return the encoded touch images of each finger; all of them touch the same side of the object."""
        side = self.side or draw_side(camera)
        images: dict[str, list[bytes]] = {}
        for index, (name, finger) in enumerate(drawn.items()):
            units = worn(finger.unit, finger.errors, time) if finger.errors else [finger.unit] * len(time)
            done = index * len(time)
            count = None if progress is None else lambda made, done=done: progress(done + made)
            one = replace(self, side=side)
            images[name] = one._touch_images(motion.of_finger(index), units, finger.camera, count)
        return images


def seed_of_finger(unit_seed: int, index: int) -> int:
    """Return the seed of the unit of one finger of a hand with this seed."""
    return int(np.random.SeedSequence([unit_seed, index]).generate_state(1)[0])


def _gripper(fingers: dict[str, SensorProfile], half: float) -> Hand:
    """Return the open hand of two fingers that face each other, each so far from its middle [m]; the first is at +y."""
    left, right = fingers
    return Hand(fingers, {left: (0.0, half, -0.5 * np.pi), right: (0.0, -half, 0.5 * np.pi)})


def _finger_poses(stated: Hand, hand_pose: Array, closing: Array) -> dict[str, Array]:
    """Return world_T_finger (N, 3) of fingers that have closed by (N,) [m], as the gripper states it."""
    in_hand = closed(np.array(list(stated.mounts.values())), closing)
    return {name: se2.compose(hand_pose, in_hand[:, index]) for index, name in enumerate(stated.fingers)}


def _as_built(stated: Hand, drawn: dict[str, _Drawn]) -> Hand:
    """Return a stated hand as it is: with the gels of its units, each beside its mount."""
    mounts = {}
    for name, mount in stated.mounts.items():
        errors = drawn[name].errors
        true = mount if errors is None else se2.compose(mount, se2.inverse(errors.mounting))
        mounts[name] = tuple(map(float, true))
    fingers = {name: replace(stated.fingers[name], radius=each.unit.radius) for name, each in drawn.items()}
    return Hand(fingers, mounts)


def _with_errors(recording: Recording, drawn: dict[str, _Drawn]) -> Recording:
    """Return the recording of an exact world as a robot with errors makes it; its truth stays exact.

    Mounting errors are in the fingers; outline and first pose have those of the first finger's draw.
    """
    first = next(iter(drawn.values())).errors
    if first is None:
        return recording
    assert recording.object_pose is not None
    images = None
    if recording.images is not None:
        images = {name: _late(given, drawn[name].errors) for name, given in recording.images.items()}
    return replace(
        recording,
        shape=scaled(recording.shape, first.outline),
        images=images,
        first_pose=se2.compose(recording.object_pose[0], first.first_pose),
        first_pose_sigma=first.first_pose_sigma,
    )


def _late(images: Any, errors: SetUpErrors | None) -> list[bytes]:
    """Return the images of one finger as they come with its delay."""
    delay = errors.late if errors else 0
    return [images[max(index - delay, 0)] for index in range(len(images))]
