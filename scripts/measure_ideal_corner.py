"""How well an ideal observer could read the turn of a corner in rendered images: docs/study/ideal_corner.json.

    python scripts/measure_ideal_corner.py

The observer knows the renderer and sees two images of one unit as the networks do, with the camera's noise. It does not
know, in each image, how the corner is turned, where it lies, how deep it is pressed in and how it shears the gel; nor
how the side leans and what the unit is like: lights, colours, gel, camera, each with what units differ by as its prior.
The Cramer-Rao bound of the turn between the two follows from derivatives by differences. With `known unit` the observer
knows the unit; `edge` is a flat side, whose turn moves the imprint. Two minutes on one core.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate.geometry.shapes import Rectangle
from palpate.lab.simulate.gel import Side, draw_side, gel_height, prism_overlap
from palpate.lab.simulate.optics import shading
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.difference import COLUMNS, ROWS
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]
OUT = Path(__file__).parents[1] / "docs/study/ideal_corner.json"
UNITS, FIRST_SEED = 40, 15_300_000
SQUARE = Rectangle(0.2, 0.2)
TURN = math.radians(12.0)
"""Between the two images, as in half of the contacts with true corners that a model learns from."""
OF_IMAGE = (("yaw", 0.35, 1e-3), ("place", 5e-3, 2e-5), ("depth", 3e-4, 5e-6), ("shear", 0.5, 0.02))
"""What differs from image to image: name, standard deviation of its prior and step of differences [rad, m, m, N]."""
OF_UNIT = (("radius", 7e-4, 2e-5), ("pitch", 2.7e-6, 1e-7), ("halo", 0.22, 0.01), ("shadow", 0.17, 0.01))
OF_UNIT = (*OF_UNIT, ("fold", 0.29, 0.01), ("response", 0.17, 0.01), ("shear_compliance", 9e-5, 3e-6))
"""Numbers of a unit, likewise; besides, its lights and colours."""
LIGHT, COLOUR = (0.3, 0.01), (0.3, 0.01)
"""Standard deviation and step of a light's direction [rad] and of what it adds to a channel, as a share of all."""
ROUNDING = 1.0 / 12.0
"""Variance of what networks see, which is rounded to grey levels [grey levels^2]."""


@dataclass(frozen=True)
class Seen:
    """What two images are of."""

    unit: SensorUnit
    side: Side
    images: tuple[dict[str, float], ...]


def main() -> None:
    """Bound the turn for corners and edges, with the unit known or not, and write medians over units."""
    cv2.setNumThreads(1)
    found: dict[str, list[float]] = {}
    for seed in range(FIRST_SEED, FIRST_SEED + UNITS):
        for name, pose in (("corner", corner_pose), ("edge", edge_pose)):
            for known in (False, True):
                key = f"{name}, known unit" if known else name
                found.setdefault(key, []).append(math.degrees(bound(drawn(seed), pose, known)))
    told = {name: {"median_deg": median(each), "worst_deg": max(each)} for name, each in found.items()}
    OUT.write_text(json.dumps({"units": UNITS, "turn_deg": math.degrees(TURN), **told}, indent=2) + "\n", "utf-8")


def drawn(seed: int) -> Seen:
    """Return a unit that sees something turn by TURN on it."""
    rng = np.random.default_rng(seed)
    place, depth = rng.uniform(-4e-3, 4e-3), rng.uniform(3e-4, 9e-4)
    images = tuple(
        {"yaw": yaw, "place": place, "depth": depth, "shear": rng.uniform(-0.5, 0.5)} for yaw in (-TURN / 2, TURN / 2)
    )
    return Seen(draw_unit(DIGIT, seed), draw_side(rng), images)


def corner_pose(unit: SensorUnit, image: dict[str, float]) -> Array:
    """Return object_T_sensor of a tip that touches a corner at a place on the pad, turned by yaw off the bisector."""
    angle = math.asin(image["place"] / unit.radius)
    return _pose(unit, np.array([-0.1, -0.1]), 0.25 * math.pi + image["yaw"], angle)


