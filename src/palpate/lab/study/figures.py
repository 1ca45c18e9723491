"""Figures of a study, all in one style: a column for each group of recordings, a colour for each method."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import shape_from_dict
from palpate.lab.study.results import ALL, FINALS
from palpate.lab.study.trial import Method, Trial
from palpate.pipeline.metrics import inside_95

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

STYLE: Any = {"font.size": 9, "axes.titlesize": 10, "axes.grid": True, "grid.alpha": 0.25, "savefig.dpi": 110}
# Colours that people with any colour vision tell apart (Okabe and Ito).
COLOURS = {"none": "#000000", "learnt": "#0072B2", "oracle": "#009E73"}
OTHERS = ("#E69F00", "#56B4E9", "#CC79A7", "#D55E00")
SENSOR = "#D55E00"
FLOOR = {"mm": 0.1, "deg": 0.05}
"""Smaller errors are drawn here on logarithmic axes."""
OVER_TIME: dict[str, Callable[[Trial], Array]] = {
    "mm": lambda trial: 1e3 * trial.translation_error,
    "deg": lambda trial: np.degrees(np.abs(trial.rotation_error)),
    "%": lambda trial: np.where(np.isfinite(trial.nees), 100.0 * inside_95(trial.nees), np.nan),
}
"""Quantities over time by their units; the last is coverage."""


@dataclass(frozen=True)
class StudyFigure:
    """A figure and its words."""

    name: str
    """Of its file, without the ending."""
    title: str
    caption: str
    alt: str
    """Description for those who cannot see it."""
    png: bytes


def study_figures(trials: Sequence[Trial], recordings: Mapping[str, Mapping[str, Any]]) -> list[StudyFigure]:
    """Return the figures of trials; `recordings` holds the "shape" of each. Those without data are left out."""
    import matplotlib as mpl

    scored = [trial for trial in trials if trial.summary["scored_frames"]]
    with mpl.rc_context(STYLE):
        figures = [_over_time(scored), _final_errors(scored), _trajectories(scored, recordings)] if scored else []
        return [*figures, _step_times(trials)] if trials else []


def methods_of(trials: Sequence[Trial]) -> list[Method]:
    """Return the methods of trials in the order in which they come."""
    return list(dict.fromkeys(trial.method for trial in trials))


def main_method(methods: Sequence[Method]) -> Method:
    """Return the method to show where there is room for one: `learnt`, else the last one."""
    return next((method for method in methods if str(method) == "learnt"), methods[-1])


def _over_time(trials: Sequence[Trial]) -> StudyFigure:
    figure, panels = _grid(trials, 3, sharey="row")
    ends: list[str] = []
    for group, some, axes in panels:
        axes[2].axhline(95.0, color="#666666", lw=0.8)
        for method, of_method in _by_method(some):
            for axis, (unit, quantity) in zip(axes, OVER_TIME.items(), strict=True):
                time, values = _sampled(of_method, quantity)
                if unit == "%":  # in the 95 % region
                    axis.plot(time, _over_trials(np.nanmean, values), **_line(method))
                    continue
                values = np.maximum(values, FLOOR[unit])
                low, middle, high = (_over_trials(np.nanpercentile, values, q=q) for q in (25.0, 50.0, 75.0))
                axis.fill_between(time, low, high, color=_line(method)["color"], alpha=0.12, lw=0)
                axis.plot(time, middle, **_line(method))
                if group == panels[0][0]:
                    ends.append(f"{method} {middle[np.isfinite(middle)][-1]:.2g} {unit}")
        for axis, label in zip(axes, ("error [mm]", "error [deg]", "in the 95 % region [%]"), strict=True):
            axis.set(xlabel="time since the start [s]", ylabel=label)
            if "%" in label:
                axis.set(ylim=(-3.0, 103.0))
            else:
                _logarithmic(axis, "y")
    return _finished(
        figure,
        "over-time",
        "Errors and coverage over time",
        "Error of the online estimate from the first contact on: median over the sequences of a group, shaded from the "
        "first to the third quartile (the paper's Fig. 6). Below, the share of sequences whose true pose lies in the "
        "region that should hold it with 95 % probability. Lines end where fewer than half of the sequences go on.",
        f"Median errors and coverage over time of {panels[0][0]}; errors end at {', '.join(ends)}.",
    )


def _final_errors(trials: Sequence[Trial]) -> StudyFigure:
    figure, panels = _grid(trials, 2, sharex="row", sharey="row")
    words: list[str] = []
    for group, some, axes in panels:
        for axis, (name, key) in zip(axes, FINALS.items(), strict=True):
            unit = name.removeprefix("final_")
            by_method = [
                (method, np.maximum([trial.summary[key] for trial in of_method], FLOOR[unit]))
                for method, of_method in _by_method(some)
            ]
            boxes = axis.boxplot(
                [values for _, values in by_method],
                whis=(5.0, 95.0),
                orientation="horizontal",
                widths=0.6,
                patch_artist=True,
            )
            for (method, values), box, line in zip(by_method, boxes["boxes"], boxes["medians"], strict=True):
                box.set(facecolor=f"{_line(method)['color']}38", edgecolor=_line(method)["color"])
                line.set_color(_line(method)["color"])
                if group == panels[0][0]:
                    words.append(f"{method} {np.median(values):.2g} {unit}")
            axis.set_yticks(range(1, len(by_method) + 1), [str(method) for method, _ in by_method])
            axis.set(xlabel=f"final error [{unit}]", ylim=(len(by_method) + 0.5, 0.5))
            _logarithmic(axis, "x")
    return _finished(
        figure,
        "final-errors",
        "Final errors",
        "Error at the last frame with ground truth. The line in a box is the median, the box holds the middle half of "
        "the sequences, the whiskers 5 to 95 % of them, and dots are the others. The paper's Fig. 7.",
        f"Final errors of {panels[0][0]}, medians: {', '.join(words)}.",
    )


def _step_times(trials: Sequence[Trial]) -> StudyFigure:
    figure, ((_, some, (axis,)),) = _grid(trials, 1, by_group=False)
    medians: list[str] = []
    for method, of_method in _by_method(some):
        time, values = _sampled(of_method, lambda trial: trial.step_ms)
        axis.plot(time, _over_trials(np.nanmedian, values), **_line(method))
        axis.plot(time, _over_trials(np.nanpercentile, values, q=95.0), **_line(method) | {"ls": ":", "label": None})
        medians.append(f"{method} {np.nanmedian(values):.2g} ms")
    axis.set(xlabel="time since the start [s]", ylabel="step [ms]")
    _logarithmic(axis, "y")
    return _finished(
        figure,
        "step-time",
        "Time of a step over the sequence",
        "Time of `Tracker.update`, median and 95th percentile (dotted) over all sequences, while the study ran on all "
        "its workers. Where lines are flat, it does not grow with the length of a sequence. The paper's Fig. 8.",
        f"Time of a step over the sequence, medians: {', '.join(medians)}.",
    )


def _trajectories(trials: Sequence[Trial], recordings: Mapping[str, Mapping[str, Any]]) -> StudyFigure:
    figure, panels = _grid(trials, 2, with_all=False)
    for _, some, axes in panels:
        main = main_method(methods_of(some))
        ranked = sorted(
            (each for each in some if each.method == main), key=lambda each: each.summary[FINALS["final_mm"]]
        )
        for axis, trial, kind in zip(
            axes, (ranked[(len(ranked) - 1) // 2], ranked[-1]), ("median", "worst"), strict=True
        ):
            _draw_trajectory(axis, trial, recordings.get(trial.recording, {}))
            errors = (trial.summary[key] for key in FINALS.values())
            axis.set_title("{}: {}\n{:.1f} mm, {:.1f}°".format(kind, trial.recording[-28:], *errors), fontsize=8)
    return _finished(
        figure,
        "trajectories",
        "Trajectories, true and estimated",
        "From above, in each group the sequence with the median final error and the one with the largest, with "
        f"outlines at the start, halfway and at the end. By {main_method(methods_of(trials))}, or the nearest "
        "method that applies. The paper's Figs. 10 to 12.",
        f"True and estimated trajectories of {len(panels)} groups.",
    )


def _draw_trajectory(axis: "Axes", trial: Trial, facts: Mapping[str, Any]) -> None:
    known = np.flatnonzero(np.isfinite(trial.truth[:, 0]))
    in_contact = np.where(trial.contact[:, None], trial.sensor_pose[:, :2], np.nan)
    truth: dict[str, Any] = {"color": "#000000", "ls": "-", "label": "truth"}
    estimate: dict[str, Any] = {"color": _line(trial.method)["color"], "ls": "--", "label": f"estimate, {trial.method}"}
    axis.plot(*(1e3 * in_contact.T), color=SENSOR, lw=1.2, label="sensor in contact")
    axis.plot(*(1e3 * trial.truth[:, :2].T), lw=2.0, **truth)
    axis.plot(*(1e3 * trial.pose[: known[-1] + 1, :2].T), lw=1.2, **estimate)
    if facts.get("shape"):
        outline = shape_from_dict(facts["shape"]).outline(100)
        for frame in known[[0, len(known) // 2, -1]]:
            for pose, style in ((trial.truth[frame], truth), (trial.pose[frame], estimate)):
                axis.fill(*(1e3 * se2.transform(pose, outline).T), fill=False, alpha=0.7, **style | {"label": None})
    axis.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", adjustable="datalim")


# The shared frame


def _grid(
    trials: Sequence[Trial], rows: int, with_all: bool = True, by_group: bool = True, **share: Any
) -> tuple["Figure", list[tuple[str, list[Trial], list["Axes"]]]]:
    """Return a figure and, for all groups together and for each group, its name, trials and axes, from above."""
    from matplotlib.figure import Figure

    names = sorted({trial.group for trial in trials}) if by_group else []
    names = [*([ALL] if with_all and len(names) != 1 else []), *names]
    figure = Figure(figsize=(3.3 * max(len(names), 2), 2.7 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, len(names), squeeze=False, **share)
    panels = []
    for column, name in enumerate(names):
        some = [trial for trial in trials if name in (ALL, trial.group)]
        grid[0, column].set_title(f"{name} ({len({trial.recording for trial in some})})")
        panels.append((name, some, list(grid[:, column])))
    return figure, panels


def _finished(figure: "Figure", name: str, title: str, caption: str, alt: str) -> StudyFigure:
    """Return a figure as PNG, with a legend of the lines drawn in its first panel."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False)
    with io.BytesIO() as file:
        FigureCanvasAgg(figure).print_png(file)
        return StudyFigure(name, title, caption, alt, file.getvalue())


