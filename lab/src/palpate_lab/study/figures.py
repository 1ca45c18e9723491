"""The figures of a study."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import Array
from palpate.files import whole_file
from palpate.pipeline.figures import own_style
from palpate.pipeline.metrics import rotation_errors, translation_errors
from palpate_lab.study.results import ALL, FINALS
from palpate_lab.study.study import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Quantity = Callable[[Trial], Array]
"""A quantity (N,) of a trial over time."""
Panels = list[tuple[list[Trial], list["Axes"]]]

STYLE: Any = {"font.size": 9, "axes.titlesize": 10, "axes.grid": True, "grid.alpha": 0.25, "savefig.dpi": 110}
# Colours that people with any colour vision tell apart (Okabe and Ito).
COLOURS = {
    "none": "#000000",
    "const": "#E69F00",  # this and the last of `palpate paper`
    "learnt": "#0072B2",
    "oracle": "#009E73",
    "palpate": "#D55E00",
}
OVER_TIME: dict[str, Quantity] = {
    "error [mm]": lambda trial: np.maximum(1e3 * translation_errors(trial.pose, trial.truth), 0.1),
    "error [deg]": lambda trial: np.maximum(np.degrees(np.abs(rotation_errors(trial.pose, trial.truth))), 0.05),
    "step [ms]": lambda trial: np.maximum(trial.step_ms, 0.1),
}
"""Quantities (N,) over time by their labels; smaller ones are drawn at 0.1 mm, 0.05 deg and 0.1 ms."""


def write_figures(folder: Path, trials: Sequence[Trial]) -> None:
    """Write figures of those trials that have ground truth, as PNG, to a folder; none where no trial has it."""
    scored = [trial for trial in trials if trial.summary["scored_frames"]]
    if not scored:
        return
    folder.mkdir(parents=True, exist_ok=True)
    with own_style(**STYLE):
        for name, figure in (("over-time", errors_over_time(scored)), ("final-errors", final_errors(scored))):
            handles, labels = figure.axes[0].get_legend_handles_labels()
            if handles:
                figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False)
            with whole_file(folder / f"{name}.png", overwrite=True) as part:
                figure.savefig(part, format="png")


def errors_over_time(trials: Sequence[Trial], quantities: Mapping[str, Quantity] = OVER_TIME) -> "Figure":
    """Draw errors and the time of a step over time; the paper's figures 6 and 8.

    Lines are medians over the sequences of a group, shaded is from the first to the third quartile. They begin at the
    first contact and end where fewer than half of the sequences go on.
    """
    figure, panels = _grid(trials, len(quantities), sharey="row")
    for of_group, axes in panels:
        for axis, (label, quantity) in zip(axes, quantities.items(), strict=True):
            axis.set(xlabel="time since the start [s]", ylabel=label, yscale="log")
            for method, of_method in _by_method(of_group):
                time, (low, middle, high) = _quartiles(of_method, quantity)
                axis.fill_between(time, low, high, color=COLOURS[method], alpha=0.12, lw=0)
                axis.plot(time, middle, color=COLOURS[method], lw=1.6, label=method)
    return figure


def final_errors(trials: Sequence[Trial]) -> "Figure":
    """Draw errors at the last frame with ground truth as boxes, with whiskers to 5 and 95 %; the paper's figure 7."""
    figure, panels = _grid(trials, 2, sharex="row", sharey="row")
    for of_group, axes in panels:
        for axis, (name, least) in zip(axes, (("final_mm", 0.1), ("final_deg", 0.05)), strict=True):
            by_method = dict(_by_method(of_group))
            errors = []
            for of_method in by_method.values():
                errors.append(np.maximum([trial.summary[FINALS[name]] for trial in of_method], least))
            boxes = axis.boxplot(errors, whis=(5.0, 95.0), orientation="horizontal", widths=0.6, patch_artist=True)
            for method, box, line in zip(by_method, boxes["boxes"], boxes["medians"], strict=True):
                box.set(facecolor=f"{COLOURS[method]}38", edgecolor=COLOURS[method])
                line.set_color(COLOURS[method])
            axis.set_yticks(range(1, len(by_method) + 1), list(by_method))
            label = f"final error [{name.removeprefix('final_')}]"
            axis.set(xlabel=label, xscale="log", ylim=(len(by_method) + 0.5, 0.5))
    return figure


def _grid(trials: Sequence[Trial], rows: int, **share: Any) -> tuple["Figure", Panels]:
    """Return a figure and, for all groups together and for each group, its trials and axes, from above."""
    from matplotlib.figure import Figure

    names = sorted({trial.group for trial in trials})
    names = [ALL, *names] if len(names) > 1 else names
    count = math.ceil(len(names) / 8)  # rows of groups, which are short enough for a screen
    down = rows * count
    across = math.ceil(len(names) / count)
    panels = Panels()
    figure = Figure(figsize=(3.3 * max(across, 2), 2.7 * down + 0.5), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, **share)
    columns = grid.reshape(-1, rows, across).swapaxes(1, 2).reshape(-1, rows)
    for name, axes in zip(names, columns, strict=False):
        of_group = [trial for trial in trials if name in (ALL, trial.group)]
        axes[0].set_title(f"{name} ({len({trial.recording for trial in of_group})})")
        panels.append((of_group, list(axes)))
    for axis in columns[len(names) :].flat:
        axis.remove()
    return figure, panels


def _by_method(trials: Sequence[Trial]) -> Iterator[tuple[str, list[Trial]]]:
    for method in dict.fromkeys(trial.method for trial in trials):
        yield method, [trial for trial in trials if trial.method == method]


def _quartiles(trials: Sequence[Trial], quantity: Callable[[Trial], Array]) -> tuple[Array, Array]:
    """Return instants (T,) [s] since the start and the quartiles (3, T) of a quantity over trials.

    A trial counts from its first contact, before which the object rests where it was said to be, to its end; NaN where
    fewer than half count.
    """
    instants = np.linspace(0.0, max(trial.time[-1] - trial.time[0] for trial in trials), 150)
    rows = []
    for trial in trials:
        time = trial.time - trial.time[0]
        frame = np.searchsorted(time, instants).clip(0, len(time) - 1)
        is_there = (instants <= time[-1]) & (frame >= np.argmax(trial.contact))
        rows.append(np.where(is_there, quantity(trial)[frame], np.nan))
    enough = np.isfinite(rows).mean(axis=0) >= 0.5
    quartiles = np.full((3, len(instants)), np.nan)
    quartiles[:, enough] = np.nanpercentile(np.array(rows)[:, enough], (25.0, 50.0, 75.0), axis=0)
    return instants, quartiles
