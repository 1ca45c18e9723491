"""Draw docs/pictures/frames_*.png: world, object and sensor frames, and how a touch image lies, to be looked at.

python scripts/make_frames_pictures.py
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np

from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.lab.simulate.gel import render
from palpate.lab.simulate.unit import draw_unit
from palpate.types.sensor import DIGIT

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Arc, Polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURES = Path(__file__).resolve().parents[1] / "docs/pictures"
OBJECT, SENSOR, GREY = "#0072B2", "#D55E00", "#666666"
BOX = Rectangle(0.11, 0.07)
WORLD_T_OBJECT = np.array([0.17, 0.10, math.radians(25.0)])
OBJECT_T_SENSOR = np.array([-0.055, 0.008, math.radians(-8.0)])
HALF_WIDTH = 0.0092
"""Of the DIGIT's pad [m]."""
YAW = math.radians(-10.0)
"""Of the sensor on the object's left edge: that is touched at +10 degrees on the tip, so right of the middle."""
UNIT, DEPTH = 2, 8e-4
"""The drawn sensor unit, and how deep it is pressed in [m]."""


def arrow(axes: "Axes", start: np.ndarray, end: np.ndarray, colour: str, **style: Any) -> None:
    """Draw an arrow between two points [mm]."""
    axes.annotate(
        "",
        (end[0], end[1]),
        (start[0], start[1]),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8, **style},
    )


def label(axes: "Axes", place: np.ndarray, text: str, **style: Any) -> None:
    """Write at a point [mm]."""
    axes.text(place[0], place[1], text, **style)


def frame(axes: "Axes", pose: np.ndarray, colour: str, name: str, length: float, offset: tuple[float, float]) -> None:
    """Draw the axes x and y of a pose (3,) [m, m, rad] in mm, and its name beside the origin."""
    origin = 1e3 * pose[:2]
    for axis, angle in (("x", pose[2]), ("y", pose[2] + 0.5 * math.pi)):
        along = np.array([math.cos(angle), math.sin(angle)])
        arrow(axes, origin, origin + length * along, colour)
        label(axes, origin + 1.13 * length * along, axis, color=colour, ha="center", va="center", fontsize=11)
    axes.plot(*origin, "o", color=colour, ms=4)
    label(axes, origin + offset, name, color=colour, fontsize=11, ha="center", va="center")


def outline(axes: "Axes", points: np.ndarray, colour: str) -> None:
    """Draw a closed outline (n, 2) [m] in mm."""
    axes.add_patch(Polygon(1e3 * points, facecolor=f"{colour}1c", edgecolor=colour, lw=1.6))


def turn(axes: "Axes", place: np.ndarray, radius: float, first: float, last: float, name: str, colour: str) -> None:
    """Draw an angle [rad] about a place [mm], counter-clockwise, from a dashed line to another."""
    end = place + 1.35 * radius * np.array([math.cos(first), math.sin(first)])
    axes.plot(*np.column_stack([place, end]), color=colour, ls=":", lw=1.2)
    axes.add_patch(
        Arc(
            (place[0], place[1]),
            2 * radius,
            2 * radius,
            theta1=math.degrees(first),
            theta2=math.degrees(last),
            color=colour,
        )
    )
    middle = 0.5 * (first + last)
    at = place + 1.1 * radius * np.array([math.cos(middle), math.sin(middle)])
    label(axes, at, name, color=colour, fontsize=11)


