"""The figure of a run: the push from above, and errors over time, in mm and degrees."""

import logging
import math
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
from palpate.pipeline.learnt_outline import is_anywhere
from palpate.pipeline.metrics import deviations, flag_runs, pose_words, rotation_errors, translation_errors
from palpate.pipeline.track import Run
from palpate.types.estimate import Status

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)

# The colours of Okabe and Ito, which people with any colour vision can tell apart, and greys.
TRUTH = "#7F7F7F"
ESTIMATE = "#0072B2"
SENSOR = "#D55E00"
CONTACT = "#E69F00"
START = "#AAAAAA"
OTHERS = "#CC79A7"

TOUCHED_STYLE: Any = {"color": ESTIMATE, "lw": 4.0, "solid_capstyle": "butt"}

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
    """Draw with Matplotlib's defaults and some settings, not those in the user's matplotlibrc."""
    from matplotlib import style

    with style.context(["default", settings]):
        yield


def draw(path: Path, write: Callable[[Path], object]) -> None:
    """Write a drawing that a run does not need: if that fails, a warning says so and the run goes on."""
    try:
        with own_style(), whole_file(path, overwrite=True) as part:
            write(part)
    except Exception as error:  # of a library, caused by its fonts, the data or the environment
        logger.warning("%s is left out: %s: %s", path.name, type(error).__name__, one_line(error))


