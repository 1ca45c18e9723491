"""A run seen from above, in millimetres: where the object was, where it was thought to be, and the sensor."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.lines import closed_outline, ellipses_95
from palpate.pipeline.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

# Okabe and Ito's colours, which people with any colour vision tell apart, and greys.
TRUTH, ESTIMATE, SENSOR, START = "#7F7F7F", "#0072B2", "#D55E00", "#AAAAAA"
_ELLIPSES = 12
"""Ellipses that are drawn along the whole path."""


def draw_above(axes: "Axes", run: Run, instants: list[int]) -> None:
    """Draw the whole way, the object at numbered instants and, stronger, at the end."""
    last = len(run.online) - 1
    draw_start(axes, run)
    draw_way(axes, run, last)
    along = np.linspace(0, last, _ELLIPSES).astype(int)
    axes.plot(*_joined(_ellipses(run, along)).T, color=ESTIMATE, lw=0.7, alpha=0.7, label="95 % ellipses")
    for number, index in enumerate(instants, 1):
        draw_object(axes, run, index, 1.0, 0.6)
        draw_sensor(axes, run, index)
        x, y, yaw = run.recording.sensor_pose[index]
        draw_number(axes, number, (1e3 * x, 1e3 * y), -32.0 * np.array([np.cos(yaw), np.sin(yaw)]))
    draw_object(axes, run, last, 1.8, 1.0)
    draw_sensor(axes, run, last)
    frame_above(axes)


def frame_above(axes: "Axes") -> None:
    """Give the view its axes."""
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.25)


def draw_start(axes: "Axes", run: Run) -> None:
    """Draw the outline where tracking began."""
    axes.plot(*_placed(run, run.first_pose), color=START, lw=1.0, ls=":", label="start")


def draw_way(axes: "Axes", run: Run, last: int) -> None:
    """Draw the ways of object, estimate and sensor up to a frame."""
    shown = slice(0, last + 1)
    sensor = run.recording.sensor_pose[shown, :2]
    contact = np.zeros(len(sensor), np.bool_) if run.online.contact is None else run.online.contact[shown]
    if known_truth(run) is not None:
        assert run.truth is not None
        axes.plot(*_millimetres(run.truth[shown, :2]), color=TRUTH, lw=3.0, label="truth")
    axes.plot(*_millimetres(run.online.pose[shown, :2]), color=ESTIMATE, lw=1.4, label="estimate")
    axes.plot(*_millimetres(sensor), color=SENSOR, lw=0.8, ls=":")
    touching = np.where(contact[:, None], sensor, np.nan)
    axes.plot(*_millimetres(touching), color=SENSOR, lw=1.6, label="sensor (dotted: no contact)")


def draw_object(axes: "Axes", run: Run, index: int, width: float, alpha: float) -> None:
    """Draw the object at a frame: the true outline, where it is known, the estimated one, and the ellipse of 95 %."""
    known = known_truth(run)
    if known is not None and known[index]:
        assert run.truth is not None
        axes.fill(*_placed(run, run.truth[index]), color=TRUTH, alpha=0.12, lw=0)
        axes.plot(*_placed(run, run.truth[index]), color=TRUTH, lw=1.8 * width, alpha=alpha)
    axes.plot(*_placed(run, run.online.pose[index]), color=ESTIMATE, lw=width, alpha=alpha)
    (ellipse,) = _ellipses(run, np.array([index]))
    axes.fill(*_millimetres(ellipse), facecolor=ESTIMATE, alpha=0.25, lw=0)
    axes.plot(*_millimetres(ellipse), color=ESTIMATE, lw=1.0)


def draw_sensor(axes: "Axes", run: Run, index: int) -> None:
    """Draw the sensor's pads at a frame."""
    for pad in run.recording.sensor.pads:
        at = se2.transform(run.recording.sensor_pose[index], pad)
        axes.fill(*_millimetres(at), color=SENSOR, alpha=0.8, lw=0)


def draw_number(axes: "Axes", number: int, place: Any, away: Any = (0.0, 0.0), coordinates: Any = "data") -> None:
    """Write a number in a circle at a place, or so many points away from it."""
    axes.annotate(
        str(number),
        place,
        away,
        coordinates,
        "offset points",
        ha="center",
        va="center",
        fontsize=9,
        bbox={"boxstyle": "circle,pad=0.25", "facecolor": "white", "edgecolor": SENSOR},
        zorder=5,
    )


def known_truth(run: Run) -> NDArray[np.bool_] | None:
    """Return the frames (N,) with ground truth, None if there are none."""
    if run.truth is None:
        return None
    known = np.isfinite(run.truth[:, 0])
    return known if known.any() else None


def _placed(run: Run, pose: Array) -> Array:
    """The closed outline (2, P) [mm] at a pose."""
    return _millimetres(se2.transform(pose, closed_outline(run.recording.shape)))


def _ellipses(run: Run, frames: NDArray[np.intp]) -> Array:
    """The ellipses (M, P, 2) [m] of M frames."""
    assert run.online.covariance is not None
    return ellipses_95(run.online.pose[frames], run.online.covariance[frames])


def _joined(lines: Array) -> Array:
    """Lines (M, P, 2) [m] as one (K, 2) [mm] with gaps."""
    gaps = np.full((len(lines), 1, 2), np.nan)
    return 1e3 * np.concatenate((lines, gaps), axis=1).reshape(-1, 2)


def _millimetres(points: Array) -> Array:
    return 1e3 * points.T
