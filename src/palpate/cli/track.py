"""`palpate track`, `demo` and `warm-up`: track recordings, leave a folder for each and print its scores."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.cli.console import print_line, progress_bar, report
from palpate.cli.options import Bag, Estimator, Force, Json, Start, Touch, arg
from palpate.errors import PalpateError

if TYPE_CHECKING:
    from palpate.types.recording import Recording


def track(
    file: Annotated[Path, arg("FILE")],
    /,
    *,
    json: Json = False,
    start: Start = Start(),
    touch: Touch = Touch(),
    estimator: Estimator = Estimator(),
    bag: Bag = Bag(),
    out: Annotated[Path | None, arg("DIR", "runs/<name>")] = None,
    mcap: bool = False,
    html: bool = False,
    force: Force = False,
) -> int:
    """Track the object of a recording, and write poses, covariances, scores and a figure to a folder.

    Example: palpate track push.mcap --first-pose 0.1 0 0.3 --first-pose-sigma 0.01 0.01 0.1

    Args:
        file: A recording in any known format, or a bag of ROS messages.
        out: Folder of the run.
        mcap: Write the estimates as ROS 2 messages too, estimates.mcap.
        html: Write a page that shows the push in any browser, page.html.
    """
    from palpate.io.ros_messages import nanoseconds
    from palpate.pipeline.figures import drawing
    from palpate.pipeline.run_folder import PAGE, new_run, write_files
    from palpate.pipeline.track import track as track_recording
    from palpate.types.space import flat

    folder = out or Path("runs") / ((file.with_suffix("") if file.suffix == ".gz" else file).stem or file.name)
    settings = estimator.settings(touch.tactile)
    first_pose, sigma = start.pose_and_sigma()
    model, unit = touch.load(touch.tactile)
    known: Any = {"first_pose_sigma": sigma, "model": model, "calibration": unit}
    with new_run(folder, force) as part:
        recording, plane = bag.read(file)
        if mcap:
            nanoseconds(file, recording.time)  # raises before tracking where they cannot be stamps
        with progress_bar(file.name, len(recording)) as progress:
            run = track_recording(recording, settings, first_pose, **known, progress=progress)
        write_files(run, part, (plane or flat()) if mcap else None)
        if html:
            from palpate.viewer.page import write_page

            with drawing(PAGE):
                write_page(run, part / PAGE)
    report_run(run.summary, folder, json)
    return 0


def demo(*, out: Annotated[Path, arg("DIR")] = Path("demo-run"), json: Json = False) -> int:
    """Simulate a push with touch images and track it; shows a table and writes a figure in well under a minute.

    Example: palpate demo --out demo-run

    Args:
        out: Folder of the run; an earlier run there is replaced.
    """
    from palpate.config import TrackerSettings
    from palpate.pipeline.run_folder import RECORDING, new_run, write_files
    from palpate.pipeline.track import track as track_recording

    with new_run(out, force=True) as part:
        with progress_bar("simulating", 450) as progress:
            recording = demo_recording(progress)
        with progress_bar("tracking", len(recording)) as progress:
            run = track_recording(recording, TrackerSettings("learnt"), progress=progress)
        write_files(run, part)
    if not json:
        print_line(f"A DIGIT pushes a rectangle in simulation. The recording: {out / RECORDING}")
    report_run(run.summary, out, json)
    return 0


def demo_recording(progress: Callable[[int], None] | None = None) -> "Recording":
    """Simulate the push of the demo; `progress` is called with the number of images made."""
    from palpate.geometry.shapes import SHAPES
    from palpate.lab.simulate.recordings import plan

    # The first seed with three contacts; its final error is about the median of pushes at the edges of this object.
    (simulation,) = plan({"rectangle": SHAPES["rectangle"]}, 1, seed=2, seconds=15.0).values()
    return simulation.run(progress)


def report_run(summary: dict[str, Any], folder: Path, json: bool) -> None:
    """Print the summary of one run."""
    from palpate.pipeline.metrics import pose_words

    final = {} if json else {"final_pose": pose_words(summary["final_pose"], summary["final_sigma"])}
    report(json, "run", summary | final)
    if not json:
        print_line(f"run: {folder}   figure: {folder / 'figure.png'}")


def warm_up(*, json: Json = False) -> int:
    """Compile what tracking needs and keep it, such as while a container image is built.

    Example: palpate warm-up
    """
    import numpy as np

    from palpate import DIGIT, Disc, Frame, Tracker
    from palpate.graph.compiled import folder_of
    from palpate.graph.gauss_newton import improve

    if (folder := folder_of(improve)) is None:
        raise PalpateError("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder that only you can write to")
    tracker, random = Tracker(Disc(0.05), DIGIT, None), np.random.default_rng(0)
    for index in range(30):  # images of an untouched gel, then of one that is pressed
        image = random.integers(100, 120, (DIGIT.image_height, DIGIT.image_width, 3), np.uint8)
        image[80:200, 60:160] += np.uint8(0 if index < 25 else 100)
        tracker.update(Frame(index / DIGIT.rate, np.array([0.001 * min(index, 25) - 0.1, 0.0, 0.0]), image=image))
    report(json, "compiled code", {"folder": str(folder)})
    return 0
