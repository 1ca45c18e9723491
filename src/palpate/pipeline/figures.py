"""The figure of a run: the push from above, touch images, and errors over time, in mm and degrees."""

import logging
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, one_line
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.metrics import deviations, pose_words, rotation_errors, translation_errors
from palpate.pipeline.track import Run
from palpate.pipeline.truth import flag_runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

# The colours of Okabe and Ito, which people with any colour vision can tell apart, and greys.
TRUTH, ESTIMATE, SENSOR, START, CONTACT = "#7F7F7F", "#0072B2", "#D55E00", "#AAAAAA", "#E69F00"


@contextmanager
def own_style(**settings: Any) -> Iterator[None]:
    """Draw with Matplotlib's defaults and some settings, whatever a matplotlibrc of the user says."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        for name, value in settings.items():
            mpl.rcParams[name] = value  # pyright: ignore[reportArgumentType]
        yield


@contextmanager
def drawing(what: str) -> Iterator[None]:
    """Draw what a run can do without: if that fails, a warning says so and nothing else is lost."""
    try:
        with own_style():
            yield
    except Exception as error:  # of a library, by its fonts or the data
        logger.warning("%s is left out: %s: %s", what, type(error).__name__, one_line(error))


def run_figure(run: Run) -> "Figure":
    """Draw a run: from above on the left; on the right touch images, if any, and the errors over time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    instants = shown_instants(run)
    has_touch = run.recording.image is not None and len(instants) > 0
    heights = [1.3, 0.25, 1.0, 1.0] if has_touch else [1.0, 1.0]  # below touch, room for its axis
    width, height = 11.5, 7.4 if has_touch else 5.8
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    # Margins in inches; a layout that fits itself to the texts takes as long as the drawing.
    margins: Any = {"left": 0.8 / width, "right": 1.0 - 0.1 / width, "bottom": 0.85 / height, "top": 1.0 - 0.9 / height}
    grid = figure.add_gridspec(
        len(heights), 2, width_ratios=(1.05, 1.0), height_ratios=heights, wspace=0.15, hspace=0.1, **margins
    )
    above, translation = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[-2, 1])
    draw_above(above, run, len(run.online) - 1, instants)
    draw_errors(translation, figure.add_subplot(grid[-1, 1], sharex=translation), run, instants)
    if has_touch:
        strip = grid[0, 1].subgridspec(1, len(instants))
        for number, index in enumerate(instants, 1):
            axes = figure.add_subplot(strip[number - 1])
            draw_touch(axes, run, index)
            axes.tick_params(labelleft=number == 1)
            axes.set_ylabel("z on the pad [mm]" if number == 1 else "")
            _draw_number(axes, number, (0.0, 1.0), (11.0, -11.0), axes.transAxes)
    figure.suptitle(_title(run), y=1.0 - 0.08 / height, fontsize=11, parse_math=False)
    handles = {
        str(one.get_label()): one for axes in (above, translation) for one in axes.get_legend_handles_labels()[0]
    }
    place: Any = {"loc": "lower center", "ncols": min(len(handles), 8), "frameon": False, "fontsize": 9}
    figure.legend(list(handles.values()), list(handles), **place)
    return figure


