"""The registry of formats, and the real recordings where they are at hand."""

import numpy as np
import pytest
from planar import gaps
from recording_samples import load, pushed

import palpate
from palpate import FileError
from palpate import io as formats


def test_recording_file_goes_through_the_registry(tmp_path):
    path = tmp_path / "a.mcap"
    palpate.write_recording(pushed(), path)
    assert formats.detect_format(path) == "palpate"
    assert len(formats.load_recording(path)) == 40
    path.rename(tmp_path / "b.json")
    assert formats.detect_format(tmp_path / "b.json") == "palpate"


ODD = {
    "binary": bytes(range(256)) * 20,
    "text": b"hello\n",
    "latin": "caf\xe9 ".encode("latin-1") * 2000,
    "json": b'{"a": 1}',
    "list": b"[1, 2]",
    "csv": b"a,b\n1,2\n",
    "tum": b"0 1 2 0 0 0 0 1\n0.1 1 2 0 0 0 0 1\n",
    "gzip": b"\x1f\x8b broken",
    "eight": b"1 2 3 4 5 6 7 8\n",
    "blank": b"\n",
}


@pytest.mark.parametrize("name", ODD)
def test_odd_files_are_in_no_format(tmp_path, name):
    path = tmp_path / "odd.json"
    path.write_bytes(ODD[name])
    assert formats.detect_format(path) is None
    with pytest.raises(FileError, match="is in no known format; known are palpate's, ROS bags"):
        formats.load_recording(path)


def test_a_trajectory_of_quaternions_is_no_log_of_cmu(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("".join(f"{k / 30},{0.1 + k / 900},0.2,0,0,0,0,1\n" for k in range(60)))
    assert formats.detect_format(path) is None


def test_detection_does_not_raise_on_what_is_no_file(tmp_path):
    for each in formats.FORMATS.values():
        assert not each[0](tmp_path) and not each[0](tmp_path / "none")
    for path, message in ((tmp_path, "is a folder"), (tmp_path / "none", "no such file")):
        with pytest.raises(FileError, match=message):
            formats.load_recording(path)


def known_gap(found):
    gap = gaps(found)
    return gap[found.contact & ~np.isnan(gap)] * 1e3


@pytest.mark.parametrize(
    ("files", "name", "count", "frames", "contact", "mean", "spread"),
    [
        ("mit_point_push/*.json.gz", "mit-push", 11, (140, 290), (0.95, 1.01), 1.3, 1.1),
        ("cmu_two_finger/*.txt", "cmu-two-finger", 16, (330, 370), (0.89, 0.95), 0.6, 1.5),
    ],
)
def test_real_pushes(shared_data, files, name, count, frames, contact, mean, spread):
    paths = sorted(shared_data.glob(files))
    assert len(paths) == count
    for path in paths:
        assert formats.detect_format(path) == name
        found = load(path)
        assert frames[0] < len(found) < frames[1]
        assert contact[0] < found.contact.mean() < contact[1]
        gap = known_gap(found)
        assert abs(gap.mean()) < mean and gap.std() < spread and gap.min() > -3.0
        if name == "mit-push":
            assert np.abs(np.diff(found.time) - 1 / 30).max() < 0.006
        else:
            assert np.isnan(found.object_pose[:, 0]).mean() < 0.2


def test_real_images_are_in_no_format(shared_data):
    for path in (shared_data / "gelslim_presses").iterdir():
        assert formats.detect_format(path) is None
    assert formats.detect_format(shared_data / "README.md") is None
