"""palpate's own recording file."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from recording_samples import pushed, tiny_recording

from palpate.errors import FileError
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle
from palpate.io.palpate_h5 import read_recording, write_recording
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import POINT


@pytest.mark.parametrize(
    "shape",
    [
        Disc(0.088),
        Rectangle(0.2363, 0.1579),
        Ellipse(0.1638, 0.2428),
        Polygon([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)]),  # type: ignore[arg-type]
    ],
)
def test_file_round_trip(tmp_path, shape):
    made = tiny_recording(shape=shape)
    path = tmp_path / "a.h5"
    write_recording(made, path)
    found = read_recording(path)
    for name in ("time", "sensor_pose", "object_pose", "first_pose", "first_pose_sigma", "contact", "episode"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
        assert getattr(found, name).dtype == getattr(made, name).dtype
    assert found.image == made.image
    for name in ("shape", "sensor", "codec", "contact_derived", "source", "frames"):
        assert getattr(found, name) == getattr(made, name)
    assert found.file == path
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.h5"]


def test_file_round_trip_without_optional_fields(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(Recording(np.array([0.0, 1.0]), np.zeros((2, 3)), Disc(0.05), POINT), path)
    found = read_recording(path)
    assert (found.object_pose, found.contact, found.episode, found.image) == (None, None, None, None)
    assert (found.first_pose, found.first_pose_sigma) == (None, None)
    assert found.contact_derived is False


def test_an_existing_file_is_kept_unless_asked(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(tiny_recording(5), path)
    with pytest.raises(FileError, match=r"a\.h5: already exists; overwrite=True replaces it"):
        write_recording(tiny_recording(3), path)
    assert len(read_recording(path)) == 5
    write_recording(tiny_recording(3), path, overwrite=True)
    assert len(read_recording(path)) == 3


def test_a_write_that_fails_leaves_nothing(tmp_path):
    made = tiny_recording()
    object.__setattr__(made, "frames", {"broken": {1, 2}})
    with pytest.raises(TypeError):
        write_recording(made, tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileError, match=r"the folder .* does not exist"):
        write_recording(tiny_recording(), tmp_path / "no" / "a.h5")
    with pytest.raises(FileError, match="is a folder"):
        write_recording(tiny_recording(), tmp_path, overwrite=True)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(tiny_recording(), path)
    return path


def refuses(path, message):
    with pytest.raises(FileError, match=message) as caught:
        read_recording(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_file(tmp_path):
    refuses(tmp_path / "none.h5", "no such file")
    refuses(tmp_path, "is a folder, expected a file")
    (tmp_path / "empty.h5").touch()
    refuses(tmp_path / "empty.h5", "is empty")
    (tmp_path / "text.h5").write_text("hello")
    refuses(tmp_path / "text.h5", "is not an HDF5 file")


@pytest.mark.parametrize("part", [0.01, 0.3, 0.6, 0.9, 0.999])
def test_truncated_file(path, part):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])
    refuses(path, "is truncated or damaged")


def change(path, edit):
    with h5py.File(path, "r+") as file:
        edit(file)


def put(name, value):
    def edit(file):
        del file[name]
        file[name] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda f: f.attrs.__setitem__("format", "other"), "attribute format is 'other', expected"),
        (lambda f: f.attrs.__delitem__("format"), "attribute format is 'none'"),
        (lambda f: f.attrs.__setitem__("version", 2), "has version 2, this palpate reads up to version 1"),
        (lambda f: f.attrs.__setitem__("version", 0), "attribute version: found .*0.*, allowed is 1 to 1"),
        (lambda f: f.attrs.__setitem__("version", "x"), "attribute version: found 'x'"),
        (lambda f: f.attrs.__delitem__("source"), "attribute source is missing"),
        (lambda f: f.attrs.__setitem__("shape", "{"), "attribute shape: is not valid JSON"),
        (lambda f: f.attrs.__setitem__("shape", "[1]"), "attribute shape: found a JSON list"),
        (lambda f: f.attrs.__setitem__("sensor", json.dumps({"name": "x"})), "radius"),
        (lambda f: f.__delitem__("time"), "dataset time is missing"),
        (lambda f: f.__delitem__("sensor_pose"), "dataset sensor_pose is missing"),
        (put("sensor_pose", np.zeros((5, 4))), r"sensor_pose: found shape \(5, 4\), expected \(5, 3\)"),
        (put("sensor_pose", 1.0), r"sensor_pose: found shape \(\), expected \(5, 3\)"),
        (put("time", np.array([b"a"] * 5)), "time: found values of type .*, expected numbers"),
        (put("time", np.array([0, 1, 1, 2, 3.0])), "time: frame 2 repeats"),
        (put("contact", np.zeros(5)), "contact: found values of type float64"),
        (put("image", np.zeros(5)), "image: expected one row of variable-length bytes"),
        (lambda f: f["image"].attrs.__setitem__("height", 7), "height and width are 7 and 8"),
        (lambda f: f["image"].attrs.__setitem__("codec", "gif"), "codec: found 'gif'"),
    ],
)  # fmt: skip
def test_bad_content(path, edit, message):
    change(path, edit)
    refuses(path, message)


def test_a_bad_image_is_named_when_it_is_looked_at(path):
    other = np.frombuffer(encode_image(np.zeros((6, 8, 3), np.uint8), "png"), np.uint8)
    change(path, lambda f: f["image"].__setitem__(2, np.arange(50, dtype=np.uint8)))
    change(path, lambda f: f["image"].__setitem__(3, other))
    change(path, lambda f: f["image"].__setitem__(4, np.zeros(0, np.uint8)))
    # A PNG header that claims 2^30 columns makes OpenCV raise rather than return nothing.
    huge = other.copy()
    huge[16:20] = [64, 0, 0, 0]
    change(path, lambda f: f["image"].__setitem__(1, huge))
    found = read_recording(path)
    assert found[0].image is not None
    with pytest.raises(FileError, match=r"a\.h5: image of frame 2: its 50 bytes do not decode as png"):
        found[2]
    with pytest.raises(FileError, match=r"image of frame 3: found \(6, 8\) rows and columns, the sensor has \(12, 8\)"):
        found[3]
    with pytest.raises(FileError, match=r"image of frame 1: its \d+ bytes do not decode"):
        found[1]
    with pytest.raises(FileError, match=r"image of frame 4: its 0 bytes"):
        found[-1]


def test_extra_rows_come_back(tmp_path):
    made = replace(
        pushed(3), extra={"force": np.array([0.0, np.nan, 2.0]), "clean": np.ones((3, 3)), "on": np.ones(3, bool)}
    )
    write_recording(made, tmp_path / "a.h5")
    back = read_recording(tmp_path / "a.h5").extra
    assert back.keys() == made.extra.keys()
    for name, value in made.extra.items():
        assert back[name].dtype == value.dtype
        assert np.array_equal(back[name], value, equal_nan=True)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["extra"]  # as in a file from before there were any
    assert read_recording(tmp_path / "a.h5").extra == {}


def test_a_damaged_extra_is_said(tmp_path):
    write_recording(pushed(3), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["extra"] = np.ones(3)
    with pytest.raises(FileError, match=r"a\.h5: extra: found a dataset, expected a group"):
        read_recording(tmp_path / "a.h5")
