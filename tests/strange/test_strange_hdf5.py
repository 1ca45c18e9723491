"""HDF5 that crashes its library, holds it up, leads out of the file or unpacks to more than it should."""

import os
import random
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from recording_samples import pushed, tiny_recording

from palpate import io as formats
from palpate.errors import FileError
from palpate.io import hdf5
from palpate.io.palpate_h5 import read_recording, recording_to_bytes, write_recording


@pytest.fixture
def path(tmp_path):
    write_recording(tiny_recording(), tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.fixture
def planted(monkeypatch):
    """Put a process that runs some code in the place of the one that reads."""
    monkeypatch.setattr(hdf5, "_children", {})

    def plant(code):
        hdf5._stop()
        pipe = subprocess.PIPE
        hdf5._children[os.getpid()] = subprocess.Popen([sys.executable, "-S", "-c", code], stdin=pipe, stdout=pipe)

    yield plant
    hdf5._stop()


def test_a_crash_of_the_library_is_one_sentence(path, planted):
    # Stands for any damage that ends the process in which the library runs.
    for death in (signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL):
        code = f"import os, sys; sys.stdin.readline(); os.kill(os.getpid(), {int(death)})"
        planted(code)
        with pytest.raises(FileError, match=r"a\.h5: is truncated or damaged \(the HDF5 library crashed\)"):
            read_recording(path)
        assert len(read_recording(path)) == 5  # by another one


def test_a_crash_is_one_where_no_signal_says_that_time_is_up(path, planted, monkeypatch):
    monkeypatch.delattr(signal, "SIGXCPU", raising=False)  # as on Windows
    planted("import os, sys; sys.stdin.readline(); os._exit(0)")
    with pytest.raises(FileError, match=r"a\.h5: is truncated or damaged \(the HDF5 library crashed\)"):
        read_recording(path)


def test_half_an_answer_is_a_crash(path, planted):
    code = 'print(\'{"attributes": {}, "arrays": {"a": {"type": "<f8", "shape": [9], "attributes": {}}}}\')'
    planted(code)
    with pytest.raises(FileError, match="the HDF5 library crashed"):
        read_recording(path)


def test_what_takes_too_long_is_stopped(path, planted, monkeypatch):
    monkeypatch.setenv("PALPATE_MAX_SECONDS", "1")
    monkeypatch.setattr(hdf5, "PATIENCE", 1)
    planted("import time; time.sleep(60)")
    before = time.monotonic()
    with pytest.raises(FileError, match="took longer than 1 s, allowed are 1; PALPATE_MAX_SECONDS allows more"):
        read_recording(path)
    assert time.monotonic() - before < 30.0
    monkeypatch.delenv("PALPATE_MAX_SECONDS")
    assert len(read_recording(path)) == 5


def test_damaged_bytes_never_reach_this_process(path, monkeypatch):
    def never(*_, **__):
        raise AssertionError("HDF5 was opened here")

    monkeypatch.setattr(h5py, "File", never)
    whole, rng = path.read_bytes(), random.Random(2)
    read = 0
    for _ in range(40):
        data = bytearray(whole)
        for _ in range(26):
            data[rng.randrange(8, 3000)] = rng.randrange(256)
        path.write_bytes(data)
        try:
            read += len(formats.load_recording(path)) > 0
        except FileError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    assert read < 40


def edited(path, edit):
    with h5py.File(path, "r+") as file:
        edit(file)


def test_no_array_is_larger_than_allowed(path):
    def declare(file):
        file["extra/wide"] = np.zeros(5)
        del file["extra/wide"]
        file.create_dataset("extra/wide", (5, 80_000_000), "f8", chunks=(1, 1_000_000), compression="gzip")

    edited(path, declare)
    assert path.stat().st_size < 173_000
    with pytest.raises(FileError, match=r"extra/wide: holds 3200\.0 MB; for all arrays allowed are 256 MB"):
        read_recording(path)


def test_the_limit_of_arrays_is_raised(path, monkeypatch):
    edited(path, lambda file: file.create_dataset("extra/a", (5, 30_000), "f8", compression="gzip"))
    monkeypatch.setenv("PALPATE_MAX_ARRAYS_MB", "1")
    with pytest.raises(FileError, match=r"extra/a: holds 1\.2 MB; .*PALPATE_MAX_ARRAYS_MB allows more"):
        read_recording(path)
    monkeypatch.setenv("PALPATE_MAX_ARRAYS_MB", "2")
    assert read_recording(path).extra["a"].shape == (5, 30_000)


def test_rows_that_share_their_bytes_do_not_multiply(tmp_path):
    path = tmp_path / "a.h5"
    write_recording(tiny_recording(200), path)
    edited(path, lambda file: file["image"].__setitem__(0, np.zeros(100_000, np.uint8)))
    with h5py.File(path, "r") as file:
        start = file["image"].id.get_offset()
    data = bytearray(path.read_bytes())
    for index in range(1, 200):  # each refers to the same bytes as the first
        data[start + 16 * index : start + 16 * index + 16] = data[start : start + 16]
    path.write_bytes(data)
    found = read_recording(path)
    with pytest.raises(FileError, match="image of frame 1: its 100000 bytes do not decode"):  # read one by one
        found[1]


@pytest.fixture
def secret(tmp_path):
    place = tmp_path / "secret.h5"
    with h5py.File(place, "w") as file:
        file["time"] = np.arange(5.0)
    (tmp_path / "secret.raw").write_bytes(np.arange(5.0).tobytes())
    return place


def external_storage(file, secret):
    raw = str(secret.with_suffix(".raw"))
    file.create_dataset("time", (5,), "f8", external=[(raw, 0, h5py.h5f.UNLIMITED)])


def external_link(file, secret):
    file["time"] = h5py.ExternalLink(str(secret), "time")


def soft_link(file, _):
    file["moment"] = np.arange(5.0)
    file["time"] = h5py.SoftLink("/moment")


def virtual(file, secret):
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "time", (5,))
    file.create_virtual_dataset("time", layout)


