"""A simulated push by two fingers on the command line: tracked, shown, and what is named in one sentence."""

import json
import re
import runpy
import sys
from pathlib import Path

import pytest

import palpate

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")

EXAMPLE = Path(__file__).parents[2] / "examples" / "10_several_fingers.py"


@pytest.fixture(scope="module")
def hand_file(tmp_path_factory, command):
    """A recording of two fingers, and beside it one of each finger alone with its calibration."""
    folder = tmp_path_factory.mktemp("hand")
    assert (
        command("simulate", folder, "--fingers", "2", "--shape", "disc", "--count", "1", "--seconds", "4", "--ideal")
        == 0
    )
    (path,) = folder.glob("*.mcap")
    pushed = palpate.load_recording(path)
    assert pushed.images is not None and pushed.hand is not None
    palpate.Tracker(pushed.shape, pushed.hand, None)  # compiles, if nothing has, before a command counts the minutes
    for name, (sensor, poses) in zip(pushed.images, pushed.tips(), strict=True):
        one = palpate.Recording(pushed.time, poses, pushed.shape, sensor, pushed.object_pose, image=pushed.images[name])
        palpate.write_recording(one, folder / name)
        assert command("calibrate", folder / name, "--out", folder / f"{name}.npz") == 0
    return path


def test_tracking_needs_no_option_and_shows_both_fingers(hand_file, succeeds, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = succeeds("track", hand_file, "--html", "--out", "run", "--video", "push.gif")
    assert "final pose" in said and Path("push.gif").stat().st_size > 10_000
    summary = json.loads(Path("run/summary.json").read_text())
    assert summary["tactile"] == "learnt" and summary["final_translation_error_mm"] < 10.0
    (data,) = map(json.loads, re.findall(r"const run = (.*);\n", Path("run/page.html").read_text()))
    left, right = (tip["pose"][0] for tip in data["tips"])
    hand = palpate.load_recording(hand_file).hand
    assert hand is not None
    (_, y, _), (_, other_y, _) = hand.mounts.values()
    assert ((left[0] - right[0]) ** 2 + (left[1] - right[1]) ** 2) ** 0.5 == pytest.approx(
        1e3 * (y - other_y), abs=0.01
    )
    assert len(data["touch"]) > 50


def test_the_example_tracks_it(hand_file, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["10_several_fingers.py", str(hand_file)])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    frames, *_, off = capsys.readouterr().out.splitlines()
    assert frames.startswith("120 frames, ") and float(off.split()[0]) < 10.0


def test_calibrations_are_by_finger_and_those_that_are_exchanged_are_named(hand_file, succeeds, fails, tmp_path):
    left = hand_file.parent / "left.npz"
    right = hand_file.parent / "right.npz"
    out = ("--out", tmp_path / "run")
    succeeds("track", hand_file, "--calibration", f"left={left},right={right}", *out)
    settings = json.loads((tmp_path / "run" / "settings.json").read_text())
    assert settings["calibration"] == {"left": str(left), "right": str(right)}
    out = ("--out", tmp_path / "other")
    assert "exchanged" in fails("track", hand_file, "--calibration", f"left={right},right={left}", *out)
    assert "'middle'" in fails("track", hand_file, "--calibration", f"left={left},middle={right}", *out)
    assert "left=" in fails("track", hand_file, "--calibration", "left=", *out)
    assert not (tmp_path / "other").exists()


def test_a_tracker_refuses_images_that_do_not_fit_the_calibration_of_their_finger(hand_file):
    recording = palpate.load_recording(hand_file)
    assert recording.hand is not None
    left, right = (palpate.load_calibration(hand_file.parent / f"{name}.npz") for name in ("left", "right"))
    exchanged = palpate.Tracker(recording.shape, recording.hand, None, calibration={"left": right, "right": left})
    with pytest.raises(palpate.FrameError, match=r"finger left is left out: .*right\.npz"):
        exchanged.update(recording[0])


def test_info_says_what_the_hand_is(hand_file, json_of):
    found = json_of("info", hand_file)
    assert found["mounts"]["left"][1] == -found["mounts"]["right"][1] > 0.0
    assert found["images"] == {"left": 120, "right": 120}
    assert found["contact_share"] > 0.1


def test_a_format_of_one_sensor_says_so(hand_file, fails, tmp_path):
    assert "hand" in fails("convert", hand_file, tmp_path / "set", "--lerobot")
