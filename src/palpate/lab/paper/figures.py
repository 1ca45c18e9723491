"""Figures 5 to 8 and 10 to 12 of the paper."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.arrays import Array
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.pipeline.figures import own_style
from palpate.pipeline.metrics import rotation_errors, translation_errors

Tracks = Mapping[str, Mapping[str, Any]]
COLOURS = {"none": "#000000", "const": "#E69F00", "learnt": "#0072B2", "oracle": "#009E73", "palpate": "#D55E00"}
UNITS = ("translation [mm]", "rotation [deg]")


@own_style()
def draw(out: Path, tracks: Tracks) -> None:
    """Write all figures to a folder."""
    rectangles = {name: track for name, track in tracks.items() if name.startswith("rect")}
    others = {name: track for name, track in tracks.items() if name not in rectangles}
    figures = {
        "fig5_keypoints": keypoints([next(iter(rectangles.values())), *list(others.values())[:: len(others) - 1]]),
        "fig6_error_over_time": errors_over_time(tracks),
        "fig7_final_error": final_errors(tracks),
        "fig8_runtime": runtime(tracks),
        "fig10_11_rect": trajectories(rectangles),
        "fig12_disc_ellip": trajectories(others),
    }
    for name, figure in figures.items():
        with whole_file(out / f"{name}.png", overwrite=True) as part:
            figure.savefig(part, format="png", dpi=110)


def errors(track: Mapping[str, Any], mode: str) -> tuple[Array, Array]:
    """Return errors of translation (N,) [mm] and rotation (N,) [degrees] of a tracked sequence."""
    pose, truth = track[f"{mode}_pose"], track["truth"]
    return 1e3 * translation_errors(pose, truth), np.degrees(np.abs(rotation_errors(pose, truth)))


def keypoints(tracks: list[Mapping[str, Any]]) -> Figure:
    """Figure 5: key points on touch images over a contact, a row for each object."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    for row, track in zip(figure.subplots(len(tracks), len(tracks[0]["images"])), tracks, strict=True):
        for axes, image, point in zip(row, track["images"], track["keypoints"], strict=True):
            height, width = image.shape[:2]
            axes.imshow(np.clip(0.5 + 0.3 * image.astype(np.float32), 0.0, 1.0), aspect=4 / 3 * width / height)
            axes.plot(*(0.5 * (point + 1.0) * (width, height) - 0.5), "o", color="blue", markersize=5)
            axes.set_axis_off()
    return figure


def errors_over_time(tracks: Tracks) -> Figure:
    """Figure 6 (e, f): RMSE over the time so far, mean over the sequences and a standard deviation, semi-log."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    count = min(len(track["time"]) for track in tracks.values())
    time = next(iter(tracks.values()))["time"][:count]
    for which, axes in enumerate(figure.subplots(1, 2)):
        for mode, colour in COLOURS.items():
            curves = np.array([errors(track, mode)[which][:count] for track in tracks.values()])
            rmse = np.sqrt(np.cumsum(curves**2, axis=1) / np.arange(1, count + 1)) + 1e-3
            mean, deviation = rmse.mean(axis=0), rmse.std(axis=0)
            axes.semilogy(time - time[0], mean, color=colour, label=mode)
            below = np.maximum(mean - deviation, 1e-2)
            axes.fill_between(time - time[0], below, mean + deviation, color=colour, alpha=0.1)
        axes.set(xlabel="time [s]", ylabel=f"RMSE of {UNITS[which]}")
        axes.set_ylim(bottom=1e-2)
    figure.axes[0].legend(fontsize=8)
    return figure


def final_errors(tracks: Tracks) -> Figure:
    """Figure 7: box plots of final errors, semi-log."""
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    for which, axes in enumerate(figure.subplots(1, 2)):
        final = [[max(errors(track, mode)[which][-1], 1e-3) for track in tracks.values()] for mode in COLOURS]
        axes.boxplot(final, tick_labels=list(COLOURS))
        axes.set(yscale="log", ylabel=f"final error of {UNITS[which]}")
    return figure


def runtime(tracks: Tracks) -> Figure:
    """Figure 8: time of a step of the graph optimiser over the steps in contact."""
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for mode in ("none", "const", "learnt", "oracle"):
        curves = [track[f"{mode}_ms"][track["episode"] >= 0] for track in tracks.values()]
        count = min(len(curve) for curve in curves)
        median = np.median([curve[:count] for curve in curves], axis=0)
        axes.plot(median, color=COLOURS[mode], label=mode, linewidth=0.8)
    axes.set(xlabel="step in contact", ylabel="time of a step [ms]", yscale="log")
    axes.legend(fontsize=8)
    return figure


def trajectories(tracks: Tracks) -> Figure:
    """Figures 10 to 12: true (grey) and estimated object poses over time, a row a sequence and a column a mode."""
    shown = dict(sorted(tracks.items())[:: max(len(tracks) // 6, 1)][:6])
    figure = Figure(figsize=(11.0, 2.2 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), len(COLOURS), squeeze=False)
    for row, (name, track) in zip(grid, shown.items(), strict=True):
        for axes, (mode, colour) in zip(row, COLOURS.items(), strict=True):
            _draw_poses(axes, track, mode, colour)
            axes.set_title(f"{name}, {mode}", fontsize=7)
    return figure


def _draw_poses(axes: Axes, track: Mapping[str, Any], mode: str, colour: str) -> None:
    chosen = np.linspace(0, len(track["truth"]) - 1, 5).astype(int)
    closed = np.concatenate([track["outline"], track["outline"][:1]])
    for poses, look in ((track["truth"], "#999999"), (track[f"{mode}_pose"], colour)):
        axes.plot(*poses[:, :2].T, color=look, linewidth=0.8)
        for pose in poses[chosen]:
            axes.plot(*se2.transform(pose, closed).T, color=look, linewidth=0.7)
    axes.plot(*track["sensor"][:, :2].T, ":", color="#666666", linewidth=0.6)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=5)
