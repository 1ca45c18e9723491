"""The untouched gel: what an image is compared with, and its file (`.npz`)."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.files import NUMBERS, checked_array, existing_file, whole_file

Image = NDArray[np.uint8]
Levels = NDArray[np.float32]

_FIELDS = ("mean", "deviation")
_SWAPPED = 4.0  # times better that blue for red must fit: untouched values differ by noise, swapped ones by tens


@dataclass(frozen=True, eq=False)
class Background:
    """Statistics of one sensor unit's images while nothing touches it."""

    mean: Levels
    """(height, width, 3) RGB [grey levels]."""
    deviation: Levels
    """Standard deviation over time, (height, width, 3) [grey levels]."""
    file: Path | None = None
    """What it was read from, if from a file."""


def background_of(images: Iterable[Image]) -> Background:
    """Return the statistics of two or more untouched images (height, width, 3), read one after the other."""
    total, squares, count = np.zeros(()), np.zeros(()), 0
    for image in images:
        levels = image.astype(np.float64)
        total = total + levels
        squares = squares + levels**2
        count += 1
    if count < 2:
        raise SettingError(f"a background needs 2 or more untouched images, found {count}")
    mean = total / count
    variance = np.maximum(squares - count * mean**2, 0.0) / (count - 1)
    return Background(mean.astype(np.float32), np.sqrt(variance).astype(np.float32))


def check_image(image: Image, height: int, width: int) -> None:
    """SettingError unless the image is uint8 (height, width, 3)."""
    expected = f"uint8 ({height}, {width}, 3): rows, columns, red green blue"
    if not isinstance(image, np.ndarray):
        raise SettingError(f"image: found {type(image).__name__}, expected an array {expected}")
    if image.dtype != np.uint8 or image.shape != (height, width, 3):
        hint = {(width, height, 3): "turned by a quarter", (3, height, width): "channels first"}.get(image.shape)
        found = f"{image.dtype} {image.shape}" + (f", {hint}" if hint and height != width else "")
        raise SettingError(f"image: found {found}; expected {expected}")


def check_channel_order(image: Image, background: Background) -> None:
    """SettingError if the image fits the background only with red and blue swapped.

    Most of the gel looks as it did untouched, whatever touches it; so the medians over the image tell. A gel that is
    lit in greys looks the same in both orders and passes.
    """
    levels = image.astype(np.float32)
    given = np.median(np.abs(levels - background.mean))
    swapped = np.median(np.abs(levels[..., ::-1] - background.mean))
    if given > _SWAPPED * (swapped + 1.0):
        raise SettingError(
            f"image: found BGR, expected RGB: it is {given:.0f} grey levels off the untouched gel in the median, "
            f"and {swapped:.0f} with red and blue swapped"
        )


def write_background(background: Background, path: Path | str, overwrite: bool = False) -> None:
    """Write the `.npz`, whole or not at all; an existing one is replaced only if `overwrite`."""
    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, mean=background.mean, deviation=background.deviation)


def load_background(path: Path | str) -> Background:
    """Read a file of `write_background`, which runs no code. Raises FileError, in one sentence, on anything else."""
    import zipfile
    import zlib

    path = existing_file(path)
    if not zipfile.is_zipfile(path):
        raise FileError(f"{path}: is not a calibration (an .npz of palpate calibrate), or is truncated")
    try:
        with np.load(path, allow_pickle=False) as file:
            if missing := [name for name in _FIELDS if name not in file]:
                raise FileError(f"is not a calibration: {' and '.join(missing)} missing; expected mean and deviation")
            mean, deviation = (_levels(name, file[name]) for name in _FIELDS)
        if mean.shape != deviation.shape:
            raise FileError(f"deviation: found shape {deviation.shape}, expected {mean.shape} as of mean")
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    except (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(f"{path}: is truncated or damaged ({' '.join(str(error).split())})") from error
    return Background(mean, deviation, path)


def _levels(name: str, value: NDArray) -> Levels:
    levels = checked_array(name, value, NUMBERS, ("N", "N", 3))
    if levels.dtype != np.float32:
        raise FileError(f"{name}: found values of type {levels.dtype}, expected float32")
    if not levels.size or not ((levels >= 0.0) & (levels <= 255.0)).all():
        raise FileError(f"{name}: found no values, or some that are not grey levels from 0 to 255")
    return levels
