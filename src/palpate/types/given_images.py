"""Touch images as a user has them, as the bytes that a recording keeps."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import existing_file
from palpate.types.images import Codec, codec_of, decode_image, encode_image

Images = NDArray[np.uint8] | Sequence[NDArray[np.uint8] | bytes | str | Path]
"""What a user may have of images: arrays (N, height, width, 3), encoded bytes, or paths of files."""


def encoded_images(images: Images, codec: Codec, size: tuple[int, int]) -> tuple[tuple[bytes, ...], Codec]:
    """One or more images of this size (rows, columns) as encoded bytes, and how they are encoded.

    Arrays become `codec`; bytes and files stay as they are. Raises FileError that names the first image which is
    neither a colour image of this size nor JPEG or PNG, or files of both kinds.
    """
    data = tuple(_encoded(index, image, codec, size) for index, image in enumerate(images))
    found = codec
    for index, each in enumerate(data):
        if (kind := codec_of(each)) is None:
            raise FileError(f"images: image {index} is neither JPEG nor PNG; its bytes begin with {each[:8]!r}")
        if index and kind != found:
            raise FileError(f"images: image {index} is {kind}, those before it are {found}; expected one of them")
        found = kind
    try:
        decode_image(data[0], found, size)
    except FileError as error:
        raise FileError(f"images: image 0: {error}") from error
    return data, found


def check_several(images: Any) -> None:
    """Raise FileError on one path, or the bytes of one image, in place of several."""
    if isinstance(images, str | Path) and Path(images).is_dir():
        raise FileError(
            f"images: {str(images)!r} is a folder; give its files, sorted(Path({str(images)!r}).glob('*.png'))"
        )
    if isinstance(images, str | bytes | Path):
        raise FileError(
            f"images: found {str(images)[:60]!r} alone, expected N arrays, encoded images or paths of files"
        )


def _encoded(index: int, image: Any, codec: Codec, size: tuple[int, int]) -> bytes:
    if isinstance(image, str | Path):
        return existing_file(image).read_bytes()
    if isinstance(image, bytes):
        return image
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8 or pixels.shape != (*size, 3):
        fits = ""
        if pixels.shape == (*size[::-1], 3):
            fits = "; turned by a quarter they fit, np.rot90(image) or np.rot90(image, -1)"
        elif pixels.shape == (3, *size):
            fits = "; colours come last, np.moveaxis(images, 1, -1)"
        elif pixels.dtype.kind == "f" and pixels.shape == (*size, 3):
            is_share = pixels.size and np.nanmax(pixels) <= 1.0
            factor, image = (1, "(255 * images)") if is_share else (255, "images")
            fits = f"; colours from 0 to {factor} fit as {image}.astype(np.uint8)"
        raise FileError(
            f"images: image {index} is {pixels.dtype} of shape {pixels.shape}, the sensor's are uint8 of shape "
            f"{(*size, 3)}{fits}"
        )
    return encode_image(pixels, codec)
