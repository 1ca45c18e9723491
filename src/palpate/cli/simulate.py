"""`palpate simulate`: recordings of a simulated sensor, or touch images for a real motion."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from palpate.cli.options import (
    DaskOption,
    JsonOption,
    SensorOption,
    ShapeUnit,
    ShapeUnitOption,
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
            "rectangle such as 0.09x0.06 [m], or an outline in a file. Repeat for more.",
            help_behavior_hint="(default: disc, rectangle and ellipse)",
        ),
    ] = (),
    shape_unit: ShapeUnitOption = None,
    replay: Annotated[
        tyro.conf.UseAppendAction[tuple[Path, ...]],
        tyro.conf.arg(
            metavar="FILE",
            help="Take the motion of this real recording, in any known format, and render touch images for it. Repeat "
            "for more.",
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
        bool, tyro.conf.arg(help="A finger shoves the object now and then, unknown to the sensor.")
    ] = False,
    ideal: Annotated[
        bool,
        tyro.conf.arg(
            help="State mounting, outline, time and first pose exactly, which no real set-up does, and keep gel and "
            "light constant.",
        ),
    ] = False,
    sensor: SensorOption = SENSOR,
    workers: WorkersOption = 1,
    images: Annotated[bool, tyro.conf.arg(help="Make no touch images, which is faster.", help_behavior_hint="")] = True,
    resume: Annotated[bool, tyro.conf.arg(help="Keep the recordings that are there and make the rest.")] = False,
    dask: DaskOption = None,
    json: JsonOption = False,
) -> int:
    """Simulate recordings of a sensor that pushes objects: poses, touch images, contacts and forces."""
    import time

    from palpate.cli.console import busy, complain, print_json, print_line, progress_bar
    from palpate.lab.simulate.folder import plan, simulate_folder
    from palpate.lab.simulate.replay import replay_folder
    from palpate.types.sensor import known_sensor

    begin = time.perf_counter()
    unreadable: dict[str, str] = {}
    how = {"workers": workers, "resume": resume, "dask": dask}
    if replay:
        _check_replay(
            {
                "--shape": bool(shape or shape_unit),
                "--count": count != COUNT,
                "--seconds": seconds != SECONDS,
                "--no-images": not images,
                "--knocks": knocks,
                "--ideal": ideal,
                "--sensor": sensor != SENSOR,
            }
        )
        with busy("reading"):
            recordings, unreadable = _recordings(replay)
        with progress_bar("rendering", len(recordings)) as progress:
            outcome = replay_folder(folder, recordings, seed, unit, progress=progress, **how)
    else:
        what = {"seconds": seconds, "images": images, "unit": unit, "knocks": knocks, "ideal": ideal}
        shapes = _shapes(shape or ("disc", "rectangle", "ellipse"), shape_unit)
        simulations = plan(shapes, count, seed, sensor=known_sensor(sensor), **what)
        with progress_bar("simulating", len(simulations)) as progress:
            outcome = simulate_folder(folder, simulations, progress=progress, **how)
    failed = unreadable | outcome.failed
    wall_s = time.perf_counter() - begin
    for name, why in failed.items():
        complain(why if replay else f"{folder / name}: {why}")  # the error of a replay names the file that was read
    if json:
        errors = [{"file": name, "error": why} for name, why in failed.items()]
        made = {"made": list(outcome.made), "kept": list(outcome.kept), "failed": errors}
        print_json({"folder": str(folder), **made, "wall_s": wall_s})
    else:
        counts = f"{len(outcome.made)} made, {len(outcome.kept)} kept, {len(failed)} failed"
        print_line(f"{folder}: {counts}, {wall_s:.1f} s")
    return 3 if failed else 0


def _check_replay(given: dict[str, bool]) -> None:
    """Raise SettingError for options about the motion, which a replay takes from its file."""
    from palpate.errors import SettingError

    if wrong := [option for option, is_given in given.items() if is_given]:
        raise SettingError(f"--replay takes object and motion from its file; {', '.join(wrong)} cannot go with it")


def _recordings(files: tuple[Path, ...]) -> tuple[dict[str, "Recording"], dict[str, str]]:
    """Return recordings by the names of their replays, and the errors of unreadable ones."""
    from palpate.errors import FileError, SettingError
    from palpate.io import load_recording
    from palpate.lab.simulate.folder import SUFFIX

    sources: dict[str, Path] = {}
    found: dict[str, Recording] = {}
    failed: dict[str, str] = {}
    for file in files:
        name = (file.with_suffix("") if file.suffix == ".gz" else file).stem + SUFFIX
        if name in sources:
            raise SettingError(f"--replay {sources[name]} and --replay {file} would both be {name}; replay them apart")
        sources[name] = file
        try:
            found[name] = load_recording(file)
        except FileError as error:
            failed[name] = str(error)
    return found, failed


def _shapes(given: tuple[str, ...], unit: ShapeUnit | None) -> dict[str, "Shape"]:
    """Return shapes by name, the stem for a file; raises SettingError if two have the same name."""
    from palpate.errors import SettingError
    from palpate.geometry.objects import SHAPES
    from palpate.io.outlines.load import load_shape

    found = {}
    for source in given:
        name = Path(source).stem if Path(source).is_file() and source not in SHAPES else source
        if name in found:
            raise SettingError(f"--shape {source}: {name!r} is given twice; each shape needs a name of its own")
        found[name] = load_shape(source, unit)
    return found
