"""Measure pushes by a hand of two fingers with images: docs/study/fingers.json.

    palpate simulate SET_UP --fingers 2 --count 10 --seed 20261802
    palpate simulate PINCH --fingers 2 --pinch --count 4 --seed 20261804
    palpate simulate IDEAL --fingers 2 --count 10 --ideal --seed 20261801
    palpate simulate UNKNOWN --fingers 2 --shape rectangle --shape ellipse --count 12 --seed 20261803
    python scripts/measure_fingers.py SET_UP PINCH IDEAL UNKNOWN [COUNT]

COUNT recordings of each folder are tracked, 60 by default, a like number of each object. An object is lost if it is
more than 50 mm or 30 degrees off at the end. Those of UNKNOWN are tracked from an unknown start, as in
measure_unknown_start.py. What is there is written after each folder. One process, a minute for three recordings.
"""

import sys
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from _common import write
from measure_unknown_start import SIGMA, drawn_first_pose, tracked

import palpate
from palpate.pipeline.track import track
from palpate_lab.parallel import quiet
from palpate_lab.study.recordings import find_recordings

LOST = 50.0, 30.0
"""Final errors [mm, deg] beyond which an object is lost."""


def main(folders: Sequence[Path], count: int) -> None:
    """Track the recordings of all folders, and write what came of them."""
    content: dict[str, Any] = {}
    *pushes, unknown = folders
    for name, folder in zip(("set_up", "pinch", "ideal"), pushes, strict=True):
        content[name] = summarised([scored(file) for file in chosen(folder, count)])
        print(name, content[name], flush=True)
        write("fingers", content)
    rows = [from_unknown_start(file) for file in chosen(unknown, count)]
    shares = {f"{name}_share": fmean(row[name] for row in rows) for name in ("found", "honest")}
    content["unknown_start"] = {"recordings": len(rows), **shares}
    print(content["unknown_start"], flush=True)
    write("fingers", content)


def chosen(folder: Path, count: int) -> list[Path]:
    """Return so many recordings, the first of each object in turn."""
    by_object: dict[str, list[Path]] = {}
    for file in sorted(find_recordings(folder).values()):
        by_object.setdefault(file.stem.rsplit("-", 1)[0], []).append(file)
    turns = zip_longest(*by_object.values())
    return [file for turn in turns for file in turn if file is not None][:count]


def scored(file: Path) -> dict[str, float]:
    """Return the scores of a recording."""
    with quiet():
        run = track(palpate.load_recording(file))
    summary = run.summary
    print(file.name, summary["final_translation_error_mm"], summary["final_rotation_error_deg"], flush=True)
    return {
        "final_mm": summary["final_translation_error_mm"],
        "final_deg": summary["final_rotation_error_deg"],
        "inside_contact": summary["in_95_contact_share"],
        "inside_final": float(summary["in_95_final"]),
        "ambiguous": summary["ambiguous_share"],
        "uncertain": float(np.mean(np.array(run.online.status)[run.online.contact] == "uncertain")),
    }


def summarised(rows: list[dict[str, float]]) -> dict[str, float]:
    """Return medians of errors, and means of shares."""
    of = {name: [row[name] for row in rows] for name in rows[0]}
    return {
        "recordings": len(rows),
        "final_mm_median": median(of["final_mm"]),
        "final_deg_median": median(of["final_deg"]),
        "final_mm_worst": max(of["final_mm"]),
        "lost": sum(row["final_mm"] > LOST[0] or row["final_deg"] > LOST[1] for row in rows),
        "inside_contact_mean": fmean(of["inside_contact"]),
        "inside_final_mean": fmean(of["inside_final"]),
        "ambiguous_mean": fmean(of["ambiguous"]),
        "uncertain_mean": fmean(of["uncertain"]),
    }


def from_unknown_start(file: Path) -> dict[str, bool]:
    """Return if an object is found from a first pose that is hardly known, and if the answer is honest."""
    recording = palpate.load_recording(file)
    with quiet():
        found, honest = tracked(recording, drawn_first_pose(recording, file.stem), SIGMA)
    print(file.name, found, honest, flush=True)
    return {"found": found, "honest": honest}


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:5]], int(sys.argv[5]) if len(sys.argv) > 5 else 60)
