"""Touch images as the encoded bytes that a recording keeps."""

import io
import mmap
import struct
import tempfile
import warnings
import weakref
import zlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import IO, Any, Literal, get_args, overload

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError

Codec = Literal["jpeg", "png"]


def check_codec(codec: str) -> None:
    """Raise FileError unless a codec is known."""
    if codec not in get_args(Codec):
        raise FileError(f"codec: found {codec!r}, allowed are 'jpeg' and 'png'")


def codec_of(data: bytes) -> Codec | None:
    """Return the codec of encoded bytes by the first of them; None for neither JPEG nor PNG."""
    return "png" if data.startswith(b"\x89PNG\r\n\x1a\n") else "jpeg" if data.startswith(b"\xff\xd8\xff") else None


def encode_image(image: NDArray[np.uint8], codec: Codec = "jpeg") -> bytes:
    """Return an RGB image (height, width, 3) as bytes: "jpeg" at quality 95, or "png", lossless. Raises FileError."""
    import cv2

    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise FileError(f"image: found {image.dtype} of shape {image.shape}, allowed is uint8 (height, width, 3)")
    check_codec(codec)
    options = [cv2.IMWRITE_JPEG_QUALITY, 95] if codec == "jpeg" else []
    done, data = cv2.imencode(f".{codec}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
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
    """Encoded images, the first 64 MB of them in memory and the rest in a temporary file."""

    def __init__(self) -> None:
        self._images: list[bytes | tuple[int, int]] = []
        """Each image, or its place in the file and its length [bytes]."""
        self._file: IO[bytes] | None = None
        self._size = 0

    def append(self, data: bytes) -> None:
        """Add an image."""
        if self._size + len(data) <= 64_000_000:
            self._images.append(data)
        else:
            try:
                if self._file is None:
                    self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  # closed by the finalizer
                    weakref.finalize(self, self._file.close)
                self._images.append((self._file.seek(0, 2), len(data)))
                self._file.write(data)
            except OSError as error:
                raise FileError(f"{tempfile.gettempdir()}: images cannot be kept there ({error.strerror})") from error
        self._size += len(data)

    def keep(self, indices: Iterable[int]) -> None:
        """Keep these images only, in this order."""
        self._images = [self._images[index] for index in indices]

    def __len__(self) -> int:
        return len(self._images)

    @overload
    def __getitem__(self, index: int) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[bytes, ...]: ...
    def __getitem__(self, index: int | slice) -> bytes | tuple[bytes, ...]:
        """Return one image, or a tuple of some."""
        found = self._images[index]
        if isinstance(found, list):
            return tuple(map(self._read, found))
        return self._read(found)

    def _read(self, image: bytes | tuple[int, int]) -> bytes:
        if isinstance(image, bytes):
            return image
        assert self._file is not None
        # Reading moves no place in the file, which threads and forked processes would share.
        offset, length = image
        start = offset - offset % mmap.ALLOCATIONGRANULARITY
        size = offset + length - start
        with mmap.mmap(self._file.fileno(), size, access=mmap.ACCESS_READ, offset=start) as found:
            return found[offset - start :]

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (list(self),)
