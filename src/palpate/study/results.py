"""What a study found, as plain data: `results.json`, and a row a trial in `sequences.csv`.

`results.json` holds

    command     the command line
    settings    methods, noise, pressure, model, first_pose
    study       palpate, folder, recordings, trials, kept, skipped, failed, broken, wall_s, workers, cores, lost_above
    table       {group: {method: row}}, the groups by name and then "all groups"; see `table`
    recordings  {recording: {group, shape, source, frames, seconds, images, truth}}
    lost        [{recording, method, final_mm, final_deg}]
    skipped     [{recording, method, reason}]: what a recording cannot be tracked with
    failed      [{recording, method, error}]: what could not be tracked to its end
    broken      [{recording, error}]: what could not be read
    against     see `comparison`, where there is something to compare with
"""

import csv
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import palpate
from palpate.errors import FileError
from palpate.estimation.settings import PRESETS
from palpate.files import whole_file
from palpate.study.job import StudySettings, inside_95, since_contact
from palpate.study.study import Study
from palpate.study.trial import Method, Trial
from palpate.touch.model import TouchModel

Array = NDArray[np.float64]
ALL = "all groups"
LOST_MM, LOST_DEG = 50.0, 30.0
"""A sequence is lost if its final error is above either."""

FINALS = {"final_mm": "final_translation_error_mm", "final_deg": "final_rotation_error_deg"}
RMSES = {"rmse_mm": "translation_rmse_mm", "rmse_deg": "rotation_rmse_deg"}
"""What columns of the table are called in a trial's summary."""


def results_of(
    study: Study, settings: StudySettings, model: TouchModel, folder: Path, workers: int, command: str
) -> dict[str, Any]:
    """Return the content of `results.json`, but `against`."""
    counted = {name: len(getattr(study, name)) for name in ("recordings", "trials", "skipped", "failed", "broken")}
    return {
        "command": command,
        "settings": {
            "methods": [str(method) for method in settings.methods],
            "noise_preset": next((name for name, preset in PRESETS.items() if preset == settings.noise), None),
            "noise": asdict(settings.noise),
            "pressure": settings.pressure,
            "model": {"folder": str(model.folder), "hash": model.hash},
            "first_pose": settings.first_pose,
        },
        "study": {
            "palpate": palpate.__version__,
            "folder": str(folder),
            **counted,
            "kept": study.kept,
            "wall_s": study.wall_s,
            "workers": workers,
            "cores": os.cpu_count(),
            "lost_above": {"mm": LOST_MM, "deg": LOST_DEG},
        },
        "table": table(study.trials, settings.methods),
        "recordings": study.recordings,
        "lost": [
            {"recording": trial.recording, "method": str(trial.method), **_finals(trial)}
            for trial in study.trials
            if is_lost(trial)
        ],
        "skipped": _named(study.skipped, "reason"),
        "failed": _named(study.failed, "error"),
        "broken": [{"recording": name, "error": error} for name, error in study.broken.items()],
    }


def table(trials: Sequence[Trial], methods: Sequence[Method]) -> dict[str, dict[str, Any]]:
    """Return a row of figures for each group and method, and for all groups together.

    A row holds, of its `sequences` with ground truth:
    final_mm, final_deg: {median, p75, worst} of the error at the last frame with truth;
    rmse_mm, rmse_deg: median of the RMSE over a sequence;
    nees: {median, mean} and inside_95: share in the 95 % region, both of all frames from the first contact on, before
    which the pose is as good as given;
    final_inside_95: share of the final poses in it;
    lost: how many; and, of all sequences, step_ms: {p50, p95}, medians over sequences.
    What cannot be told is None.
    """
    scored = [(trial, since_contact(trial)) for trial in trials]
    names = [*sorted({trial.group for trial in trials}), ALL] if trials else []
    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    for name in names:
        for method in methods:
            chosen = [pair for pair in scored if pair[0].method == method and name in (pair[0].group, ALL)]
            if chosen:
                found[name][str(method)] = _row(*zip(*chosen, strict=True))
    return found


def is_lost(trial: Trial) -> bool:
    """Say whether the final error is beyond what can be called tracked."""
    mm, deg = _finals(trial).values()
    return mm is not None and deg is not None and (mm > LOST_MM or deg > LOST_DEG)


def write_results(folder: Path, results: Mapping[str, Any], trials: Sequence[Trial]) -> None:
    """Write `results.json` and `sequences.csv`, each whole or not at all."""
    try:
        with whole_file(folder / "results.json", overwrite=True) as part:
            part.write_text(json.dumps(results, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        rows = [_flat(trial) for trial in trials]
        with (
            whole_file(folder / "sequences.csv", overwrite=True) as part,
            part.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error.strerror})") from error


def _row(trials: Sequence[Trial], since: Sequence[Array]) -> dict[str, Any]:
    """The row of trials, and the NEES of each since its first contact."""
    scored = [trial for trial in trials if trial.summary["scored_frames"]]
    steps = {share: [trial.summary["step_ms"][share] for trial in trials] for share in ("p50", "p95")}
    nees = np.concatenate(since)
    ends = [known for trial in scored if (known := trial.summary["final_inside_95"]) is not None]
    return {
        "sequences": len(scored),
        "unscored": len(trials) - len(scored),
        **{name: _spread([trial.summary[key] for trial in scored]) for name, key in FINALS.items()},
        **{name: _spread([trial.summary[key] for trial in scored])["median"] for name, key in RMSES.items()},
        "nees": {
            "median": float(np.median(nees)) if len(nees) else None,
            "mean": float(np.mean(nees)) if len(nees) else None,
        },
        "inside_95": float(np.mean(inside_95(nees))) if len(nees) else None,
        "final_inside_95": float(np.mean(ends)) if ends else None,
        "lost": sum(is_lost(trial) for trial in scored),
        "step_ms": {share: float(np.median(values)) for share, values in steps.items()},
    }


def _spread(values: Sequence[float]) -> dict[str, float | None]:
    shares = {"median": 50, "p75": 75, "worst": 100}
    if not values:
        return dict.fromkeys(shares)
    return {name: float(np.percentile(values, share)) for name, share in shares.items()}


def _finals(trial: Trial) -> dict[str, float | None]:
    return {name: trial.summary[key] for name, key in FINALS.items()}


def _named(found: Mapping[tuple[str, Method], str], what: str) -> list[dict[str, str]]:
    return [{"recording": name, "method": str(method), what: said} for (name, method), said in found.items()]


def _flat(trial: Trial) -> dict[str, Any]:
    """The trial as a row: its summary without what is not one value."""
    row = {"recording": trial.recording, "group": trial.group, **asdict(trial.method), "lost": is_lost(trial)}
    row |= {key: value for key, value in trial.summary.items() if not isinstance(value, dict)}
    return row | {f"step_ms_{share}": value for share, value in trial.summary["step_ms"].items()}
