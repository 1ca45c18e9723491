"""A study: every recording of a folder tracked with several kinds of touch, on several cores or a cluster, resumable.

The folder of a study holds `study.json`, its settings, and trials/METHOD/RECORDING.npz. A method is a source of touch
measurements, as in `TrackerSettings.tactile`.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np

import palpate
from palpate.arrays import Array, Flags
from palpate.config import TrackerSettings
from palpate.errors import FileError, PalpateError, SettingError, ShapeError
from palpate.files import read_arrays, read_json, whole_file, write_json
from palpate.geometry.shapes import shape_to_dict
from palpate.io import load_recording
from palpate.pipeline.metrics import nees
from palpate.pipeline.track import Run, track
from palpate.touch.calibration import Calibration
from palpate.touch.touch_model import TouchModel
from palpate.tracker import warm_up
from palpate.types.choices import Tactile
from palpate_lab.parallel import held_folder, quiet, spread
from palpate_lab.study.recordings import group_of

FORMAT = {"format": "palpate-study", "version": 4}


@dataclass(frozen=True)
class StudySettings:
    """Methods of a study, and the settings that all of them share."""

    methods: tuple[str, ...]
    """In the order of tables."""
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    """All settings but `tactile`."""
    model: TouchModel | None = None
    """Touch model; None takes the one of each recording's sensor."""
    calibration: Calibration | None = None
    """Calibration of the sensor unit that made all recordings."""
    orientation: str = ""
    """Words that say how images lie."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A recording of N frames tracked by one method."""

    recording: str
    """Its file, relative to the folder of recordings."""
    method: str
    file: list[int]
    """Size [bytes] and time of the last change [ns] of the recording's file."""
    group: str
    """Kind of recording, such as "rectangle-edges"."""
    shape: dict[str, Any]
    """Its outline, as `shape_to_dict` gives it."""
    source: str
    """Origin of the recording."""
    summary: dict[str, Any]
    """Scores; see `metrics.summarise`."""
    time: Array
    """(N,) [s]"""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where unknown."""
    pose: Array
    """Online estimate (N, 3) [m, m, rad]."""
    nees: Array
    """Squared error in units of the covariance (N,); NaN where the truth is unknown."""
    contact: Flags
    """(N,)"""
    step_ms: Array
    """Duration of each `Tracker.update` (N,) [ms]."""


@dataclass
class Study:
    """Outcome of all recordings and methods, in the order of recordings, then of methods."""

    trials: list[Trial] = field(default_factory=list)
    skipped: dict[tuple[str, str], str] = field(default_factory=dict)
    """Reason why a method does not apply to a recording, by both."""
    failed: dict[tuple[str, str], str] = field(default_factory=dict)
    """Error of reading or tracking a recording by a method, by both."""
    kept: int = 0
    """Trials of an earlier run."""
    wall_s: float = 0.0
    """Duration [s]."""


@dataclass(frozen=True)
class _Failure:
    """The reason why there is no trial."""

    reason: str
    is_skipped: bool = False
    """The method does not apply to the recording."""


Key = tuple[str, str]
"""Name of a recording, and a method."""


def track_file(path: Path, method: str, settings: StudySettings) -> Run:
    """Track the recording of a file by a method, without warnings; auto is learnt where there are images, else oracle.

    Raises PalpateError if it cannot be read or tracked, SettingError or ShapeError if the method does not apply to it.
    """
    recording = load_recording(path, settings.orientation)
    if method == "auto":
        method = "oracle" if recording.image is None else "learnt"
    tracker = replace(settings.tracker, tactile=cast(Tactile, method))
    with quiet():
        return track(recording, tracker, model=settings.model, calibration=settings.calibration)


def run_study(
    files: Mapping[str, Path],
    out: Path,
    settings: StudySettings,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    progress: Callable[[int], None] | None = None,
    track_by: Callable[[Path, str, StudySettings], Run] = track_file,
) -> Study:
    """Track recordings, by name as `find_recordings` gives them, and write each trial to the folder `out`.

    `workers` are processes of this machine, `dask` is the address of a cluster's scheduler, which has to see the files
    under the same paths. With `resume`, trials that exist are kept, but for those of recordings that have changed;
    without it the folder must be empty. `progress` is called with the number of trials that are done, `track_by` for
    each. Raises SettingError on a folder made with other settings, FileError if it cannot be written.
    """
    begin = time.perf_counter()
    study = Study()
    outcomes: dict[Key, Trial | _Failure] = {}
    with held_folder(out):
        _check_folder(out, settings, resume)
        jobs: list[tuple[Key, Path]] = []
        for (name, path), method in product(files.items(), settings.methods):
            kept = _kept_trial(_trial_file(out, name, method), path)
            if kept is None:
                jobs.append(((name, method), path.resolve()))
            else:
                outcomes[name, method] = kept
        study.kept = len(outcomes)
        warm_up()  # before there are workers, so that none has to
        with closing(spread(partial(_track, settings=settings, track_by=track_by), jobs, workers, dask)) as results:
            for key, outcome in results:
                if isinstance(outcome, Trial):
                    _write_trial(outcome, _trial_file(out, *key))
                outcomes[key] = outcome
                if progress:
                    progress(len(outcomes))
    for key in product(files, settings.methods):
        outcome = outcomes[key]
        if isinstance(outcome, Trial):
            study.trials.append(outcome)
        elif outcome.is_skipped:
            study.skipped[key] = outcome.reason
        else:
            study.failed[key] = outcome.reason
    study.wall_s = time.perf_counter() - begin
    return study


def described(settings: StudySettings) -> dict[str, Any]:
    """Return the settings of a study as plain data."""
    tracker = settings.tracker
    model = settings.model
    file = settings.calibration and settings.calibration.file
    return {
        "palpate": palpate.__version__,
        "methods": list(settings.methods),
        "noise": asdict(tracker.noise),
        "smoother": tracker.smoother,
        "hypotheses": tracker.hypotheses,
        "orientation": settings.orientation or None,
        "model": model and {"folder": str(model.folder), "hash": model.hash},
        "calibration": file and {"file": str(file), "hash": sha256(file.read_bytes()).hexdigest()},
    }


def flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield settings within settings as `noise.contact.deviation`, with their values."""
    for name, value in settings.items():
        yield from flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else [(prefix + name, value)]


