"""Whatever is in a file, palpate reads it or says in one sentence what is wrong with it; nothing moves the cursor."""

import gzip
import json
import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from bag_samples import CONTAINERS, push_messages, write_bag
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

import palpate
from palpate import Disc, PalpateError, Recording, SensorProfile

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())
"""Files on which a reader once failed."""


def recording() -> Recording:
    time, pixels = np.arange(6) / 30, np.random.default_rng(0).integers(0, 256, (6, 12, 8, 3), np.uint8)
    camera = SensorProfile(name="tiny", radius=0.01, image_height=12, image_width=8)
    return Recording.from_arrays(time, pixels, time, np.zeros((6, 3)), Disc(0.05), camera, object_poses=np.ones((6, 3)))


def written(folder: Path, kind: str) -> Path:
    """Write a whole file of a kind into a new folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    if kind in CONTAINERS:
        path = write_bag(folder / kind, kind, push_messages()[:20])
        return next(path.glob("*.db3")) if path.is_dir() else path
    if kind == "own":
        palpate.write_recording(recording(), folder / "own.mcap")
        return folder / "own.mcap"
    name, content = TEXTS[kind]
    (folder / name).write_text(content)
    return folder / name


POSES = [[0.3, 0.31, 0.32], [0.0, 0.0, 0.01]]
MIT = {"timeJSON": [0.0, 0.001, 0.002], "q_sliderJSON": [*POSES, [0.0, 0.0, 0.0]], "q_pusher_sensedJSON": POSES}
TEXTS = {
    "mit": ("a.json", json.dumps(MIT)),
    "cmu": ("a.txt", "0,1,2,0.1,3,4,0.1,0\n0.03,1,2,0.1,3,4,0.1,0\n0.06,1,2,0.1,3,4,0.1,0\n"),
    "table": ("b.csv", "0 0\n0.1 0\n0.1 0.1\n0 0.1\n"),
    "shape": ("b.json", '{"vertices": [[0, 0], [0.1, 0], [0, 0.1]]}'),
    "svg": ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg" width="90mm"><rect width="90" height="60"/></svg>'),
}


def try_readers(path: Path) -> None:
    """Read a file in every way that takes one; errors are one sentence about it."""
    for read in (
        lambda path: list(zip(range(3), palpate.load_recording(path), strict=False)),
        lambda path: palpate.read_bag(path, Disc(0.05)),
        palpate.load_shape,
    ):
        try:
            read(path)
        except PalpateError as error:
            assert "\n" not in str(error) and len(str(error)) < 2500


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_files_on_which_a_reader_once_failed(path):
    try_readers(path)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["own", *CONTAINERS, *TEXTS])
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(
    cut=some.floats(0.0, 1.0),
    changes=some.lists(some.tuples(some.floats(0.0, 1.0), some.binary(max_size=9)), max_size=4),
    number=some.sampled_from([b"", b"1e999", b"-1", b"NaN", b"9" * 400, b"[" * 2000, b"\xff" * 7 + b"\x7f"]),
)
def test_changed_files_are_read_or_refused(tmp_path, kind, cut, changes, number):
    """Bytes are replaced, numbers become absurd, and the end is cut off."""
    whole = written(tmp_path / kind, kind)
    content = bytearray(whole.read_bytes())
    for place, data in [*changes, (cut, number)]:
        at = int(place * len(content))
        content[at : at + len(data)] = data
    whole.write_bytes(bytes(content[: int((0.5 + cut) * len(content)) + 1]))
    try_readers(whole)


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, '{"timeJSON": [0, 1' + "0" * 400 + "]}"])
def test_absurd_json_is_refused(tmp_path, content):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(PalpateError, match=r"a\.json: "):
        palpate.load_recording(tmp_path / "a.json")


def test_a_text_that_unpacks_without_end_is_refused(tmp_path):
    (tmp_path / "a.json.gz").write_bytes(gzip.compress(b'{"timeJSON":' + b" " * 101_000_000, 1))
    with pytest.raises(PalpateError, match=r"a\.json\.gz: is a text of more than 100 MB"):
        palpate.load_recording(tmp_path / "a.json.gz")


def test_an_enormous_image_is_not_decoded(tmp_path):
    png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (10**6).to_bytes(4, "big") * 2 + b"\x08\2\0\0\0" + bytes(8)
    camera = SensorProfile(name="tiny", radius=0.01, image_height=12, image_width=8)
    found = Recording([0.0], np.zeros((1, 3)), Disc(0.1), camera, image=(png,))  # pyright: ignore[reportArgumentType]
    tracemalloc.start()
    with pytest.raises(PalpateError, match="image of frame 0: "):
        found[0]
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\x08\r"


def test_text_in_a_file_does_not_move_the_cursor(tmp_path, run_palpate):
    sensor = SensorProfile(name=EVIL, radius=0.01)
    made = Recording(np.arange(5) / 30, np.zeros((5, 3)), Disc(0.1), sensor, source=EVIL)
    palpate.write_recording(made, tmp_path / "a.mcap")
    for words in (("info", tmp_path / "a.mcap"), ("info", tmp_path / "a.mcap", "--json"), ("info", tmp_path / EVIL)):
        _, out, err = run_palpate(*words)
        printed = out + err
        assert not any((ord(each) < 32 and each != "\n") or 127 <= ord(each) < 160 for each in printed)
        assert "\u202e" not in printed and "owned" in printed
    assert len(str(PalpateError("x" * 100_000))) < 2500
