"""Draw docs/pictures/frames_*.png: the frames of world, object and sensor, and of a touch image.

python scripts/make_frames_pictures.py
"""

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from palpate import DIGIT, Rectangle
from palpate.geometry import se2
from palpate.lab.simulate.gel import render
from palpate.lab.simulate.unit import draw_unit

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Arc, Polygon

PICTURES = Path(__file__).resolve().parents[1] / "docs/pictures"
OBJECT, SENSOR, GREY = "#0072B2", "#D55E00", "#666666"
BOX = Rectangle(0.11, 0.07)
PAD = 1e3 * DIGIT.pads[0]


def unit(angle: float) -> np.ndarray:
    """Return the unit vector (2,) at an angle [rad]."""
    return np.array([math.cos(angle), math.sin(angle)])


def arrow(axes: Any, start: np.ndarray, end: np.ndarray, colour: str, **style: Any) -> None:
    """Draw an arrow between two points [mm]."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8, **style})


def frame(axes: Any, pose: np.ndarray, colour: str, name: str, length: float, offset: tuple[float, float]) -> None:
    """Draw the axes x and y of a pose (3,) [m, m, rad] in mm, and its name beside the origin."""
    origin = 1e3 * pose[:2]
    for axis, angle in (("x", pose[2]), ("y", pose[2] + 0.5 * math.pi)):
        arrow(axes, origin, origin + length * unit(angle), colour)
        axes.text(*(origin + 1.13 * length * unit(angle)), axis, color=colour, ha="center", va="center", fontsize=11)
    axes.plot(*origin, "o", color=colour, ms=4)
    axes.text(*(origin + offset), name, color=colour, fontsize=11, ha="center", va="center")


def turn(axes: Any, place: np.ndarray, radius: float, angle: float, name: str, colour: str) -> None:
    """Draw an angle [rad] about a place [mm], counter-clockwise from a dotted line along x."""
    axes.plot([place[0], place[0] + 1.35 * radius], [place[1]] * 2, color=colour, ls=":", lw=1.2)
    axes.add_patch(Arc((place[0], place[1]), 2 * radius, 2 * radius, theta2=math.degrees(angle), color=colour))
    axes.text(*(place + 1.1 * radius * unit(0.5 * angle)), name, color=colour, fontsize=11)


def save(figure: Any, name: str) -> None:
    """Write a picture without axes."""
    figure.savefig(PICTURES / f"frames_{name}.png", dpi=120)
    plt.close(figure)


def world() -> None:
    """Draw the three frames from above."""
    figure, axes = plt.subplots(figsize=(6.4, 4.6), layout="constrained")
    world_t_object = np.array([0.17, 0.10, math.radians(25.0)])
    sensor = se2.compose(world_t_object, np.array([-0.055, 0.008, math.radians(-8.0)]))
    for outline, colour in (
        (se2.transform(world_t_object, BOX.outline()), OBJECT),
        (se2.transform(sensor, PAD / 1e3), SENSOR),
    ):
        axes.add_patch(Polygon(1e3 * outline, facecolor=f"{colour}1c", edgecolor=colour, lw=1.6))
    frame(axes, np.zeros(3), "#000000", "world", 40.0, (4.0, -10.0))
    frame(axes, world_t_object, OBJECT, "object", 34.0, (16.0, -12.0))
    frame(axes, sensor, SENSOR, "sensor", 24.0, (-30.0, -16.0))
    for pose, colour in ((world_t_object, OBJECT), (sensor, SENSOR)):
        arrow(axes, np.zeros(2), 1e3 * pose[:2], colour, linestyle="--", lw=1.0, shrinkA=0, shrinkB=4)
    axes.text(112.0, 52.0, "world_T_object", color=OBJECT, rotation=30, fontsize=9)
    axes.text(36.0, 56.0, "world_T_sensor", color=SENSOR, rotation=37, fontsize=9)
    turn(axes, 1e3 * world_t_object[:2], 52.0, float(world_t_object[2]), r"$\theta$", OBJECT)
    axes.set(aspect="equal", xlim=(-25, 262), ylim=(-22, 168))
    axes.set_axis_off()
    save(figure, "world")


def pad() -> None:
    """Draw the pad from above, with its centre of curvature and the contact direction."""
    figure, axes = plt.subplots(figsize=(6.0, 4.4), layout="constrained")
    axes.add_patch(Polygon(PAD, facecolor=f"{SENSOR}1c", edgecolor=SENSOR, lw=1.6))
    frame(axes, np.zeros(3), SENSOR, "apex: origin", 9.0, (5.0, -1.6))
    centre, angle = 1e3 * DIGIT.centers[0], math.radians(20.0)
    axes.plot(*centre, "o", color=GREY, ms=4)
    axes.text(centre[0] - 1.0, centre[1] - 1.4, "centre of\ncurvature", color=GREY, ha="center", va="top", fontsize=10)
    contact = centre + 21.0 * unit(angle)
    arrow(axes, centre, contact, OBJECT)
    turn(axes, centre, 8.0, angle, "direction, here 20°", OBJECT)
    face = contact + np.array([[-12.0], [9.0]]) * unit(angle + 0.5 * math.pi)
    axes.plot(*face.T, color=OBJECT, lw=2.0)
    axes.text(face[1, 0] - 1.2, face[1, 1] + 0.4, "edge of the object", color=OBJECT, ha="right", fontsize=10)
    axes.text(contact[0] + 2.2, contact[1], "contact point", color=OBJECT, fontsize=10)
    axes.set(aspect="equal", xlim=(-29, 14), ylim=(-12, 17))
    axes.set_axis_off()
    save(figure, "sensor")


def image() -> None:
    """Draw a touch image of an edge in contact at y > 0, with its rows and columns."""
    figure, axes = plt.subplots(figsize=(4.6, 4.8), layout="constrained")
    yaw, depth, half_width = math.radians(-10.0), 8e-4, 0.0092
    apex = np.array([-0.5 * BOX.size_x - DIGIT.radius + depth, 0.0]) + DIGIT.radius * unit(yaw)
    axes.imshow(render(draw_unit(DIGIT, 2), BOX, np.array([*apex, yaw]), depth))
    column = 0.5 * DIGIT.image_width * (1.0 - DIGIT.radius * math.sin(yaw) / half_width)
    axes.axvline(column, color="white", ls=":", lw=1.2)
    axes.text(column - 5.0, 20, "contact: y > 0", color="white", ha="right", fontsize=9)
    axes.set_xlabel("column, 0 to 239: along +y of the sensor  →")
    axes.set_ylabel("←  row, 0 to 319: downwards, along −z")
    axes.set(xticks=[0, 60, 120, 180, 239], yticks=[0, 80, 160, 240, 319])
    save(figure, "image")


if __name__ == "__main__":
    world()
    pad()
    image()
