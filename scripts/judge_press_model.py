"""Train a model from presses of a simulated dome with pins and judge it on others: docs/study/presses.json.

    python scripts/judge_press_model.py FOLDER

Some minutes on one core.
"""

import json
import sys
from pathlib import Path

import numpy as np

from palpate.cli.console import progress_bar
from palpate.lab.simulate.pins import PIN_DOME, draw_dome, press
from palpate.lab.train.from_presses import train_on_presses
from palpate.touch.difference import difference, reduced
from palpate.touch.model import TouchModel
from palpate.touch.presses import Presses

OUT = Path(__file__).parents[1] / "docs/study/presses.json"
SEED, LEARNED, JUDGED = 1000, 200, 200
WIDEST = np.radians(45.0)


def main(out: Path) -> None:
    """Press, train, press again."""
    rng, dome = np.random.default_rng(100), draw_dome(SEED)
    still = [press(dome, None, rng) for _ in range(5)]
    angles = rng.uniform(-WIDEST, WIDEST, LEARNED)
    images = tuple(press(dome, angle, rng) for angle in angles)
    given = Presses(images, angles, tuple(f"press {i}" for i in range(LEARNED)))
    train_on_presses(given, still, PIN_DOME.name, out, progress_bar)
    model, mean = TouchModel(out), np.asarray(np.mean([reduced(image) for image in still], axis=0), np.float32)
    scale = model.settings.spread["direction"].scale
    true = rng.uniform(-WIDEST, WIDEST, JUDGED)
    said = [model.look(difference(press(dome, angle, rng), mean)).direction for angle in true]
    told, variance = np.array(said).T
    error, sigma = np.degrees(np.abs(told - true)), np.degrees(np.sqrt(variance * scale))
    result = {
        "presses": LEARNED,
        "judged": JUDGED,
        "rms_deg": float(np.sqrt(np.mean(error**2))),
        "median_deg": float(np.median(error)),
        "in_68_share": float(np.mean(error < 0.9945 * sigma)),
        "in_95_share": float(np.mean(error < 1.96 * sigma)),
    }
    OUT.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
