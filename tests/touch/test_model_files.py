"""Damaged model files are refused in one sentence."""

import json

import numpy as np
import pytest

from palpate import FileError, TouchModel
from palpate.touch.touch_model import NETWORK, SHIPPED, SHIPPED_OF, fingerprint


@pytest.fixture
def model(tmp_path):
    """Return a function that writes the shipped model with changes and a right hash."""

    def change(network: bytes | None = None, **settings: object):
        network = (SHIPPED / NETWORK).read_bytes() if network is None else network
        written = json.loads((SHIPPED / "model.json").read_text())
        written["settings"] |= settings
        written["hash"] = fingerprint(written["settings"], network)
        (tmp_path / "model.json").write_text(json.dumps(written))
        (tmp_path / NETWORK).write_bytes(network)
        return tmp_path

    return change


@pytest.mark.parametrize(
    "settings",
    [
        {"spread": []},
        {"spread": {"turn": {"scale": 1.0, "together": 1.0}}},
        {"spread": {name: {"scale": "x", "together": 1.0} for name in ("direction", "turn")}},
        {"image_height": None},
        {"sensor": 3},
        {"more": 1},
    ],
)
def test_settings_with_a_right_hash_are_checked(model, settings):
    with pytest.raises(FileError, match=r"model\.json: settings do not fit this version"):
        TouchModel(model(**settings))


@pytest.mark.parametrize("network", [b"\x08\x07garbage", b"", (SHIPPED_OF["GelSight Mini"] / NETWORK).read_bytes()])
def test_another_network_is_refused(model, network):
    with pytest.raises(FileError, match=r"touch\.onnx: (is no network|is empty)"):
        TouchModel(model(network)).read(np.zeros((32, 128, 3), np.float32))


def test_a_network_that_keeps_its_numbers_elsewhere_is_refused(model, tmp_path):
    onnx = pytest.importorskip("onnx")
    network = onnx.load_from_string((SHIPPED / NETWORK).read_bytes())
    onnx.external_data_helper.convert_model_to_external_data(network, location="other.bin", size_threshold=0)
    onnx.save(network, str(tmp_path / "elsewhere.onnx"))
    with pytest.raises(FileError, match=r"touch\.onnx: keeps its numbers in another file"):
        TouchModel(model((tmp_path / "elsewhere.onnx").read_bytes()))
