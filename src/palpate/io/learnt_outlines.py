"""Files of learnt outlines: the points with their band in the folder of a run, and a drawing for next time."""

import json
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import in_file, read_json, whole_file, write_json
from palpate.types.outline import Outline

_FIELDS = ("points", "deviation", "touched", "origin")


def write_outline(outline: Outline, path: Path) -> None:
    """Write an outline as JSON: points and origin [m], object frame, deviations [m], and which points were touched."""
    data = {name: np.asarray(getattr(outline, name)).tolist() for name in _FIELDS}
    write_json(path, data)


def read_outline(path: Path) -> Outline:
    """Return the outline that `write_outline` wrote; raises FileError on anything else."""
    with in_file(path):
        data = read_json(path)
        try:
            points = np.array(data["points"], np.float64)
            deviation = np.array(data["deviation"], np.float64)
            touched = np.array(data["touched"], np.bool_)
            origin = np.array(data.get("origin", (0.0, 0.0)), np.float64)  # earlier versions had none
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"is no learnt outline: lacks {', '.join(_FIELDS)} of numbers") from error
        is_whole = points.shape[1:] == origin.shape == (2,) and len(points) == len(deviation) == len(touched)
        if not is_whole:
            raise FileError(f"is no learnt outline: found {points.shape} points and {deviation.shape} deviations")
    return Outline(points, deviation, touched, origin)


def draw_outline(outline: Outline, path: Path, force: bool = False) -> None:
    """Write an outline as a drawing, .svg in millimetres or .json, which `load_shape` reads, with its sigma in words.

    Raises FileError if the path has another extension, or exists without `force`.
    """
    suffix = path.suffix.lower()
    if suffix not in (".svg", ".json"):
        raise FileError(f"{path}: extension {path.suffix!r} is of no outline to write, allowed are .svg and .json")
    sigma = 1e3 * outline.sigma
    points = 1e3 * outline.shape.corners
    if suffix == ".json":
        text = json.dumps({"vertices": outline.shape.corners.tolist()})
    else:
        low = points.min(axis=0) - 5.0
        width, height = np.ptp(points, axis=0) + 10.0
        placed = (points - low) * (1.0, -1.0) + (0.0, height)
        path_words = " L ".join(f"{x:.3f} {y:.3f}" for x, y in placed.tolist())
        text = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.3f}mm" height="{height:.3f}mm" '
            f'viewBox="0 0 {width:.3f} {height:.3f}">\n'
            f"<desc>learnt by touch; --outline-sigma {sigma:.1f}mm</desc>\n"
            f'<path d="M {path_words} Z" fill="#cccccc" stroke="none"/>\n</svg>\n'
        )
    with whole_file(path, overwrite=force) as part:
        part.write_text(text, encoding="utf-8")
