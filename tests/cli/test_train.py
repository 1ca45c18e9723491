"""`palpate train` on a few seconds of recordings and presses: models that track, and input too poor to learn from."""

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recording_samples import pushed
from training_samples import DISC, SENSOR, image, pushes, write_pushes

import palpate

pytest.importorskip("torch", reason="torch is not installed: pip install 'palpate-lab[train]'")
pytest.importorskip("onnxscript", reason="onnxscript is not installed: pip install 'palpate-lab[train]'")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    return write_pushes(tmp_path_factory.mktemp("recordings"))


@pytest.fixture(scope="module")
def trained(recordings, tmp_path_factory, command) -> Path:
    """A model after four steps."""
    folder = tmp_path_factory.mktemp("models") / "new" / "model"
    assert command("train", recordings, "--out", folder, "--seed", "5", "--steps", "4") == 3
    return folder


def results(folder: Path) -> Any:
    return json.loads((folder / "training/results.json").read_text())


def test_a_model_is_judged_and_tracks(trained, recordings, run_palpate):
    found = results(trained)
    assert list(found["recordings"]["left_out"]) == [str(recordings / "bare.mcap")]
    assert found["frames"] == 120  # 15 % of 12 contacts of 60 frames
    assert list(found["scores"]) == ["direction", "turn"]
    assert set(found["scores"]["turn"]) >= {"coverage", "rms_deg", "median_deg"}
    assert {path.name for path in trained.iterdir()} == {"model.json", "training", "touch.onnx"}
    settings = palpate.TouchModel(trained).settings
    assert (settings.sensor, settings.image_height, settings.image_width) == (SENSOR.name, 64, 128)
    assert settings.training["seed"] == 5 and settings.training["frames"] == 9 * 60
    words = ("--tactile", "learnt", "--model", trained, "--out", trained.parent / "run")
    assert run_palpate("track", recordings / "push-0.mcap", *words)[0] == 0


def test_fine_tuning_starts_from_a_model(trained, recordings, tmp_path, run_palpate):
    out = tmp_path / "fine"
    words = ("--from", trained, "--out", out, "--test", recordings, "--steps", "1", "--json")
    code, said, err = run_palpate("train", recordings, *words)
    assert code == 3 and "left out: " in err and json.loads(said)["scores"] == results(out)["scores"]
    assert results(out)["frames"] == 720
    seen = np.random.default_rng(0).normal(0.0, 0.5, (32, 128, 3)).astype(np.float32)
    before, after = (palpate.TouchModel(folder).read(seen)["direction"] for folder in (trained, out))
    assert before != after and before == pytest.approx(after, abs=0.1)


def test_an_interrupted_training_continues(trained, recordings, tmp_path, run_palpate, fails):
    out = shutil.copytree(trained, tmp_path / "model")
    assert "holds a model already" in fails("train", recordings, "--out", out, "--resume")
    (out / "model.json").unlink()  # the last file of all
    assert "--resume continues it" in fails("train", recordings, "--out", out)
    begun = (out / "training" / "touch.pt").stat().st_mtime_ns
    assert run_palpate("train", recordings, "--out", out, "--seed", "5", "--steps", "4", "--resume")[0] == 3
    assert (out / "training" / "touch.pt").stat().st_mtime_ns == begun
    assert results(out)["scores"] == results(trained)["scores"]


def test_folders_that_cannot_be_learned_from(recordings, tmp_path, fails):
    out = tmp_path / "model"
    assert "nowhere: no such folder of recordings" in fails("train", "nowhere", "--out", out)
    assert "steps is 0; allowed is 1 or more" in fails("train", recordings, "--out", out, "--steps", 0)
    assert "holds no recordings" in fails("train", tmp_path, "--out", out)
    few, other, bare = (tmp_path / name for name in ("few", "other", "bare"))
    for folder in (few, other, bare):
        folder.mkdir()
    palpate.write_recording(pushes(DISC, 1), few / "push.mcap")
    assert "too little to learn from: 60 frames of 1 contacts" in fails("train", few, "--out", out)
    palpate.write_recording(pushed(), bare / "push.mcap")
    assert "has no image; learning needs them" in fails("train", bare, "--out", out)
    sensor = dataclasses.replace(SENSOR, name="other")
    palpate.write_recording(dataclasses.replace(pushes(DISC, 1), sensor=sensor), other / "push.mcap")
    assert "sensor 'other' is not the 'small' of" in fails("train", recordings, "--out", out, "--test", other)
    assert "no recording can be judged by; the first: " in fails("train", recordings, "--out", out, "--test", bare)
    said = fails("train", recordings, "--out", out, "--from", "digit")
    assert "digit: sensor 'small' has images of 64 x 128 px, and the touch model is of 'DIGIT'" in said


@pytest.mark.parametrize("command", ["train", "tune", "evaluate"])
def test_images_of_a_folder_are_turned(command, recordings, tmp_path, run_palpate):
    (tmp_path / "in").mkdir()
    shutil.copy(recordings / "push-0.mcap", tmp_path / "in")
    code, _, err = run_palpate(command, tmp_path / "in", "--out", tmp_path / "out.json", "--orientation", "90")
    assert code and "they lie upright before they are turned" in err


def test_a_model_of_directions_from_grey_presses(tmp_path, run_palpate, fails):
    angles = np.random.default_rng(0).uniform(-0.7, 0.7, 60)
    for k, place in enumerate([*(angles / 0.7), None]):
        colours = np.frombuffer(image(place, k), np.uint8)
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.asarray(cv2.imdecode(colours, cv2.IMREAD_GRAYSCALE)))
    table = tmp_path / "presses.csv"
    table.write_text("\n".join(["file,angle_deg", *(f"{k}.png,{np.degrees(a)}" for k, a in enumerate(angles))]))
    given = ["train", table, "--untouched", tmp_path / "60.png", "--out", tmp_path / "model", "--steps", "2"]
    assert "presses (.csv) need --sensor" in fails(*given)
    given += ["--sensor", "dome"]
    assert "presses (.csv) take no" in fails(*given, "--calibration", "no.npz")
    code, out, _ = run_palpate(*given, "--json")
    assert code == 0 and json.loads(out)["held_out"] == 9
    settings = palpate.TouchModel(tmp_path / "model").settings
    assert settings.sensor == "dome" and list(settings.spread) == ["direction"]
    few = tmp_path / "few.csv"
    few.write_text("\n".join(table.read_text().splitlines()[:11]))
    assert "found 10 presses; at least 50" in fails("train", few, *given[2:5], tmp_path / "few", *given[-2:])
