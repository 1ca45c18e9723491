"""Results of a study as plain data: `results.json`, and a row for each trial in `sequences.csv`.

`results.json` holds

    command     the command line
    settings    see `study.described`
    study       palpate, folder, recordings, trials, kept, skipped, failed, wall_s, workers, cores
    table       {group: {method: row}}, the groups by name and then "all groups"; see `table`
    recordings  {recording: {group, shape, source}}
    skipped     [{recording, method, reason}]: methods that do not apply to a recording
    failed      [{recording, method, error}]: trials that ended in an error
"""

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import palpate
from palpate.files import whole_file, write_json
from palpate.pipeline.metrics import CONTENT, gain_by_rescaling, inside_95, since_contact
from palpate_lab.study.study import Study, StudySettings, Trial, described

ALL = "all groups"
FORMULA = re.compile(r"[-=+@\t\r']")
FINALS = {"final_mm": "final_translation_error_mm", "final_deg": "final_rotation_error_deg"}
"""Columns of the table by their names in a trial's summary."""


def results_of(study: Study, settings: StudySettings, folder: Path, workers: int, command: str) -> dict[str, Any]:
    """Return the content of `results.json`."""
    about = ("group", "shape", "source")
    recordings = {trial.recording: {name: getattr(trial, name) for name in about} for trial in study.trials}
    return {
        "command": command,
        "settings": described(settings),
        "study": {
            "palpate": palpate.__version__,
            "folder": str(folder),
            "recordings": len(recordings),
            **{name: len(getattr(study, name)) for name in ("trials", "skipped", "failed")},
            "kept": study.kept,
            "wall_s": study.wall_s,
            "workers": workers,
            "cores": os.cpu_count(),
        },
        "table": table(study.trials, settings.methods),
        "recordings": recordings,
        "skipped": [{"recording": name, "method": m, "reason": why} for (name, m), why in study.skipped.items()],
        "failed": [{"recording": name, "method": m, "error": why} for (name, m), why in study.failed.items()],
    }


def table(trials: Sequence[Trial], methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return a row for each group and method, and for all groups together.

    A row holds, of its `sequences` with ground truth:
    final_mm, final_deg: {median, worst} of the error at the last frame with truth;
    nees: {median, mean} and inside_95: share in the 95 % region, both of all frames since the first contact;
    contact_inside_95, rest_inside_95, final_inside_95: share of frames in contact, at rest, and of the last ones;
    nats, nats_rescaled: mean log likelihood of frames in contact, and with the best factor on covariances;
    crps_mm, sigma_mm: means over sequences;
    silently_wrong: mean of the share of such frames, see `metrics.summarise`;
    knocks, lost: their number;
    and of all sequences final_sigma_mm, final_sigma_deg: medians of the stated standard deviation at the end;
    good: mean share of frames that are tracking or resting; ambiguous: share of the frames in contact with that status,
    and step_ms: {p50, p95, p99}, medians over sequences. Unknown values are None.
    """
    rows: dict[str, dict[str, Any]] = {}
    for group in [*sorted({trial.group for trial in trials}), ALL] if trials else []:
        of_group = [trial for trial in trials if group in (trial.group, ALL)]
        by_method = {method: [trial for trial in of_group if trial.method == method] for method in methods}
        rows[group] = {method: _row(of_method) for method, of_method in by_method.items() if of_method}
    return rows


def is_lost(trial: Trial) -> bool:
    """Return true if the final error is above 50 mm or 30 degrees; the yaw of a disc does not count."""
    mm = trial.summary[FINALS["final_mm"]]
    deg = trial.summary[FINALS["final_deg"]]
    return mm is not None and (mm > 50.0 or (deg > 30.0 and trial.summary.get("yaw_shows", True)))


def write_results(folder: Path, results: Mapping[str, Any], trials: Sequence[Trial]) -> None:
    """Write `results.json` and `sequences.csv`, the summaries of trials without lists, each whole or not at all.

    In the table, a name that a spreadsheet would run as a formula gets an apostrophe.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "results.json", results)
    rows = []
    for trial in trials:
        row = {"recording": trial.recording, "group": trial.group, "tactile": trial.method, "lost": is_lost(trial)}
        row |= {key: value for key, value in trial.summary.items() if not isinstance(value, dict | list)}
        axes = ("final_sigma_x", "final_sigma_y", "final_sigma_theta")
        row |= dict(zip(axes, trial.summary["final_sigma"], strict=True))
        row["good_share"] = _good_share(trial.summary)
        row |= {f"step_ms_{share}": value for share, value in trial.summary["step_ms"].items()}
        names = {key: f"'{value}" for key, value in row.items() if isinstance(value, str) and FORMULA.match(value)}
        rows.append(row | names)
    with (
        whole_file(folder / "sequences.csv", overwrite=True) as part,
        part.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file,
    ):
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)


