"""Touch images as the bytes that a recording keeps."""

import io
import struct
import warnings
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import existing_file
from palpate.limits import IMAGE

Codec = Literal["jpeg", "png"]
Images = NDArray[np.uint8] | Sequence[NDArray[np.uint8] | bytes | str | Path]
"""What a user may have of images: arrays (N, height, width, 3), encoded bytes, or paths of files."""

PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"


def codec_of(data: bytes) -> Codec | None:
    """How bytes are encoded, by the first of them; None for neither JPEG nor PNG."""
    return "png" if data.startswith(PNG) else "jpeg" if data.startswith(JPEG) else None


def encoded_images(images: Images, codec: Codec, size: tuple[int, int]) -> tuple[tuple[bytes, ...], Codec]:
    """One or more images of this size (rows, columns) as encoded bytes, and how they are encoded.

    Arrays become `codec`; bytes and files stay as they are. Raises FileError that names the first image which is
    neither a colour image of this size nor JPEG or PNG, or files of both kinds.
    """
    if isinstance(images, str | bytes | Path):
        raise FileError(
            f"images: found {str(images)[:60]!r} alone, expected N arrays, encoded images or paths of files"
        )
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
            fits = "; colours from 0 to 1 fit as (255 * images).astype(np.uint8)"
        raise FileError(
            f"images: image {index} is {pixels.dtype} of shape {pixels.shape}, the sensor's are uint8 of shape "
            f"{(*size, 3)}{fits}"
        )
    return encode_image(pixels, codec)


def encode_image(image: NDArray[np.uint8], codec: Codec = "jpeg") -> bytes:
    """An RGB image (height, width, 3) as bytes: "jpeg" at quality 95, or "png", lossless."""
    import cv2

    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise FileError(f"image: found {image.dtype} of shape {image.shape}, allowed is uint8 (height, width, 3)")
    settings = {"jpeg": (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95]), "png": (".png", [])}
    if codec not in settings:
        raise FileError(f"codec: found {codec!r}, allowed are 'jpeg' and 'png'")
    extension, options = settings[codec]
    done, data = cv2.imencode(extension, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise FileError(f"image: an image of shape {image.shape} could not be encoded as {codec}")
    return data.tobytes()


def image_size(data: bytes) -> tuple[int, int] | None:
    """The rows and columns that a PNG or JPEG says it has, without decoding it; None if it is neither.

    Raises FileError where it would take more memory than `limits.IMAGE`.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is large; that is checked here
            with Image.open(io.BytesIO(data), formats=("PNG", "JPEG")) as image:
                columns, rows = image.size
    except Image.DecompressionBombError as error:
        raise FileError(f"is an image that is far too large ({error}), {IMAGE.words}") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError, struct.error, zlib.error):
        return None
    IMAGE.check(3 * rows * columns, f"is an image of {rows} rows and {columns} columns")
    return rows, columns


def decode_image(data: bytes, codec: Codec, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The RGB image (height, width, 3) that bytes hold; FileError if they are damaged or it has another size."""
    import cv2

    told = image_size(data)
    image = None
    if told == size or told == size[::-1]:  # JPEGs may say that they are to be turned
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        told = None if image is None else (image.shape[0], image.shape[1])
    if told is None:
        raise FileError(f"its {len(data)} bytes do not decode as {codec}")
    if image is None or told != size:
        fits = "; turned by a quarter it fits" if told == size[::-1] else ""
        raise FileError(f"found {told} rows and columns, the sensor has {size}{fits}")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
