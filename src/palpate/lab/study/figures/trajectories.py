"""The figure of where objects went and where they were thought to be."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import shape_from_dict
from palpate.lab.study.figures.final_errors import ROTATION, TRANSLATION
from palpate.lab.study.figures.methods import colour, groups_of, in_order, main_method, methods_of
from palpate.lab.study.figures.sheet import Key, Sheet, Tile
from palpate.lab.study.trial import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

TRUTH, SENSOR, START = "#000000", "#D55E00", "#999999"
_SHOWN = 3
"""Outlines along the way, besides the first and the last."""


def trajectory_sheet(trials: Sequence[Trial], recordings: Mapping[str, Mapping[str, Any]]) -> Sheet | None:
    """The typical and the worst sequence of each group by its main method; None where no truth is known.

    `recordings` tells the "shape" of each recording.
    """
    scored = [trial for trial in trials if trial.summary.get(TRANSLATION) is not None]
    if not scored:
        return None
    tiles, shown = [], []
    for group in groups_of(scored):
        of_group = [trial for trial in scored if trial.group == group]
        method = main_method(methods_of(of_group))
        shown.append(method)
        ranked = sorted((t for t in of_group if t.method == method), key=lambda t: t.summary[TRANSLATION])
        typical, worst = ranked[(len(ranked) - 1) // 2], ranked[-1]
        # Of two sequences the better one is typical, of one there is no worst.
        for word, trial in {"typical": typical, "worst": worst}.items():
            if word == "typical" or trial is not typical:
                tiles.append(_tile(f"{group}, {word}", trial, _outline(recordings.get(trial.recording, {}))))
    return Sheet(
        "trajectories",
        "Trajectories, true and estimated",
        "From above, of each group the sequence whose final translation error is the median one (typical) and the one "
        f"with the largest; by {main_method(shown)}, or by what touch tells most of a group that it cannot be done "
        "with. Outlines stand at the start, at the end and at three instants between them. The paper's Figs. 10 to 12.",
        tuple(tiles),
        (
            Key("truth", TRUTH),
            *(Key(f"estimate, {method}", colour(method), (4.0, 2.0)) for method in in_order(shown)),
            Key("start", START, (1.0, 1.2)),
            Key("sensor in contact", SENSOR),
        ),
        width=3.6,
        height=3.9,
    )


def _outline(recording: Mapping[str, Any]) -> Array | None:
    """Closed outline (n, 2) [m] in the object frame, None where it is not known."""
    if recording.get("shape") is None:
        return None
    outline = shape_from_dict(recording["shape"]).outline(100)
    return np.concatenate([outline, outline[:1]])


def _tile(title: str, trial: Trial, outline: Array | None) -> Tile:
    mm, deg = trial.summary[TRANSLATION], trial.summary[ROTATION]
    name = trial.recording.rpartition("/")[2].partition(".")[0]
    shown = name if len(name) <= 32 else f"…{name[-31:]}"
    alt = f"True and estimated trajectory of {trial.recording} ({title}): final error {mm:.1f} mm and {deg:.1f}°."
    return Tile(f"{title}\n{shown}\n{mm:.1f} mm, {deg:.1f}°", alt, lambda axes: _draw(axes, trial, outline))


def _draw(axes: "Axes", trial: Trial, outline: Array | None) -> None:
    known = np.flatnonzero(np.isfinite(trial.truth[:, 0]))
    first, last = known[0], known[-1]
    between = known[np.linspace(0, len(known) - 1, _SHOWN + 2).astype(int)[1:-1]]
    estimate = colour(trial.method)
    sensor = np.where(trial.contact[:, None], trial.sensor_pose[:, :2], np.nan)
    axes.plot(*(sensor * 1e3).T, color=SENSOR, lw=1.4)
    axes.plot(*(trial.truth[:, :2] * 1e3).T, color=TRUTH, lw=2.2)
    axes.plot(*(trial.pose[: last + 1, :2] * 1e3).T, color=estimate, lw=1.4, ls="--")
    if outline is not None:
        axes.plot(*_placed(outline, trial.truth[first]), color=START, lw=1.2, ls=":")
        for index in between:
            axes.plot(*_placed(outline, trial.truth[index]), color=TRUTH, lw=0.9, alpha=0.35)
            axes.plot(*_placed(outline, trial.pose[index]), color=estimate, lw=0.9, alpha=0.6, ls="--")
        axes.fill(*_placed(outline, trial.truth[last]), color=TRUTH, alpha=0.06, lw=0)
        axes.plot(*_placed(outline, trial.truth[last]), color=TRUTH, lw=1.8)
        axes.plot(*_placed(outline, trial.pose[last]), color=estimate, lw=1.8, ls="--")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.locator_params(nbins=6)


def _placed(outline: Array, pose: Array) -> Array:
    """Outline (2, n) [mm] in the world."""
    return se2.transform(pose, outline).T * 1e3
