"""Folders of simulated recordings: the recordings that belong to one, and making those that are missing."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import held_folder
from palpate.geometry.shapes import Shape
from palpate.io.recording_mcap import source_of, write_recording
from palpate.lab.parallel import spread
from palpate.lab.simulate.paths import kinds
from palpate.lab.simulate.recordings import COUNT, Simulation
from palpate.lab.simulate.scene import load_mujoco
from palpate.types.recording import Recording

Item = TypeVar("Item")
SUFFIX = ".mcap"
"""Extension of recordings."""


@dataclass(frozen=True)
class Outcome:
    """Files of a folder after it was filled."""

    made: tuple[str, ...]
    """New files."""
    kept: tuple[str, ...]
    """Files that were there already."""
    failed: dict[str, str]
    """Files that could not be made, with the reason."""


def plan(shapes: Mapping[str, Shape], count: int, seed: int = 0, **options: Any) -> dict[str, Simulation]:
    """Return the recordings of a folder by file name: `count` of each named object, its kinds of contact in turn.

    Options are further fields of `Simulation`. Raises SettingError on a value that is not allowed.
    """
    if not 1 <= count <= COUNT:
        raise SettingError(f"count is {count}; allowed is 1 to {COUNT} recordings of each shape")
    if seed < 0:
        raise SettingError(f"seed is {seed}; allowed is 0 or more")
    found: dict[str, Simulation] = {}
    for number in range(seed * COUNT, seed * COUNT + count):
        for name, shape in shapes.items():
            places = kinds(shape)
            kind = places[number % COUNT % len(places)]
            _, *place = kind.split("-", 1)
            found[f"{'-'.join([name, *place])}-{number:06d}{SUFFIX}"] = Simulation(shape, kind, number, **options)
    return found


def simulate_folder(folder: Path, simulations: Mapping[str, Simulation], **options: Any) -> Outcome:
    """Simulate recordings by file name and write them to a folder; options are those of `fill_folder`."""
    load_mujoco()
    return fill_folder(folder, simulations, lambda each: each.source, Simulation.run, **options)


def fill_folder(
    folder: Path,
    items: Mapping[str, Item],
    source: Callable[[Item], str],
    make: Callable[[Item], Recording],
    workers: int = 1,
    resume: bool = False,
    dask: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> Outcome:
    """Make a recording of each item by file name and write it to a folder, each whole or not at all.

    With `resume`, recordings that are there are kept if their source is that of the item; otherwise they are an error.
    A PalpateError of `make` does not stop the rest. `workers` and `dask` are those of `parallel.spread`; `progress` is
    called with the number of recordings done. Raises SettingError on recordings made with other options, FileError if
    the folder cannot be written.
    """
    with held_folder(folder):
        there = {path.name for path in folder.glob(f"*{SUFFIX}")}
        if there and not resume:
            raise FileError(f"{folder}: holds {len(there)} recordings already; --resume keeps them and makes the rest")
        kept = {name for name, item in items.items() if name in there and _is_whole(folder / name, source(item))}
        missing = [(name, item) for name, item in items.items() if name not in kept]
        made: list[str] = []
        failed: dict[str, str] = {}
        with closing(spread(partial(_made, make=make), missing, workers, dask)) as results:
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
    """Return a recording, or the reason that there is none; the calling process writes the files."""
    name, item = named
    try:
        return name, make(item)
    except PalpateError as error:
        return name, str(error)


def _is_whole(path: Path, wanted: str) -> bool:
    """Check that a file is the undamaged recording of this source; raises SettingError if it is another one."""
    try:
        found = source_of(path)
    except FileError:  # cut off by a broken copy or a failed disk
        return False
    if found != wanted:
        raise SettingError(f"{path}: was made with other options ({found!r}, now {wanted!r}); take another folder")
    return True
