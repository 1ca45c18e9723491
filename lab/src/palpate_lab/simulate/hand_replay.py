"""Replays of a hand: the motion of a real push by several tips, with rendered touch images of each of them.

As in `replay`, object and contact move as recorded, and so does the gap between robot and motion capture. Each tip
becomes a DIGIT with its apex where that of the tip is, a drawn unit of its own; the hand moves as recorded, and farther
on by the indentation of the gels. Gels at the places of thin tips may overlap, as no real ones could.

All tips have to touch one flat side at once, for a real recording does not say which of them does. As a gel is larger
than a tip, the place that it touches moves by R - r times the angle at which motion capture sees the side.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.io.recording import Recording
from palpate.pipeline.metrics import flag_runs
from palpate.types.hand import Hand
from palpate.types.images import encode_image
from palpate.types.sensor import DIGIT, SensorProfile
from palpate_lab.simulate.gel import Side, draw_side, render
from palpate_lab.simulate.hand_recordings import NAMES, seed_of_finger
from palpate_lab.simulate.replay import (
    Replay,
    Touched,
    check_contacts,
    real_motion,
    refuse_frames,
    sliding,
    tangential_force,
    touched_places,
)
from palpate_lab.simulate.unit import SensorUnit, draw_unit

_APART = 2e-3
"""Largest difference [m] of the tips' distances from a side that all of them touch: motion capture tilts it."""


@dataclass(frozen=True, eq=False)
class HandReplay(Replay):
    """One replay with images of each finger to make. Raises SettingError on a value that is not allowed."""

    fingers: int = 2
    """Number of fingers, 2 or 3: that of the recording's tips."""

    def __post_init__(self) -> None:
        super().__post_init__()
        tips = len(self.recording.sensor.tips)
        if self.fingers != tips or tips not in NAMES:
            name = self.recording.file or "the recording"
            raise SettingError(
                f"{name}: a replay by {self.fingers} fingers needs a sensor of as many tips, 2 or 3; it has {tips}"
            )

    @property
    def source(self) -> str:
        """Description of the replay's origin, with all that is needed to make it again."""
        return f"{super().source}, {self.fingers} fingers"

    def run(self) -> Recording:
        """Return the replay, a recording of a hand. Poses get no noise, for the recorded ones have it.

        Raises SettingError, which names file and frames, for a motion that cannot be rendered, as `Replay.run` does,
        and for one in which a tip does not touch the side that the others touch.
        """
        unit_seed, *seeds = self.seeds()
        draws, camera = (np.random.default_rng(each) for each in seeds)
        motion, known = real_motion(self.recording)
        assert motion.object_pose is not None and motion.contact is not None
        hand = _hand_of(motion.sensor)
        touched = touched_places(motion.shape, motion.sensor, se2.between(motion.object_pose, motion.sensor_pose))
        units = {name: draw_unit(DIGIT, seed_of_finger(unit_seed, k)) for k, name in enumerate(hand.fingers)}
        slip = sliding(motion, touched)
        felt = {name: _felt(motion, touched, unit, slip, draws) for name, unit in units.items()}
        depth = np.mean([each["indentation"] for each in felt.values()], axis=0)
        hand_pose = se2.compose(motion.sensor_pose, np.column_stack((depth, np.zeros((len(depth), 2)))))
        places = {name: se2.between(motion.object_pose, pose) for name, pose in hand.poses(hand_pose).items()}
        self._check(motion, touched, hand, places, units, depth)
        side = draw_side(camera)
        return replace(
            motion,
            sensor_pose=hand_pose,
            hand=hand,
            object_pose=np.where(known[:, None], motion.object_pose, np.nan),
            images={
                name: _rendered(motion.shape, unit, places[name], felt[name], side, camera.spawn(1)[0])
                for name, unit in units.items()
            },
            contacts=dict.fromkeys(units, motion.contact),
            source=self.source,
            extra={f"{name}/{key}": value for name, each in felt.items() for key, value in each.items()},
        )

    def _check(
        self,
        motion: Recording,
        touched: Touched,
        hand: Hand,
        places: dict[str, Array],
        units: dict[str, SensorUnit],
        depth: Array,
    ) -> None:
        """Raise SettingError for frames in which a tip is beside what the others touch, or a gel does not fit.

        `places` are object_T_finger (N, 3) of each finger, once the hand has gone on by the indentation `depth` (N,).
        """
        assert motion.object_pose is not None and motion.contact is not None
        tip = motion.sensor.radius
        thin = Hand(dict.fromkeys(hand.fingers, replace(DIGIT, radius=tip)), hand.mounts)
        gaps = thin.gaps(motion.sensor_pose, motion.object_pose, motion.shape)
        apart = np.ptp(list(gaps.values()), axis=0)
        worst = 1e3 * apart[motion.contact].max()
        reason = f"the tips are {worst:.1f} mm apart in their distance from the object; allowed are {1e3 * _APART:.0f}"
        refuse_frames(self.recording, motion, apart > _APART, reason)
        for name, unit in units.items():
            center = motion.shape.signed_distance(se2.transform(places[name], DIGIT.center))
            of_flat_side = gaps[name] + tip + (DIGIT.radius - tip - depth) * np.cos(touched.angle)
            check_contacts(self.recording, motion, unit, touched.angle, center - of_flat_side)


def _hand_of(sensor: SensorProfile) -> Hand:
    """Return the hand that has a DIGIT at each tip of a sensor, from left to right."""
    names = NAMES[len(sensor.tips)]
    tips = sorted(sensor.tips, key=lambda tip: -tip[1])
    mounts = {name: (*tip, 0.0) for name, tip in zip(names, tips, strict=True)}
    return Hand(dict.fromkeys(names, replace(DIGIT, rate=sensor.rate)), mounts)


def _felt(
    motion: Recording, touched: Touched, unit: SensorUnit, slip: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """Return what a finger feels in each frame, (N,) each, by the names of `extra` of a recording."""
    assert motion.contact is not None
    depth = _indentation(motion, rng)
    return {
        "slip": slip,
        "pad_angle": np.where(motion.contact, touched.angle, np.nan),
        "shown_angle": np.where(motion.contact, unit.shown_angle(touched.angle), np.nan),
        "indentation": depth,
        "tangential_force": tangential_force(depth, slip, rng),
    }


def _indentation(motion: Recording, rng: np.random.Generator) -> Array:
    """Draw the indentation of a gel in each frame, (N,) [m]; 0 without contact.

    It is that of `replay`, pressed in over 4 frames, but without a release: the hand of a recording stands when a push
    is over, and is elsewhere in the next frame.
    """
    assert motion.contact is not None
    depth = np.zeros(len(motion))
    for first, last in flag_runs(motion.contact):
        frames = np.arange(first, last + 1)
        level, rate, phase = rng.uniform((4e-4, 0.1, 0.0), (1e-3, 0.5, 2.0 * np.pi))  # [m], [Hz], [rad]
        varied = level * (1.0 + 0.1 * np.sin(2.0 * np.pi * rate * motion.time[frames] + phase))
        depth[frames] = varied * np.minimum((frames - first + 1) / 4, 1.0)
    return depth


def _rendered(
    shape: Shape, unit: SensorUnit, place: Array, felt: dict[str, Array], side: Side, camera: np.random.Generator
) -> tuple[bytes, ...]:
    """Return the encoded touch images of a finger at object_T_finger (N, 3)."""
    frames = zip(place, felt["indentation"], felt["tangential_force"], strict=True)
    return tuple(encode_image(render(unit, shape, *each, rng=camera, side=side)) for each in frames)
