"""Touch images as the encoded bytes that a recording keeps."""

import io
import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Image
from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file

Codec = Literal["jpeg", "png"]
Level = TypeVar("Level", np.uint8, np.float32)


@dataclass(frozen=True)
class CameraView:
    """Steps that turn a camera's images, rotated, mirrored or with exchanged channels, into those of the profile."""

    quarter_turns: int = 0
    """Counter-clockwise quarter turns, done first, 0 to 3."""
    mirrored: bool = False
    """True if left and right are exchanged, which is done second."""
    channels: tuple[int, int, int] = (0, 1, 2)
    """The camera's channels that are red, green and blue."""
    is_stated: bool = field(default=False, compare=False)
    """True if the user has said how images lie, and not only the order of their channels."""

    @property
    def keeps_left_and_right(self) -> bool:
        """True if the right side of a camera's image is the right side of the profile's."""
        return (self.quarter_turns, self.mirrored) in ((0, False), (2, True))

    def of(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return a camera's image (height, width, 3), or its cells, in the profile's view."""
        if self == AS_IT_IS:
            return image
        turned = np.rot90(image, self.quarter_turns)
        if self.mirrored:
            turned = turned[:, ::-1]
        return np.ascontiguousarray(turned[..., self.channels])

    def __str__(self) -> str:
        order = "".join("RGB"[channel] for channel in self.channels)
        steps = []
        if self.quarter_turns:
            steps.append(f"turned by {90 * self.quarter_turns} degrees")
        if self.mirrored:
            steps.append("mirrored")
        if order != "RGB":
            steps.append(f"channels {order}")
        return ", ".join(steps) or "as they come"


AS_IT_IS = CameraView()
_TURNS = {"upright": 0, "0": 0, "90": 1, "180": 2, "270": 3}


def camera_view(orientation: str) -> CameraView:
    """Return the view that words as in "90,mirrored,bgr" describe. Raises SettingError."""
    view = AS_IT_IS
    for word in str(orientation).lower().replace(",", " ").split():
        if word in _TURNS:
            view = replace(view, quarter_turns=(view.quarter_turns + _TURNS[word]) % 4, is_stated=True)
        elif word == "mirrored":
            view = replace(view, mirrored=True, is_stated=True)
        elif sorted(word) == sorted("rgb"):
            view = replace(view, channels=(word.index("r"), word.index("g"), word.index("b")))
        else:
            raise SettingError(
                f"orientation is {orientation!r}; allowed are, with commas, upright, 90, 180 or 270 (degrees by "
                "which to turn images counter-clockwise), mirrored, and the order of channels, such as bgr"
            )
    return view


class UprightImage(bytes):
    """An encoded image that is in the profile's view already, so that nothing turns and encodes it again."""


def codec_of(data: bytes) -> Codec | None:
    """Return the codec of encoded bytes, which their first bytes tell; None for neither JPEG nor PNG."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "png"
    if data.startswith(b"\xff\xd8\xff"):
        return "jpeg"
    return None


def checked_pixels(image: NDArray[Any]) -> Image:
    """Return an image if it is RGB. Raises FileError."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise FileError(f"is {image.dtype} of shape {image.shape}, expected uint8 (height, width, 3) of RGB to 255")
    return image


def encode_image(image: Image, codec: Codec = "jpeg") -> bytes:
    """Return an RGB image (height, width, 3) as bytes: "jpeg" at quality 95, or "png", lossless. Raises FileError."""
    checked_pixels(image)
    if codec not in get_args(Codec):
        raise FileError(f"codec: found {codec!r}, allowed are 'jpeg' and 'png'")
    if codec == "png":
        return _png(image)
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, codec, quality=95)
    return data.getvalue()


def _png(image: Image) -> bytes:
    """Return an RGB image as PNG, each pixel as its difference from that to the left.

    Pillow, which tries several differences, takes three times as long. Zlib leaves other threads running.
    """
    height, width, _ = image.shape
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = 1  # such differences
    values = image.reshape(height, 3 * width)
    rows[:, 1:4] = values[:, :3]
    np.subtract(values[:, 3:], values[:, :-3], out=rows[:, 4:])
    pack = zlib.compressobj(1, strategy=zlib.Z_RLE)
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", pack.compress(rows.tobytes()) + pack.flush()),
        (b"IEND", b""),
    )
    coded = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(coded)


