"""Draw docs/pictures/presses.png: presses on a simulated unit that calibrate well, and such that do not.

python scripts/make_press_pictures.py
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np

from palpate import GELSIGHT_MINI
from palpate.arrays import Image
from palpate_lab.simulate.gel import touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit

matplotlib.use("Agg")
from matplotlib import pyplot as plt

PICTURE = Path(__file__).resolve().parents[1] / "docs/pictures/presses.png"
SEED = 11  # of a unit with dots
BALL = 0.003  # [m]


def main() -> None:
    """Draw three good presses above three bad ones."""
    unit = replace(draw_unit(GELSIGHT_MINI, SEED), offset=(0.0, 0.0), roll=0.0)
    drawn = {
        "good: whole, near the left side": pressed(unit, [(-5.5, 1.0)], 0.7),
        "good: whole, in the middle": pressed(unit, [(0.3, -2.0)], 0.7),
        "good: whole, near the right side": pressed(unit, [(5.5, 0.5)], 0.7),
        "bad: cut off by the border": pressed(unit, [(-9.7, 6.5)], 0.7),
        "bad: two at once": pressed(unit, [(-3.0, 2.0), (2.5, -2.5)], 0.7),
        "bad: hardly touched": pressed(unit, [(2.0, 1.0)], 0.06),
    }
    figure, rows = plt.subplots(2, 3, figsize=(9.0, 5.2), layout="constrained")
    for axes, (title, image) in zip(rows.flat, drawn.items(), strict=True):
        axes.imshow(image)
        axes.set_axis_off()
        axes.set_title(title, fontsize=9)
    figure.savefig(PICTURE, dpi=80)


def pressed(unit: SensorUnit, places: Sequence[tuple[float, float]], depth: float) -> Image:
    """Return the image of balls that are pressed in at places (y, z) on the pad, to a depth, all in mm."""
    overlap = np.zeros(unit.place.shape[1:], np.float32)
    for y, z in places:
        away = np.hypot(unit.place[0] - 1e-3 * y, unit.place[1] - 1e-3 * z)
        bulge = BALL * (1.0 - np.sqrt(np.maximum(1.0 - (away / BALL) ** 2, 0.0)))
        ball = np.where(away < BALL, np.maximum(1e-3 * depth - bulge, 0.0), 0.0)
        overlap = np.maximum(overlap, ball.astype(np.float32))
    return touch_image(unit, overlap, rng=np.random.default_rng(0))


if __name__ == "__main__":
    main()
