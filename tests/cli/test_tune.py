"""The command `palpate tune`, and its file in `palpate track`."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed, seen, unit_seen

from palpate.cli import main
from palpate.config import ContactSettings, NoiseSettings, read_noise, write_noise
from palpate.io.recording_mcap import write_recording
from palpate.lab.tune import tuning
from palpate.touch.calibration import DirectionCorrection, load_calibration, write_calibration

TUNED = ("contact.deviation", "relative_pose.oracle")
WORDS = ("tune", "all", "--out", "noise.json", "--tactile", "oracle", "--parameters", *TUNED)
DEVIATION_5_MM = NoiseSettings(contact=ContactSettings(deviation=5e-3))


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch, no_figures):
    """Every test works in a folder of its own, with five recordings in the folder `all`."""
    monkeypatch.chdir(tmp_path)
    Path("all").mkdir()
    for index in range(5):
        recording = pushed(30)
        bent = recording.sensor_pose + np.array([0.0, 1e-4 * index, 0.0])
        write_recording(replace(recording, sensor_pose=bent), f"all/push-{index}.mcap")


def palpate(*words: str) -> int:
    """The exit code of the command line."""
    try:
        return main.main(words)
    except SystemExit as stop:
        return int(stop.code or 0)


def failure(capsys: Any, *words: str) -> str:
    """The one line with which a command fails."""
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("palpate: ") and err.count("\n") == 1
    return err


def test_tune_leaves_a_file_that_track_takes(capsys):
    assert palpate(*WORDS, "--evaluations", "8", "--json") == 0
    out, err = capsys.readouterr()
    found, content = json.loads(out), json.loads(Path("noise.json").read_text())
    assert err == "" and found["left_out"] == [] and found["out"] == "noise.json" and found["wall_s"] > 0
    assert found["noise"] == content["noise"]
    tuned = content["tuned"]
    assert {key: found[key] for key in tuned} == tuned
    assert tuned["recordings"] == ["push-0.mcap", "push-1.mcap", "push-2.mcap", "push-4.mcap"]
    assert tuned["held_out"] == ["push-3.mcap"]
    assert (tuned["evaluations"], tuned["tactile"], tuned["smoother"]) == (8, "oracle", "fixed-lag")
    assert (tuned["start"], tuned["model"], tuned["calibration"]) == ("palpate", None, None)
    assert tuned["after"]["score"] < tuned["before"]["score"]
    assert set(tuned["held_out_after"]) == set(tuned["held_out_before"]) == set(tuned["before"])
    noise = read_noise("noise.json")
    before = NoiseSettings()
    contact = replace(before.contact, deviation=noise.contact.deviation)
    relative_pose = replace(before.relative_pose, oracle=noise.relative_pose.oracle)
    assert noise == replace(before, contact=contact, relative_pose=relative_pose) != before
    deviation, oracle = (tuned["parameters"][name] for name in TUNED)
    assert deviation == {"before": 1e-3, "after": contact.deviation}
    assert oracle == {"before": before.relative_pose.oracle[2], "after": relative_pose.oracle[2]}

    assert palpate("track", "all/push-0.mcap", "--noise", "noise.json", "--json") == 0
    settings = json.loads(Path("runs/push-0/settings.json").read_text())
    assert settings["noise"] == content["noise"] and settings["noise_preset"] is None


def test_tune_shows_what_it_found(capsys):
    assert palpate(*WORDS, "--evaluations", "2", "--smoother", "isam2") == 0
    out = capsys.readouterr().out
    assert all(word in out for word in (*TUNED, "tuned on", "held out", "oracle, isam2", "noise.json"))
    words = ("--tactile", "none", "--parameters", "pressure", "--evaluations", "2")
    assert palpate("tune", "all", "--out", "c.json", *words) == 0
    out = capsys.readouterr().out
    command = next(line for line in out.splitlines() if "--pressure" in line)
    assert (
        float(command.split()[-1]) == json.loads(Path("c.json").read_text())["tuned"]["parameters"]["pressure"]["after"]
    )


def test_a_tuning_knows_the_unit_that_all_recordings_are_of(capsys):
    Path("images").mkdir()
    touched = seen(replace(pushed(40), contact=np.ones(40, np.bool_)))  # taken for untouched without the unit
    for index in range(5):
        write_recording(touched, f"images/push-{index}.mcap")
    for name, unit in (("unit", unit_seen()), ("small", unit_seen(height=8, width=8))):
        write_calibration(unit, f"{name}.npz")
    words = ("tune", "images", "--out", "noise.json", "--tactile", "none", "--evaluations", "1", "--json")
    for calibration, said in (
        ((), "push-0.mcap: is never in contact where ground truth is known"),
        (("--calibration", "small.npz"), "small.npz: is of images of 8 x 8 px"),
        (("--calibration", "nowhere.npz"), "nowhere.npz: no such file"),
    ):
        assert said in failure(capsys, *words, *calibration)
    assert palpate(*words, "--calibration", "unit.npz") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["left_out"] == [] and found["calibration"] == load_calibration("unit.npz").hash
    assert json.loads(Path("noise.json").read_text())["tuned"]["calibration"] == found["calibration"]
    # What presses have measured is no longer open.
    pressed = replace(unit_seen(), direction=DirectionCorrection(0.01, 0.98, 0.005, 0.06))
    write_calibration(pressed, "pressed.npz")
    again = ("tune", "images", "--out", "other.json", *words[4:], "--calibration", "pressed.npz", "--parameters")
    for name in ("priors.direction_bias", "priors.direction_scale"):
        assert f"parameter {name!r} is measured in pressed.npz" in failure(capsys, *again, name)
    assert not Path("other.json").exists()
    assert palpate(*again, "direction.share") == 0


def test_tuning_goes_on_from_its_file(capsys):
    write_noise(DEVIATION_5_MM, "noise.json", {})
    said = failure(capsys, *WORDS)
    assert "noise.json: already exists" in said and "--start noise.json" in said
    assert read_noise("noise.json") == DEVIATION_5_MM
    assert palpate(*WORDS, "--start", "noise.json", "--evaluations", "2") == 0
    tuned = json.loads(Path("noise.json").read_text())["tuned"]
    assert tuned["start"] == "noise.json" and tuned["parameters"]["contact.deviation"]["before"] == 5e-3
    assert palpate(*WORDS[:3], "other.json", *WORDS[4:], "--start", "published", "--evaluations", "1") == 0
    assert json.loads(Path("other.json").read_text())["tuned"]["parameters"]["contact.deviation"]["before"] == 1e-2


def test_a_tuning_takes_one_worker_or_more(capsys):
    assert "workers is 0; allowed is 1 or more" in failure(capsys, *WORDS, "--workers", "0")


def test_an_interrupted_tuning_leaves_the_best_so_far(monkeypatch):
    judge, scores = tuning.judge, [3.0, 4.0, 2.0]

    def until_interrupted(*words: Any) -> Any:
        if not scores:
            raise KeyboardInterrupt
        return replace(judge(*words), score=scores.pop(0))

    monkeypatch.setattr(tuning, "judge", until_interrupted)
    assert palpate(*WORDS) == 130
    content = json.loads(Path("noise.json").read_text())
    tuned = content["tuned"]
    assert (tuned["evaluations"], tuned["before"]["score"], tuned["after"]["score"]) == (3, 3.0, 2.0)
    assert tuned["held_out_after"] is None
    assert content["noise"]["contact"]["deviation"] == tuned["parameters"]["contact.deviation"]["after"]
    assert asdict(read_noise("noise.json")) != asdict(NoiseSettings())


def test_recordings_that_are_of_no_use_are_named_and_the_others_used(capsys):
    Path("all/broken.mcap").write_text("no")
    write_recording(replace(pushed(), object_pose=None), "all/blind.mcap")
    assert palpate(*WORDS, "--evaluations", "1", "--json") == 3
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [left["file"] for left in found["left_out"]] == ["all/blind.mcap", "all/broken.mcap"]
    lines = err.splitlines()
    assert len(lines) == 2 and all(line.startswith("palpate: left out: all/b") for line in lines)
    assert "no ground truth" in lines[0]
    assert len(found["recordings"]) == 4 and found["held_out"] == ["push-3.mcap"]


def test_what_cannot_be_tuned(capsys):
    assert "nowhere: no such folder" in failure(capsys, "tune", "nowhere", *WORDS[2:])
    Path("empty").mkdir()
    assert "empty: holds no recordings" in failure(capsys, "tune", "empty", *WORDS[2:])
    said = failure(capsys, "tune", "all", "--out", "noise.json")
    assert "no recording can be tuned on; the first: all/push-0.mcap: has no images, which tactile learnt needs" in said
    assert "evaluations is 0; it must be at least 1" in failure(capsys, *WORDS, "--evaluations", "0")
    said = failure(capsys, *WORDS[:4], "--parameters", "magic")
    assert "'magic' cannot be tuned; allowed are" in said and "contact.kernel" in said
    said = failure(capsys, *WORDS, "--start", "magic")
    assert "noise is 'magic'; allowed are 'palpate', 'sticking', 'published'" in said
    assert "the folder away does not exist" in failure(capsys, *WORDS[:3], "away/noise.json")
    assert "already exists" in failure(capsys, *WORDS[:3], "all")
    assert "--model here is not used with --tactile oracle" in failure(capsys, *WORDS, "--model", "here")
    assert not Path("noise.json").exists()
