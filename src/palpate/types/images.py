"""Touch images as the bytes that a recording keeps."""

import io
import struct
import warnings
import zlib
from contextlib import suppress
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.limits import IMAGE

Codec = Literal["jpeg", "png"]

PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"


def codec_of(data: bytes) -> Codec | None:
    """How bytes are encoded, by the first of them; None for neither JPEG nor PNG."""
    return "png" if data.startswith(PNG) else "jpeg" if data.startswith(JPEG) else None


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
