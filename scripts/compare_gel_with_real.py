"""Draw real presses of a ball beside simulated ones at the same places, to be looked at; real images stay outside.

    python scripts/compare_gel_with_real.py DIR OUT.png [--units SEED ...]

DIR is as `digit_balls`: untouched.png, truth.csv with columns file, column_px and row_px, and the images it names. Of
each row of pictures the first is of the images, the second of their differences from the untouched gel, twofold.
"""

import argparse
import csv
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.press_files import read_image
from palpate.types.sensor import DIGIT

BALL, DEPTH = 0.005, 0.0012
"""Radius of the simulated ball and how deep it is pressed in [m]: as large on the gel as the real one."""
SHOWN, SIZE = 10, (120, 160)


def main() -> None:
    """Read, render, save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--units", type=int, nargs="+", default=[0, 1, 2, 3])
    arguments = parser.parse_args()
    with (arguments.folder / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))[:SHOWN]
    untouched = read_image(arguments.folder / "untouched.png")
    lines = both([read_image(arguments.folder / row["file"]) for row in rows], untouched)
    for seed in arguments.units:
        unit = draw_unit(DIGIT, seed)
        lines += both([pressed(unit, float(row["column_px"]), float(row["row_px"])) for row in rows], unit.no_contact)
    cv2.imwrite(str(arguments.out), np.vstack(lines)[..., ::-1])


def pressed(unit: SensorUnit, column: float, row: float) -> Any:
    """Return the image of a ball at a place in the image [px]."""
    last = unit.no_contact.shape[0] - 1
    y, z = unit.place[:, min(round(row), last), round(column)]
    return touch_image(unit, ball_overlap(unit, BALL, (float(y), float(z)), DEPTH), rng=np.random.default_rng(0))


def both(images: list[Any], untouched: Any) -> list[Any]:
    """Return a line of images and one of their differences."""
    differences = [np.clip(128.0 + 2.0 * (image - untouched.astype(float)), 0, 255) for image in images]
    return [
        np.hstack([cv2.resize(each.astype(np.uint8), SIZE, interpolation=cv2.INTER_AREA) for each in line])
        for line in (images, differences)
    ]


if __name__ == "__main__":
    main()
