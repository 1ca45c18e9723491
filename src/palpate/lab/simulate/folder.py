"""Folders of simulated recordings: which belong to it, which are there, and making the rest."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from palpate.errors import FileError, PalpateError, SettingError
from palpate.geometry.shapes import Shape
from palpate.io.recording_mcap import source_of, write_recording
from palpate.lab.simulate.places import kinds
from palpate.lab.simulate.pushes import SECONDS
from palpate.lab.simulate.recordings import COUNT, simulate_recording, simulated_source
from palpate.lab.simulate.scene import load_mujoco
from palpate.locks import held_folder, remove_parts
from palpate.parallel import spread
from palpate.shards import Shard, part_of_work
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile

Item = TypeVar("Item")


@dataclass(frozen=True)
class Job:
    """One recording to make."""

    name: str
    """Its file, without the folder."""
    shape: Shape
    """The object."""
    kind: str
    """Kind of contact."""
    seed: int
    """Seed of this recording alone."""
    unit: int | None = None
    """Seed of its sensor unit; None draws one for this recording alone."""
    knocks: bool = False
    """Whether someone shoves the object now and then."""
    ideal: bool = False
    """Whether nothing is wrong but noise."""
    sensor: SensorProfile = DIGIT
    """What pushes it."""


@dataclass(frozen=True)
class Outcome:
    """What became of a folder."""

    made: tuple[str, ...]
    """Files that were made."""
    kept: tuple[str, ...]
    """Files that were there already."""
    failed: dict[str, str]
    """Files that could not be made, and why."""


def plan(
    shapes: Mapping[str, Shape],
    count: int,
    seed: int = 0,
    unit: int | None = None,
    knocks: bool = False,
    ideal: bool = False,
    sensor: SensorProfile = DIGIT,
) -> list[Job]:
    """Return the recordings that belong to a folder: `count` of each object by name, its kinds of contact in turn."""
    if not 1 <= count <= COUNT:
        raise SettingError(f"count is {count}; allowed is 1 to {COUNT} recordings of each shape")
    if seed < 0:
        raise SettingError(f"seed is {seed}; allowed is 0 or more")
    if unit is not None and unit < 0:
        raise SettingError(f"unit is {unit}; allowed is 0 or more")
    jobs: list[Job] = []
    for index in range(count):
        for name, shape in shapes.items():
            places = kinds(shape)
            kind = places[index % len(places)]
            _, *place = kind.split("-", 1)
            number = seed * COUNT + index
            file = f"{'-'.join([name, *place])}-{number:06d}.mcap"
            jobs.append(Job(file, shape, kind, number, unit, knocks, ideal, sensor))
    return jobs


def simulate_folder(
    folder: Path,
    jobs: Sequence[Job],
    seconds: float = 15.0,
    images: bool = True,
    workers: int = 1,
    resume: bool = False,
    dask: str | None = None,
    progress: Callable[[int], None] | None = None,
    shard: Shard | None = None,
) -> Outcome:
    """Simulate recordings and write them to a folder, each whole or not at all.

    Recordings that are there are kept if `resume`, and otherwise an error. `workers` and `dask` are those of
    `parallel.spread`; `progress` is called with the number of recordings that are there. Of a shard only its own
    recordings are looked at and made; other processes may be at the others meanwhile. Raises SettingError on values
    that are not allowed and on recordings made with others, FileError where the folder cannot be written.
    """
    load_mujoco()
    if not SECONDS[0] <= seconds <= SECONDS[1]:
        raise SettingError(f"seconds is {seconds:g}; allowed is {SECONDS[0]:g} to {SECONDS[1]:g} s")

    def source(job: Job) -> str:
        told = job.shape, job.kind, job.seed, seconds, images, job.unit, job.knocks, job.ideal, job.sensor
        return simulated_source(*told)

    make = partial(_simulate, seconds=seconds, images=images)
    return fill_folder(folder, {job.name: job for job in jobs}, source, make, workers, resume, dask, progress, shard)


def fill_folder(
    folder: Path,
    items: Mapping[str, Item],
    source: Callable[[Item], str],
    make: Callable[[Item], Recording],
    workers: int = 1,
    resume: bool = False,
    dask: str | None = None,
    progress: Callable[[int], None] | None = None,
    shard: Shard | None = None,
) -> Outcome:
    """Make a recording of each item, by the name of its file, and write it; see `simulate_folder`.

    `source` tells what the source of a recording that is there must say; what `make` raises, a PalpateError, does not
    stop the rest.
    """
    wanted = part_of_work(tuple(items.items()), shard)
    with held_folder(folder, "a folder of recordings", shard):
        there = {path.name for path in folder.glob("*.mcap")}
        if shard is None:
            remove_parts(folder, ".*.mcap*.part")
        else:  # what others write, alive or not, is theirs
            there &= {name for name, _ in wanted}
        if there and not resume:
            raise FileError(f"{folder}: holds {len(there)} recordings already; --resume keeps them and makes the rest")
        kept = {name for name, item in wanted if name in there and _is_whole(folder / name, source(item))}
        todo = [(name, item) for name, item in wanted if name not in kept]
        made: list[str] = []
        failed: dict[str, str] = {}
        with closing(spread(partial(_made, make=make), todo, workers, dask)) as results:
            for name, result in results:
                if isinstance(result, str):
                    failed[name] = result
                else:
                    write_recording(result, folder / name, overwrite=True)
                    made.append(name)
                if progress:
                    progress(len(kept) + len(made) + len(failed))
        return Outcome(tuple(sorted(made)), tuple(sorted(kept)), failed)


def _made(named: tuple[str, Item], make: Callable[[Item], Recording]) -> tuple[str, Recording | str]:
    """Return a recording, or why there is none; the files are written by the process that asked for it."""
    name, item = named
    try:
        return name, make(item)
    except PalpateError as error:
        return name, str(error)


def _simulate(job: Job, seconds: float, images: bool) -> Recording:
    told = job.shape, job.kind, job.seed, seconds, images, None, job.unit, job.knocks, job.ideal, job.sensor
    return simulate_recording(*told)


def _is_whole(path: Path, wanted: str) -> bool:
    """Say whether a file is the recording of this source, undamaged; raises SettingError if it is another one."""
    try:
        found = source_of(path)
    except FileError:  # cut off by a broken copy or a failed disk
        return False
    if found != wanted:
        raise SettingError(f"{path}: was made with other options ({found!r}, now {wanted!r}); take another folder")
    return True
