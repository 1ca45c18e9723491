"""What the shipped model says of presses on a real gel: docs/study/real_gel.json.

    python scripts/measure_real_gel.py [../shared/data/digit_balls]

The folder holds the presses, `untouched.png` and `truth.csv`. Each row is what `benchmarks/real_gel.py` tells of them,
as they are or in the guise of another camera, before or after `palpate calibrate` on five of them. `flanks` is a second
opinion on where the presses are: midway between the flanks that the red and the green light make brightest, which is
told by the images alone. Its slopes are of that angle over the annotated one, and of the told one over it. Ten seconds.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from palpate.touch.background import Image
from palpate.touch.difference import difference, reduced
from palpate.touch.model import shipped_model
from palpate.touch.press_files import read_image
from palpate.types.sensor import DIGIT

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
BLUR, ROWS_SEEN = 2.5, 25
"""Pixels that the light is smoothed by, and rows in which red and green differ most, which are looked at."""


def main(presses: Path) -> None:
    """Measure every row, and write."""
    found = {name: measured(presses, *options) for name, options in ROWS.items()} | {"flanks": flanks(presses)}
    OUT.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def measured(presses: Path, *options: str) -> dict[str, Any]:
    """Return one row."""
    files = ["--images", presses, "--untouched", presses / "untouched.png", "--truth", presses / "truth.csv"]
    words = [sys.executable, ROOT / "benchmarks/real_gel.py", *files, *options, "--json"]
    return json.loads(subprocess.run(words, stdout=subprocess.PIPE, check=True).stdout)


def flanks(presses: Path) -> dict[str, float]:
    """Return slopes of angles by the flanks of imprints, over annotated ones and under told ones."""
    untouched, model = read_image(presses / "untouched.png"), shipped_model()
    mean = reduced(untouched.astype(np.float32))
    with (presses / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    images = [read_image(presses / row["file"]) for row in rows]
    annotated = np.radians([float(row["angle_deg"]) for row in rows])
    seen = np.array([between_flanks(image, untouched) for image in images])
    told = np.array([model.look(difference(image, mean)).direction[0] for image in images])
    return {
        "over_annotated_slope": float(np.polyfit(annotated, seen, 1)[0]),
        "told_over_them_slope": float(np.polyfit(seen, told, 1)[0]),
    }


def between_flanks(image: Image, untouched: Image) -> float:
    """Return the angle on the tip midway between the reddest and the greenest column of an imprint [rad]."""
    assert DIGIT.half_width is not None
    change = cv2.GaussianBlur(image.astype(np.float32) - untouched, (0, 0), BLUR)
    red_over_green = change[..., 0] - change[..., 1]
    rows = np.argsort(np.ptp(red_over_green, axis=1))[-ROWS_SEEN:]
    profile = np.median(red_over_green[rows], axis=0)
    middle = 0.5 * float(profile.argmin() + profile.argmax()) - 0.5 * (len(profile) - 1)
    return float(np.arcsin(middle * 2.0 * DIGIT.half_width / len(profile) / DIGIT.radius))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared/data/digit_balls")
