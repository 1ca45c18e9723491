"""What `palpate train` refuses, before any work."""

import dataclasses
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from training_samples import DISC, SENSOR, model_settings, pushes, write_pushes

from palpate.cli import main
from palpate.io.recording_mcap import write_recording
from palpate.touch.model import NETWORKS, write_model


def failure(capsys: Any, *words: Any) -> str:
    """The one line on standard error of a command that fails."""
    assert main.main([str(word) for word in words]) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1
    return error


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    return write_pushes(tmp_path_factory.mktemp("recordings"))


def test_where_a_model_is_already(recordings, tmp_path, capsys):
    write_model(tmp_path, model_settings(), dict.fromkeys(NETWORKS, b"1"))
    for more in ((), ("--resume",)):
        said = failure(capsys, "train", recordings, "--out", tmp_path, *more)
        assert "holds a model already; take another folder" in said


def test_folders_that_cannot_be_learned_from(recordings, tmp_path, capsys):
    out = tmp_path / "model"
    assert "nowhere: no such folder of recordings" in failure(capsys, "train", "nowhere", "--out", out)
    assert "steps is 0; allowed is 1 or more" in failure(capsys, "train", recordings, "--out", out, "--steps", 0)
    assert "holds no recordings (*.mcap)" in failure(capsys, "train", tmp_path, "--out", out)
    assert "holds no recordings" in failure(capsys, "train", recordings, "--out", out, "--test", tmp_path)
    bare = tmp_path / "bare"
    bare.mkdir()
    shutil.copy(recordings / "bare.mcap", bare)
    said = failure(capsys, "train", bare, "--out", out)
    assert "no recording can be learned from; the first:" in said and "bare.mcap: has no image; learning" in said
    (bare / "bare.mcap").unlink()
    write_recording(pushes(DISC, 1), bare / "few.mcap")
    assert "too few pairs to learn from: 60 frames of 1 contacts" in failure(capsys, "train", bare, "--out", out)
    file = tmp_path / "file"
    file.write_text("mine")
    assert "file: cannot be the folder of a model (File exists)" in failure(capsys, "train", recordings, "--out", file)
    assert not out.exists() and file.read_text() == "mine"


def test_what_is_of_another_sensor(recordings, tmp_path, capsys):
    write_model(tmp_path, model_settings(sensor="DIGIT", image_height=320), dict.fromkeys(NETWORKS, b"1"))
    said = failure(capsys, "train", recordings, "--out", tmp_path / "out", "--from", tmp_path)
    assert "sensor 'DIGIT' with images of 320 x 128 px is not that of the recordings" in said
    assert "'small' with 64 x 128 px" in said
    other = tmp_path / "other"
    other.mkdir()
    sensor = dataclasses.replace(SENSOR, name="other")
    write_recording(dataclasses.replace(pushes(DISC, 1), sensor=sensor), other / "push.mcap")
    said = failure(capsys, "train", recordings, "--out", tmp_path / "out", "--test", other)
    assert "recordings to judge by: sensor 'other' with images of 64 x 128 px is not that" in said
    (tmp_path / "pair.onnx").write_bytes(b"2")
    assert "altered" in failure(capsys, "train", recordings, "--out", tmp_path / "out", "--from", tmp_path)


def test_recordings_to_judge_by_without_pairs_are_found_before_the_training(recordings, tmp_path, capsys):
    short = tmp_path / "short"
    short.mkdir()
    given = pushes(DISC, 1)
    contact: Any = given.contact
    contact = contact & (np.arange(len(given)) < 22)
    write_recording(dataclasses.replace(given, contact=contact), short / "push.mcap")
    said = failure(capsys, "train", recordings, "--out", tmp_path / "out", "--test", short)
    assert "too few pairs to learn from: no contact has frames 10 apart" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["torch", "onnxscript"])
def test_without_what_training_needs(name, recordings, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    said = failure(capsys, "train", recordings, "--out", "model")
    assert f"training needs {name}, which is not installed: pip install palpate[train]" in said
