"""The folder of a tracking run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import palpate
from palpate.config import PRESETS
from palpate.errors import FileError
from palpate.files import whole_folder
from palpate.io.estimates_mcap import write_estimates_mcap
from palpate.io.recording_mcap import write_recording
from palpate.io.trajectories import write_estimates_csv, write_tum
from palpate.pipeline import details
from palpate.pipeline.figures import run_figure
from palpate.pipeline.track import Run
from palpate.types.space import Plane

FILES = (
    "settings.json",
    "trajectory.tum",
    "estimates.csv",
    "answers.csv",
    "friction.csv",
    "summary.json",
    "figure.png",
)
"""Files of every run."""
RECORDING, PAGE, MCAP = "recording.mcap", "page.html", "estimates.mcap"
"""Optional files: the recording, if it is in no other file, and the page and messages that were asked for."""


@contextmanager
def new_run(folder: Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder for the files of a run, which becomes `folder` when the block ends without error.

    Raises FileError if the folder exists; with `force` an earlier run in it is replaced once the new one is complete.
    """
    with whole_folder(folder) as part:
        check_folder(folder, force)
        yield part


def write_files(run: Run, folder: Path, mcap: Plane | None = None) -> None:
    """Write FILES to a folder and, with the plane of the push in space, the estimates as messages (MCAP).

    `estimates.csv`, `estimates.mcap` and `summary.json` are of the online estimates, `trajectory.tum` of the smoothed
    ones.
    """
    _write_json(folder / "settings.json", settings_dict(run))
    write_tum(run.smoothed, folder / "trajectory.tum")
    write_estimates_csv(run.online, folder / "estimates.csv")
    details.write_answers(run.online.time, run.answers, folder / "answers.csv")
    details.write_friction(run.online.time, run.friction, folder / "friction.csv")
    if mcap is not None:
        write_estimates_mcap(run.online, folder / MCAP, plane=mcap, answers=run.answers)
    _write_json(folder / "summary.json", run.summary)
    run_figure(run).savefig(folder / "figure.png", dpi=150)
    if run.recording.file is None:
        write_recording(run.recording, folder / RECORDING)


def check_folder(folder: Path, force: bool = False) -> None:
    """Raise FileError unless a run may be written to `folder`: it is new, or an earlier run with `force`."""
    if not folder.name:
        raise FileError(f"{folder}: is not the name of a new folder")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FileError(f"{folder}: is a file, expected the name of a folder to write")
    if not force:
        raise FileError(f"{folder}: already exists; --force replaces a run, --out names another folder")
    if foreign := sorted({path.name for path in folder.iterdir()} - {*FILES, RECORDING, PAGE, MCAP}):
        raise FileError(f"{folder}: holds {foreign[0]!r}, which is not part of a run, so it is not replaced")


def settings_dict(run: Run) -> dict[str, Any]:
    """Return the settings of a run as plain data for JSON."""
    file, settings, calibration = run.recording.file, run.settings, run.calibration
    return {
        "palpate": palpate.__version__,
        "source": run.recording.source,
        "model": None if run.model is None else {"folder": str(run.model.folder), "hash": run.model.hash},
        "calibration": str(calibration.file.absolute()) if calibration and calibration.file else None,
        "first_pose": run.first_pose.tolist(),
        "first_pose_sigma": run.first_pose_sigma.tolist(),
        "noise_preset": next((name for name, preset in PRESETS.items() if preset == settings.noise), None),
        "recording": RECORDING if file is None else str(file.absolute()),
        "tactile": settings.tactile,
        "smoother": settings.smoother,
        "pressure": settings.pressure,
        "hypotheses": settings.hypotheses,
        "noise": asdict(settings.noise),
    }


def _write_json(path: Path, data: dict[str, Any]) -> None:
    path.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")
