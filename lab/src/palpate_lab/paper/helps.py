"""When touch helps: final errors of each mode against turning, friction radius, slip and error of the first pose.

Turning and slip are those of the pushes, in thirds; friction radius and first pose are given to the graph.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.geometry.shapes import SHAPES
from palpate.io import load_recording
from palpate_lab.paper.graph import FRICTION_RADIUS
from palpate_lab.paper.images import episode_numbers
from palpate_lab.paper.scores import loss_of_constant
from palpate_lab.paper.tracking import FIRST_ERRORS, FRICTION_FACTORS, MODES, Way
from palpate_lab.study.figures import COLOURS
from palpate_lab.study.results import FINALS
from palpate_lab.study.study import Trial

Points = list[tuple[float, float]]
"""Abscissa and median of final errors."""
Panel = Mapping[str, Points]
"""Points of each mode."""
LABELS = {
    "turn_deg": "(a) turning about the contact\n[deg rms over 10 to 50 frames]",
    "c_factor": "(b) friction radius c in the graph\nover that of uniform pressure",
    "slip_mm": "(c) slip of the contact over a push [mm]",
    "first_mm": "(d) error of the first pose\n[mm, and 0.6° for each]",
}
"""Axes of the panels, by what varies in them."""


def traits(path: Path) -> dict[str, float]:
    """Return turning about the contact [deg] and slip [mm] of a simulated sequence."""
    recording = load_recording(path)
    relative = se2.between(np.asarray(recording.object_pose), recording.sensor_pose)
    loss = loss_of_constant(relative, episode_numbers(np.asarray(recording.contact)))
    slip = np.abs(recording.extra["slip"]) * np.gradient(recording.time)
    return {"turn_deg": float(np.degrees(np.sqrt(2.0 * loss))), "slip_mm": float(1e3 * slip.sum())}


def panels_of(
    trials: Sequence[Trial], in_other_ways: Sequence[Trial], of_push: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, dict[str, Points]]]:
    """Return the points of the figure by unit (mm, deg), panel and mode; `of_push` has the traits by recording."""
    rectangles = [trial for trial in trials if trial.recording.startswith("rect")]
    found: dict[str, dict[str, dict[str, Points]]] = {}
    for unit in ("mm", "deg"):
        found[unit] = {
            "turn_deg": _by_thirds(rectangles, of_push, "turn_deg", unit),
            "c_factor": _by_friction(rectangles, in_other_ways, unit),
            "slip_mm": _by_thirds(rectangles, of_push, "slip_mm", unit),
            "first_mm": _by_first_error(rectangles, in_other_ways, unit),
        }
    return found


def draw_panels(panels: Mapping[str, Mapping[str, Panel]]) -> Figure:
    """Draw what `panels_of` returns, mm above and degrees below."""
    figure = Figure(figsize=(13.0, 6.6), layout="constrained")
    grid = figure.subplots(2, len(LABELS), sharey="row")
    for axes, (unit, of_unit) in zip(grid, panels.items(), strict=True):
        for axis, (name, label) in zip(axes, LABELS.items(), strict=True):
            _draw_lines(axis, of_unit[name])
            axis.set(xlabel=label, yscale="log", xscale="log" if name == "c_factor" else "linear")
        ticks = [at for at, _ in next(iter(of_unit["c_factor"].values()))]
        axes[1].set_xticks(ticks, [f"{at:.2g}" for at in ticks], minor=False)
        axes[1].set_xticks([], minor=True)
        axes[0].set_ylabel(f"median final error [{unit}]")
    return figure


def _draw_lines(axis: Axes, lines: Panel) -> None:
    for mode, points in lines.items():
        abscissae, errors = zip(*points, strict=True)
        axis.plot(abscissae, errors, "o-", color=COLOURS[mode], label=mode, markersize=4)


def _by_thirds(
    trials: Sequence[Trial], of_push: Mapping[str, Mapping[str, float]], trait: str, unit: str
) -> dict[str, Points]:
    """Return medians over the thirds of sequences with least, middling and most of a trait."""
    names = sorted({trial.recording for trial in trials}, key=lambda name: of_push[name][trait])
    lines: dict[str, Points] = {mode: [] for mode in MODES}
    for third in np.array_split(names, 3):
        if not len(third):
            continue
        at = float(np.median([of_push[name][trait] for name in third]))
        for mode, points in lines.items():
            points.append((at, _median([t for t in trials if t.method == mode and t.recording in third], unit)))
    return lines


def _by_friction(trials: Sequence[Trial], in_other_ways: Sequence[Trial], unit: str) -> dict[str, Points]:
    """Return medians over the swept sequences for each friction radius; palpate's is that of uniform pressure."""
    swept = {trial.recording for trial in in_other_ways}
    authors = FRICTION_RADIUS["rect"] / SHAPES["rectangle"].friction_radius()
    factors = {authors: None, **{factor: factor for factor in FRICTION_FACTORS}}
    together = [*in_other_ways, *(trial for trial in trials if trial.recording in swept)]
    lines: dict[str, Points] = {}
    for mode in MODES:
        lines[mode] = []
        for at, friction in sorted(factors.items()):
            method = mode if mode == "palpate" else Way(mode, friction).name
            lines[mode].append((at, _median([trial for trial in together if trial.method == method], unit)))
    return lines


def _by_first_error(trials: Sequence[Trial], in_other_ways: Sequence[Trial], unit: str) -> dict[str, Points]:
    """Return medians over the swept sequences for each error of the first pose."""
    swept = {trial.recording for trial in in_other_ways}
    together = [*in_other_ways, *(trial for trial in trials if trial.recording in swept)]
    lines: dict[str, Points] = {}
    for mode in MODES:
        lines[mode] = []
        for error in (0.0, *FIRST_ERRORS):
            method = Way(mode, first_error=error).name
            lines[mode].append((error, _median([trial for trial in together if trial.method == method], unit)))
    return lines


def _median(trials: Sequence[Trial], unit: str) -> float:
    errors: Array = np.array([trial.summary[FINALS[f"final_{unit}"]] for trial in trials], np.float64)
    return float(np.median(errors))
