import pickle
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from view_samples import CAMERA

from palpate import io as formats
from palpate.errors import FileError
from palpate.geometry.shapes import Disc
from palpate.io import palpate_h5
from palpate.io.bags.bag_recording import read_bag
from palpate.io.bags.choices import BagChoices
from palpate.io.bags.recording_mcap import IMAGES, SENSOR_POSES
from palpate.types import stored_images
from palpate.types.images import encode_image
from palpate.types.recording import Recording

COUNT, SENSOR = 300, replace(CAMERA, image_height=100, image_width=100)


def large() -> Recording:
    """A recording of 300 images, 9 MB together, each unlike the others."""
    noise = np.random.default_rng(1).integers(0, 256, (100, 100, 3), np.uint8)
    images = tuple(encode_image(np.roll(noise, number, axis=0), "png") for number in range(COUNT))
    poses: Any = np.column_stack([0.001 * np.arange(COUNT), np.zeros((COUNT, 2))])
    return Recording(1.0 + np.arange(COUNT) / 30.0, poses, Disc(0.05), SENSOR, image=images, codec="png")


def as_a_bag(path: Path) -> Recording:
    """The messages of an MCAP of palpate's own, read as those of anybody."""
    choices = BagChoices(images=IMAGES, sensor_poses=SENSOR_POSES)
    return read_bag(path, Disc(0.05), choices, SENSOR).recording


@pytest.mark.parametrize(
    ("name", "read"),
    [("large.h5", formats.load_recording), ("large.mcap", formats.load_recording), ("large.mcap", as_a_bag)],
)
def test_images_are_read_when_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, read: Callable[[Path], Recording]
):
    monkeypatch.setattr(stored_images, "IN_MEMORY", 100_000)
    monkeypatch.setattr(palpate_h5, "IN_MEMORY", 100_000)
    written = large()
    assert written.image is not None
    size = sum(map(len, written.image))
    formats.write(written, tmp_path / name)
    read(tmp_path / name)  # what is loaded and kept for good is loaded
    tracemalloc.start()
    found: Any = read(tmp_path / name)
    for frame in found:
        assert frame.image is not None
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.4 * size  # a container's chunk, some times
    assert found.image == written.image
    assert found.image[-1] == written.image[-1] and found.image[2:4] == written.image[2:4]
    assert pickle.loads(pickle.dumps(found)).image == written.image
    with pytest.raises(IndexError, match="image 300 of 300"):
        found.image[COUNT]


def test_a_frame_is_found_by_an_integer_of_any_kind(tmp_path: Path):
    formats.write(large(), tmp_path / "large.h5")
    found: Any = formats.load_recording(tmp_path / "large.h5")
    for index in (np.int64(3), np.uint8(3), np.int32(3 - COUNT)):
        assert np.array_equal(found[index].image, found[3].image) and found.image[index] == found.image[3]


def test_an_image_that_is_damaged_is_named(tmp_path: Path):
    path = tmp_path / "damaged.h5"
    formats.write(large(), path)
    found: Any = formats.load_recording(path)
    with h5py.File(path) as file:
        rows: Any = file["image"]
        begin, length = rows.id.get_offset(), rows.id.get_storage_size()
    with path.open("r+b") as file:
        file.seek(begin + length // 2)
        file.write(b"\x01" * 64)  # where the rows are
    with pytest.raises(FileError, match=r"damaged.h5: image of frame 15\d: is truncated or damaged"):
        list(found)


def test_no_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(palpate_h5, "IN_MEMORY", 100_000)
    monkeypatch.setattr(palpate_h5.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 5_000_000}))
    with pytest.raises(FileError, match=r"large.h5: cannot be written \(it takes 0.0 GB, 0.0 are free\)"):
        formats.write(large(), tmp_path / "large.h5")
    assert not list(tmp_path.iterdir())