def _check_folder(out: Path, settings: StudySettings, resume: bool) -> None:
    """Write the settings to an empty folder, or check that those in it are the same."""
    path = out / "study.json"
    now = json.loads(json.dumps(described(settings)))
    if all(file.name.startswith(".") for file in out.iterdir()):
        write_json(path, {**FORMAT, "made_with": now})
        return
    if not resume:
        raise FileError(f"{out}: is not empty; --resume continues a study, --out names another folder")
    found = read_json(path)
    if {key: found.get(key) for key in FORMAT} != FORMAT or not isinstance(found.get("made_with"), dict):
        raise FileError(f"{path}: is not of format {FORMAT['format']!r}, version {FORMAT['version']}")
    old = dict(flat(found["made_with"]))
    new = dict(flat(now))
    for name in old | new:
        if old.get(name) != new.get(name) and name not in ("methods", "model.folder", "calibration.file"):
            change = f"{name} was {old.get(name)}, is {new.get(name)}"
            raise SettingError(f"{out}: was made with other settings ({change}); name another folder")


def _track(
    job: tuple[Key, Path], settings: StudySettings, track_by: Callable[[Path, str, StudySettings], Run]
) -> tuple[Key, Trial | _Failure]:
    """Track a recording by a method; errors are returned and not raised."""
    (name, method), path = job
    try:
        stat = path.stat()
        run = track_by(path, method, settings)
    except Exception as error:
        words = " ".join(str(error).split()).removeprefix(f"{path}: ")
        words = words if isinstance(error, PalpateError) else f"{type(error).__name__}: {words}"
        return (name, method), _Failure(words, isinstance(error, SettingError | ShapeError))
    online = run.online
    truth = run.recording.truth
    trial = Trial(
        recording=name,
        method=method,
        file=[stat.st_size, stat.st_mtime_ns],
        group=group_of(name),
        shape=shape_to_dict(run.recording.shape),
        source=run.recording.source,
        summary=run.summary,
        time=online.time,
        truth=truth,
        pose=online.pose,
        nees=nees(online.pose, online.covariance, truth),
        contact=online.contact,
        step_ms=run.step_ms,
    )
    return (name, method), trial


def _trial_file(out: Path, name: str, method: str) -> Path:
    return out / "trials" / method / f"{name}.npz"


def _write_trial(trial: Trial, path: Path) -> None:
    arrays: dict[str, Any] = {name: value for name, value in vars(trial).items() if isinstance(value, np.ndarray)}
    about = {name: value for name, value in vars(trial).items() if name not in arrays}
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, overwrite=True) as part, part.open("wb") as file:
        np.savez_compressed(file, about=np.array(json.dumps(about, allow_nan=False)), **arrays)


def _kept_trial(path: Path, recording: Path) -> Trial | None:
    """Return the trial of a file; None if it is missing or damaged, or if the recording has changed since."""
    try:
        arrays: dict[str, Any] = read_arrays(path)
        trial = Trial(**json.loads(str(arrays.pop("about"))), **arrays)
    except (FileError, ValueError, TypeError, KeyError):
        return None
    stat = recording.stat()
    return trial if trial.file == [stat.st_size, stat.st_mtime_ns] else None
