"""A study: every recording of a folder tracked by every method, on several cores or a cluster, and resumable.

The folder of a study holds `study.json`, with settings and facts of recordings, and trials/METHOD/RECORDING.npz.
"""

import json
import logging
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import palpate
from palpate.config import PRESETS
from palpate.errors import FileError, SettingError
from palpate.files import held_folder, read_json, whole_file
from palpate.lab.parallel import spread
from palpate.lab.study.trial import Method, Outcome, StudySettings, Trial, read_trial, track_recording, write_trial
from palpate.tracker import first_pose_of

logger = logging.getLogger(__name__)
FORMAT = {"format": "palpate-study", "version": 2}
Job = tuple[str, Path, Sequence[Method]]


@dataclass
class Study:
    """Outcome of all recordings."""

    trials: list[Trial] = field(default_factory=list)
    """In the order of recordings, then of methods."""
    recordings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Facts of each recording that could be read; see `Outcome`."""
    skipped: dict[tuple[str, Method], str] = field(default_factory=dict)
    """Methods that do not apply to a recording, with the reason."""
    failed: dict[tuple[str, Method], str] = field(default_factory=dict)
    """Trials that ended in an error, with the error."""
    broken: dict[str, str] = field(default_factory=dict)
    """Recordings that cannot be read, with the error."""
    kept: int = 0
    """Trials of an earlier run."""
    wall_s: float = 0.0
    """Duration [s]."""

    def counts(self) -> dict[str, float]:
        """Return the numbers of recordings and trials of each kind, and the duration [s]."""
        numbers = {name: len(getattr(self, name)) for name in ("recordings", "trials", "skipped", "failed", "broken")}
        return {**numbers, "kept": self.kept, "wall_s": self.wall_s}


def run_study(
    files: Mapping[str, Path],
    out: Path,
    settings: StudySettings,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Study:
    """Track recordings, by name as `find_recordings` gives them, and write each trial to the folder `out`.

    `workers` are processes of this machine, `dask` is the address of a cluster's scheduler, which has to see the files
    under the same paths. With `resume`, trials that exist are kept; without it the folder must be empty. `progress` is
    called with the number of trials that are done. Raises SettingError on values that are not allowed and on a folder
    made with other settings, FileError if the folder cannot be written.
    """
    begin = time.perf_counter()
    for method in settings.methods:
        first_pose_of(settings.first_pose, settings.first_pose_sigma, settings.of(method))
    study, trials = Study(), dict[tuple[str, Method], Trial]()
    with held_folder(out):
        index = _index(out, settings, resume)
        jobs: list[Job] = []
        for name, path in files.items():
            kept = _kept_trials(out, index, name, path, settings.methods)
            trials |= {(name, method): trial for method, trial in kept.items()}
            if missing := [method for method in settings.methods if method not in kept]:
                jobs.append((name, path.resolve(), missing))
        study.kept = done = len(trials)
        with closing(_outcomes(partial(track_recording, settings=settings), jobs, workers, dask)) as outcomes:
            for outcome in outcomes:
                name = outcome.recording
                if outcome.facts is not None:  # before the trials: without it nobody knows what they were made from
                    index["recordings"][name] = {"file": _signature(files[name]), "facts": outcome.facts}
                    _write_index(out, index)
                for trial in outcome.trials:
                    write_trial(trial, _trial_file(out, name, trial.method))
                    trials[name, trial.method] = trial
                study.skipped |= {(name, method): reason for method, reason in outcome.skipped.items()}
                study.failed |= {(name, method): error for method, error in outcome.failed.items()}
                if outcome.broken is not None:
                    study.broken[name] = outcome.broken
                done += sum(len(methods) for job, _, methods in jobs if job == name)
                if progress:
                    progress(done)
    for name in files:
        study.trials += [trials[name, method] for method in settings.methods if (name, method) in trials]
        if name in index["recordings"] and name not in study.broken:
            study.recordings[name] = index["recordings"][name]["facts"]
    study.wall_s = time.perf_counter() - begin
    return study


def described(settings: StudySettings) -> dict[str, Any]:
    """Return the settings of a study as plain data."""
    tracker, model, unit = settings.tracker, settings.model, settings.calibration
    return {
        "palpate": palpate.__version__,
        "methods": [str(method) for method in settings.methods],
        "noise_preset": next((name for name, preset in PRESETS.items() if preset == tracker.noise), None),
        "noise": asdict(tracker.noise),
        "pressure": tracker.pressure,
        "hypotheses": tracker.hypotheses,
        "model": model and {"folder": str(model.folder), "hash": model.hash},
        "calibration": unit and {"file": str(unit.file or ""), "hash": unit.hash},
        "first_pose": settings.first_pose,
        "first_pose_sigma": settings.first_pose_sigma,
        "first_pose_of_all": settings.first_pose_of_all,
    }


def read_index(folder: Path) -> dict[str, Any]:
    """Return the content of `study.json`; FileError if the folder is not a study's."""
    path = folder / "study.json"
    if not path.is_file():
        raise FileError(f"{folder}: is not the folder of a study: there is no study.json in it")
    found = read_json(path)
    if {key: found.get(key) for key in FORMAT} != FORMAT or not {"made_with", "recordings"} <= found.keys():
        raise FileError(
            f"{path}: is not of format {FORMAT['format']!r}, version {FORMAT['version']}, or lacks settings"
        )
    return found


