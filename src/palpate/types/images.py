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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Literal, TypeVar, get_args, overload

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file

Codec = Literal["jpeg", "png"]
Image = NDArray[np.uint8]
Level = TypeVar("Level", np.uint8, np.float32)


@dataclass(frozen=True)
class CameraView:
    """Steps that turn a camera's images, rotated, mirrored or with exchanged channels, into those of the profile."""

    quarter_turns: int = 0
    """Rotation, done first, in counter-clockwise quarter turns, 0 to 3."""
    mirrored: bool = False
    """Exchange left and right, done second."""
    channels: tuple[int, int, int] = (0, 1, 2)
    """The camera's channels that are red, green and blue."""

    @property
    def keeps_left_and_right(self) -> bool:
        """The right side of a camera's image is the right side of the profile's."""
        return (self.quarter_turns, self.mirrored) in ((0, False), (2, True))

    def of(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return a camera's image (height, width, 3), or its cells, in the profile's view."""
        if self == AS_IT_IS:
            return image
        turned = np.rot90(image, self.quarter_turns)
        return np.ascontiguousarray((turned[:, ::-1] if self.mirrored else turned)[..., self.channels])

    def __str__(self) -> str:
        turned = f"turned by {90 * self.quarter_turns} degrees" if self.quarter_turns else ""
        order = "".join("RGB"[channel] for channel in self.channels)
        channels = "" if order == "RGB" else f"channels {order}"
        return ", ".join(filter(None, (turned, "mirrored" * self.mirrored, channels))) or "as they come"


AS_IT_IS = CameraView()


def camera_view(orientation: str) -> CameraView:
    """Return the view that words as in "90,mirrored,bgr" describe. Raises SettingError."""
    view = AS_IT_IS
    for word in filter(None, orientation.lower().replace(",", " ").split()):
        if word in ("0", "90", "180", "270"):
            view = replace(view, quarter_turns=int(word) // 90)
        elif word == "mirrored":
            view = replace(view, mirrored=True)
        elif sorted(word) == sorted("rgb"):
            view = replace(view, channels=(word.index("r"), word.index("g"), word.index("b")))
        else:
            raise SettingError(
                f"orientation is {orientation!r}; allowed are, with commas, 90, 180 or 270 (degrees by which to turn "
                "images counter-clockwise), mirrored, and the order of channels, such as bgr"
            )
    return view


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


def decode_image(data: bytes, size: tuple[int, int] | None = None, view: CameraView = AS_IT_IS) -> Image:
    """Return the RGB image that a PNG or JPEG holds, `fitted` to a size if one is given. Raises FileError.

    A turn in the EXIF data is ignored: viewers and phones write it, cameras of touch sensors do not.
    """
    import cv2

    image = None
    if image_size(data):
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise FileError(f"its {len(data)} bytes do not decode as {codec_of(data) or 'JPEG or PNG'}")
    pixels = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    return pixels if size is None else fitted(pixels, size, view)


def scaled(image: Image, size: tuple[int, int]) -> Image:
    """Return an image scaled down where it is a multiple of a size (rows, columns), upright or turned by a quarter."""
    import cv2

    rows, columns = size if (image.shape[0] > image.shape[1]) == (size[0] > size[1]) else size[::-1]
    scale = image.shape[0] // rows
    if scale > 1 and image.shape[:2] == (scale * rows, scale * columns):
        image = np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
    return image


def fitted(image: Image, size: tuple[int, int], view: CameraView = AS_IT_IS) -> Image:
    """Return an image in a view and of a size (rows, columns), scaled if it is a multiple of it; else FileError."""
    found = scaled(view.of(image), size)
    if found.shape[:2] == size:
        return found
    question = "crop and scale them to it"
    if found.shape[:2] == size[::-1]:
        question = (
            "they lie on their side: orientation='90' (--orientation 90) turns them as digit-interface does, 270 "
        )
        question += "the other way, and scales multiples"
    raise FileError(f"found {image.shape[0]} rows and {image.shape[1]} columns, the sensor has {size}: {question}")


def turned_image(data: bytes, size: tuple[int, int], view: CameraView) -> bytes:
    """Return the bytes of an image in a view; those that are damaged stay. Raises FileError on another size."""
    if view == AS_IT_IS:
        return data
    try:
        image = decode_image(data)
    except FileError:
        return data
    return encode_image(fitted(image, size, view), codec_of(data) or "jpeg")


def read_image(path: Path) -> Image:
    """Return the RGB image in a file. Raises FileError."""
    with in_file(path):
        return decode_image(existing_file(path).read_bytes())


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
