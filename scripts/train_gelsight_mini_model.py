"""Make again the touch model of the GelSight Mini that comes with palpate, and the study of it.

    python scripts/train_gelsight_mini_model.py FOLDER [--study-only]

An hour on two cores; half of it for the study alone, which is of the model that comes along then. Weights may differ in
the last digits from one processor to another.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from palpate.cli.console import progress_bar
from palpate.geometry.shapes import SHAPES
from palpate.lab.simulate.recordings import plan, simulate_folder
from palpate.lab.train.fit import FitSettings
from palpate.lab.train.train import TrainSettings, train
from palpate.touch.touch_model import SHIPPED_OF
from palpate.types.sensor import GELSIGHT_MINI

RECORDINGS = 60
"""Of each of the paper's objects, to learn from."""
STUDIED = ("disc", "rectangle-edges", "ellipse")
"""Kinds of contact of the study; true corners on a flat pad are not what it is good for."""
SEQUENCES, SEED = 50, 761
"""Of each kind, and the seed of them, which nothing was chosen on."""


def main() -> None:
    """Simulate, train, simulate other units, track them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--study-only", action="store_true")
    arguments = parser.parse_args()
    folder = arguments.folder
    if not arguments.study_only:
        learn(folder)
    study(folder, SHIPPED_OF[GELSIGHT_MINI.name] if arguments.study_only else folder / "model")


def learn(folder: Path) -> None:
    """Make recordings and the model."""
    shapes = {name: SHAPES[name] for name in ("disc", "rectangle", "ellipse")}
    learned = plan(shapes, RECORDINGS, seed=1, ideal=True, sensor=GELSIGHT_MINI, seconds=6.0)
    with progress_bar("simulating", len(learned)) as progress:
        simulate_folder(folder / "train", learned, workers=2, resume=True, progress=progress)
    settings = TrainSettings(touch=FitSettings(steps=2500))
    train(sorted((folder / "train").glob("*.mcap")), folder / "model", settings, progress_bar)


def study(folder: Path, model: Path) -> None:
    """Track pushes by other units, with an exact set-up and with the errors of a real one."""
    shapes = {name: SHAPES[name] for name in ("disc", "rectangle", "ellipse")}
    for name, ideal in (("real", False), ("ideal", True)):
        jobs = plan(shapes, 3 * SEQUENCES, seed=SEED, ideal=ideal, sensor=GELSIGHT_MINI, seconds=10.0)
        judged = {
            name: job
            for kind in STUDIED
            for name, job in [one for one in jobs.items() if one[1].kind == kind][:SEQUENCES]
        }
        with progress_bar(f"simulating, {name}", len(judged)) as progress:
            simulate_folder(folder / name, judged, workers=2, resume=True, progress=progress)
        judge = ["evaluate", str(folder / name), "--out", str(folder / f"results-{name}"), "--tactile", "learnt"]
        options = ["--model", str(model), "--workers", "2"]
        subprocess.run([sys.executable, "-m", "palpate", *judge, *options], check=True)


if __name__ == "__main__":
    main()
