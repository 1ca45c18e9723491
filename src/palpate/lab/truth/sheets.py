"""The sheets to print, true to scale: tags for table, object and sensor, and the calibration board."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.geometry.shapes import Shape
from palpate.lab.truth.tags import OBJECT, SENSOR, SQUARE, SQUARES, TABLE, Tag, board, tag_image

Array = NDArray[np.float64]

PAPERS = {"a4": (0.297, 0.21), "a3": (0.42, 0.297)}
"""Sizes of paper, broad side first [m]."""


def write_sheets(path: Path, name: str, shape: Shape, paper: str = "a4", overwrite: bool = False) -> None:
    """Write a PDF of four pages for an object. Raises SettingError if its outline is larger than the paper."""
    from matplotlib.backends.backend_pdf import PdfPages

    size, margin = np.array(PAPERS[paper]), 0.008  # [m] that printers leave white
    outline = shape.outline()
    extent = np.ptp(outline, axis=0)
    if (extent > size - 2 * margin).any():
        width, height = 1e3 * extent
        raise SettingError(f"{name} is {width:.0f} x {height:.0f} mm, larger than {paper}; --paper a3 is larger")
    middle = outline.min(axis=0) + 0.5 * extent
    half = 0.5 * SQUARE * np.array(SQUARES)
    with whole_file(path, overwrite) as part, PdfPages(part, metadata={"CreationDate": None}) as pdf:
        pdf.savefig(_page(size, "Table: lay it flat and fix it, all four tags in view", TABLE)[0])
        figure, axes = _page(size, f"Object {name}: cut along the outline, glue it on top", (OBJECT,), -middle)
        axes.plot(*(np.vstack([outline, outline[:1]]) - middle).T, "k-", linewidth=0.5)
        pdf.savefig(figure)
        pdf.savefig(_page(size, "Sensor: fix the tag on top, parallel to the table", (SENSOR,))[0])
        figure, axes = _page(
            size, f"Board for palpate truth-camera: glue it on something flat; squares of {SQUARE * 1e3:.0f} mm"
        )
        _draw(axes, board().generateImage((SQUARES[0] * 245, SQUARES[1] * 245), None, 0, 1), -half, half)
        pdf.savefig(figure)


def _page(size: Array, title: str, tags: Iterable[Tag] = (), shift: Array | tuple[float, float] = (0, 0)) -> Any:
    """Return figure and axes of a page, in metres from its middle, with tags and a line of 100 mm to measure."""
    from matplotlib.figure import Figure

    left, low = -0.5 * size
    figure = Figure((float(size[0]) / 0.0254, float(size[1]) / 0.0254))  # [inch]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.axis("off")
    axes.text(left + 0.012, -low - 0.012, title, fontsize=9, va="top")
    axes.plot((-0.05, 0.05), (low + 0.012, low + 0.012), "k-", linewidth=1.0)
    axes.text(0.055, low + 0.012, "100 mm, if printed at 100 %", fontsize=7, va="center")
    for tag in tags:
        corners = tag.corners + shift
        _draw(axes, tag_image(tag.number, 8), corners.min(axis=0), corners.max(axis=0))  # a pixel for each square
    axes.set(xlim=(left, -left), ylim=(low, -low))
    return figure, axes


def _draw(axes: Any, image: Any, low: Array, high: Array) -> None:
    """Draw a picture between two corners (2,) [m]."""
    window = axes.axis()
    extent = (low[0], high[0], low[1], high[1])
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
    axes.axis(window)
