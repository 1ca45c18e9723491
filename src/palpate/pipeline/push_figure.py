"""The figure of a calibration by pushes: each number, by single pushes and by all together."""

from typing import TYPE_CHECKING

import numpy as np

from palpate.pipeline.figures import ESTIMATE, TRUTH
from palpate.pipeline.push_calibration import NUMBERS, PushFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def push_figure(fit: PushFit) -> "Figure":
    """Draw each number of a calibration by pushes with one sigma: usual, by single pushes, and by all together."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    for axes, (name, unit), row in zip(figure.subplots(2, 3).flat, NUMBERS.items(), range(len(NUMBERS)), strict=True):
        usual, usual_sigma = unit * fit.before[row]
        fitted, fitted_sigma = unit * fit.after[row]
        axes.axhspan(usual - usual_sigma, usual + usual_sigma, color=TRUTH, alpha=0.2, lw=0, label="usual robot")
        axes.axhspan(fitted - fitted_sigma, fitted + fitted_sigma, color=ESTIMATE, alpha=0.3, lw=0)
        axes.axhline(fitted, color=ESTIMATE, label="all pushes")
        if row < fit.each.shape[1]:
            mean, deviation = unit * fit.each[:, row].T
            axes.errorbar(np.arange(1, len(mean) + 1), mean, deviation, fmt="o", ms=3, color="black", label="one push")
        axes.set_title(name, fontsize=10)
        axes.set_xlim(0.5, len(fit.each) + 0.5)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure
