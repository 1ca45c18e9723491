"""`palpate train` from recordings and from presses to a model that gives the network's outputs."""

import dataclasses
import json
import shutil
import sys
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
import torch
from pin_samples import draw_dome, press
from scipy.stats import norm
from training_samples import DISC, SENSOR, model_settings, pushes, samples, write_pushes

from palpate.cli import main
from palpate.errors import EstimationError
from palpate.io.recording_mcap import write_recording
from palpate.lab.train import train
from palpate.lab.train.export import restore, width_of
from palpate.lab.train.fit import FitSettings
from palpate.lab.train.networks import WIDTH, TouchNetwork
from palpate.lab.train.scores import coverage, measure_spread, spread_of, turn_errors
from palpate.lab.train.train import TrainSettings, split
from palpate.touch.touch_model import COLUMNS, OUTPUTS, ROWS, TouchModel, difference, reduced, write_model

SHORT = FitSettings(steps=4, check=2)
COUNT = 60_000
EPISODE = np.repeat(np.arange(COUNT // 300), 300)


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


def failure(capsys: Any, *words: Any) -> str:
    assert palpate(*words) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1
    return error


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    return write_pushes(tmp_path_factory.mktemp("recordings"))


@pytest.fixture(scope="module")
def trained(recordings, tmp_path_factory) -> Any:
    """A training by the command: its folder, results and exit code."""
    folder = tmp_path_factory.mktemp("models") / "new" / "model"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "TrainSettings", partial(train.TrainSettings, touch=SHORT, fine=SHORT, groups=(4, 8)))
        written: list[str] = []
        patch.setattr(sys.stdout, "write", lambda text: written.append(text) or len(text))
        code = palpate("train", recordings, "--out", folder, "--seed", "5", "--json")
    return folder, json.loads("".join(written)), code


def test_results_of_the_command(trained, recordings):
    folder, found, code = trained
    assert code == 3 and list(found["recordings"]["left_out"]) == [str(recordings / "bare.mcap")]
    assert found["model"] == str(folder) and found["frames"] == 120  # 15 % of 12 contacts of 60 frames
    assert list(found["scores"]) == ["direction", "turn"]
    assert set(found["scores"]["turn"]) >= {"coverage", "log_likelihood", "rms_deg", "median_deg"}
    assert {path.name for path in folder.iterdir()} == {"model.json", "training", "touch.onnx"}
    work = {path.name for path in (folder / "training").iterdir()}
    assert work == {"touch.csv", "touch.pt", "results.json", "calibration.png"}
    settings = TouchModel(folder).settings
    assert (settings.sensor, settings.image_height, settings.image_width) == (SENSOR.name, 64, 128)
    assert settings.training["seed"] == 5 and settings.training["frames"] == 9 * 60
    network = TouchModel(folder).network
    assert b"networks.py" not in network and b"site-packages" not in network


def test_the_file_gives_the_network_s_outputs(trained):
    model = TouchModel(trained[0])
    network = TouchNetwork(OUTPUTS[0]).eval()
    restore(network, model.network)
    seen = np.random.default_rng(0).normal(0.0, 0.5, (ROWS, COLUMNS, 3)).astype(np.float32)
    with torch.no_grad():
        direction, turn = (each[0].numpy() for each in network(torch.from_numpy(seen).permute(2, 0, 1)[None]))
    look = model.read(seen)
    np.testing.assert_allclose(look.direction, [direction[0], np.exp(direction[1])], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(look.turn, [turn[0], np.exp(turn[1])], rtol=1e-4, atol=1e-4)  # type: ignore[arg-type]


def test_a_wider_network_continues_as_wide_as_it_is(trained):
    written = TouchModel(trained[0]).network
    wider = onnx.load_from_string(written)
    first = next(each for each in wider.graph.initializer if each.name == "encoder.layers.0.weight")
    first.CopyFrom(onnx.numpy_helper.from_array(np.zeros((WIDTH + 8, 3, 7, 7), np.float32), first.name))
    assert (width_of(written), width_of(wider.SerializeToString())) == (WIDTH, WIDTH + 8)
    with pytest.raises(EstimationError, match="has no weights encoder"):
        restore(TouchNetwork(OUTPUTS[0], WIDTH + 8), written)


def test_fine_tuning_starts_from_a_model(trained, recordings, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(train, "exported", lambda network: kept.append(network) or b"network")
    kept: list[TouchNetwork] = []
    out = tmp_path / "fine"
    assert palpate("train", recordings, "--from", trained[0], "--out", out, "--test", recordings, "--steps", 4) == 3
    assert "accuracy and calibration" in capsys.readouterr().out
    before = TouchNetwork(OUTPUTS[0])
    restore(before, TouchModel(trained[0]).network)
    moved = [
        float((a - b).detach().abs().max()) for a, b in zip(kept[0].parameters(), before.parameters(), strict=True)
    ]
    assert 0.0 < max(moved) < 0.01
    assert json.loads((out / "training" / "results.json").read_text())["frames"] == 720


def test_an_interrupted_training_continues(trained, recordings, tmp_path, capsys, monkeypatch):
    out = shutil.copytree(trained[0], tmp_path / "model")
    assert "holds a model already" in failure(capsys, "train", recordings, "--out", out, "--resume")
    (out / "model.json").unlink()  # the last file of all
    assert "--resume continues it" in failure(capsys, "train", recordings, "--out", out)
    monkeypatch.setattr(train, "TrainSettings", partial(train.TrainSettings, touch=SHORT, groups=(4, 8)))
    monkeypatch.setattr(train, "exported", lambda _: b"network")
    begun = (out / "training" / "touch.pt").stat().st_mtime_ns
    assert palpate("train", recordings, "--out", out, "--seed", "5", "--resume", "--json") == 3
    assert (out / "training" / "touch.pt").stat().st_mtime_ns == begun
    assert json.loads(capsys.readouterr().out)["scores"] == trained[1]["scores"]


def test_folders_that_cannot_be_learned_from(recordings, tmp_path, capsys):
    out = tmp_path / "model"
    assert "nowhere: no such folder of recordings" in failure(capsys, "train", "nowhere", "--out", out)
    assert "steps is 0; allowed is 1 or more" in failure(capsys, "train", recordings, "--out", out, "--steps", 0)
    assert "holds no recordings" in failure(capsys, "train", tmp_path, "--out", out)
    write_recording(pushes(DISC, 1), tmp_path / "few.mcap")
    assert "too little to learn from: 60 frames of 1 contacts" in failure(capsys, "train", tmp_path, "--out", out)
    other = tmp_path / "other"
    other.mkdir()
    sensor = dataclasses.replace(SENSOR, name="other")
    write_recording(dataclasses.replace(pushes(DISC, 1), sensor=sensor), other / "push.mcap")
    said = failure(capsys, "train", recordings, "--out", out, "--test", other)
    assert "recordings to judge by: sensor 'other' with images of 64 x 128 px is not that" in said
    write_model(other, model_settings(sensor="DIGIT", image_height=320), b"1")
    said = failure(capsys, "train", recordings, "--out", out, "--from", other)
    assert "sensor 'DIGIT' with images of 320 x 128 px is not that of the recordings" in said


@pytest.mark.parametrize("name", ["torch", "onnxscript"])
def test_missing_extras_are_named(name, recordings, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    said = failure(capsys, "train", recordings, "--out", "model")
    assert f"training needs {name}, which is not installed: pip install palpate[train]" in said


def test_a_model_of_directions_from_grey_presses(tmp_path, capsys):
    rng = np.random.default_rng(0)
    dome, angles = draw_dome(0), rng.uniform(-0.7, 0.7, 60)
    still, images = press(dome, None, rng), [press(dome, angle, rng) for angle in angles]
    for k, image in enumerate([*images, still]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image[..., 0])
    table = tmp_path / "presses.csv"
    table.write_text("\n".join(["file,angle_deg", *(f"{k}.png,{np.degrees(a)}" for k, a in enumerate(angles))]))
    given = ["train", table, "--untouched", tmp_path / "60.png", "--out", tmp_path / "model", "--steps", "2"]
    assert "presses take --untouched and --sensor" in failure(capsys, *given)
    given += ["--sensor", "pin dome"]
    assert "are of no use with presses" in failure(capsys, *given, "--calibration", "no.npz")
    assert palpate(*given) == 0
    assert "held out" in capsys.readouterr().out
    model = TouchModel(tmp_path / "model")
    assert model.settings.sensor == "pin dome" and list(model.settings.spread) == ["direction"]
    look = model.read(difference(images[0], reduced(still)))
    assert look.turn is look.place is None and look.direction[1] > 0.0
    few = tmp_path / "few.csv"
    few.write_text("\n".join(table.read_text().splitlines()[:11]))
    assert "found 10 presses; at least 50" in failure(capsys, "train", few, *given[2:5], tmp_path / "few", *given[-2:])


@pytest.mark.parametrize(
    ("recordings_of", "held"), [(np.repeat(np.arange(20), 3), 3), (np.repeat(np.arange(5), 12), 9)]
)
def test_recordings_or_contacts_are_held_out_whole(recordings_of, held):
    given = samples([15] * 60, recordings=recordings_of)
    kept, out = split(given, 0.15, np.random.default_rng(0), TrainSettings())
    by = "recording" if len(set(recordings_of)) >= 10 else "episode"
    assert not set(getattr(kept, by)) & set(getattr(out, by)) and len(set(getattr(out, by))) == held
    both = np.concatenate([part.difference[:, 0, 0, 0] for part in (kept, out)])
    np.testing.assert_array_equal(np.sort(both), np.arange(len(given)))


@pytest.mark.parametrize("told", [1.0, 0.25])
def test_white_noise_is_calibrated(told):
    rng = np.random.default_rng(0)
    variance = rng.uniform(0.1, 3.0, COUNT)
    found = spread_of(rng.normal(0.0, np.sqrt(variance)), told * variance, EPISODE)
    assert found.scale == pytest.approx(1.0 / told, rel=0.03) and found.together == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("r", [0.3, 0.5])
def test_correlated_errors_count_for_less(r):
    # x_t = r x_t-1 + w has correlations r^k, whose sum over all k is (1 + r) / (1 - r); here anew in each contact.
    error = np.random.default_rng(1).normal(size=(COUNT // 300, 300))
    error[:, 1:] *= np.sqrt(1.0 - r**2)
    for t in range(1, 300):
        error[:, t] += r * error[:, t - 1]
    found = spread_of(error.ravel(), np.ones(COUNT), EPISODE)
    assert found.scale == pytest.approx(1.0, abs=0.05)
    assert found.together == pytest.approx((1.0 + r) / (1.0 - r), rel=0.1)


def test_no_variance_is_reduced():
    error, one = np.random.default_rng(0).normal(size=COUNT), np.ones(COUNT)
    found = measure_spread({"direction": (0.5 * error, one), "turn": (2.0 * error, one)}, EPISODE)
    assert found["direction"].scale == 1.0 and found["turn"].scale == pytest.approx(4.0, rel=0.05)


def test_coverage_of_a_gaussian():
    error = norm.ppf((np.arange(10_000) + 0.5) / 10_000)
    assert coverage(3.0 * error, np.full(10_000, 9.0)) == pytest.approx({0.68: 0.68, 0.95: 0.95}, abs=2e-4)


def test_turns_have_no_offset():
    given = dataclasses.replace(samples([2, 2]), yaw=np.zeros(4))
    # (1 / 1 + 4 / 0.5) / (1 / 1 + 1 / 0.5) = 3; of the other contact, past half a turn, (3 + 2 pi - 3) / 2.
    found = turn_errors(np.array([1.0, 2.5, 3.0, -3.0]), np.array([1.0, 0.5, 2.0, 2.0]), given)
    half = np.pi - 3.0
    np.testing.assert_allclose(found, [1.0 - 2.0, 2.5 - 2.0, -half, half])