def run_figure(run: Run, at_end: bool = True) -> "Figure":
    """Draw a run: from above on the left, errors and status over time on the right.

    The object and the sensor at the last frame are drawn unless `at_end` is false; the view has room for them anyway.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 5.8))
    # Fixed margins: a layout that fits itself to the texts takes as long as the drawing.
    figure.subplots_adjust(left=0.07, right=0.99, bottom=0.19, top=0.84, wspace=0.15, hspace=0.1)
    grid = figure.add_gridspec(3, 2, height_ratios=(3.0, 3.0, 0.4))
    above = figure.add_subplot(grid[:, 0])
    translation = figure.add_subplot(grid[0, 1])
    rotation = figure.add_subplot(grid[1, 1], sharex=translation)
    status = figure.add_subplot(grid[2, 1], sharex=translation)
    draw_from_above(above, run)
    for artist in draw_moment(above, run, len(run.online) - 1):
        artist.set_visible(at_end)
    if not at_end:
        name_others(above, run)
    draw_errors(translation, rotation, run)
    draw_status(status, run)
    figure.suptitle(title_of(run), y=0.98, fontsize=11, parse_math=False)
    handles: dict[str, Any] = {}  # by label, so that one that several axes have is shown once
    for axes in (above, translation, status):
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles[label] = handle
    narrow: Any = {"columnspacing": 1.2, "handletextpad": 0.5}  # so that it is not cut if every status is named
    columns = math.ceil(len(handles) / math.ceil(len(handles) / 8))  # rows of equal length
    figure.legend(handles.values(), handles, loc="lower center", ncols=columns, frameon=False, fontsize=9, **narrow)
    return figure


def draw_from_above(axes: "Axes", run: Run) -> None:
    """Draw the paths of object and sensor, the outline at the start, and ellipses of the estimate, from above."""
    online = run.online
    if not run.outlines:
        axes.plot(*outline_at(run, run.first_pose), color=START, lw=1.0, ls=":", label="start")
    if run.summary["scored_frames"]:
        axes.plot(*millimetres(run.recording.truth[:, :2]), color=TRUTH, lw=3.0, label="truth")
    axes.plot(*millimetres(online.pose[:, :2]), color=ESTIMATE, lw=1.4, label="estimate")
    for index, (_, pose) in enumerate(run.recording.tips()):
        sensor = pose[: len(online), :2]
        axes.plot(*millimetres(sensor), color=SENSOR, lw=0.8, ls=":")
        touching = np.where(online.contact[:, None], sensor, np.nan)
        label = "" if index else "sensor (dotted: no contact)"
        axes.plot(*millimetres(touching), color=SENSOR, lw=1.6, label=label)
    frames = np.linspace(0, len(online) - 1, 12).astype(int)
    if run.outlines:
        axes.fill([], [], facecolor=ESTIMATE, alpha=0.15, lw=0, label="95 % band of the outline")
        axes.plot([], [], **TOUCHED_STYLE, label="touched")
        frames = frames[frames >= first_placed(run)]
    ellipses = ellipses_95(online.pose[frames], online.covariance[frames])
    lines = np.insert(ellipses, ellipses.shape[1], np.nan, axis=1)  # one line with gaps
    axes.plot(*millimetres(lines.reshape(-1, 2)), color=ESTIMATE, lw=0.7, alpha=0.7, label="95 % ellipses")
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.25)


def name_others(axes: "Axes", run: Run) -> None:
    """Give the legend a line for the other answers, which pages and videos draw, if the run has some."""
    if any(len(answers) > 1 for answers in run.answers):
        axes.plot([], [], color=OTHERS, lw=1.0, label="other answers")


def draw_status(axes: "Axes", run: Run) -> None:
    """Draw the status over time, as a band of colours."""
    time = run.online.time - run.online.time[0]
    last_frame = len(time) - 1
    for status, colour in STATUS_COLOURS.items():
        for first, last in flag_runs(np.array(run.online.status) == status):
            axes.axvspan(time[first], time[min(last + 1, last_frame)], color=colour, lw=0, label=status)
    axes.set(yticks=[], xlabel="time [s]")


def draw_moment(axes: "Axes", run: Run, frame: int) -> "list[Artist]":
    """Draw the object and the sensor's pads at a frame."""
    drawn: list[Artist] = []
    truth = run.recording.truth[frame]
    if np.isfinite(truth).all() and run.recording.is_shape_known:
        drawn += axes.fill(*outline_at(run, truth), facecolor=TRUTH, edgecolor=TRUTH, alpha=0.2, lw=3.0)
    if run.outlines and frame >= first_placed(run):
        drawn += axes.fill(*band_at(run, frame), facecolor=ESTIMATE, alpha=0.15, lw=0)
        drawn += axes.plot(*touched_at(run, frame), **TOUCHED_STYLE)
    if frame >= first_placed(run):
        drawn += axes.plot(*estimated_outline_at(run, frame), color=ESTIMATE, lw=1.8)
    for sensor, pose in run.recording.tips():
        for pad in sensor.pads:
            drawn += axes.fill(*millimetres(se2.transform(pose[frame], pad)), color=SENSOR, alpha=0.8, lw=0)
    return drawn


def draw_errors(translation: "Axes", rotation: "Axes", run: Run) -> None:
    """Draw translation and rotation errors with their sigma over time, or sigma alone without truth."""
    online = run.online
    truth = run.recording.truth
    translation_sigma, rotation_sigma = deviations(online.covariance)
    rotation_sigma = np.minimum(rotation_sigma, np.pi)  # beyond half a turn nothing is known
    distance = 1e3 * translation_errors(online.pose, truth)
    angle = np.degrees(rotation_errors(online.pose, truth))
    _draw_error(translation, run, "translation {} [mm]", distance, 1e3 * translation_sigma, is_signed=False)
    _draw_error(rotation, run, "rotation {} [°]", angle, np.degrees(rotation_sigma), is_signed=True)
    rotation.axhline(0.0, color=START, lw=0.8)


