"""Simulated recordings: a drawn sensor unit pushes an object in a drawn world; and folders of them."""

import json
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from palpate.errors import FileError, PalpateError, SettingError
from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate.geometry.shapes import Shape, shape_to_dict
from palpate.io.recording import Recording
from palpate.io.recording_mcap import METADATA, write_recording
from palpate.io.rosbag_reader import CutShort, front_matter, mcap_messages
from palpate.types.images import encode_image
from palpate.types.sensor import DIGIT, SensorProfile
from palpate_lab import required
from palpate_lab.parallel import held_folder, spread
from palpate_lab.simulate.any_unit import Faults, through_camera, with_faults
from palpate_lab.simulate.gel import Side, draw_side, render
from palpate_lab.simulate.paths import kinds
from palpate_lab.simulate.push_settings import ROBOT, PushSettings
from palpate_lab.simulate.pushes import draw_sequence, measured
from palpate_lab.simulate.set_up_errors import Mark, draw_errors, with_errors, worn
from palpate_lab.simulate.unit import SensorUnit, draw_unit
from palpate_lab.simulate.world import Motion

if TYPE_CHECKING:
    from palpate_lab.simulate.replay import Replay

COUNT = 100_000
"""Most recordings of one object in a folder: number n of a folder with seed s has the seed s * COUNT + n."""
SUFFIX = ".mcap"
"""Extension of recordings."""


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
    """Seed of a sensor unit on a robot, to have it in many recordings; errors of mounting, outline and time are its
    own, too. None draws one for this recording."""
    knocks: bool = False
    """A finger shoves the object now and then; extra/knocked marks the frames."""
    ideal: bool = False
    """Noise alone; otherwise mounting, outline, time, first pose, gel and light have the errors of a real set-up."""
    sensor: SensorProfile = DIGIT
    """Nominal profile of the sensor."""
    marks: tuple[Mark, ...] | None = None
    """Marks that appear on the gel in place of those that are drawn with the other errors of a set-up."""
    pushes: PushSettings = ROBOT
    """Ranges that the pushes are drawn from."""
    side: Side | None = None
    """Side of the object that meets the pad; None draws one."""
    avoids: ClassVar[tuple[str, ...]] = ()
    """Ends of the kinds of contact that are not simulated."""
    faults: Faults | None = None
    """Properties of the sensor unit beyond the usual; None for a usual one."""

    def __post_init__(self) -> None:
        check_not_negative(seed=self.seed, unit=self.unit)
        extent = self.shape.extent
        if not 0.05 <= extent <= 0.5:  # larger than a gel, and passed in a few seconds
            raise SettingError(f"the outline is {extent:g} m wide; simulation allows 0.05 to 0.5 m")
        if not 3.0 <= self.seconds <= 600.0:
            raise SettingError(f"seconds is {self.seconds:g}; allowed is 3 to 600 s")
        if self.ideal and self.marks is not None:
            raise SettingError("marks are errors of a set-up, and an ideal recording has none")

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
            + ("" if self.ideal else f", with systematic errors{'' if self.unit is None else ' of the unit'}")
            + ("" if self.marks is None else f", marks {self.marks}")
            + ("" if self.pushes == ROBOT else f", {self.pushes}")
            + ("" if self.side is None else f", {self.side}")
            + ("" if self.faults is None else f", {self.faults}")
        )

    def run(self, progress: Callable[[int], None] | None = None) -> Recording:
        """Return the recording; `progress` is called with the number of images made, which take most of the time.

        The recording's sensor is the nominal profile, for nobody measures each unit.
        """
        unit_seed, *seeds = self._seeds()
        pushes, noise, camera, shoves, systematic = (np.random.default_rng(each) for each in seeds)
        errors = None if self.ideal else draw_errors(systematic, self.unit)
        if errors and self.marks is not None:
            errors = replace(errors, marks=self.marks)
        if self.faults is None:
            unit = draw_unit(self.sensor, unit_seed)
        else:
            unit = with_faults(self.sensor, unit_seed, self.faults)
        gel = replace(self.sensor, radius=unit.radius)
        hand = shoves if self.knocks else None
        drift = errors.gel_drift if errors else (0.0, 0.0)
        motion = draw_sequence(self.shape, self.kind, gel, pushes, self.seconds, hand, drift, self.pushes)
        time = np.arange(len(motion.contact)) / gel.rate
        units = worn(unit, errors, time) if errors else [unit] * len(time)
        images = self._touch_images(motion, units, camera, progress) if self.images else None
        exact = Recording(
            time=time,
            sensor_pose=measured(motion.sensor_pose, noise),
            shape=self.shape,
            sensor=self.sensor,
            object_pose=measured(motion.object_pose, noise),
            contact=motion.contact,
            image=images,
            source=self.source,
            # Forces [N], slip [m/s] towards the sensor's +y, indentation [m], angles from the gel's apex [rad].
            extra={
                "normal_force": motion.normal_force,
                "tangential_force": motion.tangential_force,
                "slip": motion.slip,
                "indentation": motion.indentation,
                "pad_angle": motion.pad_angle,
                "shown_angle": unit.shown_angle(motion.pad_angle),
                "sensor_pose_clean": motion.sensor_pose,
                "object_pose_clean": motion.object_pose,
                **({"knocked": motion.knocked.astype(np.float64)} if self.knocks else {}),
            },
            set_up_sigma=None if errors else np.zeros(3),
        )
        return with_errors(exact, errors) if errors else exact

    def _touch_images(
        self,
        motion: Motion,
        units: Iterable[SensorUnit],
        camera: np.random.Generator,
        progress: Callable[[int], None] | None,
    ) -> list[bytes]:
        """Return the encoded touch image of each frame, as the unit is at that frame."""
        images = []
        side = draw_side(camera) if self.side is None else self.side
        poses = se2.between(motion.object_pose, motion.sensor_pose)
        depth = motion.indentation
        if self.pushes.deep_as_pressed:
            depth = np.maximum(depth, motion.normal_force / float(np.mean(self.pushes.gel_stiffness)))
        delivered = None if self.faults is None else through_camera(self.faults)
        for unit, *contact in zip(units, poses, depth, motion.tangential_force, strict=True):
            image = render(unit, self.shape, *contact, rng=camera, side=side)
            images.append(encode_image(delivered(image) if delivered else image))
            if progress:
                progress(len(images))
        return images

    def _seeds(self) -> tuple[int, *tuple[np.random.SeedSequence, ...]]:
        """Return the seeds of unit, pushes, noise, camera, knocks and errors, different for each object and kind."""
        what = json.dumps([shape_to_dict(self.shape), self.kind]).encode()
        drawn, *others = np.random.SeedSequence([self.seed, zlib.crc32(what)]).spawn(6)
        return int(drawn.generate_state(1)[0]) if self.unit is None else self.unit, *others


