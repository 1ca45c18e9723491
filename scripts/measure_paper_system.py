"""The paper's own system beside palpate's on the same recordings: docs/study/paper_system.json.

    palpate simulate FOLDER/ideal --count 4 --seed SEED --ideal
    palpate simulate FOLDER/real --count 4 --seed SEED
    python scripts/measure_paper_system.py FOLDER

`ideal` are recordings of an exact set-up, `real` those in which its errors are drawn. The paper's is its linear model
of two key points, iSAM2, its standard deviations and one answer, as with

    palpate track FILE --tactile learnt-linear --smoother isam2 --noise published --hypotheses 1

It keeps what palpate has otherwise: a round tip, contact by images, key points learnt from simulated units. With `its
model's own noise`, the variance of a turn is the one measured with the model and not the published one. Twenty minutes
on one core.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median
from typing import Any

from palpate.cli.console import progress_bar
from palpate.config.settings import PUBLISHED
from palpate.config.tracker_settings import TrackerSettings
from palpate.io import load_recording
from palpate.lab.study.results import LOST_DEG, LOST_MM
from palpate.pipeline.run import track

OUT = Path(__file__).parents[1] / "docs/study/paper_system.json"
SET_UPS = ("ideal", "real")
MILDER = replace(PUBLISHED, relative_pose=replace(PUBLISHED.relative_pose, linear=None))
WAYS = {
    "the paper's": TrackerSettings("learnt-linear", "isam2", PUBLISHED, hypotheses=1),
    "the paper's, its model's own noise": TrackerSettings("learnt-linear", "isam2", MILDER, hypotheses=1),
    "palpate's": TrackerSettings("learnt"),
}
MM, DEG = "final_translation_error_mm", "final_rotation_error_deg"


def main(folder: Path) -> None:
    """Track all recordings of both kinds in all ways."""
    files = {set_up: sorted((folder / set_up).glob("*.h5")) for set_up in SET_UPS}
    if lacking := [set_up for set_up in SET_UPS if not files[set_up]]:
        raise SystemExit(f"{folder / lacking[0]}: has no recordings; there must be some in each of {SET_UPS}")
    found = {set_up: {name: scores(name, files[set_up]) for name in WAYS} for set_up in SET_UPS}
    OUT.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def scores(name: str, files: Sequence[Path]) -> dict[str, Any]:
    """Return how recordings are tracked in one of WAYS."""
    runs = []
    with progress_bar(f"{name}, {files[0].parent.name}", len(files)) as progress:
        for done, file in enumerate(files, 1):
            runs.append(track(load_recording(file), WAYS[name]).summary)
            progress(done)
    return {
        "sequences": len(runs),
        "final_mm": {"median": median(run[MM] for run in runs), "worst": max(run[MM] for run in runs)},
        "final_deg": {"median": median(run[DEG] for run in runs), "worst": max(run[DEG] for run in runs)},
        "in_95_contact": fmean(run["in_95_contact_share"] for run in runs),
        "in_95_final": fmean(run["in_95_final"] for run in runs),
        "lost": sum(run[MM] > LOST_MM or run[DEG] > LOST_DEG for run in runs),
        "indeterminate_frames": sum(run["statuses"].get("indeterminate", 0) for run in runs),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]))