@pytest.mark.parametrize("lead", [external_storage, external_link, soft_link, virtual])
def test_nothing_outside_the_file_is_opened(path, secret, lead):
    edited(path, lambda file: file.__delitem__("time"))
    edited(path, lambda file: lead(file, secret))
    with h5py.File(path, "r") as file:
        assert np.asarray(file["time"])[3] == 3.0  # it would work
    with pytest.raises(FileError, match=r"a\.h5: time: (is a link|keeps its values in another file)"):
        read_recording(path)


def test_a_group_that_is_a_link_is_not_followed(path, secret):
    with h5py.File(secret, "a") as file:
        file["inner/password"] = np.arange(5.0)
    edited(path, lambda file: file.__setitem__("extra", h5py.ExternalLink(str(secret), "inner")))
    with pytest.raises(FileError, match="extra: is a link"):
        read_recording(path)


def test_one_process_serves_many_files_and_ends_with_its_parent(path):
    read_recording(path)
    first = hdf5._children[os.getpid()].pid
    assert len(formats.load_recording(path)) == 5 and hdf5._children[os.getpid()].pid == first
    code = "import sys; from palpate.io import hdf5, load_recording; load_recording(sys.argv[1])\n"
    code += "print(list(hdf5._children.values())[0].pid)"
    pid = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True).stdout
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid), 0)


def test_bytes_are_read_as_files_are():
    made = pushed(4)
    found = hdf5.read_hdf5(recording_to_bytes(made))
    np.testing.assert_array_equal(found.arrays["time"], made.time)
    assert found.attributes["format"] == "palpate-recording"
    with pytest.raises(FileError, match="is truncated or damaged"):
        hdf5.read_hdf5(b"\x89HDF\r\n\x1a\n" + bytes(100))


def test_other_hdf5_is_no_recording(tmp_path, secret):
    assert formats.detect_format(secret) is None
    with pytest.raises(FileError, match="is an HDF5 file of another kind"):
        formats.read(secret)
