"""The figure of a run: the push from above, and errors over time, in mm and degrees."""

import logging
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import Array
from palpate.errors import one_line
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.metrics import deviations, flag_runs, pose_words, rotation_errors, translation_errors
from palpate.pipeline.push_calibration import NUMBERS, PushFit
from palpate.pipeline.track import Run
from palpate.types.estimate import Status

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)

# The colours of Okabe and Ito, which people with any colour vision can tell apart, and greys.
TRUTH, ESTIMATE, SENSOR, CONTACT = "#7F7F7F", "#0072B2", "#D55E00", "#E69F00"
START, OTHERS = "#AAAAAA", "#CC79A7"

STATUS_COLOURS: dict[Status, str] = {
    "tracking": "#009E73",
    "resting": "#A6B8C2",
    "ambiguous": "#E69F00",
    "strained": "#D55E00",
    "uncertain": "#F0E442",
    "displaced": "#CC79A7",
    "indeterminate": "#7F3FBF",
    "faulty": "#B00020",
}


@contextmanager
def own_style(**settings: Any) -> Iterator[None]:
    """Draw with Matplotlib's defaults and some settings, whatever a matplotlibrc of the user says."""
    from matplotlib import style

    with style.context(["default", settings]):
        yield


def draw(path: Path, write: Callable[[Path], object]) -> None:
    """Write a drawing that a run can do without: if that fails, a warning says so and nothing else is lost."""
    try:
        with own_style(), whole_file(path, overwrite=True) as part:
            write(part)
    except Exception as error:  # of a library, by its fonts, the data or the environment
        logger.warning("%s is left out: %s: %s", path.name, type(error).__name__, one_line(error))


def run_figure(run: Run, at_end: bool = True) -> "Figure":
    """Draw a run: from above on the left, errors and status over time on the right; the object at the end if wanted."""
    from matplotlib.figure import Figure

    online, last = run.online, len(run.online) - 1
    figure = Figure(figsize=(11.5, 5.8))
    # Fixed margins: a layout that fits itself to the texts takes as long as the drawing.
    figure.subplots_adjust(left=0.07, right=0.99, bottom=0.19, top=0.84, wspace=0.15, hspace=0.1)
    grid = figure.add_gridspec(3, 2, height_ratios=(3.0, 3.0, 0.4))
    above, translation = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    rotation, status = (figure.add_subplot(grid[row, 1], sharex=translation) for row in (1, 2))
    above.plot(*outline_at(run, run.first_pose), color=START, lw=1.0, ls=":", label="start")
    if run.summary["scored_frames"]:
        above.plot(*millimetres(run.recording.truth[:, :2]), color=TRUTH, lw=3.0, label="truth")
    above.plot(*millimetres(online.pose[:, :2]), color=ESTIMATE, lw=1.4, label="estimate")
    sensor = run.recording.sensor_pose[:, :2]
    above.plot(*millimetres(sensor), color=SENSOR, lw=0.8, ls=":")
    touching = np.where(online.contact[:, None], sensor, np.nan)
    above.plot(*millimetres(touching), color=SENSOR, lw=1.6, label="sensor (dotted: no contact)")
    frames = np.linspace(0, last, 12).astype(int)
    ellipses = ellipses_95(online.pose[frames], online.covariance[frames])
    lines = np.insert(ellipses, ellipses.shape[1], np.nan, axis=1)  # one line with gaps
    above.plot(*millimetres(lines.reshape(-1, 2)), color=ESTIMATE, lw=0.7, alpha=0.7, label="95 % ellipses")
    above.set(xlabel="x [mm]", ylabel="y [mm]")
    above.set_aspect("equal", adjustable="datalim")
    above.grid(alpha=0.25)
    for artist in draw_moment(above, run, last):  # the view has room for it
        artist.set_visible(at_end)
    draw_errors(translation, rotation, run)
    time = online.time - online.time[0]
    for word, colour in STATUS_COLOURS.items():
        for first, end in flag_runs(np.array(online.status) == word):
            status.axvspan(time[first], time[min(end + 1, last)], color=colour, lw=0, label=word)
    status.set(yticks=[], xlabel="time [s]")
    figure.suptitle(title_of(run), y=0.98, fontsize=11, parse_math=False)
    pairs = (zip(*axes.get_legend_handles_labels(), strict=True) for axes in (above, translation, status))
    handles = {label: handle for some in pairs for handle, label in some}
    figure.legend(handles.values(), handles, loc="lower center", ncols=8, frameon=False, fontsize=9)
    return figure