def _draw_error(axes: "Axes", run: Run, name: str, error: Array, sigma: Array, is_signed: bool) -> None:
    """Draw an error (N,) over time, which is NaN without truth, and a band of its sigma (N,)."""
    time = run.online.time - run.online.time[0]
    is_scored = bool(run.summary["scored_frames"])
    least = -1.0 if is_signed else 0.0  # lower end of the axis and of the band, as a multiple of the upper one
    whole_height: Any = axes.get_xaxis_transform()
    contact_style: Any = {"color": CONTACT, "alpha": 0.12, "lw": 0, "label": "contact"}
    axes.fill_between(time, 0.0, 1.0, run.online.contact, step="post", transform=whole_height, **contact_style)
    axes.fill_between(time, least * sigma, sigma, color=ESTIMATE, alpha=0.3, lw=0, label="1 sigma of the estimate")
    placed = sigma[min(first_placed(run), len(sigma) - 1) :]
    top = float(np.percentile(placed, 99)) * 1.1
    if is_scored:
        axes.plot(time, error, color="black", lw=1.3, label="error")
        worst = float(np.nanmax(np.abs(error)))
        top = max(1.1 * worst, min(top, 4.0 * worst))  # as much of the band as leaves the error readable
    top = top or 1.0
    end = time[-1] if len(time) > 1 else time[0] + 1.0
    axes.set(xlim=(time[0], end), ylim=(least * top, top), ylabel=name.format("error" if is_scored else "1 sigma"))
    axes.tick_params(labelbottom=False)
    axes.grid(alpha=0.25)


def title_of(run: Run) -> str:
    """Return three lines: the name, the final pose with its status, and its error."""
    summary = run.summary
    file = run.recording.file
    # The name of a file may contain bytes that are not text.
    name = file.name.encode("utf-8", "replace").decode() if file else run.recording.source or "recording"
    short_name = textwrap.shorten(name, 120, placeholder=" ...")
    pose = pose_words(summary["final_pose"], summary["final_sigma"])
    error = "no ground truth"
    if summary["scored_frames"]:
        translation = summary["final_translation_error_mm"]
        rotation = summary["final_rotation_error_deg"]
        seconds = summary["final_scored_time_s"] - run.online.time[0]
        error = f"final error {translation:.1f} mm and {rotation:.1f}°, at {seconds:.1f} s"
    return f"{short_name}\nfinal pose {pose} (1 sigma), {run.online.status[-1]}\n{error}"


def outline_at(run: Run, pose: Array) -> Array:
    """Return the closed outline (2, P) [mm] at a pose (3,)."""
    outline = run.recording.shape.outline(100)
    return millimetres(se2.transform(pose, np.concatenate((outline, outline[:1]))))


def estimated_outline_at(run: Run, frame: int) -> Array:
    """Return the closed outline (2, P) [mm] as it is known at a frame, at its estimated pose."""
    pose = run.online.pose[frame]
    if not run.outlines:
        return outline_at(run, pose)
    points = run.outlines[frame].points
    return millimetres(se2.transform(pose, np.concatenate((points, points[:1]))))


def band_at(run: Run, frame: int) -> Array:
    """Return the 95 % band of a learnt outline at a frame as one area (2, P) [mm]: its outer edge, then the inner."""
    inner, outer = run.outlines[frame].edges()
    area = np.concatenate((outer, outer[:1], inner[:1], inner[::-1]))
    return millimetres(se2.transform(run.online.pose[frame], area))


def touched_at(run: Run, frame: int) -> Array:
    """Return the touched parts of a learnt outline at a frame (2, P) [mm], NaN in between: half a side to each side."""
    outline = run.outlines[frame]
    points = outline.points
    before = 0.5 * (np.roll(points, 1, axis=0) + points)
    after = 0.5 * (np.roll(points, -1, axis=0) + points)
    pieces = np.stack((before, points, after, np.full_like(points, np.nan)), axis=1)[outline.touched]
    return millimetres(se2.transform(run.online.pose[frame], pieces.reshape(-1, 2)))


def first_placed(run: Run) -> int:
    """Return the first frame at which the object has a place: one that nobody drew may be anywhere until a contact."""
    if not run.outlines or not is_anywhere(run.first_pose_sigma):
        return 0
    return int(np.argmax(np.append(run.online.contact, True)))


def millimetres(points: Array) -> Array:
    """Return points (P, 2) [m] as x and y [mm]."""
    return 1e3 * points.T
