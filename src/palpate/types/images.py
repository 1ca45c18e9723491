"""Touch images as the encoded bytes that a recording keeps."""

import io
import mmap
import operator
import struct
import tempfile
import warnings
import weakref
import zlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import IO, Any, Literal, SupportsIndex, overload

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
    """Encoded images, beyond 64 MB in a temporary file; equal to any sequence of the same bytes.

    Reading moves no place in the file, which threads and forked processes would share.
    """

    def __init__(self) -> None:
        self._images: list[bytes | tuple[int, int]] = []  # or offset and length in the file
        self._in_memory = 0
        self._file: IO[bytes] | None = None
        self._owner: SpooledImages | None = None  # closes the file

    def append(self, data: bytes) -> None:
        """Add an image."""
        if self._in_memory + len(data) <= 64_000_000:
            self._images.append(data)
            self._in_memory += len(data)
            return
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115  # closed by the finalizer
            weakref.finalize(self, self._file.close)
        self._images.append((self._file.seek(0, 2), len(data)))
        self._file.write(data)
        self._file.flush()

    def selected(self, indices: Iterable[int]) -> "SpooledImages":
        """Return some of the images, without copying them."""
        found = SpooledImages()
        found._images, found._file, found._owner = [self._images[index] for index in indices], self._file, self
        return found

    def __len__(self) -> int:
        return len(self._images)

    @overload
    def __getitem__(self, index: SupportsIndex) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[bytes, ...]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> bytes | tuple[bytes, ...]:
        """Return one image, or a tuple of some."""
        if isinstance(index, slice):
            return tuple(self[each] for each in range(*index.indices(len(self))))
        image = self._images[operator.index(index)]
        if isinstance(image, bytes):
            return image
        assert self._file is not None
        offset, length = image
        start = offset - offset % mmap.ALLOCATIONGRANULARITY
        file, size = self._file.fileno(), offset + length - start
        with mmap.mmap(file, size, access=mmap.ACCESS_READ, offset=start) as found:
            return found[offset - start :]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(bytes.__eq__, self, other))

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (list(self),)
