"""The objects that are simulated: those that have names, and outlines that a user gives."""

from pathlib import Path

from palpate.errors import FileError
from palpate.geometry.objects import SHAPES
from palpate.geometry.shapes import Shape
from palpate.io.outlines.load import Unit, load_shape
from palpate.types.units import extent_of

PAPER = ("disc", "rectangle", "ellipse")
"""The paper's objects."""

_EXTENT = (0.05, 0.5)  # [m] larger than a gel, and no larger than what a sensor goes round in a few seconds


def find_shape(name: str, unit: Unit | None = None) -> tuple[str, Shape]:
    """Return name and shape of an object, as `load_shape` takes it; the name of one in a file is the file's stem.

    Raises what `load_shape` does, and FileError where it is too small or too large to be pushed about.
    """
    shape = load_shape(name, unit)
    extent = extent_of(shape)
    if not _EXTENT[0] <= extent <= _EXTENT[1]:
        raise FileError(f"{name}: the outline is {extent:g} m wide, allowed is {_EXTENT[0]} to {_EXTENT[1]} m")
    return (Path(name).stem if Path(name).is_file() and name not in SHAPES else name), shape
