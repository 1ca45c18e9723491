"""`palpate simulate`: makes recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from palpate.cli.options import (
    DaskOption,
    JsonOption,
    SensorOption,
    ShapeUnit,
    ShapeUnitOption,
    ShardOption,
    WorkersOption,
)

if TYPE_CHECKING:
    from palpate.geometry.shapes import Shape
    from palpate.types.recording import Recording

COUNT, SECONDS, SENSOR = 10, 15.0, "digit"


def simulate(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="Folder of the recordings.")],
    /,
    *,
    shape: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(
            metavar="NAME|AxB|FILE",
            help="Object: disc, rectangle, ellipse, triangle, hexagon, t, butterfly, rounded-square, the sides of a "
            "rectangle such as 0.09x0.06 [m], or an outline in a file. Can be given again for more.",
            help_behavior_hint="(default: disc, rectangle and ellipse)",
        ),
    ] = (),
    shape_unit: ShapeUnitOption = None,
    replay: Annotated[
        tyro.conf.UseAppendAction[tuple[Path, ...]],
        tyro.conf.arg(
            metavar="FILE",
            help="Take the motion of this real recording, in any known format, and make touch images only. Can be "
            "given again for more.",
            help_behavior_hint="(default: none)",
        ),
    ] = (),
    count: Annotated[int, tyro.conf.arg(metavar="N", help="Recordings of each object.")] = COUNT,
    seed: Annotated[int, tyro.conf.arg(metavar="N", help="The same seed gives the same files.")] = 0,
    seconds: Annotated[float, tyro.conf.arg(metavar="S", help="Length of a recording [s].")] = SECONDS,
    unit: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Seed of one sensor unit for all recordings.",
            help_behavior_hint="(default: another unit for each)",
        ),
    ] = None,
    knocks: Annotated[
        bool, tyro.conf.arg(help="Someone shoves the object now and then, which the sensor does not know.")
    ] = False,
    ideal: Annotated[
        bool,
        tyro.conf.arg(
            help="State mounting, outline, time and first pose exactly, which no real set-up does, and let neither "
            "gel nor light change.",
        ),
    ] = False,
    sensor: SensorOption = SENSOR,
    workers: WorkersOption = 1,
    images: Annotated[bool, tyro.conf.arg(help="Make no touch images, which is faster.", help_behavior_hint="")] = True,
    resume: Annotated[bool, tyro.conf.arg(help="Keep the recordings that are there and make the rest.")] = False,
    dask: DaskOption = None,
    shard: ShardOption = None,
    json: JsonOption = False,
) -> int:
    """Simulate recordings of a sensor that pushes objects: poses, touch images, contacts and forces."""
    import time

    from palpate.cli.console import busy, complain, print_json, print_line, progress_bar
    from palpate.lab.simulate.folder import plan, simulate_folder
    from palpate.lab.simulate.objects import PAPER
    from palpate.lab.simulate.replay import replay_folder
    from palpate.shards import part_of_work
    from palpate.types.sensor import known_sensor

    begin = time.perf_counter()
    failed: dict[str, str] = {}
    if replay:
        _check_replay((*shape, *filter(None, [shape_unit])), count, seconds, images, knocks, ideal, sensor)
        with busy("reading"):
            recordings, failed = _recordings(replay)
        with progress_bar("rendering", len(part_of_work(tuple(recordings), shard))) as progress:
            outcome = replay_folder(folder, recordings, seed, unit, workers, resume, dask, progress, shard)
    else:
        jobs = plan(_shapes(shape or PAPER, shape_unit), count, seed, unit, knocks, ideal, known_sensor(sensor))
        with progress_bar("simulating", len(part_of_work(jobs, shard))) as progress:
            outcome = simulate_folder(folder, jobs, seconds, images, workers, resume, dask, progress, shard)
    failed |= outcome.failed
    wall_s = time.perf_counter() - begin
    for name, why in failed.items():
        complain(why if replay else f"{folder / name}: {why}")  # a replay's error names the file that was read
    if json:
        print_json(
            {
                "folder": str(folder),
                "made": list(outcome.made),
                "kept": list(outcome.kept),
                "failed": [{"file": name, "error": why} for name, why in failed.items()],
                "wall_s": wall_s,
            }
        )
    else:
        counts = f"{len(outcome.made)} made, {len(outcome.kept)} kept, {len(failed)} failed"
        print_line(f"{folder}: {counts}, {wall_s:.1f} s")
    return 3 if failed else 0


def _check_replay(
    shape: tuple[str, ...], count: int, seconds: float, images: bool, knocks: bool, ideal: bool, sensor: str
) -> None:
    """SettingError for options that say what a recording's motion is to be, which a replay takes from its file.

    A replay is that of a round gel, in the place of a round tip.
    """
    from palpate.errors import SettingError

    given = {
        "--shape": bool(shape),
        "--count": count != COUNT,
        "--seconds": seconds != SECONDS,
        "--no-images": not images,
        "--knocks": knocks,
        "--ideal": ideal,
        "--sensor": sensor != SENSOR,
    }
    if wrong := [option for option, is_given in given.items() if is_given]:
        raise SettingError(f"--replay takes object and motion from its file; {', '.join(wrong)} cannot go with it")


def _recordings(files: tuple[Path, ...]) -> tuple[dict[str, "Recording"], dict[str, str]]:
    """Recordings by the names of their replays, and why others cannot be read; SettingError if two have one name."""
    from palpate.errors import FileError, SettingError
    from palpate.io import load_recording

    sources: dict[str, Path] = {}
    found: dict[str, Recording] = {}
    failed: dict[str, str] = {}
    for file in files:
        name = f"{(file.with_suffix('') if file.suffix == '.gz' else file).stem}.mcap"
        if name in sources:
            raise SettingError(f"--replay {sources[name]} and --replay {file} would both be {name}; replay them apart")
        sources[name] = file
        try:
            found[name] = load_recording(file)
        except FileError as error:
            failed[name] = str(error)
    return found, failed


def _shapes(names: tuple[str, ...], unit: ShapeUnit | None) -> dict[str, "Shape"]:
    """Shapes by name; SettingError if two have the same."""
    from palpate.errors import SettingError
    from palpate.lab.simulate.objects import find_shape

    found = {}
    for given in names:
        name, shape = find_shape(given, unit)
        if name in found:
            raise SettingError(f"--shape {given}: {name!r} is given twice; each shape needs a name of its own")
        found[name] = shape
    return found
