"""How real pushes are tracked with the true relative yaw for touch: docs/study/real.json.

    python scripts/measure_real_pushes.py [../shared/data]

Each recording of MIT's round tip and of CMU's two fingers, none left out, as by

    palpate track FILE --tactile oracle

A minute on two cores.
"""

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

from palpate.config.tracker_settings import TrackerSettings
from palpate.io import load_recording
from palpate.lab.study.files import find_recordings
from palpate.parallel import spread
from palpate.pipeline.quiet import quiet
from palpate.pipeline.run import track

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs/study/real.json"
FOLDERS = ("mit_point_push", "cmu_two_finger")


def main(data: Path) -> None:
    """Track all recordings, and write."""
    files = {f"{folder}/{name}": path for folder in FOLDERS for name, path in find_recordings(data / folder).items()}
    with closing(spread(tracked, files.values(), workers=2)) as results:
        summaries = dict(results)
    runs = [{"file": name, **summaries[path]} for name, path in files.items()]
    OUT.write_text(json.dumps({"runs": runs}, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def tracked(path: Path) -> tuple[Path, dict[str, Any]]:
    """Track a recording, and return its summary."""
    with quiet():
        return path, track(load_recording(path), TrackerSettings("oracle")).summary


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared/data")
