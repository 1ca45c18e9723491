"""`palpate train` from recordings to a model that says what torch says: one small training that all else hangs on."""

import dataclasses
import json
import shutil
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from training_samples import SENSOR, write_pushes

from palpate.cli import main
from palpate.errors import EstimationError
from palpate.files import held_folder, whole_file
from palpate.lab.train import export, features, heads, learn, results, train
from palpate.lab.train.export import restore, width_of
from palpate.lab.train.fit import FitSettings
from palpate.lab.train.learn import Keypoints, Touch
from palpate.lab.train.networks import WIDTH, PairNetwork
from palpate.touch.difference import COLUMNS, ROWS
from palpate.touch.model import KINDS, NETWORKS, TouchModel, session

MODELS = ["constant", "linear engineered", "nonlinear engineered", "linear learnt", "nonlinear learnt"]
MODELS += ["descriptor pair", "image turn"]
SHORT = FitSettings(steps=4, check=2)


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


@pytest.fixture(scope="module")
def small():
    """Descents, batches and judgements of a few; `spread` keeps all else as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "TrainSettings", partial(train.TrainSettings, keypoint=SHORT, touch=SHORT))
        for module, name, value in (
            (learn, "_GROUPS", 4),
            (learn, "_IMAGES", 16),
            (learn, "_HELD_OUT", 1),
            (heads, "_STEPS", 20),
            (features, "PAIRS", 4000),
            (results, "PAIRS", 4000),
        ):
            patch.setattr(module, name, value)
        yield


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    return write_pushes(tmp_path_factory.mktemp("recordings"))


@dataclasses.dataclass
class Trained:
    folder: Path
    code: int
    found: dict[str, Any]
    error: str


@pytest.fixture(scope="module")
def trained(small, recordings, tmp_path_factory) -> Trained:
    """A training by the command line."""
    folder = tmp_path_factory.mktemp("models") / "new" / "model"  # is made, with all above it
    with pytest.MonkeyPatch.context() as patch:
        said: dict[str, list[str]] = {"stdout": [], "stderr": []}
        for name in said:
            patch.setattr(getattr(sys, name), "write", lambda text, name=name: said[name].append(text) or len(text))
        code = palpate("train", recordings, "--out", folder, "--seed", "5", "--json")
    return Trained(folder, code, json.loads("".join(said["stdout"])), "".join(said["stderr"]))


@pytest.fixture(scope="module")
def model(trained) -> TouchModel:
    return TouchModel(trained.folder)


@pytest.fixture(scope="module")
def networks(model) -> tuple[Touch, Keypoints]:
    """The networks in torch, with the weights of the model's files."""
    torch.manual_seed(99)
    touch, keypoints = Touch(), Keypoints()
    restore(touch.image, model.networks["touch"])
    restore(touch.pair, model.networks["pair"])
    restore(keypoints.encoder, model.networks["keypoint"])
    return touch.eval(), keypoints.eval()


# --- what the command leaves and says ---


def test_what_the_command_says(trained, recordings):
    assert trained.code == 3  # one of several recordings was left out, which is said once
    assert trained.error == f"palpate: left out: {recordings / 'bare.mcap'}: has no image; learning needs them\n"
    found = trained.found
    assert found["model"] == str(trained.folder) and found["wall_s"] > 0.0
    # 12 contacts of 60 frames: 15 % of 12 are 2 to judge by, 10 % of 10 is 1 held out, the rest to learn from.
    assert found["frames"] == 120
    assert list(found["recordings"]["left_out"]) == [str(recordings / "bare.mcap")]
    table = found["mean_square_of_sine"]
    assert list(table) == MODELS
    kinds = list(found["pairs"])
    assert kinds[-1] == "combined" and set(kinds[:-1]) <= set(KINDS) and found["pairs"]["combined"] == 4000
    for errors in table.values():
        assert list(errors) == kinds
    # Constant errs by all that the sine is, its mean and its spread.
    assert found["sine"]["combined"] ** 2 < table["constant"]["combined"] < 1.0
    # Where the bright spot is tells the turn, and the ellipse fit needs no training to see that.
    assert table["linear engineered"]["combined"] < 0.05 * table["constant"]["combined"]
    assert list(found["honesty"]) == ["direction", "turn", "pair"]
    for values in found["honesty"].values():
        assert set(values) == {"coverage", "log_likelihood", "log_likelihood_constant", "rms_deg", "median_deg"}
        assert list(values["coverage"]) == ["0.68", "0.95"]


