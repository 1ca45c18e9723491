"""Touch images as a live source delivers them."""

import threading
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.types.images import Codec, decode_image, encode_image

Image = NDArray[np.uint8]


class TouchImage(NamedTuple):
    """One image, as it came."""

    time: float
    """When it was taken [s], by the session's clock."""
    data: bytes | Image
    """Encoded, or pixels (height, width, 3) RGB."""
    codec: Codec = "jpeg"
    """How it is encoded; how it is to be encoded where it is recorded."""


ImageSource = Callable[[threading.Event], Iterator[TouchImage | str]]
"""Gives the images as they come, and in between, in words, what is to be said of the source; ends at the event."""


def pixels_of(image: TouchImage, size: tuple[int, int]) -> Image:
    """The pixels (height, width, 3) RGB; FileError if encoded bytes are damaged or hold an image of another size."""
    return decode_image(image.data, image.codec, size) if isinstance(image.data, bytes) else image.data


def encoded_of(image: TouchImage) -> bytes:
    """The image as the bytes that a file keeps."""
    return image.data if isinstance(image.data, bytes) else encode_image(image.data, image.codec)