def edge_pose(unit: SensorUnit, image: dict[str, float]) -> Array:
    """Return the same of its left side, which rolls on the tip."""
    return _pose(unit, np.array([-0.1, image["place"]]), 0.0, -image["yaw"])


def _pose(unit: SensorUnit, touched: Array, normal: float, angle: float) -> Array:
    center = touched - unit.radius * np.array([math.cos(normal), math.sin(normal)])
    yaw = normal - angle
    return np.array([*(center + unit.radius * np.array([math.cos(yaw), math.sin(yaw)])), yaw])


def bound(seen: Seen, pose: Callable[[SensorUnit, dict[str, float]], Array], known_unit: bool) -> float:
    """Return the least standard deviation of the turn between both images [rad] that an observer can have."""
    columns: list[Array] = []
    priors: list[float] = []

    def differ(changed: Callable[[float], Seen], step: float, deviation: float) -> None:
        columns.append((pictures(changed(step), pose) - pictures(changed(-step), pose)) / (2.0 * step))
        priors.append(deviation)

    for number in range(2):
        for name, deviation, step in OF_IMAGE:
            differ(lambda by, n=number, k=name: _with_image(seen, n, k, by), step, deviation)
    differ(lambda by: replace(seen, side=replace(seen.side, tilt=seen.side.tilt + by)), 1e-3, math.radians(1.5))
    if not known_unit:
        for name, deviation, step in OF_UNIT:
            differ(lambda by, k=name: _with_unit(seen, **{k: getattr(seen.unit, k) + by}), step, deviation)
        for light in range(3):
            for axis in range(3):
                differ(lambda by, i=light, j=axis: _with_light(seen, i, j, by), LIGHT[1], LIGHT[0])
                differ(lambda by, i=light, j=axis: _with_colour(seen, i, j, by), COLOUR[1], COLOUR[0])
    jacobian = np.stack(columns, axis=1)
    pixels = seen.unit.no_contact[..., 0].size / (ROWS * COLUMNS)
    noise = math.sqrt(seen.unit.noise**2 / pixels + ROUNDING)
    information = jacobian.T @ jacobian / noise**2 + np.diag(np.power(priors, -2.0))
    turn = np.zeros(len(priors))
    turn[0], turn[len(OF_IMAGE)] = -1.0, 1.0
    return math.sqrt(turn @ np.linalg.solve(information, turn))


def pictures(seen: Seen, pose: Callable[[SensorUnit, dict[str, float]], Array]) -> Array:
    """Return what the networks see of both images, without noise, in one row [grey levels]."""
    shown = []
    for image in seen.images:
        overlap = prism_overlap(seen.unit, SQUARE, pose(seen.unit, image), image["depth"], seen.side)
        change = shading(seen.unit, gel_height(seen.unit, overlap, image["shear"]))
        shown.append(cv2.resize(change, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA).ravel())
    return np.concatenate(shown).astype(np.float64)


def _with_image(seen: Seen, number: int, name: str, by: float) -> Seen:
    images = list(seen.images)
    images[number] = images[number] | {name: images[number][name] + by}
    return replace(seen, images=tuple(images))


def _with_unit(seen: Seen, **changed: object) -> Seen:
    return replace(seen, unit=replace(seen.unit, **changed))  # pyright: ignore[reportArgumentType]


def _with_light(seen: Seen, light: int, axis: int, by: float) -> Seen:
    changed = seen.unit.light.copy()
    changed[light, axis] += by
    changed[light] /= np.linalg.norm(changed[light])
    return _with_unit(seen, light=changed)


def _with_colour(seen: Seen, light: int, channel: int, by: float) -> Seen:
    changed = seen.unit.colour.copy()
    changed[light, channel] += by * seen.unit.colour[light].max()
    return _with_unit(seen, colour=changed)


if __name__ == "__main__":
    main()