def shown_instants(run: Run) -> list[int]:
    """Return the middle frames of the three longest contacts."""
    longest = sorted(flag_runs(_contact(run)), key=lambda ends: ends[1] - ends[0])[-3:]
    return sorted((first + last) // 2 for first, last in longest)


def draw_above(axes: "Axes", run: Run, last: int, instants: Sequence[int] = ()) -> None:
    """Draw the paths up to a frame, the object at numbered instants and, stronger, at that frame."""
    axes.plot(*_placed(run, run.first_pose), color=START, lw=1.0, ls=":", label="start")
    draw_path(axes, run, last)
    ellipses = _ellipses(run, np.linspace(0, last, 12).astype(int))
    lines = np.insert(ellipses, ellipses.shape[1], np.nan, axis=1)  # one line with gaps
    axes.plot(*_millimetres(lines.reshape(-1, 2)), color=ESTIMATE, lw=0.7, alpha=0.7, label="95 % ellipses")
    for number, index in enumerate(instants, 1):
        _draw_object(axes, run, index, 1.0, 0.6)
        x, y, yaw = run.recording.sensor_pose[index]
        _draw_number(axes, number, (1e3 * x, 1e3 * y), -32.0 * np.array([np.cos(yaw), np.sin(yaw)]))
    _draw_object(axes, run, last, 1.8, 1.0)
    frame_above(axes)


def draw_path(axes: "Axes", run: Run, last: int) -> None:
    """Draw the paths of object, estimate and sensor up to a frame."""
    sensor = run.recording.sensor_pose[: last + 1, :2]
    if run.summary["scored_frames"]:
        axes.plot(*_millimetres(_truth(run)[: last + 1, :2]), color=TRUTH, lw=3.0, label="truth")
    axes.plot(*_millimetres(run.online.pose[: last + 1, :2]), color=ESTIMATE, lw=1.4, label="estimate")
    axes.plot(*_millimetres(sensor), color=SENSOR, lw=0.8, ls=":")
    touching = np.where(_contact(run)[: last + 1, None], sensor, np.nan)
    axes.plot(*_millimetres(touching), color=SENSOR, lw=1.6, label="sensor (dotted: no contact)")


def frame_above(axes: "Axes") -> None:
    """Set labels, aspect and grid of the view from above."""
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.25)


def draw_touch(axes: "Axes", run: Run, index: int) -> None:
    """Draw the touch image of a frame, upright and in millimetres of the pad."""
    sensor = run.recording.sensor
    right = (sensor.half_width or 0.5e-3 * sensor.image_width) * 1e3
    up = right * sensor.image_height / sensor.image_width
    with suppress(FileError):  # a damaged image
        axes.imshow(np.asarray(run.recording[index].image), extent=(-right, right, -up, up))
    axes.set(xlabel="y on the pad [mm]")
    axes.set_title(f"touch at {_seconds(run)[index]:.1f} s", fontsize=10)
    axes.locator_params(nbins=6)


def draw_errors(translation: "Axes", rotation: "Axes", run: Run, instants: Sequence[int] = ()) -> None:
    """Draw translation and rotation errors with their sigma over time, or sigma alone without truth."""
    assert run.online.covariance is not None
    distance, angle = deviations(run.online.covariance)
    distance, angle = distance * 1e3, np.degrees(angle)
    kind, off, turned = "1 sigma", None, None
    if run.summary["scored_frames"]:
        kind, off = "error", translation_errors(run.online.pose, _truth(run)) * 1e3
        turned = np.degrees(rotation_errors(run.online.pose, _truth(run)))
    _draw_error(translation, run, off, np.zeros_like(distance), distance)
    _draw_error(rotation, run, turned, -angle, angle)
    for number, index in enumerate(instants, 1):
        _draw_number(translation, number, (_seconds(run)[index], 1.0), (0.0, -9.0), translation.get_xaxis_transform())
    translation.set(ylabel=f"translation {kind} [mm]")
    translation.tick_params(labelbottom=False)
    rotation.axhline(0.0, color=START, lw=0.8)
    rotation.set(ylabel=f"rotation {kind} [°]", xlabel="time [s]")


def _draw_object(axes: "Axes", run: Run, index: int, width: float, alpha: float) -> None:
    """Draw the object at a frame, true outline, if known, estimated outline and 95 % ellipse, and the sensor's pads."""
    if np.isfinite(truth := _truth(run)[index]).all():
        axes.fill(*_placed(run, truth), color=TRUTH, alpha=0.12, lw=0)
        axes.plot(*_placed(run, truth), color=TRUTH, lw=1.8 * width, alpha=alpha)
    axes.plot(*_placed(run, run.online.pose[index]), color=ESTIMATE, lw=width, alpha=alpha)
    (ellipse,) = _ellipses(run, np.array([index]))
    axes.fill(*_millimetres(ellipse), facecolor=ESTIMATE, alpha=0.25, lw=0)
    axes.plot(*_millimetres(ellipse), color=ESTIMATE, lw=1.0)
    for pad in run.recording.sensor.pads:
        axes.fill(*_millimetres(se2.transform(run.recording.sensor_pose[index], pad)), color=SENSOR, alpha=0.8, lw=0)


