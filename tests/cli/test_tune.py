"""`palpate tune`, and its file in `palpate track`."""

import importlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import BLIND, pushed

import palpate

WORDS = ("all", "--out", "noise.json", "--tactile", "none")


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch, no_figures):
    """Work in a folder with five recordings in `all`."""
    monkeypatch.chdir(tmp_path)
    Path("all").mkdir()
    for index in range(5):
        recording = pushed(30)
        bent = recording.sensor_pose + np.array([0.0, 1e-4 * index, 0.0])
        palpate.write_recording(replace(recording, sensor_pose=bent), f"all/push-{index}.mcap")


@pytest.fixture
def tune(run_palpate):
    return lambda *words: run_palpate("tune", *words)


def content(file: str = "noise.json") -> Any:
    return json.loads(Path(file).read_text(encoding="utf-8"))


def test_a_tuning_writes_a_file_that_track_takes(tune, run_palpate):
    code, out, err = tune(*WORDS, "--evaluations", "8", "--json")
    found, tuned = json.loads(out), content()["tuned"]
    assert (code, err, found["left_out"]) == (0, "", {})
    assert {key: found[key] for key in tuned} == tuned
    assert tuned["recordings"] == ["push-0.mcap", "push-1.mcap", "push-2.mcap", "push-4.mcap"]
    assert tuned["held_out"] == ["push-3.mcap"] and tuned["evaluations"] == 8
    assert tuned["after"]["nats"] > tuned["before"]["nats"]
    assert set(tuned["held_out_after"]) == set(tuned["before"])
    # Nothing but the parameters has changed.
    before = palpate.NoiseSettings()
    assert tuned["parameters"]["sticking.share"]["before"] == before.sticking.share
    changed = {
        f"{group}.{name}"
        for group, settings in content()["noise"].items()
        for name, value in settings.items()
        if np.any(np.not_equal(value, getattr(getattr(before, group), name)))
    }
    assert changed <= set(tuned["parameters"]) and changed
    assert run_palpate("track", "all/push-0.mcap", "--noise", "noise.json")[0] == 0
    settings = json.loads(Path("runs/push-0/settings.json").read_text())
    assert settings["noise"] == content()["noise"]


def test_a_tuning_is_continued_from_its_file(tune, fails):
    assert tune(*WORDS, "--evaluations", "1")[0] == 0
    assert "already exists; name another file, or continue it with --start noise.json" in fails("tune", *WORDS)
    assert tune(*WORDS, "--start", "noise.json", "--evaluations", "2")[0] == 0
    assert content()["tuned"]["start"] == "noise.json"
    Path("start.json").write_text(json.dumps(content() | {"noise": {"sticking": {"share": 0.1}}}))
    assert tune(*WORDS[:2], "other.json", *WORDS[3:], "--start", "start.json", "--evaluations", "1")[0] == 0
    assert content("other.json")["tuned"]["parameters"]["sticking.share"]["before"] == 0.1


def test_recordings_that_cannot_be_used_are_named_and_the_others_used(tune):
    Path("all/broken.mcap").write_text("no")
    palpate.write_recording(replace(pushed(), **BLIND), "all/blind.mcap")
    palpate.write_recording(replace(pushed(), contact=np.zeros(40, np.bool_)), "all/apart.mcap")
    code, out, err = tune(*WORDS, "--evaluations", "1", "--json")
    left_out = json.loads(out)["left_out"]
    assert code == 3 and list(left_out) == ["apart.mcap", "blind.mcap", "broken.mcap"]
    assert "never in contact" in left_out["apart.mcap"] and "no ground truth" in left_out["blind.mcap"]
    assert all(line.startswith("palpate: left out: all/") for line in err.splitlines())
    assert len(json.loads(out)["recordings"]) == 4


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("nowhere", *WORDS[1:]), "nowhere: no such folder"),
        (("all", "--out", "noise.json"), "the first: all/push-0.mcap: has no images, which tactile learnt needs"),
        ((*WORDS, "--evaluations", "0"), "evaluations is 0; it must be at least 1"),
        ((*WORDS[:2], "away/noise.json"), "the folder away does not exist"),
    ],
)
def test_bad_input_is_one_line(fails, words, sentence):
    assert sentence in fails("tune", *words)
    assert not Path("noise.json").exists()


def test_an_interrupted_tuning_leaves_the_best_settings_so_far(tune, monkeypatch):
    judged: list[Any] = []
    judge = importlib.import_module("palpate_lab.tune.tuning").judge

    def until_interrupted(*words: Any) -> Any:
        if len(judged) == 4:  # one of those held out
            raise KeyboardInterrupt
        judged.append(judge(*words))
        return judged[-1]

    monkeypatch.setattr("palpate_lab.tune.tuning.judge", until_interrupted)
    assert tune(*WORDS)[0] == 130
    tuned = content()["tuned"]
    assert tuned["evaluations"] == 3 and tuned["held_out_after"] is None
    assert tuned["after"]["nats"] == max(each.nats for each in judged if each.recordings == 4)
