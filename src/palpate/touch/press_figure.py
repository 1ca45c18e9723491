"""Figure of a calibration by presses: images in the view found, and measured over true angles."""

from typing import TYPE_CHECKING

import numpy as np

from palpate.touch.press_calibration import Presses, PressFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 6  # images


def press_figure(presses: Presses, fit: PressFit) -> "Figure":
    """Return presses from the least to the greatest angle as they are seen now, and measured over true angles."""
    from matplotlib.figure import Figure

    view, direction = fit.calibration.view, fit.calibration.direction
    order = np.argsort(fit.angle)
    shown = order[np.linspace(0, len(order) - 1, min(_SHOWN, len(order))).astype(int)]
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    grid = figure.add_gridspec(2, 6)
    for place, index in enumerate(shown.tolist()):
        axes = figure.add_subplot(grid[place // 3, place % 3])
        axes.imshow(view.of(presses.images[index]))
        axes.set_title(f"{np.degrees(fit.angle[index]):+.1f}°", fontsize=8)
        axes.set(xticks=[], yticks=[])
    axes = figure.add_subplot(grid[:, 3:])
    true, measured = np.degrees(fit.angle), np.degrees(fit.measured)
    ends = np.array([true.min(), true.max()])
    axes.plot(ends, ends, color="0.7", lw=1.0, label="as given" if presses.is_measured else "as imprints lie")
    if presses.is_measured:
        offset, scale = np.degrees(direction.offset), direction.scale
        axes.plot(ends, offset + scale * ends, color="#0072B2", lw=1.0, label=f"{offset:+.2f}° + {scale:.3f} x")
    axes.plot(
        true, measured, "o", color="#D55E00", ms=4, label=f"measured, {np.degrees(fit.scatter):.2f}° about the line"
    )
    axes.set(xlabel="angle of the contact [°]", ylabel="measured [°]", title=f"images read {view}")
    axes.legend(fontsize=8)
    return figure
