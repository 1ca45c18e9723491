"""Calibrations and trials (.npz) that are damaged, or that say they are larger than they are."""

import io
import random
import zipfile

import numpy as np
import pytest
from study_samples import drawn_trial

from palpate.archives import read_arrays
from palpate.errors import FileError
from palpate.lab.study.trial import Method, read_trial, write_trial
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, load_calibration, write_calibration


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "unit.npz"
    level = np.full((4, 3, 3), 7.0, np.float32)
    write_calibration(Calibration(Background(level, level)), path)
    return path


@pytest.fixture
def trial(tmp_path):
    path = tmp_path / "trial.npz"
    write_trial(drawn_trial(Method("none", "fixed-lag"), seconds=2.0), path)
    return path


@pytest.mark.parametrize(("kind", "read"), [("calibration", load_calibration), ("trial", read_trial)])
def test_flipped_bytes_are_one_sentence(request, kind, read):
    path = request.getfixturevalue(kind)
    whole, rng = path.read_bytes(), random.Random(1)
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 3)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            read(path)
        except FileError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 100


def rewritten(path, name, content, how=zipfile.ZIP_DEFLATED):
    """Write an archive whose part `name` has other content."""
    with zipfile.ZipFile(path) as archive:
        parts = {each: archive.read(each) for each in archive.namelist()}
    with zipfile.ZipFile(path, "w", how) as archive:
        for each, data in (parts | {f"{name}.npy": content}).items():
            archive.writestr(each, data)
    return path


def array(header, data=b""):
    text = header.encode().ljust(118)
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (100000, 100000, 3), }",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 4, 3), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (4, 4, 3), }",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (4, 4, 3",
        "(" * 100,
        "-" * 9000 + "1",
    ],
)
def test_a_header_that_is_not_so_is_refused(calibration, header):
    with pytest.raises(FileError, match=r"unit\.npz: is no \.npz, or is truncated or damaged \(mean"):
        load_calibration(rewritten(calibration, "mean", array(header, bytes(64))))


def test_what_is_unpacked_is_bounded(calibration, monkeypatch):
    stream = io.BytesIO()
    np.save(stream, np.zeros((1000, 1000, 3), np.float32))
    rewritten(calibration, "mean", stream.getvalue())
    assert calibration.stat().st_size < 50_000
    assert read_arrays(calibration)["mean"].nbytes == 12_000_000
    monkeypatch.setenv("PALPATE_MAX_ARRAYS_MB", "10")
    with pytest.raises(FileError, match=r"holds arrays of 12 MB, allowed are 10 MB; PALPATE_MAX_ARRAYS_MB allows more"):
        load_calibration(calibration)


def test_other_ways_to_pack_are_refused(calibration):
    with pytest.raises(FileError, match=r"is packed as no \.npz is"):
        load_calibration(rewritten(calibration, "more", bytes(1000), zipfile.ZIP_LZMA))


def test_arrays_are_read_as_numpy_reads_them(tmp_path):
    made = {
        "a": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "b": np.array(3),
        "c": np.array("wörd"),
        "d": np.zeros((0, 3), np.bool_),
        "e": np.arange(3, dtype=">i2"),
    }
    np.savez_compressed(tmp_path / "a.npz", **made)
    found = read_arrays(tmp_path / "a.npz")
    assert found.keys() == made.keys()
    for name, value in made.items():
        np.testing.assert_array_equal(found[name], value)
        assert found[name].dtype == value.dtype


def test_a_trial_lacks_nothing(trial):
    np.savez(trial, time=np.zeros(3))
    with pytest.raises(FileError, match="is not a trial of a study: lacks about, truth"):
        read_trial(trial)