def push_figure(fit: PushFit) -> "Figure":
    """Draw each number of a calibration by pushes with one sigma: usual, by single pushes, and by all together."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    for axes, (name, unit), row in zip(figure.subplots(2, 3).flat, NUMBERS.items(), range(len(NUMBERS)), strict=True):
        (usual, wide), (found, sigma) = unit * fit.before[row], unit * fit.after[row]
        axes.axhspan(usual - wide, usual + wide, color=TRUTH, alpha=0.2, lw=0, label="usual robot")
        axes.axhspan(found - sigma, found + sigma, color=ESTIMATE, alpha=0.3, lw=0)
        axes.axhline(found, color=ESTIMATE, label="all pushes")
        if row < fit.each.shape[1]:
            mean, deviation = unit * fit.each[:, row].T
            axes.errorbar(np.arange(1, len(mean) + 1), mean, deviation, fmt="o", ms=3, color="black", label="one push")
        axes.set_title(name, fontsize=10)
        axes.set_xlim(0.5, len(fit.each) + 0.5)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def draw_moment(axes: "Axes", run: Run, frame: int) -> "list[Artist]":
    """Draw the object and the sensor's pads at a frame."""
    drawn: list[Artist] = []
    if np.isfinite(truth := run.recording.truth[frame]).all():
        drawn += axes.fill(*outline_at(run, truth), facecolor=TRUTH, edgecolor=TRUTH, alpha=0.2, lw=3.0)
    drawn += axes.plot(*outline_at(run, run.online.pose[frame]), color=ESTIMATE, lw=1.8)
    for pad in run.recording.sensor.pads:
        placed = millimetres(se2.transform(run.recording.sensor_pose[frame], pad))
        drawn += axes.fill(*placed, color=SENSOR, alpha=0.8, lw=0)
    return drawn


def draw_errors(translation: "Axes", rotation: "Axes", run: Run) -> None:
    """Draw translation and rotation errors with their sigma over time, or sigma alone without truth."""
    online, time = run.online, run.online.time - run.online.time[0]
    distance, angle = deviations(online.covariance)
    shade: Any = {"color": CONTACT, "alpha": 0.12, "lw": 0, "label": "contact"}
    is_scored, truth = bool(run.summary["scored_frames"]), run.recording.truth
    off, turned = translation_errors(online.pose, truth), rotation_errors(online.pose, truth)
    for axes, name, error, sigma, least in (
        (translation, "translation {} [mm]", off * 1e3, distance * 1e3, 0.0),
        (rotation, "rotation {} [°]", np.degrees(turned), np.degrees(angle), -1.0),
    ):
        axes.fill_between(time, 0.0, 1.0, online.contact, step="post", transform=axes.get_xaxis_transform(), **shade)
        axes.fill_between(time, least * sigma, sigma, color=ESTIMATE, alpha=0.3, lw=0, label="1 sigma of the estimate")
        top = float(np.percentile(sigma, 99)) * 1.1
        if is_scored:
            axes.plot(time, error, color="black", lw=1.3, label="error")
            worst = float(np.nanmax(np.abs(error)))
            top = max(1.1 * worst, min(top, 4.0 * worst))  # as much of the band as leaves the error readable
        top = top or 1.0
        axes.set(xlim=(time[0], time[-1] if len(time) > 1 else time[0] + 1.0), ylim=(least * top, top))
        axes.set(ylabel=name.format("error" if is_scored else "1 sigma"))
        axes.tick_params(labelbottom=False)
        axes.grid(alpha=0.25)
    rotation.axhline(0.0, color=START, lw=0.8)


def title_of(run: Run) -> str:
    """Return three lines: the name, the final pose with its status, and its error."""
    summary, file = run.summary, run.recording.file
    # The name of a file may contain bytes that are not text.
    name = file.name.encode("utf-8", "replace").decode() if file else run.recording.source or "recording"
    name, status = textwrap.shorten(name, 120, placeholder=" ..."), run.online.status[-1]
    pose = pose_words(summary["final_pose"], summary["final_sigma"])
    error = "no ground truth"
    if summary["scored_frames"]:
        translation, rotation = summary["final_translation_error_mm"], summary["final_rotation_error_deg"]
        seconds = summary["final_scored_time_s"] - run.online.time[0]
        error = f"final error {translation:.1f} mm and {rotation:.1f}°, at {seconds:.1f} s"
    return f"{name}\nfinal pose {pose} (1 sigma), {status}\n{error}"


def outline_at(run: Run, pose: Array) -> Array:
    """Return the closed outline (2, P) [mm] at a pose (3,)."""
    outline = run.recording.shape.outline(100)
    return millimetres(se2.transform(pose, np.concatenate((outline, outline[:1]))))


def millimetres(points: Array) -> Array:
    """Return points (P, 2) [m] as x and y [mm]."""
    return 1e3 * points.T
