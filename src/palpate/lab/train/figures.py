"""Pictures of what a touch model has learned, on recordings that it was not trained on."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import erf

from palpate.files import whole_file
from palpate.lab.train.features import Features, PairModels, kind_of_pairs
from palpate.lab.train.learn import Touch
from palpate.lab.train.pairs import draw_pairs, turned
from palpate.lab.train.samples import Samples
from palpate.touch.difference import COLUMNS, ROWS
from palpate.touch.model import KINDS, Spread

Array = NDArray[np.float64]

_ROWS, _COLUMNS = 3, 6
_SHOWN = 1500  # pairs in a scatter plot


def training_figures(
    samples: Samples,
    seen: Features,
    models: PairModels,
    touch: Touch,
    spread: Mapping[str, Spread],
    folder: Path,
) -> None:
    """Write keypoints.png, turns.png and calibration.png to a folder."""
    figures = {
        "keypoints": keypoint_figure(samples, seen),
        "turns": turn_figure(samples, seen, models),
        "calibration": calibration_figure(samples, seen, touch, spread),
    }
    for name, figure in figures.items():
        with whole_file(folder / f"{name}.png", overwrite=True) as part:
            figure.savefig(part, format="png", dpi=110)


def keypoint_figure(samples: Samples, seen: Features) -> Figure:
    """Return key points over touch images, as the network sees them, of all kinds of contact in turn."""
    figure = Figure(figsize=(_COLUMNS * 1.7, _ROWS * 2.0), layout="constrained")
    rng = np.random.default_rng(0)
    there = [index for index in range(len(KINDS)) if (samples.kind == index).any()]
    for place, axes in enumerate(figure.subplots(_ROWS, _COLUMNS).flat):
        kind = there[place % len(there)]
        index = int(rng.choice(np.flatnonzero(samples.kind == kind)))
        shown = np.clip(0.5 + 0.3 * samples.difference[index].astype(np.float32), 0.0, 1.0)
        axes.imshow(shown, aspect=4 / 3 * COLUMNS / ROWS)
        column, row = 0.5 * (seen.keypoint[index] + 1.0) * (COLUMNS, ROWS) - 0.5
        axes.plot(column, row, "+", color="white", markersize=12, markeredgewidth=2)
        told = KINDS[int(seen.kinds[index].argmax())]
        axes.set_title(KINDS[kind] if told == KINDS[kind] else f"{KINDS[kind]}, told {told}", fontsize=8)
        axes.set_axis_off()
    figure.suptitle("Difference from the untouched gel, and the key point (+)", fontsize=10)
    return figure


def turn_figure(samples: Samples, seen: Features, models: PairModels) -> Figure:
    """Return told against true turns between two images, by model and kind of contact."""
    earlier, later = draw_pairs(samples, 20 * _SHOWN, np.random.default_rng(2))
    true = turned(samples, earlier, later)
    kinds = kind_of_pairs(samples, earlier, later)
    names = ["linear engineered", "linear learnt", "nonlinear learnt", "descriptor pair", "image turn"]
    figure = Figure(figsize=(len(names) * 2.6, 3.2), layout="constrained")
    limit = float(np.degrees(np.quantile(np.abs(true), 0.995)))
    for axes, name in zip(figure.subplots(1, len(names), sharey=True), names, strict=True):
        told = np.degrees(np.arcsin(np.clip(models.tell[name](seen, earlier, later), -1.0, 1.0)))
        for kind in KINDS:
            chosen = np.flatnonzero(kinds[kind])[: _SHOWN // len(KINDS)]
            axes.plot(np.degrees(true[chosen]), told[chosen], ".", markersize=2, label=kind)
        axes.plot([-limit, limit], [-limit, limit], color="black", linewidth=0.8)
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="true turn [deg]", aspect="equal")
        axes.set_title(name, fontsize=10)
    figure.axes[0].set_ylabel("told turn [deg]")
    figure.axes[0].legend(fontsize=7, markerscale=4, loc="upper left")
    return figure


def calibration_figure(samples: Samples, seen: Features, touch: Touch, spread: Mapping[str, Spread]) -> Figure:
    """Return how often truth lies within an interval against how often it should, and told against found errors."""
    from palpate.lab.train.results import prediction_errors

    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    covered, told = figure.subplots(1, 2)
    deviations = np.linspace(0.0, 3.0, 61)
    for name, (error, variance) in prediction_errors(samples, seen, touch).items():
        if name == "place":
            continue  # in other units
        sigma = np.sqrt(variance * spread[name].scale)
        shares = [np.mean(np.abs(error) <= width * sigma) for width in deviations]
        covered.plot(100.0 * erf(deviations / np.sqrt(2.0)), 100.0 * np.array(shares), label=name)
        _binned(told, sigma, error, name)
    covered.plot([0, 100], [0, 100], color="black", linewidth=0.8)
    covered.set(xlabel="share that should lie within [%]", ylabel="share that does [%]", aspect="equal")
    covered.legend()
    told.set(xlabel="told standard deviation [deg]", ylabel="root mean square error [deg]", xscale="log", yscale="log")
    low, high = np.array([told.get_xlim(), told.get_ylim()]).T
    told.plot([low.min(), high.max()], [low.min(), high.max()], color="black", linewidth=0.8)
    return figure


def _binned(axes: Axes, sigma: Array, error: Array, name: str) -> None:
    """Plot root mean square errors against told standard deviations, in ten bins of as many each."""
    order = np.array_split(np.argsort(sigma), 10)
    told = [np.degrees(np.sqrt(np.mean(sigma[bin] ** 2))) for bin in order]
    found = [np.degrees(np.sqrt(np.mean(error[bin] ** 2))) for bin in order]
    axes.plot(told, found, "o-", markersize=4, label=name)