def demo_recording(progress: Callable[[int], None] | None = None) -> Recording:
    """Simulate the push of `palpate demo`; `progress` is called with the number of images made."""
    # The first seed with three contacts; its final error is about the median of pushes at the edges of this object.
    (simulation,) = plan({"rectangle": SHAPES["rectangle"]}, 1, seed=2, seconds=15.0).values()
    return simulation.run(progress)


def plan(
    shapes: Mapping[str, Shape],
    count: int,
    seed: int = 0,
    leave_out: Collection[str] = (),
    made: type[Simulation] = Simulation,
    **options: Any,
) -> dict[str, Simulation]:
    """Return the recordings of a folder by file name: `count` of each named object, its kinds of contact in turn.

    `leave_out` are kinds of contact that are not made. Options are further fields of `made`, the kind of simulation.
    Raises SettingError on a value that is not allowed, and without MuJoCo.
    """
    if not 1 <= count <= COUNT:
        raise SettingError(f"count is {count}; allowed is 1 to {COUNT} recordings of each shape")
    check_not_negative(seed=seed)
    required("simulation", "sim", "mujoco")
    simulations: dict[str, Simulation] = {}
    for number in range(seed * COUNT, seed * COUNT + count):
        for name, shape in shapes.items():
            places = [kind for kind in kinds(shape) if kind not in leave_out and not kind.endswith(made.avoids)]
            kind = places[number % COUNT % len(places)]
            _, *place = kind.split("-", 1)
            file = f"{'-'.join([name, *place])}-{number:06d}{SUFFIX}"
            simulations[file] = made(shape, kind, number, **options)
    return simulations


def fill_folder(
    folder: Path,
    items: "Mapping[str, Simulation | Replay]",
    workers: int = 1,
    resume: bool = False,
    dask: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[list[str], list[str], dict[str, str]]:
    """Make recordings by file name and write them to a folder, each whole or not at all.

    Return the names of those that are made, of those that were there, and of others with the reason. `resume` keeps
    recordings of the same source; `workers` and `dask` are those of `parallel.spread`. A PalpateError of one does not
    stop the rest. Raises SettingError on recordings made with other options, FileError on the folder.
    """
    with held_folder(folder):
        there = {path.name for path in folder.glob(f"*{SUFFIX}")}
        if there and not resume:
            raise FileError(f"{folder}: holds {len(there)} recordings already; --resume keeps them and makes the rest")
        kept = {name for name, item in items.items() if name in there and _is_whole(folder / name, item.source)}
        missing = [(name, item) for name, item in items.items() if name not in kept]
        made: list[str] = []
        failed: dict[str, str] = {}
        with closing(spread(_made, missing, workers, dask)) as results:
            for name, result in results:
                if isinstance(result, str):
                    failed[name] = result
                else:
                    write_recording(result, folder / name, overwrite=True)
                    made.append(name)
                if progress:
                    progress(len(kept) + len(made) + len(failed))
        return sorted(made), sorted(kept), failed


def _made(named: "tuple[str, Simulation | Replay]") -> tuple[str, Recording | str]:
    """Return a recording, or the reason that there is none; the calling process writes the files."""
    name, item = named
    try:
        return name, item.run()
    except PalpateError as error:
        return name, str(error)


def _is_whole(path: Path, wanted: str) -> bool:
    """Check that a file is the undamaged recording of this source; raises SettingError if it is another one."""
    try:
        for _ in mcap_messages(path):
            pass
    except CutShort:  # by a broken copy or a failed disk
        return False
    source = front_matter(path)[0].get(METADATA, {}).get("source", "")
    if source != wanted:
        raise SettingError(f"{path}: was made with other options ({source!r}, now {wanted!r}); take another folder")
    return True


def check_not_negative(**numbers: int | None) -> None:
    """Raise SettingError if one of these is below 0; None is not."""
    for name, value in numbers.items():
        if (value or 0) < 0:
            raise SettingError(f"{name} is {value}; allowed is 0 or more")
