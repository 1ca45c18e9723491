"""palpate's own recording file: all of a recording comes back, others read its messages, and damage is named."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_samples import decoded_by_another
from mcap.writer import Writer
from recording_samples import TINY_CAMERA, encoded, tiny_images
from scipy.spatial.transform import Rotation

import palpate
from palpate import Disc, Ellipse, FileError, Polygon, Recording, Rectangle

ARRAYS = ("time", "sensor_pose", "object_pose", "first_pose", "first_pose_sigma", "set_up_sigma", "contact")


def images(n: int, codec: str = "png") -> tuple[bytes, ...]:
    return tuple(encoded(image, codec) for image in tiny_images(n))


def recording(n: int = 12, **changes: Any) -> Recording:
    """Return a recording with everything, its times and poses such as no stamp and no quaternion holds."""
    rng = np.random.default_rng(8)
    truth = rng.normal(size=(n, 3)) * [1, 1, 4]
    truth[3:4] = np.nan
    fields: dict[str, Any] = {
        "time": 1.7e9 + np.cumsum(rng.uniform(0.01, 0.05, n)),
        "sensor_pose": rng.normal(size=(n, 3)) * [1, 1, 7],
        "shape": Disc(0.05),
        "sensor": TINY_CAMERA,
        "object_pose": truth,
        "contact": np.arange(n) > 1,
        "image": images(n),
        "source": "a test, with ünicode",
        "first_pose": [0.1, -0.2, 3.0],
        "first_pose_sigma": [0.01, 0.02, 0.3],
        "set_up_sigma": [0.0, 0.001, 0.02],
        "extra": {"force": np.append(np.nan, rng.normal(size=2 * n - 1)).reshape(n, 2), "on": np.arange(n) == 4},
    }
    return Recording(**(fields | changes))


BARE: dict[str, Any] = dict.fromkeys((*ARRAYS[2:], "image")) | {"extra": {}}


def same(found: Recording, wanted: Recording, count: int | None = None) -> None:
    """Assert that the first frames of two recordings are the same to the last bit."""
    for name in ARRAYS:
        one, other = getattr(found, name), getattr(wanted, name)
        assert (one is None) == (other is None), name
        if other is not None:
            rows = other if name.startswith("first") else other[:count]
            assert one.tobytes() == rows.tobytes() and one.dtype == rows.dtype, name
    images = None if found.image is None else tuple(found.image)
    assert images == (None if wanted.image is None else wanted.image[:count])
    for name in ("shape", "sensor", "source"):
        assert getattr(found, name) == getattr(wanted, name), name
    assert found.extra.keys() == wanted.extra.keys()
    for name, value in wanted.extra.items():
        assert found.extra[name].tobytes() == value[:count].tobytes() and found.extra[name].dtype == value.dtype


@pytest.mark.parametrize(
    "changes",
    [
        {},
        BARE,
        {"image": images(12, "jpeg"), "shape": Rectangle(0.2363, 0.1579)},
        {"shape": Ellipse(0.1638, 0.2428), "time": np.arange(12) / 30 - 0.1},
        {"shape": Polygon(np.array([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])), "image": None},
    ],
)
def test_round_trip(tmp_path, changes):
    made, path = recording(**changes), tmp_path / "a.mcap"
    palpate.write_recording(made, path)
    found = palpate.load_recording(path)
    same(found, made)
    assert found.file == path and palpate.read_recording(path).file == path
    palpate.write_recording(found, tmp_path / "b.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == path.read_bytes()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.mcap", "b.mcap"]


def test_a_write_that_fails_leaves_nothing(tmp_path):
    made = recording(source=3)
    with pytest.raises(AttributeError):
        palpate.write_recording(made, tmp_path / "a.mcap")
    with pytest.raises(FileError, match=r"the folder .* does not exist"):
        palpate.write_recording(recording(), tmp_path / "no" / "a.mcap")
    with pytest.raises(FileError, match="is a folder"):
        palpate.write_recording(recording(), tmp_path, overwrite=True)
    with pytest.raises(FileError, match=r"a\.mcap: frame 0 is at 3e\+09 s, stamps of ROS messages go from 0"):
        palpate.write_recording(recording(time=3e9 + np.arange(12)), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []
    palpate.write_recording(recording(5), tmp_path / "a.mcap")
    with pytest.raises(FileError, match=r"a\.mcap: already exists; .*overwrite=True"):
        palpate.write_recording(recording(3), tmp_path / "a.mcap")
    assert len(palpate.load_recording(tmp_path / "a.mcap")) == 5


def test_others_read_its_messages(tmp_path):
    made = recording()
    palpate.write_recording(made, tmp_path / "a.mcap")
    found = decoded_by_another(tmp_path / "a.mcap")
    assert set(found) == {"/sensor/pose", "/object/pose", "/sensor/image/compressed", "/sensor/contact"}
    for (time, message), wanted, image in zip(
        found["/sensor/pose"], made.sensor_pose, found["/sensor/image/compressed"], strict=True
    ):
        point, turn = message.pose.position, message.pose.orientation
        yaw = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_euler("zyx")[0]
        assert message.header.frame_id == "world" and image[0] == time
        assert [point.x, point.y] == pytest.approx(wanted[:2])
        assert np.cos(yaw - wanted[2]) == pytest.approx(1.0)
    sent = [message.header.stamp for _, message in found["/sensor/pose"]]
    seconds = [each.sec + 1e-9 * each.nanosec for each in sent]
    assert seconds == pytest.approx(made.time.tolist(), abs=5e-7)  # a double at 1.7e9 s has steps of 2.4e-7
    assert len(found["/object/pose"]) == len(made) - 1
    assert [bool(message.data) for _, message in found["/sensor/contact"]] == (np.arange(12) > 1).tolist()
    assert made.image is not None
    for (_, message), data in zip(found["/sensor/image/compressed"], made.image, strict=True):
        assert (bytes(message.data), message.format) == (data, "png")


def test_its_messages_are_a_bag(tmp_path):
    made = recording(time=np.arange(12) / 30)
    palpate.write_recording(made, tmp_path / "a.mcap")
    choices = palpate.BagChoices(sensor_poses="/sensor/pose", object_poses="/object/pose")
    found = palpate.read_bag(tmp_path / "a.mcap", made.shape, choices, TINY_CAMERA).recording
    assert found.time == pytest.approx(made.time, abs=1e-9)
    assert found.image is not None and tuple(found.image) == made.image
    assert found.sensor_pose[:, :2] == pytest.approx(made.sensor_pose[:, :2])
    assert np.cos(found.sensor_pose[:, 2] - made.sensor_pose[:, 2]) == pytest.approx(1.0)


def test_a_file_that_is_cut_off_is_read_to_its_end(tmp_path, caplog):
    rng = np.random.default_rng(0)
    made = recording(120, image=tuple(rng.integers(0, 256, 30_000, np.uint8).tobytes() for _ in range(120)))
    palpate.write_recording(made, tmp_path / "a.mcap")
    content, path, lengths = (tmp_path / "a.mcap").read_bytes(), tmp_path / "cut.mcap", []
    for cut in (0.5, 0.7, 0.99):
        path.write_bytes(content[: int(cut * len(content))])
        found = palpate.load_recording(path)
        lengths.append(len(found))
        same(found, made, len(found))
    assert 20 < lengths[0] < lengths[1] < lengths[2] <= 120
    assert f"the {lengths[2]} frames before that are read" in caplog.text
    path.write_bytes(content[: len(content) // 10])
    with pytest.raises(FileError, match=r"cut\.mcap: is cut off or damaged after .*, before the first frame"):
        palpate.load_recording(path)


def test_damaged_bytes_are_noticed(tmp_path):
    """Wherever bytes change, the recording is as written up to there, or the error names the file."""
    made, path = recording(), tmp_path / "a.mcap"
    palpate.write_recording(made, path)
    content = path.read_bytes()
    refused = 0
    for place in np.random.default_rng(2).integers(8, len(content) - 30, 60).tolist():
        damaged = bytearray(content)
        damaged[place] ^= 255
        path.write_bytes(damaged)
        try:
            found = palpate.load_recording(path)
            assert found.image is None or len(found.image) == len(found)
        except FileError as error:
            refused += 1
            assert str(error).startswith(str(path)) and "\n" not in str(error)
    assert refused > 20


def write_mcap(path: Path, about: dict[str, str], attachments: dict[str, bytes]) -> None:
    """Write an MCAP with the metadata of a recording that are given."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        writer.add_metadata("palpate", about)
        for name, data in attachments.items():
            writer.add_attachment(0, 0, name, "", data)
        writer.finish()


