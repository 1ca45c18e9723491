"""Figures 5 to 8 and 10 to 12 of the paper, each with its number in the title."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate.pipeline.figures import own_style
from palpate_lab.paper.helps import Panel, draw_panels
from palpate_lab.study.figures import COLOURS, OVER_TIME, STYLE, errors_over_time, final_errors
from palpate_lab.study.study import Trial

Shown = tuple[NDArray[np.float16], Array, NDArray[np.int_]]
"""Some images of a sequence (M, 32, 128, 3), as differences from the untouched gel, their key points (M, 2 K) from -1
to 1, and their frames (M,)."""
Tracks = Mapping[str, tuple[Recording, Sequence[Trial]]]
"""Sequences by name, with a trial for each mode."""


def draw(
    out: Path,
    seen: Mapping[str, Shown],
    rectangles: Tracks,
    others: Tracks,
    trials: Sequence[Trial],
    panels: Mapping[str, Mapping[str, Panel]],
) -> None:
    """Write the figures to a folder."""
    by_object = [replace(trial, group=trial.recording.split("-")[0]) for trial in trials]
    errors = {label: quantity for label, quantity in OVER_TIME.items() if not label.startswith("step")}
    runtime = {label: quantity for label, quantity in OVER_TIME.items() if label.startswith("step")}
    with own_style(**STYLE):
        _save(out, "fig5_keypoints", keypoints(seen), "Figure 5 of the paper: learnt key points on touch images")
        title = "Figure 6 of the paper: online errors, medians and quartiles of sequences"
        _save(out, "fig6_errors_over_time", errors_over_time(by_object, errors), title)
        title = "Figure 7 of the paper: final errors of sequences, median, quartiles, whiskers to 5 and 95 %"
        _save(out, "fig7_final_errors", final_errors(by_object), title)
        title = "Figure 8 of the paper: time of a step of the graph in contact, medians and quartiles of sequences"
        figure = errors_over_time([_in_contact(trial) for trial in by_object], runtime)
        for axes in figure.axes:
            axes.set_xlabel("time in contact [s]")
        _save(out, "fig8_runtime", figure, title)
        title = "Figures 10, 11 of the paper: poses of the rectangle at five instants of a push, by kind of touch"
        _save(out, "fig10_11_rect", trajectories(rectangles), title)
        title = "Figure 12 of the paper: poses of disc and ellipse at five instants of a push, by kind of touch"
        _save(out, "fig12_disc_ellip", trajectories(others), title)
        title = "When touch helps (not in the paper): rectangle, medians of final errors and their 95 % intervals"
        _save(out, "when_touch_helps", draw_panels(panels), title)


def keypoints(seen: Mapping[str, Shown]) -> Figure:
    """Figure 5: key points on touch images over a contact, a row for each object."""
    count = max(len(images) for images, _, _ in seen.values())
    figure = Figure(figsize=(2.1 * count, 2.6 * len(seen) + 0.5), layout="constrained")
    grid = figure.subplots(len(seen), count, squeeze=False)
    for row, (name, (images, points, frames)) in zip(grid, seen.items(), strict=True):
        for axes, image, point, frame in zip(row, images, points, frames, strict=True):
            height, width = image.shape[:2]
            axes.imshow(np.clip(0.5 + 0.3 * image.astype(np.float32), 0.0, 1.0), aspect=4 / 3 * width / height)
            column, row_of_image = (0.5 * (point.reshape(-1, 2) + 1.0) * (width, height) - 0.5).T
            axes.plot(column, row_of_image, "o", color="blue", markersize=5, label="key points")
            axes.set_title(f"{name.split('-')[0]}, frame {frame}", fontsize=8)
            axes.set_xlabel("column [px]", fontsize=7)
            axes.set_ylabel("row [px]", fontsize=7)
            axes.tick_params(labelsize=6)
            axes.grid(visible=False)
    return figure


def trajectories(tracks: Tracks) -> Figure:
    """Figures 10 to 12: true and estimated object poses over time, a row a sequence and a column a mode."""
    modes = len(next(iter(tracks.values()))[1])
    figure = Figure(figsize=(2.4 * modes, 2.4 * len(tracks) + 0.6), layout="constrained")
    grid = figure.subplots(len(tracks), modes, squeeze=False, sharex="row", sharey="row")
    for row, (name, (recording, trials)) in zip(grid, tracks.items(), strict=True):
        for axes, trial in zip(row, trials, strict=True):
            _draw_poses(axes, recording, trial)
            axes.set_title(trial.method, fontsize=8, color=COLOURS[trial.method])
            axes.set_xlabel("x [m]", fontsize=7)
        row[0].set_ylabel(f"{name.removesuffix('.mcap')}\ny [m]", fontsize=7)
    return figure


def _in_contact(trial: Trial) -> Trial:
    """Return the frames of contact alone, as if they followed each other: the paper's graph takes a step in these."""
    columns = {name: getattr(trial, name)[trial.contact] for name in ("truth", "pose", "nees", "contact", "step_ms")}
    return replace(trial, time=np.median(np.diff(trial.time)) * np.arange(trial.contact.sum()), **columns)


def _save(out: Path, name: str, figure: Figure, title: str) -> None:
    """Write a figure as PNG, with a title and, where its first axes have labels, a legend."""
    figure.suptitle(title, fontsize=11)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    with whole_file(out / f"{name}.png", overwrite=True) as part:
        figure.savefig(part, format="png", dpi=110)


def _draw_poses(axes: Axes, recording: Recording, trial: Trial) -> None:
    chosen = np.linspace(0, len(trial.truth) - 1, 5).astype(int)
    outline = recording.shape.outline()
    closed = np.concatenate([outline, outline[:1]])
    known = (trial.truth, "#999999", "true object")
    estimated = (trial.pose, COLOURS[trial.method], "estimate, in the colour of its kind of touch")
    for poses, colour, label in (known, estimated):
        axes.plot(*poses[:, :2].T, color=colour, linewidth=0.8, label=label)
        for pose in poses[chosen]:
            axes.plot(*se2.transform(pose, closed).T, color=colour, linewidth=0.7)
    axes.plot(*recording.sensor_pose[:, :2].T, ":", color="#666666", linewidth=0.6, label="path of the sensor")
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
