"""The script that converts recordings of earlier versions."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate

SCRIPT = Path(__file__).parents[1] / "scripts" / "convert_h5.py"


def test_an_earlier_recording_becomes_mcap(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(tmp_path / "push.h5", "w") as file:
        file.attrs.update(source="a test", contact_derived=False, frames=json.dumps({"sensor_pose": "robot"}))
        file.attrs["shape"] = json.dumps({"type": "disc", "radius": 0.05})
        file.attrs["sensor"] = json.dumps({"name": "DIGIT", "radius": 0.021, "image_height": 320, "image_width": 240})
        file["time"], file["sensor_pose"], file["extra/force"] = np.arange(3) / 30, np.ones((3, 3)), np.arange(3.0)
        images = file.create_dataset("image", (3,), h5py.vlen_dtype(np.uint8))
        images.attrs["codec"] = "png"
        for index in range(3):
            images[index] = np.arange(index + 4, dtype=np.uint8)
    subprocess.run([sys.executable, SCRIPT, tmp_path / "push.h5"], check=True)
    found = palpate.load_recording(tmp_path / "push.mcap")
    assert (found.shape, found.source, found.codec) == (palpate.Disc(0.05), "a test", "png")
    assert found.image == (bytes(range(4)), bytes(range(5)), bytes(range(6)))
    assert found.extra["force"].tolist() == [0.0, 1.0, 2.0]
