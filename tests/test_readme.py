"""What the README says to do first, done: from its first section on use to the end of that on own data."""

import re
import shlex
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate

README = Path(__file__).resolve().parents[1] / "README.md"
BLOCK = re.compile(r"^```python\n(.*?)^```$|((?:^ {4}[^\n]*\n)+)", re.MULTILINE | re.DOTALL)
"""Python between fences, or shell that stands indented."""


def prepare(text: str) -> None:
    """Put there what a step takes: a recording `push.mcap`, or arrays; a recording that it writes must not be there."""
    recorded = sorted(Path("recordings").glob("*.mcap"))
    if 'load_recording("push.mcap")' in text:
        Path("push.mcap").write_bytes(recorded[0].read_bytes())
    if "from_arrays" in text:
        Path("push.mcap").unlink(missing_ok=True)
        recording = palpate.load_recording(recorded[0])
        images = np.stack([frame.image for frame in recording if frame.image is not None])
        arrays = {"image_time": recording.time, "images": images, "poses": recording.sensor_pose}
        for name, array in (arrays | {"pose_time": recording.time}).items():
            np.save(f"{name}.npy", array)


def run(line: str, command: Callable[..., Any]) -> None:
    """Run a line of shell in this process, as a simulation of three seconds; lines that install are left out."""
    if not line.strip() or line.startswith(("make ", "python -m pip ", "pip ")):
        return
    name, *words = shlex.split(line.replace("palpate simulate ", "palpate simulate --seconds 3 "), comments=True)
    assert name == "palpate"
    files = [sorted(map(str, Path().glob(word))) if "*" in word else [word] for word in words]
    assert command(*chain.from_iterable(files)) == 0


def test_what_the_readme_says_up_to_the_first_picture_of_ones_own_data(tmp_path, monkeypatch, command):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    monkeypatch.chdir(tmp_path)
    text = README.read_text(encoding="utf-8")
    begin, last = text.index("\n## Install\n"), text.index("\n## Your own data\n")
    blocks = list(BLOCK.finditer(text[begin : text.find("\n## ", last + 1)]))
    assert len(blocks) > 3 and {bool(block[1]) for block in blocks} == {True, False}
    for block in blocks:
        prepare(block[0])
        if block[1]:
            exec(compile(block[1], "README.md", "exec"), {})
        for line in (block[2] or "").splitlines():
            run(line.strip(), command)
    assert (tmp_path / "runs" / "push" / "figure.png").read_bytes().startswith(b"\x89PNG")