def decode_image(data: bytes, size: tuple[int, int] | None = None) -> Image:
    """Return the RGB image in the bytes of a PNG or JPEG, `fitted` to a size if one is given. Raises FileError.

    A turn in the EXIF data is ignored: viewers and phones write it, cameras of touch sensors do not.
    """
    from PIL import Image

    try:
        image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        if image.mode.startswith(("I", "F")):  # Pillow would cut off their levels at 255
            raise FileError("is grey in 16 bits, expected 8 bits and colours")
        image.load()
        pixels = np.array(image if image.mode == "RGB" else image.convert("RGB"))  # which would copy it
    except Image.DecompressionBombError as error:
        raise FileError(f"is an image that is far too large ({error})") from error
    except (OSError, ValueError, SyntaxError, EOFError, struct.error, zlib.error) as error:
        raise FileError(f"its {len(data)} bytes do not decode as {codec_of(data) or 'JPEG or PNG'}") from error
    _check_range(data, pixels)
    return pixels if size is None else fitted(pixels, size)


def _check_range(data: bytes, pixels: Image) -> None:
    """Raise FileError if a PNG of 16 bits holds 10, 12 or 14, which are all dark in the upper 8 that are taken."""
    is_16_bits = codec_of(data) == "png" and data[24:25] == b"\x10"
    if is_16_bits and int(pixels.max()) < 64:
        raise FileError(
            f"has 16 bits, of which the upper 8 reach {pixels.max()} of 255: are these 10, 12 or 14 bits? Expected are "
            "8 bits to 255, or 16 to 65535"
        )


def scaled(image: Image, size: tuple[int, int]) -> Image:
    """Return an image scaled down if it is a multiple of a size (rows, columns), upright or turned by a quarter.

    Any other image is returned as it is.
    """
    from PIL import Image as Pillow

    smaller = scaled_size((image.shape[0], image.shape[1]), size)
    if smaller is None:
        return image
    return np.asarray(Pillow.fromarray(image).reduce(image.shape[0] // smaller[0]), np.uint8)


def scaled_size(given: tuple[int, int], size: tuple[int, int]) -> tuple[int, int] | None:
    """Return the rows and columns to which an image is scaled down, if it is a multiple of a size; see `scaled`."""
    rows, columns = size
    if not rows:
        return None
    if (given[0] > given[1]) != (rows > columns):  # it lies on its side
        columns, rows = size
    scale = given[0] // rows
    return (rows, columns) if scale > 1 and given == (scale * rows, scale * columns) else None


def fitted(image: Image, size: tuple[int, int], view: CameraView = AS_IT_IS) -> Image:
    """Return an image in a view, scaled down if it is a multiple of a size (rows, columns).

    Raises FileError if it is of another size.
    """
    if not size[0]:
        raise FileError("is an image, and the sensor has none: is it another?")
    viewed = scaled(view.of(image), size)
    if viewed.shape[:2] == size:
        return viewed
    advice = "crop and scale them to it"
    if viewed.shape[:2] == size[::-1] and view.quarter_turns % 2:
        advice = f"they lie upright before they are turned by {90 * view.quarter_turns} degrees"
    elif viewed.shape[:2] == size[::-1]:
        advice = (
            "they are of another --sensor, or lie on their side: orientation='90' (--orientation 90) turns them as "
            "digit-interface does, 270 the other way, and scales multiples"
        )
    raise FileError(f"found {image.shape[0]} rows and {image.shape[1]} columns, the sensor has {size}: {advice}")


def turned_image(data: bytes, size: tuple[int, int], view: CameraView) -> bytes:
    """Return an encoded image turned into a view and scaled down if it is a multiple of a size (rows, columns).

    Damaged bytes are returned as they are, and so are those of an image that is as it should be. Raises FileError if it
    is of another size.
    """
    from PIL import Image

    if isinstance(data, UprightImage):
        return data
    if view == AS_IT_IS:
        with suppress(Exception):  # of damaged bytes, which can raise anything in the library
            columns, rows = Image.open(io.BytesIO(data), formats=("PNG", "JPEG")).size
            if (rows, columns) == size or scaled_size((rows, columns), size) is None:
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
