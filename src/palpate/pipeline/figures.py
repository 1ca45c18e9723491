"""The figure of a run: where the object went, what touch saw and how wrong the estimate was."""

import textwrap
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.pipeline.above import ESTIMATE, draw_above, draw_number, known_truth
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.poses import pose_words
from palpate.pipeline.run import Run
from palpate.pipeline.time_gaps import time_gaps
from palpate.pipeline.truth import flag_runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

ERROR, CONTACT, UNKNOWN = "#000000", "#E69F00", "#999999"
INSTANTS = 3
"""Frames of contact that are shown from above and, where there are images, as the sensor saw them."""


def run_figure(run: Run) -> "Figure":
    """Draw a run: the view from above on the left; on the right the errors over time, below touch images if any."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    instants = shown_instants(run)
    felt = run.recording.image is not None and len(instants) > 0
    figure = Figure(figsize=(11.5, 7.4 if felt else 5.8), layout="constrained")
    FigureCanvasAgg(figure)
    heights = [1.3, 1.0, 1.0] if felt else [1.0, 1.0]
    grid = figure.add_gridspec(len(heights), 2, width_ratios=(1.05, 1.0), height_ratios=heights)
    above = figure.add_subplot(grid[:, 0])
    translation = figure.add_subplot(grid[-2, 1])
    rotation = figure.add_subplot(grid[-1, 1], sharex=translation)
    draw_above(above, run, instants)
    draw_errors(translation, rotation, run, instants)
    if felt:
        strip = grid[0, 1].subgridspec(1, len(instants))
        _draw_strip([figure.add_subplot(place) for place in strip], run, instants)
    figure.suptitle(_title(run), fontsize=11, parse_math=False)
    handles = {}
    for axes in (above, translation):
        found, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside lower center",
        ncols=min(len(handles), 8),
        frameon=False,
        fontsize=9,
    )
    return figure


def shown_instants(run: Run) -> list[int]:
    """Frames in the middle of the longest contacts, as tracking found them.

    Where contacts are too few, the longest are cut into parts.
    """
    contact = run.online.contact
    parts = sorted([] if contact is None else flag_runs(contact), key=_length)[-INSTANTS:]
    while parts and len(parts) < INSTANTS and _length(parts[-1]) > 1:
        first, last = parts.pop()
        middle = (first + last) // 2
        parts = sorted([*parts, (first, middle), (middle + 1, last)], key=_length)
    return sorted((first + last) // 2 for first, last in parts)


def _length(part: tuple[int, int]) -> int:
    return part[1] - part[0] + 1


def _title(run: Run) -> str:
    summary, file = run.summary, run.recording.file
    # A file's name may hold bytes that are no text.
    name = file.name.encode("utf-8", "replace").decode() if file else run.recording.source or "recording"
    pose = pose_words(summary["final_pose"], summary["final_sigma"])
    lines = [
        textwrap.shorten(name, 120, placeholder=" ..."),
        f"tactile {summary['tactile']}, {summary['smoother']}; final pose {pose} (1 sigma)",
        "no ground truth",
    ]
    if summary["scored_frames"]:
        when = summary["final_scored_time_s"] - run.online.time[0]
        lines[-1] = (
            f"final error {summary['final_translation_error_mm']:.1f} mm and "
            f"{summary['final_rotation_error_deg']:.1f}°, at {when:.1f} s"
        )
    return "\n".join(lines)


def _seconds(run: Run) -> Array:
    """Times (N,) [s] since the first frame."""
    return run.online.time - run.online.time[0]


def _draw_strip(strip: list["Axes"], run: Run, instants: list[int]) -> None:
    for number, (axes, index) in enumerate(zip(strip, instants, strict=True), 1):
        draw_touch(axes, run, index)
        axes.tick_params(labelleft=number == 1)
        draw_number(axes, number, (0.0, 1.0), (11.0, -11.0), axes.transAxes)
    strip[0].set_ylabel("z on the pad [mm]")


def draw_touch(axes: "Axes", run: Run, index: int) -> None:
    """Draw the touch image of a frame, upright and in millimetres of the pad."""
    sensor, image = run.recording.sensor, run.recording[index].image
    assert image is not None
    right = (sensor.half_width or 0.5e-3 * sensor.image_width) * 1e3
    up = right * sensor.image_height / sensor.image_width
    axes.imshow(image, extent=(-right, right, -up, up))
    axes.set(xlabel="y on the pad [mm]")
    axes.set_title(f"touch at {_seconds(run)[index]:.1f} s", fontsize=10)
    axes.locator_params(nbins=6)


def draw_errors(translation: "Axes", rotation: "Axes", run: Run, instants: list[int]) -> None:
    """Draw the errors of translation and rotation over time with their sigma, or sigma alone where no truth is known.

    The instants are numbered.
    """
    assert run.online.covariance is not None
    distance, angle = deviations(run.online.covariance)
    distance, angle = distance * 1e3, np.degrees(angle)
    errors: list[Array | None] = [None, None]
    if run.truth is not None and known_truth(run) is not None:
        errors = [
            translation_errors(run.online.pose, run.truth) * 1e3,
            np.degrees(rotation_errors(run.online.pose, run.truth)),
        ]
    words = "1 sigma" if errors[0] is None else "error"
    _draw_error(translation, run, errors[0], np.zeros_like(distance), distance)
    _draw_error(rotation, run, errors[1], -angle, angle)
    for number, index in enumerate(instants, 1):
        draw_number(translation, number, (_seconds(run)[index], 1.0), (0.0, -9.0), translation.get_xaxis_transform())
    translation.set(ylabel=f"translation {words} [mm]")
    translation.tick_params(labelbottom=False)
    rotation.axhline(0.0, color=UNKNOWN, lw=0.8)
    rotation.set(ylabel=f"rotation {words} [°]", xlabel="time [s]")


def _draw_error(axes: "Axes", run: Run, error: Array | None, below: Array, above: Array) -> None:
    time = _seconds(run)
    _shade(axes, run)
    times, low, high = _with_gaps(time, below, above)
    axes.fill_between(times, low, high, color=ESTIMATE, alpha=0.3, lw=0, label="1 sigma of the estimate")
    if error is not None:
        axes.plot(*_with_gaps(time, error), color=ERROR, lw=1.3, label="error")
    _limit(axes, error, above, signed=bool((below < 0).any()))
    axes.grid(alpha=0.25)
    axes.set_xlim(time[0], time[-1] if len(time) > 1 else time[0] + 1.0)


def _shade(axes: "Axes", run: Run) -> None:
    """Shade contact, and hatch where truth is not known."""
    time, known = _seconds(run), known_truth(run)
    spans = []
    if run.online.contact is not None:
        spans.append((run.online.contact, {"color": CONTACT, "alpha": 0.12, "lw": 0, "label": "contact"}))
    if known is not None:
        style = {
            "facecolor": "none",
            "edgecolor": UNKNOWN,
            "hatch": "////",
            "lw": 0,
            "label": "truth unknown",
        }
        spans.append((~known, style))
    # A frame stands for the time up to the next one, and at a gap for itself only.
    ends = np.append(time[1:], time[-1])
    gaps = time_gaps(time)
    ends[gaps] = time[gaps]
    for flags, style in spans:
        for first, last in flag_runs(flags):
            cuts = [first, *(gaps[(gaps >= first) & (gaps < last)] + 1), last + 1]
            for start, end in pairwise(cuts):
                axes.axvspan(float(time[start]), float(ends[end - 1]), **style)


def _with_gaps(time: Array, *columns: Array) -> list[Array]:
    """Time and columns (N,) with a NaN at each gap in time, so that lines end there."""
    after = time_gaps(time) + 1
    return [
        np.insert(time, after, time[after - 1]),
        *(np.insert(column, after, np.nan) for column in columns),
    ]


def _limit(axes: "Axes", error: Array | None, width: Array, signed: bool) -> None:
    """Show all of the error, and of the band what leaves the error readable."""
    top = float(np.percentile(width, 99)) * 1.1
    if error is not None:
        worst = float(np.nanmax(np.abs(error)))
        top = max(1.1 * worst, min(top, 4.0 * worst))
    top = top or 1.0
    axes.set_ylim(-top if signed else 0.0, top)
