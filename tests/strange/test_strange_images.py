"""Images that say they are enormous are refused before they are decoded."""

import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from palpate.errors import FileError
from palpate.touch.press_files import read_image
from palpate.types.images import decode_image, encode_image, image_size


def png(rows, columns):
    """A PNG of one colour, whole, of about 1/1000 of the bytes that it decodes to."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    row = bytes(1 + 3 * min(columns, 20_000))
    data = b"".join(packer.compress(row) for _ in range(min(rows, 2000))) + packer.flush()
    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(16000, 16000), (6000, 6000), (2**31 - 1, 2**31 - 1)])
def test_an_enormous_image_is_not_decoded(tmp_path, size, monkeypatch):
    def never(*_):
        raise AssertionError("was decoded")

    monkeypatch.setattr(cv2, "imdecode", never)
    monkeypatch.setattr(cv2, "imread", never)
    data = png(*size)
    path = tmp_path / "a.png"
    path.write_bytes(data)
    for read in (lambda: decode_image(data, "png", (320, 240)), lambda: decode_image(data, "png", size)):
        with pytest.raises(FileError, match="PALPATE_MAX_IMAGE_MB allows more"):
            read()
    with pytest.raises(FileError, match=r"a\.png: is an image .*PALPATE_MAX_IMAGE_MB allows more"):
        read_image(path)


def test_an_image_of_another_size_is_not_decoded(monkeypatch):
    data = encode_image(np.zeros((30, 40, 3), np.uint8), "png")
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(FileError, match=r"found \(30, 40\) rows and columns, the sensor has \(320, 240\)"):
        decode_image(data, "png", (320, 240))


def test_the_limit_is_raised(monkeypatch):
    data = encode_image(np.zeros((300, 400, 3), np.uint8), "png")
    monkeypatch.setenv("PALPATE_MAX_IMAGE_MB", "0.3")
    with pytest.raises(FileError, match=r"400 columns of 0 MB, allowed are 0\.3 MB"):
        decode_image(data, "png", (300, 400))
    monkeypatch.setenv("PALPATE_MAX_IMAGE_MB", "0.4")
    assert decode_image(data, "png", (300, 400)).shape == (300, 400, 3)


def test_other_kinds_of_images_are_not_tried():
    done, data = cv2.imencode(".tiff", np.zeros((12, 8, 3), np.uint8))
    assert done and image_size(data.tobytes()) is None
    with pytest.raises(FileError, match="do not decode as png"):
        decode_image(data.tobytes(), "png", (12, 8))


def test_a_header_is_read_without_the_pixels():
    data = png(4000, 5000)
    tracemalloc.start()
    assert image_size(data) == (4000, 5000)
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()
