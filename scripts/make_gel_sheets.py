"""Draw docs/touch_contacts.png and docs/touch_units.png: simulated touch images, to be looked at.

python scripts/make_gel_sheets.py
"""

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from palpate.geometry.shapes import Disc, Ellipse, Rectangle, Shape
from palpate.lab.simulate.gel import ball_overlap, render, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.types.sensor import DIGIT

matplotlib.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parents[1] / "docs"
SQUARE = Rectangle(0.09, 0.09)
CORNER = (-0.045, 0.045)
CONTACTS: dict[str, tuple[Shape, tuple[float, float], float]] = {
    "disc": (Disc(0.05), (-0.05, 0.0), math.pi),
    "edge": (SQUARE, (-0.045, 0.005), math.pi),
    "near a corner": (SQUARE, (-0.045, 0.043), math.pi),
    "on a corner": (SQUARE, CORNER, 0.75 * math.pi),
    "ellipse": (Ellipse(0.105, 0.1309), (-0.0525, 0.0), math.pi),
}
"""Shape, point of its outline that is touched [m] and direction out of the shape there [rad]."""
PRESSES = [(-20.0, 0.4), (-10.0, 0.4), (0.0, 0.4), (10.0, 0.4), (20.0, 0.4), (0.0, 0.2), (0.0, 0.8)]
"""Yaw [degrees] and indentation [mm]."""


def touching(unit: SensorUnit, point: tuple[float, float], outward: float, yaw: float, depth: float) -> Any:
    """Return object_T_sensor (3,) of a gel pressed in by depth [m] and turned by yaw [rad] from facing the object."""
    heading = outward + math.pi + yaw
    centre = np.asarray(point) + (unit.radius - depth) * np.array([math.cos(outward), math.sin(outward)])
    return np.array([*(centre + unit.radius * np.array([math.cos(heading), math.sin(heading)])), heading])


def sheet(rows: list[list[Any]], top: list[str], left: list[str], path: Path) -> None:
    """Save a table of images with a line of text above each column and beside each row."""
    figure, axes = plt.subplots(
        len(rows), len(rows[0]), figsize=(0.82 * len(rows[0]), 1.1 * len(rows) + 0.2), squeeze=False
    )
    for line, images, name in zip(axes, rows, left, strict=True):
        line[0].set_ylabel(name, fontsize=8)
        for axis, image in zip(line, images, strict=True):
            axis.imshow(image)
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
    for axis, name in zip(axes[0], top, strict=True):
        axis.set_title(name, fontsize=7)
    figure.subplots_adjust(0.04, 0.01, 0.99, 0.95, 0.04, 0.04)
    figure.savefig(path, dpi=96)
    plt.close(figure)


def main() -> None:
    """Draw both sheets."""
    units = [draw_unit(DIGIT, seed) for seed in range(24)]
    rows = []
    for unit, (shape, point, outward) in zip([units[k] for k in (7, 18, 8, 5, 16)], CONTACTS.values(), strict=False):
        line = []
        for degrees, millimetres in PRESSES:
            depth = 1e-3 * millimetres
            yaw = math.radians(degrees)
            # A side rolls over the gel, a corner stays where it is and the gel turns about it.
            sticks = point == CORNER
            pose = touching(unit, point, outward + yaw * sticks, yaw * (not sticks), depth)
            line.append(render(unit, shape, pose, depth, shear=0.05 * degrees))
        rows.append(line)
    places = [(-0.005, 0.004), (-0.002, 0.004), (0.0, 0.0), (0.002, -0.003), (0.005, -0.003), (0.0, 0.0), (0.0, 0.0)]
    ball = [
        touch_image(units[6], ball_overlap(units[6], 0.003, place, 1e-3 * depth))
        for place, (_, depth) in zip(places, PRESSES, strict=True)
    ]
    top = [f"{yaw:+.0f}°, {depth} mm" for yaw, depth in PRESSES]
    sheet([*rows, ball], top, [*CONTACTS, "6 mm ball"], DOCS / "touch_contacts.png")
    images = [unit.no_contact for unit in units]
    sheet([images[:8], images[8:16], images[16:]], [""] * 8, [""] * 3, DOCS / "touch_units.png")


if __name__ == "__main__":
    main()
