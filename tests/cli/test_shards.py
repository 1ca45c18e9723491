"""Shards of a simulation and of a study: together they leave what one process leaves."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.cli import main
from palpate.io.recording_mcap import write_recording
from palpate.shards import Shard, part_of_work

STUDY = ("evaluate", "pushes", "--tactile", "oracle")
BUSY = "another process is writing it"


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own, where `pushes` holds three recordings; no figures are drawn."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate.lab.study.report.write_report", lambda *_: None)
    Path("pushes").mkdir()
    for index in range(3):
        given = pushed(20)
        bent = given.sensor_pose + np.array([0.0, 1e-4 * index, 0.0])
        write_recording(replace(given, sensor_pose=bent), f"pushes/push-{index}.mcap")


def contents(folder: str) -> dict[str, Any]:
    """What is in a folder by the names of files; of trials, what does not tell how long they took."""
    found: dict[str, Any] = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.suffix == ".npz":
            with np.load(path) as arrays:
                found[str(path)] = {key: arrays[key].tobytes() for key in arrays if key not in ("step_ms", "about")}
        elif path.is_file():
            found[str(path)] = path.read_bytes()
    return {name.removeprefix(f"{folder}/"): data for name, data in found.items()}


def test_every_item_is_in_one_shard():
    items = "abcdefgh"
    parts = [part_of_work(items, Shard(number, 3)) for number in (1, 2, 3)]
    assert parts == ["adg", "beh", "cf"] and part_of_work(items, None) == items
    assert [part_of_work("a", Shard(number, 2)) for number in (1, 2)] == ["a", ""]


def test_shards_of_a_study_are_put_together(capsys):
    assert main.main([*STUDY, "--out", "whole"]) == 0
    capsys.readouterr()
    for shard in ("2/3", "1/3"):  # the third was never begun
        assert main.main([*STUDY, "--out", "parts", "--shard", shard]) == 0
        said = capsys.readouterr().out
        assert "1 trials, 0 kept" in said and "--resume without --shard reports" in said
    assert not Path("parts/sequences.csv").exists()
    assert main.main([*STUDY, "--out", "parts", "--shard", "1/3"]) == 2
    assert "parts: is not empty; --resume goes on" in capsys.readouterr().err
    assert main.main([*STUDY, "--out", "parts", "--shard", "1/3", "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["study"]["kept"] == 1
    assert main.main([*STUDY, "--out", "parts", "--resume"]) == 0
    assert "3 trials, 2 kept" in capsys.readouterr().out
    whole, parts = contents("whole"), contents("parts")
    assert parts.keys() == whole.keys()
    same = [name for name in whole if name.startswith("trials")]
    assert len(same) == 3 and all(parts[name] == whole[name] for name in same)
    indices = [json.loads(each["study.json"]) for each in (whole, parts)]
    assert indices[0] == indices[1]
    tables = [list(csv.DictReader(each["sequences.csv"].decode().splitlines())) for each in (whole, parts)]
    for rows in tables:
        for row in rows:
            for column in [name for name in row if name.startswith("step_ms") or name == "wall_s"]:
                del row[column]
    assert tables[0] == tables[1] and len(tables[0]) == 3


def test_shards_of_other_settings_are_not_put_together(capsys):
    assert main.main([*STUDY, "--out", "parts", "--shard", "1/2"]) == 0
    assert main.main([*STUDY, "--out", "parts", "--shard", "2/2", "--pressure", "rim"]) == 2
    assert "parts: was made with other settings (pressure was 'uniform', is 'rim')" in capsys.readouterr().err


def test_a_shard_leaves_alone_what_others_write(capsys):
    """Where a file system knows no locks, what others write cannot be told from what the dead left."""
    Path("parts/trials/oracle").mkdir(parents=True)
    theirs = [Path("parts/.study-shard-2-of-2.json.part"), Path("parts/trials/oracle/.push-1.mcap.npz.part")]
    for path in theirs:
        path.write_text("half")
    assert main.main([*STUDY, "--out", "parts", "--shard", "2/2"]) == 2  # trials of nobody knows what
    theirs[1].parent.rename("elsewhere")
    Path("parts/trials").rmdir()
    assert main.main([*STUDY, "--out", "parts", "--shard", "1/2"]) == 0
    Path("parts/trials/oracle/.push-1.mcap.npz.part").touch()
    assert main.main([*STUDY, "--out", "parts", "--shard", "1/2", "--resume"]) == 0
    assert Path("parts/trials/oracle/.push-1.mcap.npz.part").exists() and theirs[0].exists()
    assert main.main([*STUDY, "--out", "parts", "--resume"]) == 0
    assert not [path for path in Path("parts").rglob(".*") if path.is_file()]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*STUDY, "--out", "out", "--shard", "-1/3"), "--shard is '-1/3'"),
        ((*STUDY, "--out", "out", "--shard", "1/3", "--against", "old"), "compared with nothing"),
        (("evaluate", "pushes", "--out", "out", "--faults", "--shard", "1/3"), "--shard cannot go with it"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(capsys, words, said):
    before = sorted(Path().iterdir())
    assert main.main([*words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and said in err
    assert sorted(Path().iterdir()) == before
