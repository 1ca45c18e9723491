"""`palpate outline`, and the outline of an object that nobody drew as options of `palpate track`."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import palpate
from palpate.cli.console import Report
from palpate.cli.options import Bag, Force, arg
from palpate.cli.quantities import LENGTH, quantities, quantity
from palpate.cli.sources import Source
from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import new_file

_WORD = "unknown"


@dataclass(frozen=True)
class LearntOutline:
    """An outline that touch learns: --shape unknown, unknown:50mm-200mm, or a sketch with its sigma."""

    outline_sigma: Annotated[
        float | None, quantities("--outline-sigma", "M", LENGTH), arg("M", "none; the outline is as drawn")
    ] = None
    """Standard deviation of the true outline across that of --shape, a sketch: touch learns the rest [m]."""

    def of(self, bag: Bag) -> "palpate.Unknown | palpate.Sketch | None":
        """Return the outline that is to be learnt; None for a known one. Raises SettingError."""
        words = bag.shape or ""
        unknown = unknown_in_words(words)
        if unknown and (bag.shape_unit or bag.shape_layer):
            raise SettingError(f"--shape-unit and --shape-layer are of a drawing; found --shape {words}")
        if self.outline_sigma is None:
            return unknown
        if unknown or not words:
            found = f"--shape {words}" if words else "no --shape"
            raise SettingError(f"--outline-sigma is of a sketch; found {found}, allowed is --shape FILE")
        shape = palpate.load_shape(words, bag.shape_unit, bag.shape_layer)
        try:
            return palpate.Sketch(shape, self.outline_sigma)
        except PalpateError as error:
            raise SettingError(f"--shape {words} with --outline-sigma: {error}") from error


def unknown_in_words(words: str) -> "palpate.Unknown | None":
    """Return the outline that is meant by `unknown` or `unknown:50mm-200mm`; None for words of another."""
    first, colon, sizes = words.partition(":")
    if first.lower() != _WORD:
        return None
    if not colon:
        return palpate.Unknown()
    match = re.fullmatch(r"([^-]+)-([^-]+)", sizes)
    if match is None:
        raise SettingError(f"shape {words}: allowed is unknown or unknown:LEAST-LARGEST, as unknown:50mm-200mm")
    least, largest = (quantity(word, LENGTH) for word in match.groups())
    return palpate.Unknown((least, largest))


def read_for(outline: "palpate.Unknown | palpate.Sketch | None", source: Source, file: Path) -> "palpate.BagReading":
    """Return a recording, and the plane of its push, of an object whose outline is known or to be learnt.

    A recording's own outline is kept for scores; where there is none, another takes its place. Raises PalpateError.
    """
    if outline is None:
        return source.read(file)
    bag = replace(source.bag, shape=None, shape_unit=None, shape_layer=None)
    if _has_outline(file):
        return replace(source, bag=bag).read(file)
    if isinstance(outline, palpate.Unknown):
        bag = replace(bag, shape=f"{outline.mean_width:g}x{outline.mean_width:g}")
    else:
        bag = source.bag
    recording, plane = replace(source, bag=bag).read(file)
    return palpate.BagReading(replace(recording, is_shape_known=False), plane)


def _has_outline(file: Path) -> bool:
    """Return True for a recording with an outline of its own."""
    from palpate.io import detect_format
    from palpate.io.lerobot import has_outline, is_lerobot

    if is_lerobot(file):
        return has_outline(file)
    return file.is_file() and detect_format(file) not in (None, "bag")


def outline(
    run: Annotated[Path, arg("RUN")], /, *, out: Annotated[Path, arg("FILE.svg|FILE.json")], force: Force = False
) -> Report:
    """Write the outline that a run has learnt as a drawing, with its sigma, to be the --shape of the next run.

    Example: palpate outline runs/push --out part.svg

    Args:
        run: Folder of a run by palpate track with --shape unknown, or with --outline-sigma.
        out: The drawing, in millimetres.
    """
    from palpate.io.learnt_outlines import draw_outline, read_outline
    from palpate.pipeline.run_folder import OUTLINE

    path = run / OUTLINE
    if not run.exists():
        raise FileError(f"{run}: no such folder; allowed is the folder of a run")
    if not path.exists():
        raise FileError(f"{run}: holds no learnt outline; track with --shape unknown, or --outline-sigma with a sketch")
    new_file(out, force)
    learnt = read_outline(path)
    draw_outline(learnt, out, force)
    data = {
        "out": str(out),
        "width_mm": 1e3 * learnt.shape.extent,
        "sigma_mm": 1e3 * learnt.sigma,
        "touched_share": float(learnt.touched.mean()),
        "widest_gap_share": learnt.widest_gap,
    }
    is_svg = out.suffix.lower() == ".svg"
    centroid = learnt.shape.centroid
    notes = [_next_time(palpate.Polygon(learnt.points - is_svg * centroid), learnt.sigma, out)]
    if learnt.guessed_share:
        notes.append(f"{learnt.guessed_share:.0%} of it, in one piece, is a guess, as nothing touched it")
    if is_svg:
        x, y = 1e3 * centroid
        notes.append(f"an SVG is put about its centroid, {x:.1f}, {y:.1f} mm in the run's object frame; .json keeps it")
    return Report(out.name, data, notes=notes)


def _next_time(shape: "palpate.Shape", sigma: float, out: Path) -> str:
    """Return the options that take an outline and its deviation [m] as the next run's sketch, or why that cannot be."""
    try:
        palpate.Sketch(shape, sigma)
    except PalpateError as error:
        return f"it cannot be the sketch of the next run: {error}"
    return f"next time: --shape {out} --outline-sigma {1e3 * sigma:.1f}mm"
