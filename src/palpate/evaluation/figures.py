"""The figure of a run: where the object went and how wrong the estimate was."""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate import se2
from palpate.evaluation.findings import flag_runs, time_gaps
from palpate.evaluation.metrics import rotation_errors, translation_errors
from palpate.evaluation.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Okabe and Ito's colours, which people with any colour vision tell apart.
TRUTH, ESTIMATE, SENSOR = "#000000", "#0072B2", "#D55E00"
CONTACT, UNKNOWN = "#E69F00", "#999999"
INSTANTS = 4
"""Outlines between the first and the last one."""


def run_figure(run: Run) -> "Figure":
    """Draw a run: the view from above on the left, errors over time on the right."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.05, 1.0))
    above = figure.add_subplot(grid[:, 0])
    translation = figure.add_subplot(grid[0, 1])
    rotation = figure.add_subplot(grid[1, 1], sharex=translation)
    _draw_above(above, run)
    _draw_errors(translation, rotation, run)
    figure.suptitle(_title(run), fontsize=12)
    handles = {}
    for axes in (above, translation):
        found, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=9,
    )
    return figure


def _title(run: Run) -> str:
    summary, name = run.summary, run.recording.file.name if run.recording.file else "recording"
    how = f"{name}  (tactile {summary['tactile']}, {summary['smoother']})"
    if summary["scored_frames"] == 0:
        return f"{how}\nno ground truth"
    return (
        f"{how}\nfinal error {summary['final_translation_error_mm']:.1f} mm and "
        f"{summary['final_rotation_error_deg']:.1f}°"
    )


def _draw_above(axes: "Axes", run: Run) -> None:
    known = _known_truth(run)
    final = len(run.online) - 1 if known is None else int(np.flatnonzero(known)[-1])
    outline = run.recording.shape.outline(100)
    closed = np.concatenate([outline, outline[:1]])
    estimate = run.online.pose

    def place(pose: Array, **style: Any) -> None:
        axes.plot(*(se2.transform(pose, closed) * 1e3).T, **style)

    place(run.first_pose, color=UNKNOWN, lw=1.0, ls=":", label="start")
    for index in np.linspace(0, len(estimate) - 1, INSTANTS + 2).astype(int)[1:-1]:
        place(estimate[index], color=ESTIMATE, lw=0.8, alpha=0.3)
    if run.truth is not None and known is not None:
        axes.plot(*(run.truth[:, :2] * 1e3).T, color=TRUTH, lw=2.5, label="truth")
        place(run.truth[final], color=TRUTH, lw=1.8)
    axes.plot(*(estimate[:, :2] * 1e3).T, color=ESTIMATE, lw=1.4, ls="--", label="estimate")
    place(estimate[final], color=ESTIMATE, lw=1.4, ls="--")
    sensor = run.recording.sensor_pose[:, :2] * 1e3
    axes.plot(*sensor.T, color=SENSOR, lw=0.8, ls=":")
    contact = np.zeros(len(sensor), np.bool_) if run.online.contact is None else run.online.contact
    touching = np.where(contact[:, None], sensor, np.nan)
    axes.plot(*touching.T, color=SENSOR, lw=1.6, label="sensor (dotted: no contact)")
    axes.plot(*sensor[-1], color=SENSOR, marker="o", ms=4)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title="View from above")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.25)


def _draw_errors(translation: "Axes", rotation: "Axes", run: Run) -> None:
    assert run.online.covariance is not None
    variance = np.diagonal(run.online.covariance, axis1=1, axis2=2)
    # The expected length of a zero-mean error in the plane, root mean square.
    distance, angle = np.sqrt(variance[:, 0] + variance[:, 1]) * 1e3, np.degrees(np.sqrt(variance[:, 2]))
    errors: list[Array | None] = [None, None]
    if run.truth is not None and _known_truth(run) is not None:
        errors = [
            translation_errors(run.online.pose, run.truth) * 1e3,
            np.degrees(rotation_errors(run.online.pose, run.truth)),
        ]
    words = "1 sigma" if errors[0] is None else "error"
    _draw_error(translation, run, errors[0], np.zeros_like(distance), distance)
    _draw_error(rotation, run, errors[1], -angle, angle)
    translation.set(ylabel=f"translation {words} [mm]", title="Uncertainty" if errors[0] is None else "Error over time")
    translation.tick_params(labelbottom=False)
    rotation.axhline(0.0, color=UNKNOWN, lw=0.8)
    rotation.set(ylabel=f"rotation {words} [°]", xlabel="time [s]")


def _draw_error(axes: "Axes", run: Run, error: Array | None, below: Array, above: Array) -> None:
    time = run.online.time
    _shade(axes, run)
    times, low, high = _with_gaps(time, below, above)
    axes.fill_between(times, low, high, color=ESTIMATE, alpha=0.3, lw=0, label="1 sigma of the estimate")
    if error is not None:
        axes.plot(*_with_gaps(time, error), color=TRUTH, lw=1.3, label="error")
    _limit(axes, error, above, signed=bool((below < 0).any()))
    axes.grid(alpha=0.25)
    axes.set_xlim(time[0], time[-1] if len(time) > 1 else time[0] + 1.0)


def _shade(axes: "Axes", run: Run) -> None:
    """Shade contact, and hatch where truth is not known."""
    time, known = run.online.time, _known_truth(run)
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


def _known_truth(run: Run) -> NDArray[np.bool_] | None:
    """The frames (N,) with ground truth, None if there are none."""
    if run.truth is None:
        return None
    known = np.isfinite(run.truth[:, 0])
    return known if known.any() else None


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
