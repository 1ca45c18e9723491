"""The folder of a tracking run."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np

import palpate
from palpate.checks import NUMBERS, checked_array
from palpate.config import TrackerSettings
from palpate.errors import FileError
from palpate.files import in_file, read_json
from palpate.io import load_recording
from palpate.io.estimates import read_estimates_csv, write_estimates_csv, write_estimates_mcap, write_tum
from palpate.io.recording_mcap import write_recording
from palpate.pipeline.figures import drawing, run_figure
from palpate.pipeline.metrics import summarise
from palpate.pipeline.track import Run
from palpate.types.space import Plane

SUMMARY = "summary.json"
FILES = {"settings.json", "trajectory.tum", "estimates.csv", SUMMARY, "figure.png"}
"""Files of every run."""
RECORDING, PAGE, MCAP = "recording.mcap", "page.html", "estimates.mcap"
"""Optional files: the recording, if it is in no other file, and the page and messages that were asked for."""


@contextmanager
def new_run(folder: Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder for the files of a run, which becomes `folder` when the block ends, if they are whole.

    Raises FileError if the folder exists; with `force` an earlier run in it, and nothing else, is replaced then.
    """
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if not folder.name or (folder.exists() and not folder.is_dir()):
        raise FileError(f"{folder}: is a file, or not the name of a new folder")
    if folder.exists() and not force:
        raise FileError(f"{folder}: already exists; --force replaces a run, --out names another folder")
    if foreign := sorted(there - FILES - {RECORDING, PAGE, MCAP}):
        raise FileError(f"{folder}: holds {foreign[0]!r}, which is not part of a run, so it is not replaced")
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        try:
            yield part
        finally:
            if (part / SUMMARY).exists():
                if folder.exists():
                    shutil.rmtree(folder)
                part.rename(folder)
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_files(run: Run, folder: Path, mcap: Plane | None = None) -> None:
    """Write FILES to a folder and, with the plane of the push in space, the estimates as messages (MCAP)."""
    online, file, calibration = run.online, run.recording.file, run.calibration
    settings = {
        "palpate": palpate.__version__,
        "source": run.recording.source,
        "model": None if run.model is None else {"folder": str(run.model.folder), "hash": run.model.hash},
        "calibration": str(calibration.file.absolute()) if calibration and calibration.file else None,
        "first_pose": run.first_pose.tolist(),
        "first_pose_sigma": run.first_pose_sigma.tolist(),
        "recording": RECORDING if file is None else str(file.absolute()),
        **asdict(run.settings),
    }
    write_tum(online, folder / "trajectory.tum")
    write_estimates_csv(online, folder / "estimates.csv")
    if mcap is not None:
        write_estimates_mcap(online, folder / MCAP, plane=mcap)
    with drawing("figure.png"):
        run_figure(run).savefig(folder / "figure.png", dpi=120)
    if file is None:
        write_recording(run.recording, folder / RECORDING)
    for name, data in (("settings.json", settings), (SUMMARY, run.summary)):  # last of all: a folder with both is whole
        (folder / name).write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_run(folder: Path) -> Run:
    """Return a run as a page shows it, without other answers. Raises FileError."""
    file = folder / "settings.json"
    if not file.exists():
        raise FileError(f"{folder}: is no run of palpate track: there is no settings.json in it")
    settings, online = read_json(file), read_estimates_csv(folder / "estimates.csv")
    with in_file(file):
        first, sigma = (
            checked_array(each, settings.get(each), NUMBERS, (3,)) for each in ("first_pose", "first_pose_sigma")
        )
        if not isinstance(name := settings.get("recording"), str):
            raise FileError(f"recording is {name!r}, expected the name of a file")
    recording = load_recording(folder / name)
    written = read_json(folder / SUMMARY)
    if written.get("ended"):
        recording = recording.until(len(online))
    if not np.array_equal(online.time, recording.time):
        raise FileError(
            f"{folder}: its {len(online)} estimates are not of the {len(recording)} frames of {recording.file}, "
            "which is another recording now; track it again"
        )
    truth = np.full((len(recording), 3), np.nan) if recording.object_pose is None else recording.object_pose
    summary = summarise(online, truth, step_ms := np.zeros(len(online)))
    summary["innovations"] = written.get("innovations", {})
    known = TrackerSettings(), None, None, first, sigma
    return Run(recording, *known, online, ((),) * len(online), step_ms, truth, summary)
