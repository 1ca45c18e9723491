"""Shared by the scripts that measure a number of the docs: folders, work on two cores, scores of a run."""

import json
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from palpate import Run
from palpate.pipeline.metrics import nees, since_contact, translation_errors
from palpate_lab.parallel import quiet

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "docs/study"
DATA = ROOT.parent / "shared/data"
"""Recordings and images of others, which are no part of the repository."""

LARGEST_MM = 30.0
"""RMSE of a recording above which it counts as this: the object is lost, however far."""

Item = TypeVar("Item")
Result = TypeVar("Result")


def for_each(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the results of a function in the order of the items, from two processes."""
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(partial(_quietly, function), items))


def scores(summary: dict[str, Any]) -> dict[str, float]:
    """Return final errors, coverage and the share of silently wrong frames from the summary of a run."""
    return {
        "final_mm": summary["final_translation_error_mm"],
        "final_deg": summary["final_rotation_error_deg"],
        "inside_contact": summary["in_95_contact_share"],
        "inside_final": float(summary["in_95_final"]),
        "silent": summary["silently_wrong_share"],
    }


def clipped_rmse(run: Run) -> float:
    """Return the RMSE of positions since the first contact [mm], at most LARGEST_MM."""
    online = run.online
    truth = run.recording.truth
    errors = translation_errors(online.pose, truth)
    since = since_contact(online.contact, nees(online.pose, online.covariance, truth))
    return min(float(1e3 * np.sqrt(np.mean(errors[since] ** 2))), LARGEST_MM)


def pooled_rmse(rmse: Iterable[float]) -> float:
    """Return the RMSE of recordings of one length together."""
    return float(np.sqrt(np.mean(np.square(list(rmse)))))


def paired(old: Iterable[float], new: Iterable[float]) -> dict[str, float]:
    """Return the mean of new less old, and its standard error."""
    more = np.array(list(new)) - np.array(list(old))
    return {"mean": float(more.mean()), "standard_error": float(more.std(ddof=1) / np.sqrt(len(more)))}


def write(name: str, content: dict[str, Any]) -> None:
    """Write docs/study/NAME.json."""
    (STUDY / f"{name}.json").write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _quietly(function: Callable[[Item], Result], item: Item) -> Result:
    with quiet():
        return function(item)