def test_what_the_command_leaves(trained):
    assert sorted(path.name for path in trained.folder.iterdir()) == sorted(
        ["model.json", "training", *(f"{name}.onnx" for name in NETWORKS)]
    )
    work = trained.folder / "training"
    logs = [f"{name}.{ending}" for name in ("keypoint", "touch") for ending in ("csv", "pt")]
    pictures = ["keypoints.png", "turns.png", "calibration.png"]
    assert sorted(path.name for path in work.iterdir()) == sorted([*logs, *pictures, "results.json"])
    assert (work / "touch.csv").read_text().splitlines()[0] == (
        "step,batch_direction,batch_turn,batch_pair,held_out_direction,held_out_turn,held_out_pair"
    )
    assert [row.split(",")[0] for row in (work / "keypoint.csv").read_text().splitlines()] == ["step", "2", "4"]
    for name in pictures:
        assert (work / name).read_bytes().startswith(b"\x89PNG")
    written = json.loads((work / "results.json").read_text())
    assert written == {key: value for key, value in trained.found.items() if key not in ("model", "wall_s")}


def test_settings_of_the_model(model):
    settings = model.settings
    assert (settings.sensor, settings.image_height, settings.image_width) == (SENSOR.name, 64, 128)
    assert set(settings.spread) == {"direction", "turn", "pair", "linear"}
    assert all(spread.scale > 0.0 and spread.together >= 1.0 for spread in settings.spread.values())
    assert np.shape(settings.linear) == (len(KINDS), 2)
    assert settings.training["seed"] == 5 and settings.training["touch"]["steps"] == 4
    assert settings.training["frames"] == 9 * 60 and settings.training["from"] == ""


def test_files_say_nothing_of_where_they_were_made(model):
    for name, file in model.networks.items():
        assert b"networks.py" not in file and b"site-packages" not in file, name
        assert not onnx.load_from_string(file).metadata_props


@pytest.mark.parametrize(
    ("name", "given", "told"),
    [
        ("touch", {"difference": [1, 3, ROWS, COLUMNS]}, {"direction": [1, 2], "turn": [1, 2], "descriptor": [1, 16]}),
        ("pair", {"earlier": ["pairs", 16], "later": ["pairs", 16]}, {"turned": ["pairs", 2]}),
        ("keypoint", {"difference": [1, 3, ROWS, COLUMNS]}, {"keypoint": [1, 2], "kinds": [1, len(KINDS)]}),
    ],
)
def test_files_take_and_tell_what_is_written(model, name, given, told):
    opened = session(model.networks[name])
    assert {each.name: each.shape for each in opened.get_inputs()} == given
    assert {each.name: each.shape for each in opened.get_outputs()} == told


# --- the model says what torch says ---


def images(count: int) -> list[Any]:
    return list(np.random.default_rng(0).normal(0.0, 0.5, (count, ROWS, COLUMNS, 3)).astype(np.float32))


def in_torch(difference: Any) -> torch.Tensor:
    return torch.from_numpy(difference).permute(2, 0, 1)[None]


