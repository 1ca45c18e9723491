"""Files of presses: a table that names the image of each and its angle, or the images in order."""

import math
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import csv_rows, existing_file, read_text
from palpate.touch.background import Image, is_grey
from palpate.touch.press_calibration import Presses
from palpate.types.images import image_size


def read_presses(path: Path, grey: bool = False, in_order: bool = False) -> Presses:
    """Read a CSV with columns file and angle_deg, and its images relative to the folder; raises FileError.

    Grey images are allowed only with `grey`, a table without angles, of presses in order, only with `in_order`.
    """
    columns, *lines = csv_rows(read_text(path), path) or [[]]
    rows = [dict(zip(columns, line, strict=False)) for line in lines if line]
    has_angles = "angle_deg" in columns
    if not rows or "file" not in columns or not (has_angles or in_order):
        found = ", ".join(columns) if rows else "no rows"
        raise FileError(f"{path}: found {found}; expected a CSV with columns file and angle_deg")
    for number, row in enumerate(rows, 1):
        if has_angles and not abs(_angle(row)) <= 90.0:
            found = row.get("angle_deg")
            raise FileError(f"{path}: row {number}: angle_deg is {found!r}; expected -90 to 90 degrees")
        if not (name := row.get("file", "")).isprintable() or not name:
            raise FileError(f"{path}: row {number}: file is {name!r}; expected the name of an image")
    names = tuple(row["file"] for row in rows)
    images = tuple(read_image(path.parent / name, grey) for name in names)
    return Presses(images, np.radians([_angle(row) for row in rows]), names)


def _angle(row: dict[str, str]) -> float:
    """Return the angle in a row [deg]; NaN if there is none."""
    try:
        return float(row["angle_deg"])
    except (KeyError, ValueError):
        return math.nan


def read_image(path: Path, grey: bool = False) -> Image:
    """Return an image file as (height, width, 3) RGB; raises FileError if it is none, or grey without `grey`."""
    import cv2

    data = existing_file(path).read_bytes()
    try:
        known = image_size(data)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if known else None
    if image is None or image.dtype != np.uint8:
        raise FileError(f"{path}: is no PNG or JPEG of 8 bits that can be read")
    is_one_channel = image.ndim != 3
    if is_one_channel:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    if not grey and (is_one_channel or is_grey(np.asarray(image[..., :3], np.uint8))):
        raise FileError(f"{path}: is a grey image; touch images are in colours")
    return np.ascontiguousarray(image[..., 2::-1], np.uint8)
