"""Compare two versions of palpate on the same recordings: docs/study/tails.json.

    palpate evaluate FOLDER --out OLD/NAME --tactile learnt      # by the old version, for each study
    palpate evaluate FOLDER --out NEW/NAME --tactile learnt      # by the new one
    python scripts/compare_studies.py OLD NEW NAME...

Differences are paired: new less old of each recording, with their standard errors. A few recordings whose object is
lost decide a mean square, so that the RMSE of each counts as 30 mm at most.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from _common import LARGEST_MM, paired, pooled_rmse, write

from palpate.files import read_arrays
from palpate.pipeline.metrics import since_contact, translation_errors

Row = dict[str, float]


def main(old: Path, new: Path, names: list[str]) -> None:
    """Write the scores of all studies by both versions, and the paired differences."""
    write("tails", {name: compared(rows_of(old / name), rows_of(new / name)) for name in names})


def rows_of(study: Path) -> dict[str, Row]:
    """Return the scores of each recording of a study."""
    files = sorted((study / "trials/learnt").rglob("*.npz"))
    return {file.name: scores_of(read_arrays(file)) for file in files}


def scores_of(trial: dict[str, Any]) -> Row:
    """Return the scores of one trial."""
    summary = json.loads(str(trial["about"]))["summary"]
    errors = 1e3 * translation_errors(trial["pose"], trial["truth"])
    since = since_contact(trial["contact"], trial["nees"])
    final_mm = summary["final_translation_error_mm"]
    final_deg = summary["final_rotation_error_deg"]
    return {
        "rmse_mm": min(float(np.sqrt(np.mean(errors[since] ** 2))), LARGEST_MM),
        "final_mm": final_mm,
        "final_deg": final_deg,
        "lost": float(final_mm > 50.0 or (final_deg > 30.0 and summary["yaw_shows"])),
        "ambiguous": summary["ambiguous_share"],
        "contact_frames": summary["contact_frames"],
        "inside_contact": summary["in_95_contact_share"],
        "inside_final": float(summary["in_95_final"]),
        "silent": summary["silently_wrong_share"],
        "nats": summary["nats"],
    }


def compared(old: dict[str, Row], new: dict[str, Row]) -> dict[str, Any]:
    """Return the scores of both versions and the differences of the recordings that both have."""
    names = sorted(old.keys() & new.keys())
    differences = {}
    for score in ("rmse_mm", "ambiguous", "inside_contact", "silent", "nats"):
        differences[score] = paired((old[name][score] for name in names), (new[name][score] for name in names))
    of = {"old": pooled([old[name] for name in names]), "new": pooled([new[name] for name in names])}
    return {"recordings": len(names), **of, "new less old": differences}


def pooled(rows: list[Row]) -> dict[str, float]:
    """Return the scores of all recordings together."""
    of = {score: np.array([row[score] for row in rows]) for score in rows[0]}
    frames = of["contact_frames"]
    return {
        "rmse_mm": pooled_rmse(of["rmse_mm"]),
        "final_median_mm": float(np.median(of["final_mm"])),
        "final_median_deg": float(np.median(of["final_deg"])),
        "worst_mm": float(of["final_mm"].max()),
        "lost": int(of["lost"].sum()),
        "ambiguous": float((of["ambiguous"] * frames).sum() / frames.sum()),
        "inside_contact": float(of["inside_contact"].mean()),
        "inside_final": float(of["inside_final"].mean()),
        "silent": float(of["silent"].mean()),
        "nats_median": float(np.median(of["nats"])),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