def test_an_image_in_onnx_and_in_torch(model, networks):
    touch, keypoints = networks
    for difference in images(3):
        with torch.no_grad():
            direction, turn, descriptor = (part[0].numpy() for part in touch.image(in_torch(difference)))
            point, logits = keypoints.encoder(in_torch(difference))
        look = model.look(difference)
        np.testing.assert_allclose(look.direction, [direction[0], np.exp(direction[1])], rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(look.turn, [turn[0], np.exp(turn[1])], rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(look.descriptor, descriptor, atol=1e-4)
        found, kinds = model.keypoint(difference)
        np.testing.assert_allclose(found, point[0].numpy(), atol=1e-4)
        np.testing.assert_allclose(kinds, logits[0].softmax(dim=0).numpy(), atol=1e-4)
        assert kinds.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_pairs_in_onnx_and_in_torch(model, networks, count):
    rng = np.random.default_rng(1)
    earlier, later = rng.normal(size=(count, 16)).astype(np.float32), rng.normal(size=16).astype(np.float32)
    with torch.no_grad():
        told = networks[0].pair(torch.from_numpy(earlier), torch.from_numpy(later).expand(count, -1)).numpy()
    turn, variance = model.compare(earlier, later)
    assert turn.dtype == variance.dtype == np.float64 and turn.shape == variance.shape == (count,)
    np.testing.assert_allclose(turn, told[:, 0], atol=1e-4)
    np.testing.assert_allclose(variance, np.exp(told[:, 1]), rtol=1e-4)


def test_the_model_is_that_of_the_descent(trained, networks):
    for name, network in (("touch", networks[0]), ("keypoint", networks[1])):
        best = torch.load(trained.folder / "training" / f"{name}.pt", weights_only=True)["best_state"]
        for key, value in network.state_dict().items():
            if "decoder" not in key and not key.endswith("num_batches_tracked"):
                torch.testing.assert_close(value, best[key], rtol=0.0, atol=0.0)


def test_weights_that_do_not_fit(model):
    with pytest.raises(EstimationError, match=r"the model's network has no weights layers.0.weight \(64, 32\)"):
        restore(PairNetwork(), model.networks["touch"])


def test_a_network_goes_on_as_wide_as_it_is(model):
    written = model.networks["touch"]
    assert width_of(written) == width_of(model.networks["keypoint"]) == WIDTH
    wider = onnx.load_from_string(written)
    first = next(each for each in wider.graph.initializer if each.name == "encoder.layers.0.weight")
    first.CopyFrom(onnx.numpy_helper.from_array(np.zeros((WIDTH + 8, 3, 7, 7), np.float32), first.name))
    assert width_of(wider.SerializeToString()) == WIDTH + 8
    restore(Touch(width=WIDTH).image, written)
    with pytest.raises(EstimationError, match="has no weights encoder"):
        restore(Touch(width=WIDTH + 8).image, written)
    with pytest.raises(EstimationError, match="the model's network has no encoder to go on from"):
        width_of(model.networks["pair"])


def test_an_export_that_differs_is_an_error(model):
    network: Any = PairNetwork()
    restore(network, model.networks["pair"])
    inputs = {"earlier": torch.randn(3, 16), "later": torch.randn(3, 16)}
    export.check(network, inputs, model.networks["pair"])
    with torch.no_grad():
        network.layers[-1].bias += 0.001  # of the log variance; that of the mean cancels
    with pytest.raises(EstimationError, match=r"ONNX Runtime differs from torch by 0.001; 0.0001 is allowed"):
        export.check(network, inputs, model.networks["pair"])


# --- another run ---


@pytest.fixture
def no_export(monkeypatch, model) -> list[tuple[Keypoints, Touch]]:
    """Keeps networks instead of exporting them, which takes seconds and is tested above; the files are the model's.

    No figures either.
    """
    kept = []
    monkeypatch.setattr(train.figures, "training_figures", lambda *_: None)
    monkeypatch.setattr(train, "exported", lambda *networks: kept.append(networks) or model.networks)
    return kept


def test_fine_tuning_leaves_key_points_alone(trained, model, networks, no_export, recordings, tmp_path, capsys):
    some = tmp_path / "some"
    some.mkdir()
    for seed in range(4):
        shutil.copy(recordings / f"push-{seed}.mcap", some)
    words = ("train", some, "--from", trained.folder, "--out", tmp_path / "fine", "--test", recordings)
    assert palpate(*words, "--steps", 4) == 3  # of the recordings to judge by, one has no images
    out, error = capsys.readouterr()
    assert "mean square error of sin(yaw)" in out and f"model: {tmp_path / 'fine'}" in out
    assert error == f"palpate: left out: {recordings / 'bare.mcap'}: has no image; learning needs them\n"
    ((keypoints, touch),) = no_export
    for (key, value), before in zip(
        keypoints.encoder.state_dict().items(), networks[1].encoder.state_dict().values(), strict=True
    ):
        if not key.endswith("num_batches_tracked"):
            torch.testing.assert_close(value, before, rtol=0.0, atol=0.0)
    moved = [
        float((value - before).detach().abs().max())
        for value, before in zip(touch.parameters(), networks[0].parameters(), strict=True)
    ]
    assert 0.0 < max(moved) < 0.01  # a little: four steps from where it was
    settings = TouchModel(tmp_path / "fine").settings
    assert settings.spread["linear"] == model.settings.spread["linear"]  # of the key points, which stay
    assert settings.spread["turn"] != model.settings.spread["turn"]  # measured anew
    assert settings.training["from"] == str(trained.folder)
    assert settings.training["touch"] == dataclasses.asdict(dataclasses.replace(train.FINE, steps=4))
    assert not (tmp_path / "fine" / "training" / "keypoint.pt").exists()
    assert json.loads((tmp_path / "fine" / "training" / "results.json").read_text())["frames"] == 720


def test_a_training_that_was_cut_off_goes_on(trained, no_export, recordings, tmp_path, capsys, monkeypatch):
    out = tmp_path / "model"
    words = ("train", recordings, "--out", out, "--seed", "5", "--json")
    with monkeypatch.context() as patch:

        def cut_off(*_: Any) -> None:
            raise KeyboardInterrupt

        patch.setattr(train, "learn_touch", cut_off)
        assert palpate(*words) == 130
    capsys.readouterr()
    assert palpate(*words) == 2
    assert "holds a training that was cut off; --resume goes on with it" in capsys.readouterr().err
    begun = (out / "training" / "keypoint.pt").stat().st_mtime_ns
    assert palpate(*words, "--resume", "--steps", 5) == 2
    assert "keypoint.pt: was begun with steps 4, going on with steps 5 would mix the two" in capsys.readouterr().err
    assert palpate(*words, "--resume") == 3
    assert (out / "training" / "keypoint.pt").stat().st_mtime_ns == begun
    found = json.loads(capsys.readouterr().out)
    # The same seed, the same table, whether it was cut off or not.
    for name, errors in found["mean_square_of_sine"].items():
        assert errors == pytest.approx(trained.found["mean_square_of_sine"][name], rel=1e-5)


def test_a_training_that_was_cut_off_between_its_last_files_goes_on(
    trained, model, no_export, recordings, tmp_path, capsys, monkeypatch
):
    out = shutil.copytree(trained.folder, tmp_path / "model")
    (out / "model.json").unlink()  # the last file of all
    (out / "pair.onnx").unlink()
    (out / "training" / ".turns.png.part").write_bytes(b"half")
    with (out / "training" / "touch.csv").open("a") as log:
        log.write("6,1,1,1,1,1,1\n")  # of a look after the checkpoint
    begun = (out / "training" / "touch.pt").stat().st_mtime_ns

    def draws(*given: Any) -> None:
        assert not (out / "model.json").exists()
        with whole_file(given[-1] / "turns.png", overwrite=True) as part:
            part.write_bytes(b"whole")

    monkeypatch.setattr(train.figures, "training_figures", draws)
    words = ("train", recordings, "--out", out, "--seed", "5")
    with held_folder(out):
        assert palpate(*words, "--resume") == 2
        assert "model: another process is writing it" in capsys.readouterr().err
    assert palpate(*words, "--resume") == 3
    found = TouchModel(out).settings
    assert found.training == model.settings.training
    for name, spread in found.spread.items():
        assert spread.scale == pytest.approx(model.settings.spread[name].scale, rel=1e-5)
    assert (out / "training" / "touch.pt").stat().st_mtime_ns == begun
    for name in ("touch.csv", "keypoint.csv"):
        assert (out / "training" / name).read_bytes() == (trained.folder / "training" / name).read_bytes()
    assert not list(out.rglob(".*"))
