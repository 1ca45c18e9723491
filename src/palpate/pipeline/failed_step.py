"""What reproduces a step that failed: the tracker before it and the frame, in one file that runs no code."""

from pathlib import Path

from palpate.errors import EstimationError, FileError, PalpateError
from palpate.tracker import Tracker
from palpate.tracker_state import load_tracker_and, save_tracker
from palpate.types.frame import Frame


def write_failed_step(path: Path, before: Tracker, frame: Frame, failure: Exception) -> EstimationError:
    """Write the tracker before a step, and the frame that failed; returns an error that says so.

    An earlier file is replaced. Where nothing can be written, the error says why.
    """
    what = str(failure) if isinstance(failure, PalpateError) else f"{type(failure).__name__}: {failure}"
    what = what if what.startswith("frame at") else f"frame at {frame.time:.3f} s: {what}"
    try:
        save_tracker(before, path, frame)
    except PalpateError as error:
        return EstimationError(f"{what}; what reproduces it cannot be written: {error}")
    return EstimationError(
        f"{what}; {path} holds the tracker before this step and the frame: "
        f"tracker, frame = palpate.pipeline.failed_step.load_failed_step({str(path)!r}), then tracker.update(frame)"
    )


def load_failed_step(path: Path | str) -> tuple[Tracker, Frame]:
    """Return a tracker and the frame that it fails on. Raises FileError where the file is none of `palpate track`."""
    tracker, frame = load_tracker_and(path)
    if not isinstance(frame, Frame):
        raise FileError(f"{path}: holds a tracker, but no frame that it fails on")
    return tracker, frame
