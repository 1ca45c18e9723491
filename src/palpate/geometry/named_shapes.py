"""Objects by name. Their polygons load shapely, so that they are not in `shapes`, which every tracker loads."""

import numpy as np

from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle, Shape


def _butterfly() -> Polygon:
    """Return two wings with a waist between them, into which a gel of radius 21 mm fits: its radius is 46 mm."""
    angle = np.arange(96) * (2.0 * np.pi / 96)
    radius = 0.085 + 0.03 * np.cos(2.0 * angle)
    return Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))))


def _rounded_square(size: float, radius: float) -> Polygon:
    """Return a square of a full size [m] with corners of a radius [m]."""
    quarter = np.linspace(0.0, 0.5 * np.pi, 13)
    angle = (quarter + 0.5 * np.pi * np.arange(4)[:, None]).ravel()
    center = np.repeat(np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (0.5 * size - radius), len(quarter), axis=0)
    return Polygon(center + radius * np.column_stack((np.cos(angle), np.sin(angle))))


SHAPES: dict[str, Shape] = {
    "disc": Disc(0.088),
    "rectangle": Rectangle(0.2363, 0.1579),
    "ellipse": Ellipse(0.1638, 0.2428),
    "triangle": Polygon([(-0.1, -0.06), (0.1, -0.06), (0.0, 0.12)]),
    "hexagon": Polygon(Disc(0.1).outline(6)),
    "t": Polygon(
        [(-0.1, 0.0), (-0.03, 0.0), (-0.03, -0.14), (0.03, -0.14), (0.03, 0.0), (0.1, 0.0), (0.1, 0.06), (-0.1, 0.06)]
    ),
    "butterfly": _butterfly(),
    "rounded-square": _rounded_square(0.17, 0.03),
}
"""Objects by name. Disc, rectangle and ellipse are the paper's; the others are kept for testing."""
