"""Simulated recordings: a drawn sensor unit pushes an object in a drawn world."""

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape, shape_to_dict
from palpate.lab.parallel import one_thread
from palpate.lab.simulate.episodes import episode_numbers
from palpate.lab.simulate.gel import draw_side, render
from palpate.lab.simulate.pushes import SECONDS, Sequence, draw_sequence, measured
from palpate.lab.simulate.set_up_errors import Wear, draw_errors, with_errors, worn
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile

COUNT = 100_000
"""Most recordings of one object in a folder: number n of a folder with seed s has the seed s * COUNT + n."""


@dataclass(frozen=True)
class Simulation:
    """One recording to simulate. Raises SettingError on a value that is not allowed.

    World, sensor unit, pushes, noise and errors are drawn from seed, shape and kind: the same give the same, with
    images or without.
    """

    shape: Shape
    """The object."""
    kind: str
    """Kind of contact, one of `paths.kinds(shape)`."""
    seed: int
    """Seed of this recording alone."""
    seconds: float = 15.0
    """Length [s]."""
    images: bool = True
    """Make touch images."""
    unit: int | None = None
    """Seed of the sensor unit, to have the same in many recordings; None draws one for this recording."""
    knocks: bool = False
    """A finger shoves the object now and then; extra/knocked marks the frames."""
    ideal: bool = False
    """Noise alone; otherwise mounting, outline, time, first pose, gel and light have the errors of a real set-up."""
    sensor: SensorProfile = DIGIT
    """Nominal profile of the sensor."""

    def __post_init__(self) -> None:
        for name, value in (("seed", self.seed), ("unit", self.unit or 0)):
            if value < 0:
                raise SettingError(f"{name} is {value}; allowed is 0 or more")
        if not 0.05 <= (extent := self.shape.extent) <= 0.5:  # larger than a gel, and passed in a few seconds
            raise SettingError(f"the outline is {extent:g} m wide; simulation allows 0.05 to 0.5 m")
        if not SECONDS[0] <= self.seconds <= SECONDS[1]:
            raise SettingError(f"seconds is {self.seconds:g}; allowed is {SECONDS[0]:g} to {SECONDS[1]:g} s")

    @property
    def source(self) -> str:
        """Description of the recording's origin, with all that is needed to make it again."""
        folder_seed, number = divmod(self.seed, COUNT)
        unit = self._seeds()[0]
        return (
            f"simulated by palpate: MuJoCo, {self.kind}, {float(self.seconds)!r} s, "
            f"seed {folder_seed}, recording {number}, "
            + (f"drawn touch images of unit {unit}" if self.images else f"no touch images, gel of unit {unit}")
            + (", knocked" if self.knocks else "")
            + ("" if self.sensor == DIGIT else f", {self.sensor.name}")
            + ("" if self.ideal else ", with systematic errors")
        )

    def run(self, progress: Callable[[int], None] | None = None) -> Recording:
        """Return the recording; `progress` is called with the number of images made, which take most of the time.

        The recording's sensor is the nominal profile, for nobody measures each unit.
        """
        unit_seed, *seeds = self._seeds()
        pushes, noise, camera, shoves, systematic = (np.random.default_rng(each) for each in seeds)
        errors = None if self.ideal else draw_errors(systematic)
        unit = draw_unit(self.sensor, unit_seed)
        with one_thread():
            gel = replace(self.sensor, radius=unit.radius)
            hand, drift = shoves if self.knocks else None, errors.gel_drift if errors else (0.0, 0.0)
            sequence = draw_sequence(self.shape, self.kind, gel, pushes, self.seconds, hand, drift)
            wear = errors.wear if errors else None
            images = _images(unit, wear, self.shape, sequence, camera, progress) if self.images else None
        motion = sequence.motion
        knocked = {"knocked": motion.knocked.astype(np.float64)} if self.knocks else {}
        exact = Recording(
            time=sequence.time,
            sensor_pose=measured(sequence.sensor_pose, noise),
            shape=self.shape,
            sensor=self.sensor,
            object_pose=measured(motion.object_pose, noise),
            contact=motion.contact,
            episode=episode_numbers(motion.contact),
            image=images,
            source=self.source,
            frames={
                "sensor_pose": "simulated motion capture with drawn noise; exact in extra/sensor_pose_clean",
                "object_pose": "simulated motion capture with drawn noise; exact in extra/object_pose_clean",
                "contact": "contacts of the simulation",
                "extra": "normal_force [N], tangential_force [N] and slip [m/s] towards the sensor's +y, indentation "
                "[m], pad_angle [rad] from the gel's apex; shown_angle [rad], the same as images show it"
                + ("; knocked, 1 in frames in which a finger pushes the object and 0 in others" * self.knocks),
            },
            extra={
                "normal_force": motion.normal_force,
                "tangential_force": motion.tangential_force,
                "slip": motion.slip,
                "indentation": motion.indentation,
                "pad_angle": motion.pad_angle,
                "shown_angle": unit.shown_angle(motion.pad_angle),
                "sensor_pose_clean": sequence.sensor_pose,
                "object_pose_clean": motion.object_pose,
                **knocked,
            },
        )
        return with_errors(exact, errors) if errors else exact

    def _seeds(self) -> tuple[int, *tuple[np.random.SeedSequence, ...]]:
        """Return the seeds of unit, pushes, noise, camera, knocks and errors, different for each object and kind."""
        what = json.dumps([shape_to_dict(self.shape), self.kind]).encode()
        drawn, *others = np.random.SeedSequence([self.seed, zlib.crc32(what)]).spawn(6)
        return int(drawn.generate_state(1)[0]) if self.unit is None else self.unit, *others


def simulate_recording(
    shape: Shape,
    kind: str,
    seed: int,
    seconds: float = 15.0,
    images: bool = True,
    progress: Callable[[int], None] | None = None,
    **options: Any,
) -> Recording:
    """Simulate a sequence of pushes; arguments and options are the fields of `Simulation`."""
    return Simulation(shape, kind, seed, seconds, images, **options).run(progress)


def _images(
    unit: SensorUnit,
    wear: Wear | None,
    shape: Shape,
    sequence: Sequence,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None,
) -> tuple[bytes, ...]:
    motion = sequence.motion
    side = draw_side(rng)
    poses = se2.between(motion.object_pose, sequence.sensor_pose)
    units = worn(unit, wear, sequence.time)
    images: list[bytes] = []
    for now, *contact in zip(units, poses, motion.indentation, motion.tangential_force, strict=True):
        images.append(encode_image(render(now, shape, *contact, rng=rng, side=side)))
        if progress:
            progress(len(images))
    return tuple(images)
