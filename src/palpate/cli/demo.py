"""`palpate demo`: simulates a push with touch images and tracks it."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from palpate.cli.options import Json, arg

if TYPE_CHECKING:
    from palpate.types.recording import Recording

TACTILE: Final = "learnt"
SHAPE: Final = "rectangle"
SEED: Final = 2
"""The first with three contacts. Its final error is about the median of pushes at the edges of this object."""
SECONDS = 15.0


def demo(*, out: Annotated[Path, arg("DIR")] = Path("demo-run"), json: Json = False) -> int:
    """Simulate a push with touch images and track it; shows a table and writes a figure in well under a minute.

    Example: palpate demo --out demo-run

    Args:
        out: Folder of the run; an earlier run there is replaced.
    """
    from palpate.cli.console import print_line, progress_bar
    from palpate.cli.run_report import report_run
    from palpate.config import TrackerSettings
    from palpate.pipeline.run_folder import RECORDING, new_run, write_files
    from palpate.pipeline.track import track
    from palpate.types.sensor import DIGIT

    with new_run(out, force=True) as part:
        with progress_bar("simulating", round(SECONDS * DIGIT.rate)) as progress:
            recording = demo_recording(progress)
        with progress_bar("tracking", len(recording)) as progress:
            run = track(recording, TrackerSettings(tactile=TACTILE), progress=progress)
        write_files(run, part)
    if not json:
        print_line(f"A DIGIT pushes a {SHAPE}, simulated with seed {SEED}. The recording: {out / RECORDING}")
    report_run(run.summary, out, json)
    return 0


def demo_recording(progress: Callable[[int], None] | None = None) -> "Recording":
    """Simulate the push of the demo; `progress` is called with the number of images made."""
    from palpate.geometry.shapes import SHAPES
    from palpate.lab.simulate.recordings import plan

    (simulation,) = plan({SHAPE: SHAPES[SHAPE]}, 1, SEED, seconds=SECONDS).values()
    return simulation.run(progress)
