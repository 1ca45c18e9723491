"""The picture of what single images say: each image, its change from the untouched gel, and where it is touched."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.files import whole_file
from palpate.pipeline.figures import ESTIMATE, own_style
from palpate.touch.one_image import ImageReading

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST = 12
"""Images that a picture shows."""


def in_words(reading: ImageReading) -> str:
    """Return the reading of an image in words."""
    if reading.place is not None:
        return f"place {1e3 * reading.place[0]:.2f} ± {1e3 * reading.place[1]:.2f} mm"
    if reading.direction is not None:
        angle, sigma = np.degrees(reading.direction)
        return f"direction {angle:.1f} ± {sigma:.1f}°"
    return "contact, whose place only a touch model could tell" if reading.contact else "no contact"


def write_picture(readings: Mapping[str, ImageReading], path: Path, overwrite: bool) -> None:
    """Write the picture of the first readings, by the name of their image, as PNG. Raises FileError."""
    from matplotlib.figure import Figure

    shown = dict(list(readings.items())[:MOST])
    with own_style(), whole_file(path, overwrite) as part:
        figure = Figure(figsize=(7.5, 3.4 * len(shown)), layout="constrained")
        rows: Any = figure.subplots(len(shown), 2, squeeze=False)
        for (name, reading), (left, right) in zip(shown.items(), rows, strict=True):
            change = reading.image.astype(np.float32) - reading.untouched
            left.set_title(f"{name}: {in_words(reading)}", loc="left", fontsize=9)
            right.set_title("change, twice as strong", loc="left", fontsize=9)
            _draw(left, reading.image, reading)
            _draw(right, np.clip(128.0 + 2.0 * change, 0, 255).astype(np.uint8), reading)
        figure.savefig(part, format="png", dpi=100)


def _draw(axes: "Axes", image: Any, reading: ImageReading) -> None:
    """Draw an image with the column that is touched, and a band of 95 %."""
    axes.imshow(image)
    axes.set_axis_off()
    if reading.column is None:
        return
    column, sigma = reading.column
    axes.axvline(column, color="white", linewidth=2.5)
    axes.axvline(column, color=ESTIMATE, linewidth=1.2)
    axes.axvspan(column - 1.96 * sigma, column + 1.96 * sigma, color=ESTIMATE, alpha=0.2)
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
