"""The folder that a tracking run leaves."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import palpate
from palpate.config import PRESETS
from palpate.errors import FileError
from palpate.files import read_json, remove_left_of, whole_folder
from palpate.io import estimates_csv, recording_mcap, tum
from palpate.io.estimates_mcap import write_estimates_mcap
from palpate.pipeline import details
from palpate.pipeline.figures import run_figure
from palpate.pipeline.run import Run
from palpate.types.plane import Plane

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
RECORDING, PAGE, MCAP = "recording.mcap", "page.html", "estimates.mcap"
"""What it may hold beside: the recording, where that is in no other file, and the page and messages asked for."""
_STATE = "state.npz"


@contextmanager
def new_run(folder: Path, force: bool = False, resume: bool = False) -> Iterator[Path]:
    """A temporary folder for the files of a run, which becomes `folder` when the block ends well.

    Until then no other process can begin a run there. Raises FileError where one has, or if the folder exists; with
    `force` an earlier run in it is replaced once the new one is whole. The `state_file` beside it stays where a process
    is killed or fails, and goes with the next run but one that is to `resume`.
    """
    with whole_folder(folder, keep=_STATE) as part:
        check_folder(folder, force)
        if not resume:
            state_file(part).unlink(missing_ok=True)
        yield part


def state_file(part: Path) -> Path:
    """Return where the state of a run is saved whose temporary folder is `part`."""
    return part.with_name(_STATE)


def summary_of_whole(folder: Path, asked: Mapping[str, Any], beside: Sequence[str] = ()) -> dict[str, Any]:
    """Return the summary of a run that is there already, and remove what a killed process left beside it.

    Raises FileError unless the same was asked for (see `write_files`) and it holds the files `beside` too.
    """
    found, wanted = read_json(folder / "settings.json").get("asked") or {}, json.loads(json.dumps(asked))
    other = [f"with another {name}" for name, value in wanted.items() if name not in found or found[name] != value]
    if other := [*other, *(f"without {name}" for name in beside if not (folder / name).exists())]:
        raise FileError(f"{folder}: holds a run {other[0]}; --force replaces it, --out names another folder")
    remove_left_of(folder)
    return read_json(folder / "summary.json")


def write_files(
    run: Run, folder: Path, mcap: Plane | None = None, asked: Mapping[str, Any] = MappingProxyType({})
) -> None:
    """Write FILES to a folder and, with the plane in space that `mcap` is, MCAP.

    `asked` is what was asked for, as plain data, by which a later run that is to resume knows whether it asks the same.
    `estimates.csv`, `estimates.mcap` and `summary.json` are of the online estimates, `trajectory.tum` holds the
    smoothed ones. A recording that is in no file is kept as RECORDING, so that the run can be looked at again.
    """
    _write_json(folder / "settings.json", {**settings_dict(run), "asked": dict(asked)})
    tum.write(run.smoothed, folder / "trajectory.tum")
    estimates_csv.write(run.online, folder / "estimates.csv")
    details.write_answers(run.online.time, run.answers, folder / "answers.csv")
    details.write_friction(run.online.time, run.friction, folder / "friction.csv")
    if mcap is not None:
        write_estimates_mcap(run.online, folder / MCAP, plane=mcap, answers=run.answers)
    _write_json(folder / "summary.json", run.summary)
    run_figure(run).savefig(folder / "figure.png", dpi=150)
    if run.recording.file is None:
        recording_mcap.write_recording(run.recording, folder / RECORDING)


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
    file, settings, calibration = run.recording.file, run.settings, run.calibration
    noise = settings.noise
    return {
        "palpate": palpate.__version__,
        "source": run.recording.source,
        "model": None if run.model is None else {"folder": str(run.model.folder), "hash": run.model.hash},
        "calibration": str(calibration.file.absolute()) if calibration and calibration.file else None,
        "first_pose": run.first_pose.tolist(),
        "first_pose_sigma": run.first_pose_sigma.tolist(),
        "noise_preset": next((name for name, preset in PRESETS.items() if preset == noise), None),
        "recording": RECORDING if file is None else str(file.absolute()),
        "tactile": settings.tactile,
        "smoother": settings.smoother,
        "pressure": settings.pressure,
        "hypotheses": settings.hypotheses,
        "noise": asdict(noise),
    }


def _write_json(path: Path, data: dict[str, Any]) -> None:
    path.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")
