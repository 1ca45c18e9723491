"""Touch images as the bytes that a recording keeps."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError

Codec = Literal["jpeg", "png"]


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


def decode_image(data: bytes, codec: Codec, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The RGB image (height, width, 3) that bytes hold; FileError if they are damaged or it has another size."""
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if len(data) else None
    except cv2.error:  # a header that claims an absurd size
        image = None
    if image is None:
        raise FileError(f"its {len(data)} bytes do not decode as {codec}")
    if image.shape[:2] != size:
        raise FileError(f"found {image.shape[:2]} rows and columns, the sensor has {size}")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
