"""An outline from what a user has of one: a name, two lengths or a file."""

import re
from pathlib import Path
from typing import Literal, get_args

from palpate.errors import FileError, SettingError, ShapeError
from palpate.geometry.objects import SHAPES
from palpate.geometry.shapes import Rectangle, Shape
from palpate.io.outlines.dxf import read_dxf
from palpate.io.outlines.svg import read_svg
from palpate.io.outlines.tables import read_json_shape, read_table
from palpate.io.sniff import NUMBER
from palpate.types.units import METRES, wrong_width

Unit = Literal["m", "cm", "mm", "in"]
READERS = {".svg": read_svg, ".dxf": read_dxf, ".json": read_json_shape}
"""What reads a file of each extension; files of any other are tables."""

_LENGTHS = re.compile(rf"(?P<x>{NUMBER})x(?P<y>{NUMBER})")


def load_shape(source: str | Path, unit: Unit | None = None) -> Shape:
    """Return the outline of an object from a name such as "disc", two lengths such as "0.09x0.06", or a file.

    Files are tables (.csv, .txt: a corner x y a line), JSON ({"vertices": [[x, y], ...]} or as palpate writes shapes),
    SVG and DXF (`pip install palpate[outlines]`). A table of 50 points or more that are noisy is taken as a scan:
    simplified, and a warning tells the noise. `unit` is that of the numbers, by default metres, or what a drawing says.
    Points keep their places in the object frame; an SVG, whose origin is a corner of the page, is put about its
    centroid, y up.

    Raises SettingError for a name that is not known, FileError for a file that holds no outline or one of a size that
    shows another unit.
    """
    name = str(source)
    if unit not in (None, *get_args(Unit)):
        raise SettingError(f"unit is {unit!r}; allowed are {', '.join(METRES)}")
    scale = None if unit is None else METRES[unit]
    if name in SHAPES:
        if unit is not None:
            raise SettingError(f"unit is {unit!r}, but {name} is an object of a known size")
        return SHAPES[name]
    lengths, path = _LENGTHS.fullmatch(name), Path(source)
    try:
        if lengths and not path.exists():
            shape: Shape = Rectangle(*(float(lengths[axis]) * (scale or 1.0) for axis in "xy"))
        elif path.is_file():
            shape = READERS.get(path.suffix.lower(), read_table)(path, scale)
        elif path.is_dir():
            raise FileError(f"{name}: is a folder, expected a file of an outline")
        elif "/" in name or path.suffix[1:2].isalpha():
            raise FileError(f"{name}: no such file")
        else:
            names = ", ".join(SHAPES)
            raise SettingError(
                f"shape is {name!r}; allowed are {names}, two lengths such as 0.09x0.06 [m], or a file of an outline"
            )
        if wrong := wrong_width(shape, unit, "unit={unit!r} (--shape-unit {unit})"):
            raise ShapeError(wrong)
    except ShapeError as error:
        raise FileError(f"{name}: {error}") from error
    return shape