def _row(trials: Sequence[Trial]) -> dict[str, Any]:
    scored = [trial for trial in trials if trial.summary["scored_frames"]]
    counted = [since_contact(trial.contact, trial.nees) for trial in trials]
    nees_of_trials = [trial.nees[frames] for trial, frames in zip(trials, counted, strict=True)]
    contact_of_trials = [trial.contact[frames] for trial, frames in zip(trials, counted, strict=True)]
    nees = np.concatenate(nees_of_trials)
    contact = np.concatenate(contact_of_trials)
    inside = inside_95(nees)
    final = [inside_95(of_trial)[-1] for of_trial in nees_of_trials if len(of_trial)]

    def known(key: str) -> list[float]:
        values = [trial.summary.get(key) for trial in scored]
        return [value for value in values if value is not None]

    def mean_of_frames(key: str, frames: Sequence[Any]) -> float | None:
        """Return the mean of a score of trials that each holds for a number of frames."""
        values = [trial.summary.get(key) for trial in trials]
        weighted = [(value, n) for value, n in zip(values, frames, strict=True) if n and value is not None]
        return sum(value * n for value, n in weighted) / sum(n for _, n in weighted) if weighted else None

    nats = mean_of_frames("nats", [np.count_nonzero(touched) for touched in contact_of_trials])
    return {
        "sequences": len(scored),
        **{name: {"median": _of(median, known(key)), "worst": _of(max, known(key))} for name, key in FINALS.items()},
        "nees": {"median": _of(np.median, nees), "mean": _of(np.mean, nees)},
        "inside_95": _of(np.mean, inside),
        "contact_inside_95": _of(np.mean, inside[contact]),
        "rest_inside_95": _of(np.mean, inside[~contact]),
        "final_inside_95": _of(np.mean, final),
        "nats": nats,
        "nats_rescaled": None if nats is None else nats + gain_by_rescaling(nees[contact]),
        "crps_mm": _of(fmean, known("crps_mm")),
        "sigma_mm": _of(fmean, known("sigma_mm")),
        "silently_wrong": _of(fmean, known("silently_wrong_share")),
        "final_sigma_mm": _of(median, [1e3 * math.hypot(*trial.summary["final_sigma"][:2]) for trial in trials]),
        "final_sigma_deg": _of(median, [math.degrees(trial.summary["final_sigma"][2]) for trial in trials]),
        "good": _of(fmean, [_good_share(trial.summary) for trial in trials]),
        "knocks": sum(known("knocks")),
        "lost": sum(map(is_lost, scored)),
        "ambiguous": mean_of_frames("ambiguous_share", [trial.summary.get("contact_frames", 0) for trial in trials]),
        "step_ms": {
            share: median(trial.summary["step_ms"][share] for trial in trials) for share in ("p50", "p95", "p99")
        },
    }


def _good_share(summary: Mapping[str, Any]) -> float:
    """Return the share of frames whose status reports no doubt."""
    return sum(summary["statuses"].get(word, 0) for word in CONTENT) / summary["frames"]


def _of(middle: Any, values: Sequence[Any] | ArrayLike) -> float | None:
    """Return a mean, median or maximum of values; None if there are none."""
    return float(middle(values)) if np.size(values) else None