WHOLE = {"version": "1", "shape": '{"type": "disc", "radius": 0.05}', "sensor": '{"name": "tip", "radius": 0.01}'}


@pytest.mark.parametrize(
    ("about", "attachments", "words"),
    [
        ({"version": "3"}, {}, "has version '3', this palpate reads versions 1 and 2"),
        ({}, {}, "has version None"),
        (WHOLE, {"palpate/time.npy": b"no array"}, r"attachment or metadata palpate/time\.npy is damaged"),
        ({"version": "1"}, {}, "metadata shape: is not valid JSON"),
        ({"version": "1", "shape": "{"}, {}, "metadata shape: is not valid JSON"),
    ],
)
def test_metadata_that_are_none(tmp_path, about, attachments, words):
    write_mcap(tmp_path / "a.mcap", about, attachments)
    with pytest.raises(FileError, match=rf"a\.mcap: {words}"):
        palpate.load_recording(tmp_path / "a.mcap")


def test_what_read_bag_returns_is_no_recording(tmp_path):
    reading: Any = palpate.BagReading(recording(), None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(palpate.SettingError, match=r"expected a Recording; that of read_bag is its \.recording"):
        palpate.write_recording(reading, tmp_path / "a.mcap")


def test_a_bad_image_is_named_when_it_is_looked_at(tmp_path):
    damaged = list(images(12))
    damaged[2], damaged[4] = b"\x01" * 50, b""
    palpate.write_recording(recording(image=tuple(damaged)), tmp_path / "a.mcap")
    found = palpate.load_recording(tmp_path / "a.mcap")
    assert found[0].image is not None
    for index, size in ((2, 50), (4, 0)):
        with pytest.raises(
            FileError, match=rf"a\.mcap: image of frame {index}: its {size} bytes do not decode as JPEG or PNG"
        ):
            found[index]


def test_it_is_read_without_the_types_of_all_messages(tmp_path):
    """They take as long to load as fifty frames to track."""
    palpate.write_recording(recording(), tmp_path / "one.mcap")
    code = (
        "import sys, palpate; print(len(palpate.load_recording(sys.argv[1]).image)); "
        "print(*(name for name in sys.modules if name.startswith('rosbags.typesys.stores.ros')))"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "one.mcap")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "12\n\n"), done.stderr
