"""Sheets of small pictures of one size: a PNG of the whole, and the pictures alone for a page that lets them flow."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from PIL.Image import Image

DPI = 150
_FONTS: Any = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.alpha": 0.25,
}
_BELOW, _RIGHT = 0.52, 0.14  # margins about the axes of a picture [inch]


@dataclass(frozen=True)
class Key:
    """An entry of a legend."""

    label: str
    """What it stands for."""
    colour: str
    """#rrggbb"""
    dashes: tuple[float, ...] = ()
    """Lengths of dash and gap in turn, in widths of the line; none for a line drawn through."""
    marker: bool = False
    """A dot instead of a line."""
    band: bool = False
    """A filled area instead of a line."""


@dataclass(frozen=True)
class Tile:
    """One picture of a sheet."""

    title: str
    """What stands above it, of one line or more."""
    alt: str
    """What it shows, for those who cannot see it."""
    draw: Callable[["Axes"], None]
    """Draws it."""


@dataclass(frozen=True)
class Sheet:
    """Pictures that belong together."""

    name: str
    """Of its file, without the ending."""
    title: str
    """What it is about."""
    caption: str
    """What to see, and how it was computed."""
    tiles: tuple[Tile, ...]
    """At least one."""
    legend: tuple[Key, ...] = ()
    """What lines and dots stand for in all of them."""
    width: float = 4.2
    """Of a picture [inch]."""
    height: float = 3.1
    """Of a picture [inch]."""
    left: float = 0.78
    """Margin left of the axes [inch]."""
    columns: int = 4
    """Pictures beside each other in the whole sheet, at most."""


def render(sheet: Sheet) -> tuple[bytes, tuple[bytes, ...]]:
    """Draw a sheet: the whole of it with title and legend, and each of its pictures alone; as PNG."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(sheet.columns, len(sheet.tiles))
    rows = -(-len(sheet.tiles) // columns)
    in_row = max(1, int(columns * sheet.width / 1.65))
    above = 0.18 + 0.18 * max(tile.title.count("\n") + 1 for tile in sheet.tiles)
    header = 0.4 + 0.26 * -(-len(sheet.legend) // in_row)
    # Whole pixels, so that pictures can be cut out.
    width, height, header = (round(length * DPI) for length in (sheet.width, sheet.height, header))
    size = np.array([columns * width, header + rows * height])
    with mpl.rc_context(_FONTS):
        figure = Figure(figsize=tuple(size / DPI), dpi=DPI)
        canvas = FigureCanvasAgg(figure)
        figure.text(0.1 * DPI / size[0], 1.0 - 0.1 * DPI / size[1], sheet.title, fontsize=12, weight="bold", va="top")
        if sheet.legend:
            figure.legend(
                handles=[_handle(key) for key in sheet.legend],
                loc="upper left",
                bbox_to_anchor=(0.0, 1.0 - 0.32 * DPI / size[1]),
                ncols=min(in_row, len(sheet.legend)),
                frameon=False,
            )
        for index, tile in enumerate(sheet.tiles):
            row, column = divmod(index, columns)
            corner = np.array([column * width, (rows - 1 - row) * height]) + DPI * np.array([sheet.left, _BELOW])
            inner = np.array([width, height]) - DPI * np.array([sheet.left + _RIGHT, _BELOW + above])
            axes = figure.add_axes((*(corner / size), *(inner / size)))
            tile.draw(axes)
            axes.set_title(tile.title)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    whole = _few_colours(pixels)
    pictures = []
    for index in range(len(sheet.tiles)):
        row, column = divmod(index, columns)
        left, top = column * width, header + row * height
        pictures.append(_png(whole.crop((left, top, left + width, top + height))))
    return _png(whole), tuple(pictures)


def _handle(key: Key) -> "Artist":
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if key.band:
        return Patch(color=key.colour, label=key.label)
    if key.marker:
        return Line2D([], [], color=key.colour, ls="", marker="o", label=key.label)
    return Line2D([], [], color=key.colour, ls=line_style(key.dashes), lw=2.0, label=key.label)


def line_style(dashes: tuple[float, ...]) -> str | tuple[float, tuple[float, ...]]:
    """How matplotlib calls dashes."""
    return (0.0, dashes) if dashes else "-"


def plain_ticks(axis: "Axis", subs: tuple[float, ...] = (1.0,)) -> None:
    """Write 0.1 and 10 on a logarithmic axis, not powers of ten; `subs` are the numbers within a decade."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _few_colours(pixels: NDArray[np.uint8]) -> "Image":
    """Pixels (height, width, 3) in 256 colours, which are plenty for lines and make a third of the size."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(pixels))
    return image.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _png(image: "Image") -> bytes:
    with io.BytesIO() as file:
        image.save(file, "PNG")
        return file.getvalue()
