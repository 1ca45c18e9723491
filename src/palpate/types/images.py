"""Touch images as the encoded bytes that a recording keeps."""

import io
import operator
import struct
import tempfile
import threading
import warnings
import weakref
import zlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, Literal, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError

Codec = Literal["jpeg", "png"]


def codec_of(data: bytes) -> Codec | None:
    """Return the codec of encoded bytes by the first of them; None for neither JPEG nor PNG."""
    return "png" if data.startswith(b"\x89PNG\r\n\x1a\n") else "jpeg" if data.startswith(b"\xff\xd8\xff") else None


def encode_image(image: NDArray[np.uint8], codec: Codec = "jpeg") -> bytes:
    """Return an RGB image (height, width, 3) as bytes: "jpeg" at quality 95, or "png", lossless. Raises FileError."""
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
    """Return rows and columns of a PNG or JPEG from its header; None if it is neither.

    Raises FileError where they are so many that decoding could exhaust the memory.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=("PNG", "JPEG")) as image:
                return image.size[1], image.size[0]
    except Image.DecompressionBombError as error:
        raise FileError(f"is an image that is far too large ({error})") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError, struct.error, zlib.error):
        return None


def decode_image(data: bytes, codec: Codec, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the RGB image (height, width, 3) of this size that bytes hold, as its pixels are stored. Raises FileError.

    A turn in the EXIF data is ignored: viewers and phones write it, cameras of touch sensors do not.
    """
    import cv2

    found, image = image_size(data), None
    if found == size:
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        found = None if image is None else size
    if found is None:
        raise FileError(f"its {len(data)} bytes do not decode as {codec}")
    if image is None:
        fits = "; turned by a quarter it fits" if found == size[::-1] else ""
        raise FileError(f"found {found} rows and columns, the sensor has {size}{fits}")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


class SpooledImages(Sequence[bytes]):
    """Encoded images that go to a temporary file where they are many; equal to any sequence of the same bytes."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(max_size=64_000_000)  # noqa: SIM115  # closed by the finalizer
        self._lock = threading.Lock()
        self._places: list[tuple[int, int]] = []
        weakref.finalize(self, self._file.close)

    def append(self, data: bytes) -> None:
        """Add an image."""
        with self._lock:
            self._places.append((self._file.seek(0, 2), len(data)))
            self._file.write(data)

    def selected(self, indices: Iterable[int]) -> "SpooledImages":
        """Return some of the images, without copying them."""
        found = SpooledImages.__new__(SpooledImages)
        found._file, found._lock, found._places = self._file, self._lock, [self._places[index] for index in indices]
        found._owner = self  # pyright: ignore[reportAttributeAccessIssue]  # keeps the file open
        return found

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: SupportsIndex) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[bytes, ...]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> bytes | tuple[bytes, ...]:
        """Return one image, or a tuple of some."""
        if isinstance(index, slice):
            return tuple(self[each] for each in range(*index.indices(len(self))))
        offset, length = self._places[operator.index(index)]
        with self._lock:
            self._file.seek(offset)
            return self._file.read(length)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(bytes.__eq__, self, other))

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (list(self),)
