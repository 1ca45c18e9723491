"""The folder of a tracking run."""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from palpate.errors import FileError
from palpate.files import write_json
from palpate.io.estimates import write_estimates_csv, write_estimates_mcap, write_tum
from palpate.io.learnt_outlines import write_outline
from palpate.io.recording_mcap import write_recording
from palpate.pipeline.figures import draw, run_figure
from palpate.pipeline.track import Run
from palpate.touch.calibration import Calibration
from palpate.types.space import Plane, flat

SUMMARY = "summary.json"
FILES = {"settings.json", "estimates.csv", SUMMARY, "figure.png"}
"""Files of every run."""
RECORDING = "recording.mcap"
"""The recording, if it is in no other file."""
PAGE = "page.html"
"""The page, if it is asked for."""
MCAP = "estimates.mcap"
"""The estimates as messages, if they are asked for."""
TRAJECTORY = "trajectory.tum"
"""The estimates as evo reads them, if they are asked for."""
OUTLINE = "outline.json"
"""The outline as it was learnt, if it was unknown or a sketch."""
TRUTH = "truth.tum"
"""Ground truth, likewise."""


@contextmanager
def new_run(folder: Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder for the files of a run, which becomes `folder` when the block ends, if they are whole.

    Raises FileError if the folder exists. With `force` it is replaced when the block ends, but only if it holds an
    earlier run and nothing else.
    """
    if not folder.name or (folder.exists() and not folder.is_dir()):
        raise FileError(f"{folder}: is a file, or not the name of a new folder")
    if folder.exists() and not force:
        raise FileError(f"{folder}: already exists; --force replaces a run, --out names another folder")
    may_hold = FILES | {RECORDING, PAGE, MCAP, TRAJECTORY, TRUTH, OUTLINE}
    foreign = sorted({path.name for path in folder.glob("*")} - may_hold)
    if foreign:
        raise FileError(f"{folder}: holds {foreign[0]!r}, which is not part of a run, so it is not replaced")
    target = folder.resolve()  # it may be a link
    part = next(path for path in target.parents if path.exists()) / f".{folder.name}.{os.getpid()}.part"
    try:
        part.mkdir()
        try:
            yield part
        finally:
            if (part / SUMMARY).exists():
                if target.exists():
                    shutil.rmtree(target)
                os.renames(part, target)
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _file_of(calibration: Calibration | None) -> str | None:
    """Return the file of a calibration; None where there is none."""
    return str(calibration.file.absolute()) if calibration and calibration.file else None


def write_files(
    run: Run,
    folder: Path,
    plane: Plane | None = None,
    made_of: dict[str, Any] | None = None,
    names: Collection[str] = FILES,
) -> None:
    """Write FILES to a folder, and those of MCAP and TRAJECTORY that are among the names.

    `plane` is that of the push in space, `made_of` what settings.json says of the recording's file and the options.
    """
    space = plane or flat()
    online = run.online
    recording_file = run.recording.file
    of_fingers = {name: _file_of(each) for name, each in run.calibrations.items()}
    settings = {
        "palpate": palpate.__version__,
        "source": run.recording.source,
        "model": None if run.model is None else {"folder": str(run.model.folder), "hash": run.model.hash},
        "calibration": of_fingers or _file_of(run.calibration),
        "first_pose": run.first_pose.tolist(),
        "first_pose_sigma": run.first_pose_sigma.tolist(),
        "recording": RECORDING if recording_file is None else str(recording_file.absolute()),
        "made_of": made_of,
        **asdict(run.settings),
    }
    write_estimates_csv(online, folder / "estimates.csv", run.answers)
    if MCAP in names:
        write_estimates_mcap(online, folder / MCAP, space, run.answers, run.outlines)
    if TRAJECTORY in names:
        write_tum(online.time, online.pose, folder / TRAJECTORY, space)
        if np.isfinite(run.recording.truth).any():
            write_tum(run.recording.time, run.recording.truth, folder / TRUTH, space)
    # Packed quickly, as it is a tenth larger then and takes two thirds of the time.
    quickly = {"compress_level": 1}
    draw(folder / "figure.png", lambda file: run_figure(run).savefig(file, format="png", dpi=120, pil_kwargs=quickly))
    if run.outlines:
        write_outline(run.outlines[-1], folder / OUTLINE)
    if recording_file is None:
        write_recording(run.recording, folder / RECORDING)
    # Last of all, as a folder with a summary counts as whole.
    write_json(folder / "settings.json", settings)
    write_json(folder / SUMMARY, run.summary)
