"""When touch helps: final errors of each mode against turning, friction radius, slip and error of the first pose.

In turning and slip the pushes themselves differ, in one thing each; friction radius and first pose are given to the
graph. Pushes of each setting are drawn alike: same worlds, same first contacts.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate.io import load_recording
from palpate_lab.paper.graph import FRICTION_RADIUS
from palpate_lab.paper.images import episode_numbers
from palpate_lab.paper.pushes import AS_IS, BY_SLIP, BY_TURNING
from palpate_lab.paper.scores import loss_of_constant, median_with_interval
from palpate_lab.paper.tracking import FIRST_ERRORS, FRICTION_FACTORS, MODES, Way
from palpate_lab.study.figures import COLOURS
from palpate_lab.study.study import Trial

Points = list[tuple[float, float, float, float]]
"""Abscissa, median of final errors and its 95 % interval."""
Panel = Mapping[str, Points]
"""Points of each mode."""
Choose = Callable[[str], list[Trial]]
"""Trials of a mode."""
LABELS = {
    "turn_deg": "(a) turning about the contact\n[deg rms over 10 to 50 frames]",
    "c_factor": "(b) friction radius c in the graph\n[of that of uniform pressure]",
    "slip_mm": "(c) slip of the contact over a push\n[mm]",
    "first_mm": "(d) error of the first pose\n[mm, and 0.6° for each]",
}
"""Axes of the panels, by what varies in them."""


def level_of(name: str) -> str:
    """Return the setting, of `pushes.VARIED`, of a recording by the name of its file."""
    return name.removesuffix(".mcap").partition("@")[2]


def traits(path: Path) -> dict[str, float]:
    """Return turning about the contact [deg] and slip [mm] of a simulated sequence."""
    recording = load_recording(path)
    relative = se2.between(np.asarray(recording.object_pose), recording.sensor_pose)
    loss = loss_of_constant(relative, episode_numbers(np.asarray(recording.contact)))
    slip = np.abs(recording.extra["slip"]) * np.gradient(recording.time)
    return {"turn_deg": float(np.degrees(np.sqrt(2.0 * loss))), "slip_mm": float(1e3 * slip.sum())}


def panels_of(
    trials: Sequence[Trial], in_other_ways: Sequence[Trial], of_level: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, dict[str, Points]]]:
    """Return the points of the figure by unit (mm, deg), panel and mode; `of_level` has the traits by setting."""
    as_is = [trial for trial in trials if level_of(trial.recording) == AS_IS]
    given = [*as_is, *in_other_ways]
    authors = FRICTION_RADIUS["rect"] / SHAPES["rectangle"].friction_radius()
    panels = {"turn_deg": _by_level(trials, of_level, "turn_deg", BY_TURNING)}
    panels["c_factor"] = {factor: _by_way(given, friction=factor) for factor in FRICTION_FACTORS}
    panels["c_factor"][authors] = _by_way(given)
    panels["slip_mm"] = _by_level(trials, of_level, "slip_mm", BY_SLIP)
    panels["first_mm"] = {error: _by_way(given, first_error=error) for error in (0.0, *FIRST_ERRORS)}
    return {unit: {name: _points(panel, unit) for name, panel in panels.items()} for unit in ("mm", "deg")}


def draw_panels(panels: Mapping[str, Mapping[str, Panel]]) -> Figure:
    """Draw what `panels_of` returns, mm above and degrees below."""
    figure = Figure(figsize=(13.0, 6.8), layout="constrained")
    grid = figure.subplots(2, len(LABELS), sharey="row")
    for axes, (unit, of_unit) in zip(grid, panels.items(), strict=True):
        for axis, (name, label) in zip(axes, LABELS.items(), strict=True):
            _draw_lines(axis, of_unit[name])
            axis.set(xlabel=label, yscale="log", xscale="log" if name == "c_factor" else "linear")
        ticks = [at for at, *_ in next(iter(of_unit["c_factor"].values()))]
        axes[1].set_xticks(ticks, [f"{at:.2g}" for at in ticks], minor=False)
        axes[1].set_xticks([], minor=True)
        axes[0].set_ylabel(f"final error [{unit}]")
    return figure


def _draw_lines(axis: Axes, lines: Panel) -> None:
    for mode, points in lines.items():
        at, middle, low, high = np.array(points).T
        axis.fill_between(at, low, high, color=COLOURS[mode], alpha=0.12, lw=0)
        axis.plot(at, middle, "o-", color=COLOURS[mode], label=mode, markersize=4)


def _by_level(
    trials: Sequence[Trial], of_level: Mapping[str, Mapping[str, float]], trait: str, levels: Sequence[str]
) -> dict[float, Choose]:
    """Return how to choose trials, by what was measured of a trait over the pushes of each setting."""
    return {of_level[level][trait]: _at_level(trials, level) for level in levels}


def _at_level(trials: Sequence[Trial], level: str) -> Choose:
    return lambda mode: [trial for trial in trials if trial.method == mode and level_of(trial.recording) == level]


def _by_way(trials: Sequence[Trial], friction: float | None = None, first_error: float = 0.0) -> Choose:
    """Return how to choose trials by friction radius, of which palpate has its own, and error of the first pose."""

    def choose(mode: str) -> list[Trial]:
        way = Way(mode, None if mode == "palpate" else friction, first_error)
        return [trial for trial in trials if trial.method == way.name]

    return choose


def _points(panel: Mapping[float, Choose], unit: str) -> dict[str, Points]:
    lines: dict[str, Points] = {}
    for mode in MODES:
        lines[mode] = []
        for at in sorted(panel):
            found = median_with_interval(panel[at](mode), unit)
            lines[mode].append((at, found["median"], found["low"], found["high"]))
    return lines
