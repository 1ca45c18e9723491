"""Two sets of runs of the same recordings, compared pair by pair."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.errors import FileError
from palpate.files import read_arrays, read_json

SCORES = {
    "final_translation_error_mm": -1,
    "final_rotation_error_deg": -1,
    "translation_rmse_mm": -1,
    "rotation_rmse_deg": -1,
    "nats": 1,
    "in_95_contact_share": 0,
    "silently_wrong_share": -1,
    "ambiguous_share": -1,
    "final_sigma_mm": 0,
}
"""Scores by their keys in a summary: 1 if more is better, -1 if less is, 0 if neither is by itself."""

Summaries = Mapping[str, Mapping[str, Any]]
"""Summaries of runs by the names of their recordings."""


def read_summaries(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the summaries of the runs of palpate track below a folder, or of the trials of a study in it, by name.

    The name of a trial is that of its recording, and its method where the study has several. Raises FileError.
    """
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder of runs")
    trials = folder / "trials"
    if trials.is_dir():
        has_several = sum(path.is_dir() for path in trials.iterdir()) > 1
        found = {}
        for path in sorted(trials.rglob("*.npz")):
            about = json.loads(str(read_arrays(path)["about"]))
            name = about["recording"] + (f", {about['method']}" if has_several else "")
            found[name] = about["summary"]
    else:
        files = sorted(folder.rglob("summary.json"))
        found = {str(path.parent.relative_to(folder)): read_json(path) for path in files}
    if not found:
        raise FileError(f"{folder}: holds no runs of palpate track and no study of palpate evaluate")
    return found


def compared(first: Summaries, second: Summaries) -> dict[str, dict[str, Any]]:
    """Return for each score its means in both, and the mean of second less first with its 95 % interval.

    The interval is that of Student's t over the recordings that both have with that score, None for fewer than two.
    better and worse count these recordings; they are None for a score that is neither better nor worse.
    """
    rows: dict[str, dict[str, Any]] = {}
    for score, sign in SCORES.items():
        pairs = [(_score(first[name], score), _score(second[name], score)) for name in first if name in second]
        known = np.array([pair for pair in pairs if None not in pair], np.float64)
        if not len(known):
            continue
        difference = known[:, 1] - known[:, 0]
        low, high = _interval(difference)
        rows[score] = {
            "pairs": len(known),
            "a": float(known[:, 0].mean()),
            "b": float(known[:, 1].mean()),
            "difference": float(difference.mean()),
            "low": low,
            "high": high,
            "better": int((sign * difference > 0.0).sum()) if sign else None,
            "worse": int((sign * difference < 0.0).sum()) if sign else None,
        }
    return rows


def _score(summary: Mapping[str, Any], score: str) -> float | None:
    if score == "final_sigma_mm":
        return 1e3 * math.hypot(*summary["final_sigma"][:2])
    return summary.get(score)


def _interval(difference: Array) -> tuple[float | None, float | None]:
    """Return the 95 % interval of the mean of differences (N,); None, None for fewer than two."""
    from scipy.stats import t

    count = len(difference)
    if count < 2:
        return None, None
    mean = float(difference.mean())
    half = float(t.ppf(0.975, count - 1)) * float(difference.std(ddof=1)) / math.sqrt(count)
    return mean - half, mean + half
