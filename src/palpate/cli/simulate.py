"""`palpate simulate`: recordings of a simulated sensor, or touch images for a real motion."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from palpate.cli.console import complain, progress_bar, report
from palpate.cli.options import Json, Sensor, ShapeUnit, Workers, arg
from palpate.errors import SettingError


@dataclass(frozen=True)
class Pushes:
    """The pushes to simulate."""

    shape: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        arg(
            "NAME|AxB|FILE",
            "disc, rectangle and ellipse",
            help="Object: disc, rectangle, ellipse, triangle, hexagon, t, butterfly, rounded-square, the sides of a "
            "rectangle such as 0.09x0.06 [m], or an outline in a file. Repeat for more.",
        ),
    ] = ()
    shape_unit: Annotated[ShapeUnit | None, arg(default="m, or the unit of the drawing")] = None
    """Unit of the numbers in --shape."""
    count: Annotated[int, arg("N")] = 10
    """Recordings of each object."""
    seconds: Annotated[float, arg("S")] = 15.0
    """Length of a recording [s]."""
    knocks: bool = False
    """A finger shoves the object now and then, unknown to the sensor."""
    ideal: bool = False
    """State mounting, outline, time and first pose exactly, as no real set-up does; gel and light stay constant."""
    sensor: Sensor = "digit"
    images: Annotated[bool, arg(default="with images")] = True
    """Make no touch images, which is faster."""


def simulate(
    folder: Annotated[Path, arg("DIR")],
    /,
    *,
    pushes: Pushes = Pushes(),
    replay: Annotated[tyro.conf.UseAppendAction[tuple[Path, ...]], arg("FILE", "none")] = (),
    seed: Annotated[int, arg("N")] = 0,
    unit: Annotated[int | None, arg("N", "another unit for each")] = None,
    shard: Annotated[str | None, arg("K/N", "all")] = None,
    resume: bool = False,
    workers: Workers = Workers(),
    json: Json = False,
) -> int:
    """Simulate recordings of a sensor that pushes objects: poses, touch images, contacts and forces.

    Example: palpate simulate recordings --shape disc --count 20 --knocks

    Args:
        folder: Folder of the recordings.
        replay: Render touch images for the motion of a real recording instead. Repeat for more.
        seed: The same seed gives the same files.
        unit: Seed of one sensor unit for all recordings.
        shard: Make every Nth recording from the Kth on, as one of N machines.
        resume: Keep the recordings that are there and make the rest.
    """
    from palpate.geometry.shapes import SHAPES
    from palpate.io import load_recording
    from palpate.io.outlines import load_shape
    from palpate.lab.simulate.recordings import SUFFIX, plan, simulate_folder
    from palpate.lab.simulate.replay import replay_folder
    from palpate.types.sensor import known_sensor

    options = {"resume": resume, "workers": workers.workers, "dask": workers.dask}
    if replay:
        if pushes != Pushes():
            raise SettingError("--replay takes object and motion from its file; no options of pushes can go with it")
        recordings = {Path(file.name.removesuffix(".gz")).stem + SUFFIX: load_recording(file) for file in replay}
        if len(recordings) < len(replay):
            raise SettingError("--replay: files of one name would give one file; replay them apart")
        with progress_bar("rendering", len(recordings)) as progress:
            outcome = replay_folder(folder, recordings, seed, unit, progress=progress, **options)
    else:
        shapes = {}
        for given in pushes.shape or ("disc", "rectangle", "ellipse"):
            name = Path(given).stem if Path(given).is_file() and given not in SHAPES else given
            if name in shapes:
                raise SettingError(f"--shape {given}: {name!r} is given twice; each shape needs a name of its own")
            shapes[name] = load_shape(given, pushes.shape_unit)
        given = {name: getattr(pushes, name) for name in ("seconds", "images", "knocks", "ideal")}
        simulations = plan(shapes, pushes.count, seed, unit=unit, sensor=known_sensor(pushes.sensor), **given)
        first, _, machines = (shard or "1/1").partition("/")
        if not (first.isdecimal() and machines.isdecimal() and 1 <= int(first) <= int(machines)):
            raise SettingError(f"--shard is {shard!r}; allowed is K/N, the Kth of N parts, such as 1/4")
        simulations = dict(list(simulations.items())[int(first) - 1 :: int(machines)])
        with progress_bar("simulating", len(simulations)) as progress:
            outcome = simulate_folder(folder, simulations, progress=progress, **options)
    for name, why in outcome.failed.items():
        complain(why if replay else f"{folder / name}: {why}")  # the error of a replay names the file that was read
    failed = [{"file": name, "error": why} for name, why in outcome.failed.items()]
    files = {"made": list(outcome.made), "kept": list(outcome.kept), "failed": failed}
    report(json, "recordings", {"folder": str(folder), **files})
    return 3 if outcome.failed else 0
