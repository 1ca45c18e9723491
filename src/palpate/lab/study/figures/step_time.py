"""The figure of how long a step takes over a sequence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.lab.study.figures.methods import colour, dashes, keys, methods_of
from palpate.lab.study.figures.sheet import Sheet, Tile, line_style, plain_ticks
from palpate.lab.study.trial import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_BINS = 60
_SHARES = {"median": 50, "95 %": 95}


def step_time_sheet(trials: Sequence[Trial]) -> Sheet:
    """Time per step over the sequence: the median and the 95 % of all steps of a method at about the same time."""
    longest = max(float(trial.time[-1] - trial.time[0]) for trial in trials)
    edges = np.linspace(0.0, max(longest, 1e-3), _BINS + 1)
    curves = {method: _percentiles([t for t in trials if t.method == method], edges) for method in methods_of(trials)}
    found = np.concatenate([curve.ravel() for curve in curves.values()])
    limits = (0.7 * float(np.nanmin(found)), 1.4 * float(np.nanmax(found)))
    middle = 0.5 * (edges[1:] + edges[:-1])
    tiles = []
    for row, name in enumerate(_SHARES):

        def draw(axes: "Axes", row: int = row, name: str = name) -> None:
            for method, curve in curves.items():
                axes.plot(middle, curve[row], color=colour(method), ls=line_style(dashes(method)), lw=1.6)
            axes.set(yscale="log", ylim=limits, xlim=(0.0, edges[-1]))
            axes.set(xlabel="time since the start [s]", ylabel=f"{name} of a step [ms]")
            plain_ticks(axes.yaxis, (1.0, 2.0, 5.0) if limits[1] > 20.0 * limits[0] else (1.0, 2.0, 3.0, 5.0, 7.0))

        alt = ", ".join(f"{method} {np.nanmedian(curve[row]):.2g}" for method, curve in curves.items())
        tiles.append(Tile(f"{name} of the steps", f"Time per step, {name}, over the sequence [ms]: {alt}.", draw))
    return Sheet(
        "step-time",
        "Time per step over the sequence",
        "Time of each update of the tracker, image in, estimate out, the reading of files left out. All sequences are "
        f"taken together and cut into {_BINS} spans of time; lines are the median and the 95 % of the steps in a span. "
        "A flat line means that the time does not grow with the length of the sequence. Times were taken while the "
        "study ran on all its workers. The paper's Fig. 8.",
        tuple(tiles),
        keys(list(curves)),
    )


def _percentiles(trials: Sequence[Trial], edges: Array) -> Array:
    """Percentiles (2, bins) [ms] of steps between edges (bins + 1,) [s]; NaN where less than half of them go on."""
    time = np.concatenate([trial.time - trial.time[0] for trial in trials])
    steps = np.concatenate([trial.step_ms for trial in trials])
    ends = np.array([trial.time[-1] - trial.time[0] for trial in trials])
    place = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    order = np.argsort(place, kind="stable")
    parts = np.split(steps[order], np.searchsorted(place[order], np.arange(1, len(edges) - 1)))
    found = np.full((len(_SHARES), len(parts)), np.nan)
    for index, part in enumerate(parts):
        if len(part) and np.mean(ends >= edges[index]) >= 0.5:
            found[:, index] = np.percentile(part, list(_SHARES.values()))
    return found
