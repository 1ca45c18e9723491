"""What the GelSight Mini's model tells of places, on simulated units it has not seen: docs/study/place_bias.json.

    python scripts/measure_place_bias.py

Each unit is pressed by a disc, an ellipse and a ball at places spread over its pad. The line of what is told over what
is true has an offset and a scale of its own for each unit and object; the spread of offsets is the prior of
`place_bias`. Two minutes on one core.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from measure_direction_scale import BALLS, DEPTHS, line, units_at_rest
from numpy.typing import NDArray

from palpate.geometry.shapes import Disc, Ellipse, Shape
from palpate.graph.contact_geometry import contact_model
from palpate.lab.simulate.gel import ball_overlap, draw_side, render, touch_image
from palpate.lab.simulate.unit import SensorUnit
from palpate.touch.background import Image
from palpate.touch.difference import difference_in_light
from palpate.touch.model import shipped_model
from palpate.types.sensor import GELSIGHT_MINI

OUT = Path(__file__).parents[1] / "docs/study/place_bias.json"
UNITS, FIRST_SEED = 60, 13_800_000
"""No recording has so great a seed: `simulate` counts from a folder's seed times 100,000."""
PLACES = np.linspace(-5e-3, 5e-3, 11)  # [m]
SHAPES: dict[str, Shape] = {"disc": Disc(0.05), "ellipse": Ellipse(0.13, 0.09)}


def main() -> None:
    """Press, ask, fit a line for each unit and object."""
    cv2.setNumThreads(1)
    model = shipped_model(GELSIGHT_MINI.name)
    lines: dict[str, list[tuple[float, ...]]] = {name: [] for name in (*SHAPES, "ball")}
    for unit, rng, mean in units_at_rest(GELSIGHT_MINI, range(FIRST_SEED, FIRST_SEED + UNITS)):
        for name, each in lines.items():
            true, images = zip(*presses(name, unit, rng), strict=True)
            said = [model.look(difference_in_light(image, mean)).place or (np.nan, np.nan) for image in images]
            place, variance = np.array(said).T
            each.append(line(np.array(true), place, variance * model.settings.spread["place"].scale))
    found = {name: summary(np.array(each)) for name, each in lines.items()}
    OUT.write_text(json.dumps({"units": UNITS, "places": len(PLACES), **found}, indent=2) + "\n", encoding="utf-8")


def presses(name: str, unit: SensorUnit, rng: np.random.Generator) -> Iterator[tuple[float, Image]]:
    """Yield true places [m], as the profile's geometry has them, and images."""
    side, radius = draw_side(rng), rng.uniform(*BALLS)
    for place in PLACES:
        depth = rng.uniform(*DEPTHS)
        if name == "ball":
            overlap = ball_overlap(unit, radius, (float(place), float(rng.uniform(-0.003, 0.003))), depth)
            yield float(place), touch_image(unit, overlap, rng=rng)
        else:
            shape = SHAPES[name]
            g = np.array([shape.outline()[:, 0].min(), -place, 0.0])
            true = float(contact_model(shape, GELSIGHT_MINI).touching_at(g)["material"].imag)
            yield true, render(unit, shape, g, depth, rng=rng, side=side)


def summary(lines: NDArray[np.float64]) -> dict[str, float]:
    """Return what lines of units (N, 4) say: offset, scale, scatter and the deviation that is stated."""
    offset, scale, scatter, stated = lines.T
    return {
        "offset_mm_mean": float(1e3 * offset.mean()),
        "offset_mm_deviation": float(1e3 * offset.std()),
        "scale_mean": float(scale.mean()),
        "scale_deviation": float(scale.std()),
        "scatter_mm": float(1e3 * np.median(scatter)),
        "stated_mm": float(1e3 * np.median(stated)),
    }


if __name__ == "__main__":
    main()
