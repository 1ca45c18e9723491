"""Presses at known angles as files: a table that names the image of each and its angle."""

from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import existing_file, read_csv
from palpate.recording.images import image_size
from palpate.touch.background import Image, is_grey
from palpate.touch.presses import Presses


def read_presses(path: Path, grey: bool = False) -> Presses:
    """Read a CSV with columns file and angle_deg and the images it names, relative to its folder; FileError if not.

    Grey images are taken only if `grey`.
    """
    columns, *lines = read_csv(path) or [[]]
    rows = [dict(zip(columns, line, strict=False)) for line in lines if line]
    if not rows or not {"file", "angle_deg"} <= set(columns):
        found = ", ".join(columns) if rows else "no rows"
        raise FileError(f"{path}: found {found}; expected a CSV with columns file and angle_deg")
    angles = []
    for number, row in enumerate(rows, 1):
        try:
            angles.append(float(row["angle_deg"]))
        except (KeyError, ValueError):
            angles.append(np.nan)
        if not abs(angles[-1]) <= 90.0:
            found = row.get("angle_deg")
            raise FileError(f"{path}: row {number}: angle_deg is {found!r}; expected -90 to 90 degrees")
        if not (name := row.get("file", "")).isprintable() or not name:
            raise FileError(f"{path}: row {number}: file is {name!r}; expected the name of an image")
    names = tuple(row["file"] for row in rows)
    return Presses(tuple(read_image(path.parent / name, grey) for name in names), np.radians(angles), names)


def read_image(path: Path, grey: bool = False) -> Image:
    """Return an image file as (height, width, 3) RGB; FileError where it is none, or a grey one unless `grey`."""
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
