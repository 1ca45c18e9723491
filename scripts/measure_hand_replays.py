"""Track the real pushes of CMU's two fingers with rendered images of both: docs/study/hand_replays.json.

    palpate simulate FOLDER --fingers 2 --seed 20261529 --replay ../shared/data/cmu_two_finger/*.txt
    python scripts/measure_hand_replays.py FOLDER

(`--replay` is given once for each file.) Each is tracked with its images, and by the places of its fingers alone. A
minute on two cores.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

from _common import for_each, scores, write

import palpate
from palpate.pipeline.track import track
from palpate_lab.study.recordings import find_recordings

LOST = 50.0, 30.0
"""Final errors [mm, deg] beyond which an object is lost."""


def main(folder: Path) -> None:
    """Track all recordings both ways, and write medians and means of their scores."""
    rows = for_each(tracked, find_recordings(folder).values())
    content: dict[str, Any] = {way: summarised([row[way] for row in rows]) for way in ("learnt", "none")}
    write("hand_replays", content)


def tracked(file: Path) -> dict[str, dict[str, float]]:
    """Return the scores of a recording by the kind of touch."""
    recording = palpate.load_recording(file)
    found = {}
    for way in ("learnt", "none"):
        summary = track(recording, palpate.TrackerSettings(way)).summary
        found[way] = scores(summary) | {"ambiguous": summary["ambiguous_share"]}
    return found


def summarised(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return medians and the worst of final errors, and means of shares."""
    of = {name: [row[name] for row in rows] for name in rows[0]}
    return {
        "recordings": len(rows),
        "final_mm_median": median(of["final_mm"]),
        "final_deg_median": median(of["final_deg"]),
        "final_mm_worst": max(of["final_mm"]),
        "final_deg_worst": max(of["final_deg"]),
        "lost": sum(row["final_mm"] > LOST[0] or row["final_deg"] > LOST[1] for row in rows),
        **{f"{name}_mean": fmean(of[name]) for name in ("inside_contact", "inside_final", "silent", "ambiguous")},
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]))