def _by_method(trials: Sequence[Trial]) -> Iterator[tuple[Method, list[Trial]]]:
    for method in methods_of(trials):
        yield method, [trial for trial in trials if trial.method == method]


def _line(method: Method) -> dict[str, Any]:
    colour = COLOURS.get(method.tactile) or OTHERS[sum(map(ord, method.tactile)) % len(OTHERS)]
    return {"color": colour, "lw": 1.6, "ls": "-" if method.smoother == "fixed-lag" else "-.", "label": str(method)}


def _logarithmic(axes: "Axes", which: str) -> None:
    """Make the x or y axis logarithmic, with 0.1 and 10 written on it and not powers of ten."""
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _sampled(trials: Sequence[Trial], quantity: Callable[[Trial], Array]) -> tuple[Array, Array]:
    """Return instants (T,) [s] since the start and a quantity (N,) of each trial then, (S, T).

    It is NaN before the first contact, at which the object rests where it was said to be, and after the end.
    """
    longest = max(trial.time[-1] - trial.time[0] for trial in trials)
    instants = np.linspace(0.0, longest, 150)
    rows = []
    for trial in trials:
        since = trial.time - trial.time[0]
        frame = np.searchsorted(since, instants).clip(0, len(since) - 1)
        is_there = (instants <= since[-1]) & (frame >= np.argmax(trial.contact))
        rows.append(np.where(is_there, quantity(trial)[frame], np.nan))
    return instants, np.array(rows)


def _over_trials(middle: Callable[..., Array], values: Array, **options: float) -> Array:
    """Return a mean or percentile (T,) of values (S, T) over trials; NaN where fewer than half have a value."""
    found = np.full(values.shape[1], np.nan)
    enough = np.isfinite(values).mean(axis=0) >= 0.5
    found[enough] = middle(values[:, enough], axis=0, **options)
    return found
