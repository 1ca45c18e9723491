"""A ball pressed into a simulated gel."""

import numpy as np

from palpate_lab.simulate.unit import Image, SensorUnit


def ball_overlap(unit: SensorUnit, radius: float, place: tuple[float, float], indentation: float) -> Image:
    """Return the overlap (height, width) [m] with a ball of a radius [m] pressed in at place (y, z) on the pad [m]."""
    y, z = unit.place
    away = np.hypot(y - place[0], z - place[1])
    inside = np.minimum(away / radius, 1.0)
    bulge = unit.sag(y) + unit.sag_along(z)
    bulge -= unit.sag(np.float32(place[0])) + unit.sag_along(np.float32(place[1]))
    beyond = np.sign(place[0]) * max(abs(place[0]) - 0.5 * unit.flat_width, 0.0)
    slope = (beyond / unit.radius, place[1] / unit.length_radius)  # the ball comes along the gel's normal
    bulge -= slope[0] * (y - place[0]) + slope[1] * (z - place[1])
    overlap = indentation - radius * (1.0 - np.sqrt(1.0 - inside**2)) - bulge
    return np.where(inside < 1.0, np.maximum(overlap, 0.0), 0.0).astype(np.float32)
