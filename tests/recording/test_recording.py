"""Recording: validation, images, episodes and the HDF5 file."""

import json
from dataclasses import replace
from typing import Any

import cv2
import h5py
import numpy as np
import pytest

from palpate.errors import FileError
from palpate.formats.palpate_h5 import read_recording, write_recording
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle
from palpate.recording.frame import Frame
from palpate.recording.images import encode_image
from palpate.recording.recording import Recording, episode_numbers
from palpate.recording.sensor import POINT, SensorProfile

CAMERA = SensorProfile(name="tiny", radius=0.01, image_height=12, image_width=8)


def images(n, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (n, 12, 8, 3), np.uint8)


def recording(n=5, **changes) -> Any:
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(n, 3))
    truth[1:2] = np.nan
    fields = {
        "time": np.arange(n) / 30.0,
        "sensor_pose": rng.normal(size=(n, 3)),
        "shape": Disc(0.05),
        "sensor": CAMERA,
        "object_pose": truth,
        "contact": np.arange(n) > 1,
        "episode": np.where(np.arange(n) > 1, 0, -1),
        "image": tuple(encode_image(image, "png") for image in images(n)),
        "codec": "png",
        "contact_derived": True,
        "source": "a test, with ünicode",
        "frames": {"sensor_pose": "made up"},
    }
    return Recording(**(fields | changes))


def test_frames_come_out_as_they_went_in():
    made = recording()
    frames: list[Any] = list(made)
    assert len(frames) == len(made) == 5
    assert isinstance(frames[0], Frame)
    np.testing.assert_array_equal([frame.image for frame in frames], images(5))
    assert frames[1].object_pose is None
    assert frames[2].object_pose is not None
    np.testing.assert_array_equal(frames[2].object_pose, made.object_pose[2])
    assert [frame.contact for frame in frames] == [False, False, True, True, True]
    assert made[-1].time == made.time[4]
    with pytest.raises(IndexError):
        made[5]


def test_a_bare_recording_has_bare_frames():
    made = Recording(np.array([0.0]), np.zeros((1, 3)), Disc(0.05), POINT)
    frame = made[0]
    assert (frame.image, frame.contact, frame.object_pose) == (None, None, None)


def test_colours_keep_their_order():
    image = np.zeros((12, 8, 3), np.uint8)
    image[..., 0] = 200
    made = recording(1, image=(encode_image(image, "png"),), object_pose=None)
    np.testing.assert_array_equal(made[0].image, image)
    # OpenCV reads the same bytes as blue, green, red: the 200 has to be in its last channel.
    raw = cv2.imdecode(np.frombuffer(made.image[0], np.uint8), cv2.IMREAD_COLOR)
    assert raw is not None and raw[0, 0].tolist() == [0, 0, 200]


def test_jpeg_is_close_and_smaller():
    rows = np.linspace(0, 255, 120).astype(np.uint8)
    image = np.stack([np.tile(rows, (160, 1))] * 3, axis=-1)
    data = encode_image(image)
    assert data.startswith(b"\xff\xd8")
    made = recording(
        1, image=(data,), codec="jpeg", object_pose=None,
        sensor=replace(CAMERA, image_height=160, image_width=120),
    )  # fmt: skip
    assert np.abs(made[0].image.astype(int) - image).max() <= 4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.zeros((0,))}, "time: found no frames, a recording needs at least one"),
        ({"time": np.zeros((5, 1))}, r"time: found shape \(5, 1\), expected \(N,\)"),
        ({"time": np.array([0, 1, 1, 2, 3.0])}, "time: frame 2 repeats 1 s after 1 s"),
        ({"time": np.array([0, 1, 0.5, 2, 3])}, "time: frame 2 runs backwards at 0.5 s after 1 s"),
        ({"time": np.array([0, 1, np.nan, 2, 3])}, "time: frame 2 is nan"),
        ({"time": np.array(list("abcde"))}, "time: found values of type <U1, expected numbers"),
        ({"sensor_pose": np.zeros((4, 3))}, r"sensor_pose: found shape \(4, 3\), expected \(5, 3\)"),
        ({"sensor_pose": np.zeros((5, 2))}, r"sensor_pose: found shape \(5, 2\), expected \(5, 3\)"),
        ({"sensor_pose": [[0, 0, 0], [1]]}, "sensor_pose: rows have different lengths"),
        ({"sensor_pose": np.full((5, 3), np.inf)}, r"sensor_pose: frame 0 is \[inf, inf, inf\]"),
        ({"object_pose": np.zeros((6, 3))}, r"object_pose: found shape \(6, 3\), expected \(5, 3\)"),
        ({"object_pose": np.tile([0, np.nan, 0], (5, 1))}, r"frame 0 is \[0.0, nan, 0.0\], allowed is three"),
        ({"object_pose": np.full((5, 3), np.inf)}, "object_pose: frame 0 is"),
        ({"contact": np.zeros(5)}, "contact: found values of type float64, expected booleans"),
        ({"contact": np.zeros(4, bool)}, r"contact: found shape \(4,\), expected \(5,\)"),
        ({"episode": np.zeros(5)}, "episode: found values of type float64, expected integers"),
        ({"episode": np.array([0, 0, -2, 0, 0])}, "episode: frame 2 is -2, allowed is 0, 1, 2"),
        ({"codec": "gif"}, "codec: found 'gif', allowed are 'jpeg' and 'png'"),
        ({"image": (b"",) * 4}, "image: found 4 images for 5 times"),
        ({"sensor": POINT}, "image: found images, but the sensor 'point' has none"),
    ],
)
def test_fields_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(FileError, match=message):
        recording(**changes)


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((4, 4, 4), np.uint8)])
def test_only_rgb_bytes_are_encoded(image):
    with pytest.raises(FileError, match="allowed is uint8"):
        encode_image(image)


def test_episodes_end_after_more_than_ten_frames_without_contact():
    ten = [1] * 5 + [0] * 10 + [1] * 5
    eleven = [1] * 5 + [0] * 11 + [1] * 5
    assert episode_numbers(ten).tolist() == [0] * 5 + [-1] * 10 + [0] * 5
    assert episode_numbers(eleven).tolist() == [0] * 5 + [-1] * 11 + [1] * 5


def test_episodes_count_from_five_frames_on():
    four = [0] + [1] * 4 + [0] * 11 + [1] * 5
    assert episode_numbers(four).tolist() == [-1] * 16 + [0] * 5
    assert episode_numbers([0, 0]).tolist() == [-1, -1]
    assert episode_numbers([]).tolist() == []


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
    made = recording(shape=shape)
    path = tmp_path / "a.h5"
    write_recording(made, path)
    found = read_recording(path)
    for name in ("time", "sensor_pose", "object_pose", "contact", "episode"):
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
    assert found.contact_derived is False


def test_an_existing_file_is_kept_unless_asked(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(recording(5), path)
    with pytest.raises(FileError, match=r"a\.h5: already exists"):
        write_recording(recording(3), path)
    assert len(read_recording(path)) == 5
    write_recording(recording(3), path, overwrite=True)
    assert len(read_recording(path)) == 3


def test_a_write_that_fails_leaves_nothing(tmp_path):
    made = recording()
    object.__setattr__(made, "frames", {"broken": {1, 2}})
    with pytest.raises(TypeError):
        write_recording(made, tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileError, match=r"the folder .* does not exist"):
        write_recording(recording(), tmp_path / "no" / "a.h5")
    with pytest.raises(FileError, match="is a folder"):
        write_recording(recording(), tmp_path, overwrite=True)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(recording(), path)
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
