"""`palpate simulate`: makes recordings."""

from pathlib import Path
from typing import Annotated

import tyro


def simulate(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="Folder of the recordings.")],
    /,
    *,
    shape: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(
            metavar="NAME|FILE",
            help="Object: disc, rectangle, ellipse, triangle, hexagon, t, butterfly, rounded-square, or a file of a "
            "polygon's vertices [m]. Can be given again for more.",
            help_behavior_hint="(default: disc, rectangle and ellipse)",
        ),
    ] = (),
    count: Annotated[int, tyro.conf.arg(metavar="N", help="Recordings of each object.")] = 10,
    seed: Annotated[int, tyro.conf.arg(metavar="N", help="The same seed gives the same files.")] = 0,
    seconds: Annotated[float, tyro.conf.arg(metavar="S", help="Length of a recording [s].")] = 15.0,
    unit: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N",
            help="Seed of one sensor unit for all recordings.",
            help_behavior_hint="(default: another unit for each)",
        ),
    ] = None,
    workers: Annotated[int, tyro.conf.arg(metavar="N", help="Processes that share the work.")] = 1,
    images: Annotated[bool, tyro.conf.arg(help="Make no touch images, which is faster.", help_behavior_hint="")] = True,
    resume: Annotated[bool, tyro.conf.arg(help="Keep the recordings that are there and make the rest.")] = False,
    dask: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="ADDRESS",
            help="Share the work among a Dask cluster; its scheduler's address.",
            help_behavior_hint="(default: none)",
        ),
    ] = None,
    json: Annotated[bool, tyro.conf.arg(help="Print one JSON object.")] = False,
) -> int:
    """Simulate recordings of a DIGIT that pushes objects: poses, touch images, contacts and forces."""
    import time

    from palpate.cli.console import complain, print_json, print_line, progress_bar
    from palpate.simulation.folder import plan, simulate_folder
    from palpate.simulation.objects import PAPER

    begin = time.perf_counter()
    jobs = plan(_shapes(shape or PAPER), count, seed, unit)
    with progress_bar("simulating", len(jobs)) as progress:
        outcome = simulate_folder(folder, jobs, seconds, images, workers, resume, dask, progress)
    wall_s = time.perf_counter() - begin
    for name, why in outcome.failed.items():
        complain(f"{folder / name}: {why}")
    if json:
        failed = [{"file": name, "error": why} for name, why in outcome.failed.items()]
        print_json(
            {
                "folder": str(folder),
                "made": list(outcome.made),
                "kept": list(outcome.kept),
                "failed": failed,
                "wall_s": wall_s,
            }
        )
    else:
        counts = f"{len(outcome.made)} made, {len(outcome.kept)} kept, {len(outcome.failed)} failed"
        print_line(f"{folder}: {counts}, {wall_s:.1f} s")
    return 3 if outcome.failed else 0


def _shapes(names: tuple[str, ...]) -> dict:
    """Shapes by name; SettingError if two have the same."""
    from palpate.errors import SettingError
    from palpate.simulation.objects import find_shape

    found = {}
    for given in names:
        name, shape = find_shape(given)
        if name in found:
            raise SettingError(f"--shape {given}: {name!r} is given twice; each shape needs a name of its own")
        found[name] = shape
    return found
