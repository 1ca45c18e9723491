"""`palpate info` and `palpate convert` on recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_samples import TINY_CAMERA, pushed, tiny_recording

import palpate

pytestmark = pytest.mark.usefixtures("folder")


def test_info_shows_the_contents_of_a_recording(succeeds, json_of):
    out = succeeds("info", "push.mcap")
    assert "type rectangle, size_x 0.2, size_y 0.1" in out and "findings none" in " ".join(out.split())
    found = json_of("info", "push.mcap")
    assert (found["format"], found["frames"]) == ("palpate", 40)
    assert found["shape"] == {"type": "rectangle", "size_x": 0.2, "size_y": 0.1}
    assert [contact["start_s"] for contact in found["contacts"]] == pytest.approx([5 / 30, 32 / 30])


def test_info_shows_the_innovations_of_a_run(succeeds, json_of):
    succeeds("track", "push.mcap", "--out", "run")
    scores = json_of("info", "run")["innovations"]
    assert set(scores) >= {"contact", "sensor_pose", "sticking", "balance"} and scores["contact"]["count"] > 0
    assert any(line.startswith("contact ") for line in succeeds("info", "run", "--all").splitlines())


def test_info_counts_findings_that_repeat_and_begins_time_at_the_first_frame(succeeds):
    push = pushed()
    palpate.write_recording(replace(push, time=push.time + 1.7e9), "later.mcap")
    lines = [" ".join(line.split()) for line in succeeds("info", "later.mcap").splitlines()]
    assert "0 0.167 0.633" in lines  # the first contact, in frames 5 to 19
    palpate.write_recording(replace(pushed(), sensor=TINY_CAMERA, image=(b"no image",) * 40), "damaged.mcap")
    out = succeeds("info", "damaged.mcap")
    assert out.count("do not decode") == 20 and "the first 20 of 4" in out and "image of frame 0" in out


@pytest.mark.parametrize("command", ["track", "info"])
def test_bad_files_are_one_line(fails, command):
    whole = Path("push.mcap").read_bytes()
    Path("truncated.mcap").write_bytes(whole[: len(whole) // 2])
    Path("empty.mcap").write_bytes(b"")
    Path("text.mcap").write_text("not a recording")
    assert "missing.mcap: no such file" in fails(command, "missing.mcap")
    assert "truncated.mcap: " in fails(command, "truncated.mcap")
    assert "empty.mcap: is empty" in fails(command, "empty.mcap")
    assert "text.mcap: is in no known format" in fails(command, "text.mcap")
    assert not list(Path().glob("runs/*"))


def test_convert_writes_recordings(json_of, succeeds):
    assert json_of("convert", "push.mcap", "copy.mcap") == {
        "in": "push.mcap", "out": "copy.mcap", "frames": 40,
    }  # fmt: skip
    palpate.write_recording(tiny_recording(), "tiny.mcap")
    succeeds("convert", "tiny.mcap", "back.mcap")
    one, other = palpate.load_recording("tiny.mcap"), palpate.load_recording("back.mcap")
    np.testing.assert_array_equal(one.object_pose, other.object_pose)  # pyright: ignore[reportArgumentType]
    assert (list(one.image or ()), one.source) == (list(other.image or ()), other.source)


def test_convert_overwrites_only_with_force(fails, succeeds):
    Path("there.mcap").write_text("old")
    assert "already exists; --force" in fails("convert", "push.mcap", "there.mcap")
    assert Path("there.mcap").read_text() == "old"
    succeeds("convert", "push.mcap", "there.mcap", "--force")
    assert len(palpate.load_recording("there.mcap")) == 40
    assert ".xyz" in fails("convert", "push.mcap", "a.xyz")
