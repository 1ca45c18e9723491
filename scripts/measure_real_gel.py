"""What the shipped model says of presses on a real gel: docs/study/real_gel.json.

    python scripts/measure_real_gel.py [../shared/data/digit_balls]

The folder holds the presses, `untouched.png` and `truth.csv`. Each row is what `benchmarks/real_gel.py` tells of them,
as they are or in the guise of another camera, before or after `palpate calibrate` on five of them. Ten seconds.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs/study/real_gel.json"
CALIBRATED = ("--calibrate-on", "5")
ROWS = {
    "as it is": (),
    "as it is, calibrated on 5": CALIBRATED,
    "mirrored, calibrated on 5": ("--guise", "mirrored", *CALIBRATED),
    "turned by 180 degrees, calibrated on 5": ("--guise", "upturned", *CALIBRATED),
    "red and blue exchanged": ("--guise", "swapped"),
    "red and blue exchanged, calibrated on 5": ("--guise", "swapped", *CALIBRATED),
}
"""What `benchmarks/real_gel.py` is told for each row."""


def main(presses: Path) -> None:
    """Measure every row, and write."""
    found = {name: measured(presses, *options) for name, options in ROWS.items()}
    OUT.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def measured(presses: Path, *options: str) -> dict[str, Any]:
    """Return one row."""
    files = ["--images", presses, "--untouched", presses / "untouched.png", "--truth", presses / "truth.csv"]
    words = [sys.executable, ROOT / "benchmarks/real_gel.py", *files, *options, "--json"]
    return json.loads(subprocess.run(words, stdout=subprocess.PIPE, check=True).stdout)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared/data/digit_balls")
