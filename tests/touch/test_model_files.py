"""Damaged model files are refused in one sentence."""

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import FileError
from palpate.touch.model import NETWORKS, SHIPPED, TouchModel, fingerprint


@pytest.fixture
def model(tmp_path):
    """The shipped model, and a way to change it whose hash is right."""

    def change(name="", network=b"", **settings):
        networks = {each: (SHIPPED / f"{each}.onnx").read_bytes() for each in NETWORKS}
        if name:
            networks[name] = network
        said = json.loads((SHIPPED / "model.json").read_text())
        said["settings"] |= settings
        said["hash"] = fingerprint(said["settings"], networks)
        (tmp_path / "model.json").write_text(json.dumps(said))
        for each, data in networks.items():
            (tmp_path / f"{each}.onnx").write_bytes(data)
        return tmp_path

    return change


@pytest.mark.parametrize(
    "settings",
    [
        {"spread": []},
        {"spread": {"turn": {"scale": 1.0, "together": 1.0}}},
        {"spread": {name: {"scale": "x", "together": 1.0} for name in ("direction", "turn", "pair", "linear")}},
        {"image_height": None},
        {"linear": [[1.0, 2.0]]},
        {"linear": [[1.0]] * 5},
        {"linear": "words"},
        {"sensor": 3},
        {"more": 1},
    ],
)
def test_settings_of_a_model_with_a_right_hash_are_checked(model, settings):
    with pytest.raises(FileError, match=r"model\.json: settings do not fit this version"):
        TouchModel(model(**settings))


@pytest.mark.parametrize("network", [b"\x08\x07garbage", b"", (SHIPPED / "keypoint.onnx").read_bytes()])
def test_a_network_that_is_none_is_one_sentence(model, network):
    with pytest.raises(FileError, match=r"pair\.onnx: (is no network|is empty|takes and gives)"):
        TouchModel(model("pair", network)).compare(np.zeros((2, 16), np.float32), np.zeros(16, np.float32))


def test_a_network_that_keeps_its_numbers_elsewhere_is_refused(model, tmp_path):
    import onnx

    network = onnx.load_from_string((SHIPPED / "pair.onnx").read_bytes())
    secret = tmp_path / "secret.bin"
    onnx.save_model(network, tmp_path / "a.onnx", save_as_external_data=True, location=secret.name, size_threshold=0)
    assert Path(secret).stat().st_size > 0
    with pytest.raises(FileError, match=r"pair\.onnx: keeps its numbers in another file, which is not opened"):
        TouchModel(model("pair", (tmp_path / "a.onnx").read_bytes()))
