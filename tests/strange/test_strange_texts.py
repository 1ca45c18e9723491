"""Text files that ask for too much: time, memory, depth, and numbers beyond all measure."""

import gzip
import json
import subprocess
import sys

import pytest

from palpate import io as formats
from palpate.config import read_noise
from palpate.errors import FileError, PalpateError, SettingError, ShapeError
from palpate.geometry.shapes import Disc, Polygon, shape_from_dict
from palpate.io import cmu_two_finger, estimates_csv, mit_push, theseus_json, tum
from palpate.io.outlines.load import load_shape
from palpate.lab.study.comparison import read_scores
from palpate.pipeline.details import read_friction
from palpate.touch.press_files import read_presses
from palpate.types.sensor import SensorProfile

HUGE = 10**400


@pytest.mark.parametrize("module", [tum, cmu_two_finger])
def test_many_digits_are_refused_at_once(tmp_path, module):
    path = tmp_path / "digits.txt"
    path.write_text("1" * 400_000)
    # A pattern that goes back and forth takes a minute for these, in a process of its own that can be stopped.
    code = f"from pathlib import Path; from palpate.io import {module.__name__.split('.')[-1]} as m\n"
    code += f"try:\n m.read(Path({str(path)!r}))\nexcept m.FileError as error:\n print(error)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    assert "line 1: found '111" in done.stdout


@pytest.mark.parametrize("read", [mit_push.read, theseus_json.read, read_noise])
@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000])
def test_deep_json_is_refused(tmp_path, read, text):
    path = tmp_path / "deep.json"
    path.write_text(text)
    with pytest.raises(FileError, match=r"deep\.json: is not valid JSON"):
        read(path)


def test_what_is_unpacked_is_bounded(tmp_path, monkeypatch):
    path = tmp_path / "bomb.json.gz"
    path.write_bytes(gzip.compress(b" " * 3_000_000))
    monkeypatch.setenv("PALPATE_MAX_TEXT_MB", "2")
    with pytest.raises(FileError, match=r"text of more than 2 MB.*PALPATE_MAX_TEXT_MB allows more"):
        mit_push.read(path)
    path.write_bytes(b" " * 3_000_000)
    with pytest.raises(FileError, match="text of more than 2 MB"):
        mit_push.read(path)
    monkeypatch.setenv("PALPATE_MAX_TEXT_MB", "4")
    with pytest.raises(FileError, match="is not valid JSON"):
        mit_push.read(path)


@pytest.mark.parametrize("word", ["lots", "-1", "0", "nan"])
def test_a_limit_that_is_no_number_is_told(tmp_path, monkeypatch, word):
    path = tmp_path / "a.json"
    path.write_text("{}")
    monkeypatch.setenv("PALPATE_MAX_TEXT_MB", word)
    with pytest.raises(SettingError, match=f"PALPATE_MAX_TEXT_MB is '{word}'; allowed is a number above 0"):
        mit_push.read(path)


def mit(times):
    n = len(times)
    fields = {"q_pusher_sensedJSON": [[0.3] * n, [0.0] * n], "q_sliderJSON": [[0.3] * n, [0.1] * n, [0.0] * n]}
    return json.dumps({**fields, "timeJSON": times})


@pytest.mark.parametrize("last", [1e8, 1e300, HUGE], ids=["1e8", "1e300", "huge"])
def test_far_times_are_no_reason_to_fill_the_memory(tmp_path, last):
    path = tmp_path / "far.json"
    path.write_text(mit([0.0, 0.001, last]))
    with pytest.raises(FileError, match=r"far\.json: time"):
        mit_push.read(path)


ESTIMATES = ",".join(estimates_csv.COLUMNS) + "\n0.0,0,0,0,,,,,,,,"


@pytest.mark.parametrize("end", ["\r1\n", "x" * 200_000 + "\n", '"' + "x" * 200_000])
def test_a_csv_that_is_none_is_refused(tmp_path, end):
    path = tmp_path / "a.csv"
    path.write_bytes((ESTIMATES + end).encode())
    with pytest.raises(FileError, match=r"a\.csv: "):
        estimates_csv.read(path)
    path.write_bytes(("time,friction,deviation\n0,1" + end).encode())
    with pytest.raises(FileError, match=r"a\.csv: "):
        read_friction(path, None)  # pyright: ignore[reportArgumentType]  # not needed that far
    path.write_bytes(("file,angle_deg\nx.png,1" + end).encode())
    with pytest.raises(FileError, match=r"a\.csv: |x\.png1?: "):
        read_presses(path)


def test_a_damaged_table_of_sequences_is_refused(tmp_path):
    (tmp_path / "study.json").write_text(
        json.dumps({"format": "palpate-study", "version": 1, "made_with": {}, "recordings": {}})
    )
    for text in ("recording\n" + "x" * 200_000, "recording,a\nb\rc,1\n", "recording\n\x00\n"):
        (tmp_path / "sequences.csv").write_text(text, newline="")
        with pytest.raises(FileError, match=r"sequences\.csv: is not a (table of sequences|CSV table)"):
            read_scores(tmp_path)


@pytest.mark.parametrize("size", [HUGE, 1e200, 1e-200, -HUGE], ids=["huge", "1e200", "1e-200", "below"])
def test_sizes_beyond_all_measure_are_refused(size):
    with pytest.raises(ShapeError, match=r"disc radius is .*; it must be a length from"):
        Disc(size)
    with pytest.raises(ShapeError, match="rectangle"):
        shape_from_dict({"type": "rectangle", "size_x": 0.1, "size_y": size})
    with pytest.raises(SettingError, match="has radius"):
        SensorProfile(name="a", radius=-abs(size))
    if abs(size) > 1:
        with pytest.raises(ShapeError, match="polygon vert"):
            Polygon([(0, 0), (size, 0), (0, 1)])
        with pytest.raises(SettingError, match="has radius"):
            SensorProfile(name="a", radius=abs(size))
        with pytest.raises(SettingError, match="has tips"):
            SensorProfile(name="a", radius=0.01, tips=((size, 0.0),))
        with pytest.raises(SettingError, match="has image_height"):
            SensorProfile(name="a", radius=0.01, image_height=10**400, image_width=3)


def test_an_error_shows_the_start_of_a_long_value_only():
    with pytest.raises(ShapeError) as raised:
        Disc(HUGE)
    assert len(str(raised.value)) < 300


@pytest.mark.parametrize("value", [HUGE, 1e200], ids=["huge", "1e200"])
def test_numbers_beyond_all_measure_in_files_are_refused(tmp_path, value):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"vertices": [[0, 0], [value, 0], [0, 1]]}))
    with pytest.raises(FileError, match=r"a\.json: "):
        load_shape(str(path))
    path.write_text(json.dumps({"format": "palpate-noise", "version": 2, "noise": {"contact": {"deviation": HUGE}}}))
    with pytest.raises(PalpateError, match=r"a\.json: "):
        read_noise(path)
    frames = {"obj_poses_2d": [[value, 0, 0]], "ee_poses_2d": [[0, 0, 0]], "contact_flag": [1], "contact_episode": [0]}
    path.write_text(json.dumps({**frames, "params": {"obj_radius": 0.1}}))
    with pytest.raises(FileError, match=r"a\.json: "):
        formats.read(path)
    path.write_text(json.dumps({**frames, "obj_poses_2d": [[0, 0, 0]], "params": {"obj_radius": value}}))
    with pytest.raises(FileError, match=r"a\.json: "):
        formats.read(path)