def world() -> None:
    """Draw the three frames from above."""
    figure, axes = plt.subplots(figsize=(6.4, 4.6), layout="constrained")
    sensor = se2.compose(WORLD_T_OBJECT, OBJECT_T_SENSOR)
    outline(axes, se2.transform(WORLD_T_OBJECT, BOX.outline()), OBJECT)
    outline(axes, se2.transform(sensor, DIGIT.pads[0]), SENSOR)
    frame(axes, np.zeros(3), "#000000", "world", 40.0, (4.0, -10.0))
    frame(axes, WORLD_T_OBJECT, OBJECT, "object", 34.0, (16.0, -12.0))
    frame(axes, sensor, SENSOR, "sensor", 24.0, (-30.0, -16.0))
    origins = [np.zeros(2), 1e3 * WORLD_T_OBJECT[:2], 1e3 * sensor[:2]]
    for start, end, colour in ((origins[0], origins[1], OBJECT), (origins[0], origins[2], SENSOR)):
        arrow(axes, start, end, colour, linestyle="--", lw=1.0, shrinkA=0, shrinkB=4)
    axes.text(112.0, 52.0, "world_T_object", color=OBJECT, rotation=30, fontsize=9)
    axes.text(36.0, 56.0, "world_T_sensor", color=SENSOR, rotation=37, fontsize=9)
    turn(axes, origins[1], 52.0, 0.0, float(WORLD_T_OBJECT[2]), r"$\theta$", OBJECT)
    axes.set(aspect="equal", xlim=(-25, 262), ylim=(-22, 168), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    figure.savefig(PICTURES / "frames_world.png", dpi=130)
    plt.close(figure)


def pad() -> None:
    """Draw the pad from above, with its centre of curvature and the contact direction."""
    figure, axes = plt.subplots(figsize=(6.0, 4.4), layout="constrained")
    outline(axes, DIGIT.pads[0], SENSOR)
    centre = 1e3 * DIGIT.centers[0]
    frame(axes, np.zeros(3), SENSOR, "apex: origin", 9.0, (5.0, -1.6))
    axes.plot(*centre, "o", color=GREY, ms=4)
    axes.text(centre[0] - 1.0, centre[1] - 1.4, "centre of\ncurvature", color=GREY, ha="center", va="top", fontsize=10)
    angle = math.radians(20.0)
    touched = centre + 21.0 * np.array([math.cos(angle), math.sin(angle)])
    arrow(axes, centre, touched, OBJECT)
    turn(axes, centre, 8.0, 0.0, angle, "direction, here 20°", OBJECT)
    side = np.array([-math.sin(angle), math.cos(angle)])
    face = touched + np.array([[-12.0], [9.0]]) * side
    axes.plot(*face.T, color=OBJECT, lw=2.0)
    label(axes, face[1] + np.array([-1.2, 0.4]), "edge of the object", color=OBJECT, ha="right", fontsize=10)
    label(axes, touched + np.array([2.2, 0.0]), "touched point", color=OBJECT, fontsize=10)
    axes.set(aspect="equal", xlim=(-29, 14), ylim=(-12, 17), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    figure.savefig(PICTURES / "frames_sensor.png", dpi=130)
    plt.close(figure)


def image() -> None:
    """Draw a touch image of an edge that is touched at y > 0, with its rows and columns."""
    figure, axes = plt.subplots(figsize=(4.6, 4.8), layout="constrained")
    centre = np.array([-0.5 * BOX.size_x - DIGIT.radius + DEPTH, 0.0])
    apex = centre + DIGIT.radius * np.array([math.cos(YAW), math.sin(YAW)])
    axes.imshow(render(draw_unit(DIGIT, UNIT), BOX, np.array([*apex, YAW]), DEPTH))
    column = 0.5 * DIGIT.image_width * (1.0 + DIGIT.radius * math.sin(-YAW) / HALF_WIDTH)
    axes.axvline(column, color="white", ls=":", lw=1.2)
    axes.text(column - 5.0, 20, "touched here: y > 0", color="white", ha="right", fontsize=9)
    axes.set_xlabel("column, 0 to 239: along +y of the sensor  →")
    axes.set_ylabel("←  row, 0 to 319: downwards, along −z")
    axes.set(xticks=[0, 60, 120, 180, 239], yticks=[0, 80, 160, 240, 319])
    figure.savefig(PICTURES / "frames_image.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    world()
    pad()
    image()
