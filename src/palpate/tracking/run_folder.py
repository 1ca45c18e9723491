"""The folder that a tracking run leaves."""

import json
import shutil
import uuid
from dataclasses import asdict
from pathlib import Path
from typing import Any

import palpate
from palpate.errors import FileError
from palpate.estimation.settings import PRESETS
from palpate.formats import estimates_csv, palpate_h5, tum
from palpate.formats.bags.estimates_mcap import write_estimates_mcap
from palpate.recording.plane import Plane
from palpate.tracking import details
from palpate.tracking.figures import run_figure
from palpate.tracking.run import Run

FILES = (
    "settings.json",
    "trajectory.tum",
    "estimates.csv",
    "answers.csv",
    "friction.csv",
    "summary.json",
    "figure.png",
)
"""What a run folder holds."""
RECORDING, PAGE, MCAP = "recording.h5", "page.html", "estimates.mcap"
"""What it may hold beside: the recording, where that is in no other file, and the page and messages asked for."""


def write_run(run: Run, folder: Path | str, force: bool = False, mcap: Plane | None = None) -> None:
    """Write the folder of a run, whole or not at all: FILES and, with the plane in space that `mcap` is, MCAP.

    `estimates.csv`, `estimates.mcap` and `summary.json` are of the online estimates, `trajectory.tum` holds the
    smoothed ones. A recording that is in no file is kept as RECORDING, so that the run can be looked at again.
    Raises FileError if the folder exists; with `force` an earlier run in it is replaced once the new one is
    whole.
    """
    folder = Path(folder)
    check_folder(folder, force)
    part = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        part.mkdir(parents=True)
        _write_json(part / "settings.json", settings_dict(run))
        tum.write(run.smoothed, part / "trajectory.tum")
        estimates_csv.write(run.online, part / "estimates.csv")
        details.write_answers(run.online.time, run.answers, part / "answers.csv")
        details.write_friction(run.online.time, run.friction, part / "friction.csv")
        if mcap is not None:
            write_estimates_mcap(run.online, part / MCAP, plane=mcap)
        _write_json(part / "summary.json", run.summary)
        run_figure(run).savefig(part / "figure.png", dpi=150)
        if run.recording.file is None:
            palpate_h5.write_recording(run.recording, part / RECORDING)
        _replace(folder, part)
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def check_folder(folder: Path, force: bool = False) -> None:
    """FileError unless a run may be written to `folder`: new, or an earlier run and `force`."""
    if not folder.name:
        raise FileError(f"{folder}: is not the name of a new folder")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FileError(f"{folder}: is a file, expected the name of a folder to write")
    if not force:
        raise FileError(f"{folder}: already exists; --force replaces a run, --out names another folder")
    beside = (*FILES, RECORDING, PAGE, MCAP)
    if foreign := sorted(path.name for path in folder.iterdir() if path.name not in beside):
        raise FileError(f"{folder}: holds {foreign[0]!r}, which is no part of a run, so it is not replaced")


def settings_dict(run: Run) -> dict[str, Any]:
    """Return what made a run, as plain data for JSON."""
    noise = run.settings.noise
    return {
        "palpate": palpate.__version__,
        "recording": RECORDING if run.recording.file is None else str(run.recording.file.absolute()),
        "source": run.recording.source,
        "tactile": run.settings.tactile,
        "model": None if run.model is None else {"folder": str(run.model.folder), "hash": run.model.hash},
        "calibration": None if run.calibration is None else str(run.calibration.file),
        "smoother": run.settings.smoother,
        "pressure": run.settings.pressure,
        "hypotheses": run.settings.hypotheses,
        "first_pose": run.first_pose.tolist(),
        "first_pose_sigma": None if run.first_pose_sigma is None else run.first_pose_sigma.tolist(),
        "noise_preset": next((name for name, preset in PRESETS.items() if preset == noise), None),
        "noise": asdict(noise),
    }


def _replace(folder: Path, part: Path) -> None:
    """Move `part` to `folder`; what is there goes once the new one is in its place."""
    if not folder.exists():
        part.rename(folder)
        return
    old = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}.old")
    folder.rename(old)
    try:
        part.rename(folder)
    except OSError:
        old.rename(folder)
        raise
    shutil.rmtree(old)


def _write_json(path: Path, data: dict[str, Any]) -> None:
    path.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")
