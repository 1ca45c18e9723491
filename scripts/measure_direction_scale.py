"""What the shipped model tells of directions, on simulated units it has not seen: docs/study/direction_scale.json.

    python scripts/measure_direction_scale.py

Each unit is pressed by a disc, an edge, an ellipse and a ball at directions spread over its pad. The line of what is
told over what is true has an offset and a scale of its own for each unit and object; their spread is the prior of
`direction_bias` and `direction_scale`. `scale_over_ball` is an object's scale over that of a ball on the same unit, and
its spread what a calibration on a ball leaves unknown of objects (`touch.presses`). Two minutes on one core.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse, Rectangle, Shape
from palpate.graph.contact_geometry import contact_model
from palpate.lab.simulate.gel import ball_overlap, draw_side, render, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.background import Image
from palpate.touch.difference import Difference, difference_in_light, reduced
from palpate.touch.model import shipped_model
from palpate.types.sensor import DIGIT, SensorProfile

Array = NDArray[np.float64]

OUT = Path(__file__).parents[1] / "docs/study/direction_scale.json"
UNITS, FIRST_SEED = 60, 13_300_000
"""No recording has so great a seed: `simulate` counts from a folder's seed times 100,000."""
ANGLES = np.radians(np.linspace(-15.0, 15.0, 13))
DEPTHS = (3e-4, 9e-4)  # [m]
SHAPES: dict[str, Shape] = {"disc": Disc(0.05), "edge": Rectangle(0.2, 0.2), "ellipse": Ellipse(0.13, 0.09)}
BALLS = (0.002, 0.006)  # [m] radius


def main() -> None:
    """Press, ask, fit a line for each unit and object."""
    cv2.setNumThreads(1)
    model = shipped_model()
    scale = model.settings.spread["direction"].scale
    told: dict[str, list[tuple[float, float, float, float]]] = {}
    for unit, rng, mean in units_at_rest(DIGIT, range(FIRST_SEED, FIRST_SEED + UNITS)):
        for name in (*SHAPES, "ball"):
            pressed = list(presses(name, unit, rng))
            said = [model.look(difference_in_light(image, mean)).direction for _, image in pressed]
            true = np.array([angle for angle, _ in pressed])
            angle, variance = np.array(said).T
            told.setdefault(name, []).append(line(true, angle, variance * scale))
    lines = {name: np.array(each) for name, each in told.items()}
    found = {name: spread_of(each) | over_ball(each, lines["ball"]) for name, each in lines.items()}
    OUT.write_text(json.dumps({"units": UNITS, "angles": len(ANGLES), **found}, indent=2) + "\n", encoding="utf-8")


def units_at_rest(sensor: SensorProfile, seeds: range) -> Iterator[tuple[SensorUnit, np.random.Generator, Difference]]:
    """Yield the units of these seeds, what draws for each, and its untouched gel, as small as networks see it."""
    for seed in seeds:
        unit, rng = draw_unit(sensor, seed), np.random.default_rng(seed)
        still = [touch_image(unit, None, rng=rng).astype(np.float32) for _ in range(15)]
        yield unit, rng, reduced(np.mean(still, axis=0))


def presses(name: str, unit: SensorUnit, rng: np.random.Generator) -> Iterator[tuple[float, Image]]:
    """Yield true directions [rad], as the profile's geometry has them, and images."""
    side, radius = draw_side(rng), rng.uniform(*BALLS)
    for angle in ANGLES:
        depth = rng.uniform(*DEPTHS)
        if name == "ball":
            y = DIGIT.radius * math.sin(angle)
            overlap = ball_overlap(unit, radius, (y, float(rng.uniform(-0.005, 0.005))), depth)
            yield angle, touch_image(unit, overlap, rng=rng)
        else:
            shape = SHAPES[name]
            g = touching_at(shape, unit.radius, angle)
            touch = contact_model(shape, DIGIT).touching_at(g)
            true = float(se2.wrap(np.angle(-touch["normal"]) - g[2]))
            yield true, render(unit, shape, g, depth, rng=rng, side=side)


def touching_at(shape: Shape, radius: float, angle: float) -> Array:
    """Return the pose (3,) of a sensor of this radius that touches the outline's leftmost point at an angle [rad]."""
    left = float(shape.outline()[:, 0].min())
    return np.array([left - radius + radius * math.cos(angle), -radius * math.sin(angle), -angle])


def line(true: Array, told: Array, variance: Array) -> tuple[float, float, float, float]:
    """Return offset, scale, scatter about the line and the standard deviation stated in the median."""
    slope, offset = np.polyfit(true, told, 1)
    off = told - offset - slope * true
    return offset, slope, float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.median(variance)))


def over_ball(lines: Array, ball: Array) -> dict[str, float]:
    """Return mean and standard deviation over units (N, 4) of the scale over that of a ball."""
    ratio = lines[:, 1] / ball[:, 1]
    return {"scale_over_ball_mean": float(ratio.mean()), "scale_over_ball_deviation": float(ratio.std(ddof=1))}


def spread_of(lines: Array) -> dict[str, float]:
    """Return means and standard deviations over units (N, 4)."""
    offset, slope, scatter, stated = lines.T
    return {
        "offset_mean_deg": float(np.degrees(offset.mean())),
        "offset_deviation_deg": float(np.degrees(offset.std(ddof=1))),
        "scale_mean": float(slope.mean()),
        "scale_deviation": float(slope.std(ddof=1)),
        "about_line_deg": float(np.degrees(np.sqrt(np.mean(scatter**2)))),
        "stated_deg": float(np.degrees(np.median(stated))),
    }


if __name__ == "__main__":
    main()
