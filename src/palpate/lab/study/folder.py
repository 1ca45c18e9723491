"""The folder of a study while it grows: every trial that is done, and what they were made with, so that it can go on.

study.json                      settings, and the recordings that were read
study-shard-I-of-N.json         the same of a shard, until a run without shards puts all together
trials/METHOD/RECORDING.npz     see `study.trial`
"""

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import palpate
from palpate.errors import FileError, SettingError
from palpate.files import read_json, whole_file
from palpate.lab.study.job import Job, Outcome, StudySettings
from palpate.lab.study.trial import Method, Trial, read_trial, write_trial
from palpate.shards import Shard
from palpate.signature import signature
from palpate.touch.model import TouchModel

FORMAT, VERSION = "palpate-study", 1
_EARLIER = {"hypotheses": 9, "first_pose_of_all": False}
"""What studies were made with that do not say so."""


class StudyFolder:
    """The folder of a study; all files in it are whole at any time."""

    def __init__(
        self,
        path: Path,
        settings: StudySettings,
        model: TouchModel | None,
        resume: bool = False,
        shard: Shard | None = None,
    ) -> None:
        """Take an empty folder or, with `resume`, one with trials that were made with the same settings.

        A shard takes a folder with trials of others without that. Raises FileError where it holds something else,
        SettingError where they were made with others.
        """
        self.path, self._shard = path, shard
        self._index = path / ("study.json" if shard is None else f"study-{shard}.json")
        made_with = {
            "palpate": palpate.__version__,
            "noise": asdict(settings.noise),
            "pressure": settings.pressure,
            "hypotheses": settings.hypotheses,
            "first_pose": settings.first_pose,
            "first_pose_sigma": settings.first_pose_sigma,
            "first_pose_of_all": settings.first_pose_of_all,
            "model": None if model is None else model.hash,
            "calibration": None if settings.calibration is None else settings.calibration.hash,
        }
        self._made_with: dict[str, Any] = json.loads(json.dumps(made_with))  # as it reads from a file
        self._recordings: dict[str, dict[str, Any]] = {}
        if any(not each.name.startswith(".") for each in path.iterdir()):
            self._go_on(resume)

    def kept(self, job: Job) -> dict[Method, Trial]:
        """Return the trials of a job that are there already; SettingError if its recording has changed since."""
        if job.name not in self._recordings:
            return {}
        if self._recordings[job.name]["file"] != signature(job.path):
            raise SettingError(f"{job.path}: has changed since it was tracked for {self.path}; take another folder")
        found: dict[Method, Trial] = {}
        for method in job.methods:
            path = self._trial(job.name, method)
            if path.exists():
                try:
                    found[method] = read_trial(path)
                except FileError:  # cut off by a broken copy or a failed disk
                    continue
        return found

    def add(self, outcome: Outcome) -> None:
        """Write what became of a job. Raises FileError."""
        if outcome.facts is not None:  # these first, for without them nobody knows what trials were made from
            self._recordings[outcome.job.name] = {"file": signature(outcome.job.path), "facts": outcome.facts}
            self._write()
        for trial in outcome.trials:
            write_trial(trial, self._trial(trial.recording, trial.method))

    def facts(self, name: str) -> dict[str, Any] | None:
        """Return what is known of a recording; see `job.Outcome`."""
        found = self._recordings.get(name)
        return None if found is None else found["facts"]

    def _trial(self, name: str, method: Method) -> Path:
        return self.path / "trials" / str(method).replace(", ", "+") / f"{name}.npz"

    def _go_on(self, resume: bool) -> None:
        if not resume and (self._shard is None or self._index.exists()):
            raise FileError(f"{self.path}: is not empty; --resume goes on with a study, --out names another folder")
        earlier = read_study(self.path)
        for index in earlier.values():
            if different := next(_differences(_EARLIER | index["made_with"], self._made_with), None):
                raise SettingError(f"{self.path}: was made with other settings ({different}); take another folder")
            self._recordings |= index["recordings"]
        if self._shard is not None:  # the rest is that of others, who may be alive
            return
        if shards := earlier.keys() - {self._index}:
            self._write()
            for path in shards:
                path.unlink()

    def _write(self) -> None:
        content = {"format": FORMAT, "version": VERSION, "made_with": self._made_with, "recordings": self._recordings}
        try:
            with whole_file(self._index, overwrite=True) as part:
                part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise FileError(f"{self.path}: cannot be written ({error.strerror})") from error


def read_study(folder: Path) -> dict[Path, dict[str, Any]]:
    """Return the content of `study.json` and of those of shards; FileError where the folder is no study's."""
    found = {path: _read_index(path) for path in sorted(folder.glob("study*.json"))}
    if not found:
        raise FileError(f"{folder}: is not the folder of a study: there is no study.json in it")
    return found


def _read_index(path: Path) -> dict[str, Any]:
    found = read_json(path)
    if found.get("format") != FORMAT or found.get("version") != VERSION:
        said = f"{found.get('format')!r} of version {found.get('version')!r}"
        raise FileError(f"{path}: format is {said}, expected {FORMAT!r} of version {VERSION}")
    if not all(isinstance(found.get(name), dict) for name in ("made_with", "recordings")):
        raise FileError(f"{path}: lacks made_with or recordings; it is damaged")
    return found


def _differences(old: dict[str, Any], new: dict[str, Any], within: str = "") -> Iterator[str]:
    for key in {**new, **old}:
        before, after = old.get(key), new.get(key)
        if isinstance(before, dict) and isinstance(after, dict):
            yield from _differences(before, after, f"{within}{key} ")
        elif before != after:
            yield f"{within}{key} was {before!r}, is {after!r}"
