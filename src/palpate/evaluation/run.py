"""Tracking a whole recording, and the folder that it leaves."""

import json
import logging
import shutil
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import palpate
from palpate.errors import FileError, SettingError
from palpate.evaluation.findings import contact_runs, trusted_truth
from palpate.evaluation.metrics import summarise
from palpate.formats import estimates_csv, tum
from palpate.graph.noise import PRESETS
from palpate.recording import Recording
from palpate.tracker import Estimate, Tracker, TrackerSettings
from palpate.trajectory import Trajectory

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

FILES = ("settings.json", "trajectory.tum", "estimates.csv", "summary.json", "figure.png")
"""What a run folder holds."""


@dataclass(frozen=True, eq=False)
class Run:
    """A tracked recording."""

    recording: Recording
    """What was tracked."""
    settings: TrackerSettings
    """How."""
    first_pose: Array
    """world_T_object that tracking began with, (3,) [m, m, rad]."""
    online: Trajectory
    """The estimate at each frame from all frames up to it, with covariance, contact and status."""
    smoothed: Trajectory
    """The poses as all frames of their contact leave them."""
    step_ms: Array
    """Time of each `Tracker.update` (N,) [ms], the reading and decoding of the frame left out."""
    wall_s: float
    """Time of it all [s]."""
    truth: Array | None
    """Ground truth that the run is scored by, (N, 3); NaN where it is not known or jumps away and back."""
    summary: dict[str, Any]
    """See `metrics.summarise`; of the online estimates."""


def track(
    recording: Recording,
    settings: TrackerSettings | None = None,
    first_pose: ArrayLike | None = None,
    progress: Callable[[int], None] | None = None,
) -> Run:
    """Track the object of a recording; `progress` is called after each frame with the number done.

    `first_pose` (3,) [m, m, rad] is world_T_object at the start; the default is the first known ground truth.
    Raises SettingError if the recording lacks what the settings need, EstimationError where the estimator
    cannot go on.
    """
    begin = time.perf_counter()
    settings = settings or TrackerSettings()
    first = _first_pose(recording) if first_pose is None else np.asarray(first_pose, dtype=np.float64)
    _check(recording, settings)
    tracker = Tracker(recording.shape, recording.sensor, first, settings)
    estimates: list[Estimate] = []
    step_ms = np.empty(len(recording))
    for index, frame in enumerate(recording):
        start = time.perf_counter()
        estimates.append(tracker.update(frame))
        step_ms[index] = (time.perf_counter() - start) * 1e3
        if progress:
            progress(index + 1)
    online = Trajectory(
        time=np.array([estimate.time for estimate in estimates]),
        pose=np.array([estimate.pose for estimate in estimates]),
        covariance=np.array([estimate.covariance for estimate in estimates]),
        contact=np.array([estimate.contact for estimate in estimates]),
        status=tuple(estimate.status for estimate in estimates),
    )
    smoothed = tracker.smoothed()
    wall_s = time.perf_counter() - begin
    truth = recording.object_pose
    if truth is not None:
        truth = np.where(trusted_truth(recording)[:, None], truth, np.nan)
    summary = summarise(
        online,
        truth,
        step_ms,
        tactile=settings.tactile,
        smoother=settings.smoother,
        wall_s=wall_s,
        episodes=len(contact_runs(recording)),
    )
    return Run(recording, settings, first, online, smoothed, step_ms, wall_s, truth, summary)


def write_run(run: Run, folder: Path | str, force: bool = False) -> None:
    """Write the folder of a run, whole or not at all: FILES.

    `estimates.csv` and `summary.json` are of the online estimates, `trajectory.tum` holds the smoothed ones.
    Raises FileError if the folder exists; with `force` an earlier run in it is replaced once the new one is
    whole.
    """
    from palpate.evaluation.figures import run_figure

    folder = Path(folder)
    check_folder(folder, force)
    part = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        part.mkdir(parents=True)
        _write_json(part / "settings.json", settings_dict(run))
        tum.write(run.smoothed, part / "trajectory.tum")
        estimates_csv.write(run.online, part / "estimates.csv")
        _write_json(part / "summary.json", run.summary)
        run_figure(run).savefig(part / "figure.png", dpi=150)
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
    if foreign := sorted(path.name for path in folder.iterdir() if path.name not in FILES):
        raise FileError(f"{folder}: holds {foreign[0]!r}, which is no part of a run, so it is not replaced")


def settings_dict(run: Run) -> dict[str, Any]:
    """Return what made a run, as plain data for JSON."""
    noise = run.settings.noise
    return {
        "palpate": palpate.__version__,
        "recording": None if run.recording.file is None else str(run.recording.file),
        "source": run.recording.source,
        "tactile": run.settings.tactile,
        "smoother": run.settings.smoother,
        "pressure": run.settings.pressure,
        "first_pose": run.first_pose.tolist(),
        "noise_preset": next((name for name, preset in PRESETS.items() if preset == noise), None),
        "noise": asdict(noise),
    }


def _check(recording: Recording, settings: TrackerSettings) -> None:
    name = recording.file or "the recording"
    if recording.contact is None:
        raise SettingError(f"{name}: has no contact flags, and tracking needs them")
    known = recording.object_pose is not None and not np.isnan(recording.object_pose).all()
    if settings.tactile == "oracle" and not known:
        raise SettingError(f"{name}: has no ground truth, which tactile oracle takes its measurements from")


def _first_pose(recording: Recording) -> Array:
    name = recording.file or "the recording"
    known = trusted_truth(recording)
    if recording.object_pose is None or not known.any():
        raise SettingError(
            f"{name}: has no ground truth to start from; give the object's first pose [m, m, rad]: "
            "--first-pose X Y THETA, in Python first_pose"
        )
    first = int(np.argmax(known))
    if recording.contact is not None and recording.contact[:first].any():
        logger.warning("%s: the first pose is ground truth of frame %d, after contact began", name, first)
    return recording.object_pose[first]


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