def _index(out: Path, settings: StudySettings, resume: bool) -> dict[str, Any]:
    """Return the content of `study.json` in an empty folder, or in one made with the same settings."""
    made_with = json.loads(json.dumps(described(settings)))
    if not any(not path.name.startswith(".") for path in out.iterdir()):
        return {**FORMAT, "made_with": made_with, "recordings": {}}
    if not resume:
        raise FileError(f"{out}: is not empty; --resume continues a study, --out names another folder")
    index = read_index(out)
    if different := next(_differences(index["made_with"], made_with), None):
        raise SettingError(f"{out}: was made with other settings ({different}); name another folder")
    return index


def _differences(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Yield a sentence for each setting that differs; methods and files may."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            if key in ("methods", "noise_preset", "folder", "file"):
                continue
            yield from _differences(old.get(key), new.get(key), f"{name} {key}".strip())
    elif old != new:
        yield f"{name} was {old!r}, is {new!r}"


def _kept_trials(
    out: Path, index: dict[str, Any], name: str, path: Path, methods: Sequence[Method]
) -> dict[Method, Trial]:
    """Return the trials of a recording that exist; SettingError if it has changed since."""
    if name not in index["recordings"]:
        return {}
    if index["recordings"][name]["file"] != _signature(path):
        raise SettingError(f"{path}: has changed since it was tracked for {out}; name another folder")
    kept = {}
    for method in methods:
        try:
            kept[method] = read_trial(_trial_file(out, name, method))
        except FileError:  # not there, or damaged: it is tracked again
            continue
    return kept


def _trial_file(out: Path, name: str, method: Method) -> Path:
    return out / "trials" / str(method).replace(", ", "+") / f"{name}.npz"


def _signature(path: Path) -> list[int]:
    """Return size [bytes] and time of the last change [ns] of a file."""
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns]


def _write_index(out: Path, index: dict[str, Any]) -> None:
    with whole_file(out / "study.json", overwrite=True) as part:
        part.write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")


def _outcomes(
    do: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, dask: str | None
) -> Generator[Outcome, None, None]:
    """Yield the outcomes of jobs, in no order.

    A process that dies, as for lack of memory, takes all others along. The rest is then done one by one, each in a
    process of its own, and a recording that kills its process again has failed.
    """
    done: set[str] = set()
    try:
        with closing(spread(do, jobs, workers, dask)) as outcomes:
            for outcome in outcomes:
                done.add(outcome.recording)
                yield outcome
        return
    except Exception as error:
        if not _is_death(error):
            raise
    left = [job for job in jobs if job[0] not in done]
    logger.warning("a process died; the %d recordings that are left are tracked one by one", len(left))
    for job in left:
        try:
            with closing(spread(do, [job], 2, dask)) as outcomes:  # with one worker it would be this process
                yield next(outcomes)
        except Exception as error:
            if not _is_death(error):
                raise
            yield Outcome(job[0], failed=dict.fromkeys(job[2], "its process died, perhaps for lack of memory"))


def _is_death(error: Exception) -> bool:
    """Return true if an error means that a worker died, here or on a cluster."""
    distributed = sys.modules.get("distributed")
    return isinstance(error, BrokenExecutor) or (
        distributed is not None and isinstance(error, distributed.KilledWorker)
    )
