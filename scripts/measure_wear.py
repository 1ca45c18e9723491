"""How much an untouched gel changes beyond its light, worn or not: docs/study/wear.json.

    python scripts/measure_wear.py FOLDER REAL

FOLDER has simulated recordings; their gel is worn as on the fault bench, by so many grey levels at the end. REAL is
`digit_gripped`: images of one real unit that nothing touches, minutes apart, among which it gripped things. Told is the
share of cells that are off by more than four grey levels in the light of the other image, of which the detector takes
one percent for a touch. A minute on one core.
"""

import json
import sys
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path

import numpy as np

from palpate.io import load_recording
from palpate.lab.study.faults.images import wear
from palpate.lab.study.faults.stream import stream_of
from palpate.touch.light import Levels, cells_of, share_unlike
from palpate.touch.press_files import read_image
from palpate.types.frame import Frame

OUT = Path(__file__).parents[1] / "docs/study/wear.json"
WORN = (0.0, 7.0, 14.0)  # [grey levels]
FRAMES = 8  # of the gel at rest, at the beginning and at the end
FAR = 5  # frames from a contact
OFF = np.float32(4.0)  # [grey levels]


def main(recordings: Path, real: Path) -> None:
    """Wear, compare, write."""
    files = sorted(recordings.glob("*.h5"))
    found = {f"{levels:g}": [changed(file, levels) for file in files] for levels in WORN}
    still = [cells_of(read_image(file)) for file in sorted(real.glob("*_untouched.png"))]
    found["real"] = [share_unlike(later, first, OFF) for first, later in permutations(still, 2)]
    shares = {name: {"least": min(each), "most": max(each)} for name, each in found.items()}
    OUT.write_text(json.dumps({"recordings": len(files), "shares": shares}, indent=2) + "\n", encoding="utf-8")


def changed(file: Path, levels: float) -> float:
    """Return the share of cells in which the gel at the end of a recording is unlike that at its beginning."""
    stream = stream_of(load_recording(file))
    worn = wear(stream, np.random.default_rng(0), levels) if levels else stream
    rest = np.flatnonzero(np.convolve(stream.touching, np.ones(2 * FAR + 1), mode="same") < 0.5)
    return share_unlike(_mean(worn.frames, rest[-FRAMES:]), _mean(worn.frames, rest[:FRAMES]), OFF)


def _mean(frames: Sequence[Frame], chosen: np.ndarray) -> Levels:
    images = [frames[index].image for index in chosen.tolist()]
    return np.asarray(np.mean([cells_of(image) for image in images if image is not None], axis=0), np.float32)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
