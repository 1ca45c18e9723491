"""Images of a recording that are kept in a file."""

import pickle

import pytest

from palpate import FileError
from palpate.types.images import SpooledImages

SIZE = 900_000


def image(index: int) -> bytes:
    return index.to_bytes(2, "big") * (SIZE // 2)


def spooled(count: int) -> SpooledImages:
    images = SpooledImages()
    for index in range(count):
        images.append(image(index))
    return images


def test_images_in_memory_and_in_a_file_are_a_sequence():
    images = spooled(90)  # 81 MB
    assert len(images) == 90 and images[:2] == (image(0), image(1)) and images[-1] == image(89)
    images.keep([80, 3])
    assert tuple(images) == (image(80), image(3)) == pickle.loads(pickle.dumps(images))
    with pytest.raises(IndexError):
        images[2]


def test_no_room_for_images_is_said(monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    with pytest.raises(FileError, match=r"images cannot be kept there \(No space left on device\)"):
        spooled(72)
    assert len(spooled(71)) == 71
