"""What is to be printed, true to scale: the sheet of the table, a template of the object, the sensor's tag, a board."""

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

_MARGIN = 0.008  # [m] that printers leave white
_INCH = 0.0254


def write_sheets(path: Path, name: str, shape: Shape, paper: str = "a4", overwrite: bool = False) -> None:
    """Write a PDF of four pages for an object. Raises SettingError where its outline is larger than the paper."""
    from matplotlib.backends.backend_pdf import PdfPages

    width, height = PAPERS[paper]
    outline = shape.outline()
    broad, tall = np.ptp(outline, axis=0)
    if broad > width - 2 * _MARGIN or tall > height - 2 * _MARGIN:
        raise SettingError(
            f"{name} is {broad * 1e3:.0f} x {tall * 1e3:.0f} mm, larger than {paper}; --paper a3 is larger"
        )
    middle = outline.min(axis=0) + 0.5 * np.ptp(outline, axis=0)
    pages = (
        ("Table: lay it flat and fix it, all four tags in view", TABLE, None),
        (f"Object {name}: cut along the outline, glue it on top, edge on edge", (OBJECT,), outline),
        ("Sensor: fix the tag on top, parallel to the table", (SENSOR,), None),
    )
    with whole_file(path, overwrite) as part, PdfPages(part, metadata={"CreationDate": None}) as pdf:
        for title, tags, edge in pages:
            figure, axes = _page(width, height, title)
            shift = -middle if edge is not None else np.zeros(2)
            if edge is not None:
                axes.plot(*(np.vstack([edge, edge[:1]]) + shift).T, "k-", linewidth=0.5)
            _draw(axes, tags, shift)
            pdf.savefig(figure)
        figure, axes = _page(
            width,
            height,
            f"Board for palpate truth-camera: glue it on something flat; squares of {SQUARE * 1e3:.0f} mm",
        )
        half = 0.5 * SQUARE * np.array(SQUARES)
        picture = board().generateImage((SQUARES[0] * 245, SQUARES[1] * 245), None, 0, 1)
        axes.imshow(picture, cmap="gray", extent=(-half[0], half[0], -half[1], half[1]), interpolation="nearest")
        axes.set(xlim=(-width / 2, width / 2), ylim=(-height / 2, height / 2))
        pdf.savefig(figure)


def _page(width: float, height: float, title: str) -> tuple[Any, Any]:
    """A page whose axes are in metres from its middle, with a line of 100 mm to be measured after printing."""
    from matplotlib.figure import Figure

    figure = Figure((width / _INCH, height / _INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-width / 2, width / 2), ylim=(-height / 2, height / 2))
    axes.axis("off")
    axes.text(-width / 2 + 0.012, height / 2 - 0.012, title, fontsize=9, va="top")
    low = -height / 2 + 0.012
    axes.plot((-0.05, 0.05), (low, low), "k-", linewidth=1.0)
    axes.text(0.055, low, "100 mm, if printed at 100 %", fontsize=7, va="center")
    return figure, axes


def _draw(axes: Any, tags: Iterable[Tag], shift: Array) -> None:
    """Draw tags on a page, moved by `shift` (2,) [m]."""
    for tag in tags:
        low, high = (tag.corners + shift).min(axis=0), (tag.corners + shift).max(axis=0)
        axes.imshow(
            tag_image(tag.number, 8),  # a pixel for each of its squares
            cmap="gray",
            vmin=0,
            vmax=255,
            extent=(low[0], high[0], low[1], high[1]),
            interpolation="nearest",
        )