def _draw_number(axes: "Axes", number: int, place: Any, shift: Any, coordinates: Any = "data") -> None:
    """Draw a number in a circle at a place, shifted by some points."""
    box = {"boxstyle": "circle,pad=0.25", "facecolor": "white", "edgecolor": SENSOR}
    style: Any = {"ha": "center", "va": "center", "fontsize": 9, "bbox": box, "zorder": 5}
    axes.annotate(str(number), place, shift, coordinates, "offset points", **style)


def _draw_error(axes: "Axes", run: Run, error: Array | None, below: Array, above: Array) -> None:
    time = _seconds(run)
    shade: Any = {"color": CONTACT, "alpha": 0.12, "lw": 0, "label": "contact"}
    for first, last in flag_runs(_contact(run)):
        axes.axvspan(time[first], time[min(last + 1, len(time) - 1)], **shade)
    band: Any = {"color": ESTIMATE, "alpha": 0.3, "lw": 0, "label": "1 sigma of the estimate"}
    axes.fill_between(time, below, above, **band)
    top = float(np.percentile(above, 99)) * 1.1
    if error is not None:
        axes.plot(time, error, color="black", lw=1.3, label="error")
        worst = float(np.nanmax(np.abs(error)))
        top = max(1.1 * worst, min(top, 4.0 * worst))  # as much of the band as leaves the error readable
    top = top or 1.0
    axes.set(xlim=(time[0], time[-1] if len(time) > 1 else time[0] + 1.0), ylim=(-top if below.any() else 0.0, top))
    axes.grid(alpha=0.25)


def _title(run: Run) -> str:
    summary, file = run.summary, run.recording.file
    # The name of a file may contain bytes that are not text.
    name = file.name.encode("utf-8", "replace").decode() if file else run.recording.source or "recording"
    pose = pose_words(summary["final_pose"], summary["final_sigma"])
    error = "no ground truth"
    if summary["scored_frames"]:
        translation, rotation = summary["final_translation_error_mm"], summary["final_rotation_error_deg"]
        seconds = summary["final_scored_time_s"] - run.online.time[0]
        error = f"final error {translation:.1f} mm and {rotation:.1f}°, at {seconds:.1f} s"
    kind = f"tactile {summary['tactile']}, {summary['smoother']}"
    return f"{textwrap.shorten(name, 120, placeholder=' ...')}\n{kind}; final pose {pose} (1 sigma)\n{error}"


def _seconds(run: Run) -> Array:
    """Return times (N,) [s] since the first frame."""
    return run.online.time - run.online.time[0]


def _contact(run: Run) -> NDArray[np.bool_]:
    assert run.online.contact is not None
    return run.online.contact


def _truth(run: Run) -> Array:
    """Return ground truth (N, 3), NaN where it is unknown."""
    return np.full_like(run.online.pose, np.nan) if run.truth is None else run.truth


def _placed(run: Run, pose: Array) -> Array:
    """Return the closed outline (2, P) [mm] at a pose."""
    return _millimetres(se2.transform(pose, run.recording.shape.closed_outline))


def _ellipses(run: Run, frames: NDArray[np.intp]) -> Array:
    """Return the 95 % ellipses (M, P, 2) [m] of M frames."""
    assert run.online.covariance is not None
    return ellipses_95(run.online.pose[frames], run.online.covariance[frames])


def _millimetres(points: Array) -> Array:
    return 1e3 * points.T
