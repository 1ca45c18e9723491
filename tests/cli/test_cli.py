import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from palpate.graph.smoother import SmootherName
from recording_samples import pushed, trajectory

from palpate import io as formats
from palpate.cli import demo, main, options
from palpate.config import TrackerSettings
from palpate.io.recording_mcap import write_recording
from palpate.pipeline.metrics import pose_words
from palpate.pipeline.run_folder import FILES
from palpate.touch.modes import Tactile, TactileChoice
from palpate.tracker_arguments import first_pose_of
from palpate.types.images import encode_image
from palpate.types.sensor import SensorProfile


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch, no_figures):
    """Every test works in a folder of its own that holds push.mcap and blind.mcap, which has no ground truth."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    recording = pushed()
    write_recording(recording, "push.mcap")
    write_recording(replace(recording, object_pose=None), "blind.mcap")


def palpate(*words: str) -> int:
    """Return the exit code of the command line."""
    try:
        return main.main(words)
    except SystemExit as stop:
        return int(stop.code or 0)


def failure(capsys: Any, *words: str) -> str:
    """Return the one line with which a command fails."""
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("palpate: ")
    assert err.count("\n") == 1
    return err


def test_track_leaves_a_run_and_shows_a_table(capsys):
    assert palpate("track", "push.mcap", "--tactile", "oracle") == 0
    out = capsys.readouterr().out
    assert "final translation error" in out and "mm" in out
    found = json.loads(Path("runs/push/summary.json").read_text())
    lines = [line.split() for line in out.splitlines()]
    for key, name in (("in_95_contact_share", "region, in contact"), ("in_95_rest_share", "region, at rest")):
        assert ["in", "the", "95", "%", *name.split(), f"{100 * found[key]:.0f}", "%", "of", "frames"] in lines
    pose = pose_words(found["final_pose"], found["final_sigma"])
    assert ["final", "pose", *pose.split(), "1", "sigma"] in lines
    assert "silently wrong" in out and "knocks" not in out
    assert str(Path("runs/push/figure.png")) in out
    assert sorted(path.name for path in Path("runs/push").iterdir()) == sorted(FILES)


def test_track_shows_how_long_recovery_took_where_there_are_knocks(capsys):
    told = np.zeros(40, np.bool_)
    told[8] = told[38] = True
    write_recording(replace(pushed(), extra={"knocked": told}), "knocked.mcap")
    assert palpate("track", "knocked.mcap") == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    first, second = json.loads(Path("runs/knocked/summary.json").read_text())["knock_recovery_contact_s"]
    assert second is None  # at the end nothing can be seen to stay
    assert ["knocks", "2"] in lines
    assert any(" ".join(line) == "silently wrong before a touch 0 % of frames since contact" for line in lines)
    shown = "-," if first is None else f"{first:.2f},"
    assert ["recovered", "after", shown, "-", "s", "in", "contact"] in lines


def test_track_json_is_the_summary_and_nothing_else(capsys):
    assert palpate("track", "push.mcap", "--json", "--out", "here", "--smoother", "isam2") == 0
    found = json.loads(capsys.readouterr().out)
    assert found == json.loads(Path("here/summary.json").read_text())
    assert (found["frames"], found["tactile"], found["smoother"]) == (40, "none", "isam2")


def test_options_reach_the_tracker(capsys):
    options = ("--noise", "published", "--pressure", "0.03", "--first-pose", "0.001", "0", "3")
    assert palpate("track", "blind.mcap", *options) == 0
    settings = json.loads(Path("runs/blind/settings.json").read_text())
    assert settings["noise_preset"] == "published"
    assert settings["pressure"] == 0.03
    assert settings["first_pose"] == [0.001, 0.0, 3.0]
    out = capsys.readouterr().out
    lines = [line.split() for line in out.splitlines()]
    assert ["final", "translation", "error", "-", "mm"] in lines  # a score that is not there
    summary = json.loads(Path("runs/blind/summary.json").read_text())
    assert pose_words(summary["final_pose"], summary["final_sigma"]) in out  # which needs no truth


def test_a_first_pose_that_is_known_roughly_and_how_many_answers_are_kept(capsys):
    place = ("--first-pose", "0.001", "0", "3", "--first-pose-sigma", "0.02", "0.03", "0.2", "--json")
    assert palpate("track", "blind.mcap", *place, "--hypotheses", "1") == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 40
    settings = json.loads(Path("runs/blind/settings.json").read_text())
    assert settings["first_pose"] == [0.001, 0.0, 3.0]
    assert (settings["first_pose_sigma"], settings["hypotheses"]) == ([0.02, 0.03, 0.2], 1)
    covariance = np.genfromtxt("runs/blind/estimates.csv", delimiter=",", names=True)
    assert covariance.size == 40


def test_a_first_pose_of_which_nothing_is_known(capsys):
    assert palpate("track", "--first-pose-unknown", "blind.mcap", "--json") == 0
    settings = json.loads(Path("runs/blind/settings.json").read_text())
    pose, sigma = first_pose_of(None, None, TrackerSettings())  # as Tracker(shape, sensor, first_pose=None) has it
    assert (settings["first_pose"], settings["first_pose_sigma"]) == (pose.tolist(), sigma.tolist())
    capsys.readouterr()
    for option in ("--first-pose", "--first-pose-sigma"):
        assert failure(capsys, "track", "push.mcap", "--first-pose-unknown", option, "1", "1", "1") == (
            f"palpate: --first-pose-unknown cannot be combined with {option}\n"
        )


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (("--hypotheses", "0"), "hypotheses is 0; allowed is a whole number from 1 on"),
        (
            ("--first-pose-sigma", "0", "1", "1"),
            "first pose sigma is [0.0, 1.0, 1.0]; it must be three numbers above 0: x [m], y [m], theta [rad]",
        ),
    ],
)
def test_answers_and_sigmas_that_cannot_be_are_one_sentence(capsys, option, said):
    assert failure(capsys, "track", "push.mcap", *option) == f"palpate: {said}\n"
    assert not Path("runs").exists()


def test_several_files_get_a_folder_and_a_row_each(capsys):
    write_recording(pushed(30), "other.mcap")
    assert palpate("track", "push.mcap", "other.mcap", "--out", "all") == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("push", "other", "median", "in 95 %", "contact", "rest", "silently wrong"))
    assert sorted(path.name for path in Path("all").iterdir()) == ["other", "push"]
    assert palpate("track", "push.mcap", "other.mcap", "--json", "--out", "again") == 0
    found = json.loads(capsys.readouterr().out)
    assert [run["frames"] for run in found["runs"]] == [40, 30]
    assert found["failed"] == []


def test_one_broken_file_among_several_does_not_stop_the_others(capsys):
    Path("broken.mcap").write_text("no")
    assert palpate("track", "broken.mcap", "push.mcap", "missing.mcap", "--json") == 3
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [run["file"] for run in found["runs"]] == ["push.mcap"]
    assert [failed["file"] for failed in found["failed"]] == ["broken.mcap", "missing.mcap"]
    assert [line.split(":")[1].strip() for line in err.splitlines()] == ["broken.mcap", "missing.mcap"]
    assert sorted(path.name for path in Path("runs").iterdir()) == ["push"]


def test_files_of_one_name_are_not_mixed_up(capsys):
    Path("sub").mkdir()
    write_recording(pushed(), "sub/push.mcap")
    assert "would both go to" in failure(capsys, "track", "push.mcap", "sub/push.mcap")
    assert not Path("runs").exists()


def test_force_replaces_a_run(capsys):
    assert palpate("track", "push.mcap") == 0
    capsys.readouterr()
    before = Path("runs/push/summary.json").read_text()
    assert "already exists" in failure(capsys, "track", "push.mcap", "--smoother", "isam2")
    assert Path("runs/push/summary.json").read_text() == before
    assert palpate("track", "push.mcap", "--smoother", "isam2", "--force") == 0
    assert json.loads(Path("runs/push/summary.json").read_text())["smoother"] == "isam2"


@pytest.mark.parametrize("command", ["track", "info"])
def test_bad_files_are_one_line(capsys, command):
    whole = Path("push.mcap").read_bytes()
    Path("truncated.mcap").write_bytes(whole[:1000])
    Path("empty.mcap").write_bytes(b"")
    Path("text.mcap").write_text("not a recording")
    Path("newer.mcap").write_bytes(whole.replace(b"version\x01\0\0\x001", b"version\x01\0\0\x009"))
    formats.write(trajectory(), "poses.tum")
    assert "missing.mcap: no such file" in failure(capsys, command, "missing.mcap")
    assert "truncated.mcap: array sensor_pose is missing, or the file is cut off before it" in failure(
        capsys, command, "truncated.mcap"
    )
    assert "empty.mcap: is empty" in failure(capsys, command, "empty.mcap")
    assert "text.mcap: is in no known format" in failure(capsys, command, "text.mcap")
    assert "newer.mcap: has version '9'" in failure(capsys, command, "newer.mcap")
    assert "poses.tum: holds a trajectory" in failure(capsys, command, "poses.tum")
    assert not Path("runs").exists()


def test_what_tracking_lacks_is_said(capsys):
    assert "--first-pose X Y THETA" in failure(capsys, "track", "blind.mcap")
    oracle = failure(capsys, "track", "blind.mcap", "--tactile", "oracle", "--first-pose", "0", "0", "0")
    assert "no ground truth" in oracle
    assert "no FILE" in failure(capsys, "track")
    for bad in ("soft", "-0.1", "nan"):
        line = failure(capsys, "track", "push.mcap", "--pressure", bad)
        assert "uniform, rim, corner or a friction radius" in line


@pytest.mark.parametrize(
    ("option", "names"),
    [
        ("--tactile", ["none", "constant", "oracle"]),
        ("--smoother", ["fixed-lag", "isam2"]),
        ("--noise", ["palpate", "published"]),
    ],
)
def test_unknown_option_values_name_the_allowed_ones(capsys, option, names):
    assert palpate("track", "push.mcap", option, "magic") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "magic" in err and all(f"'{name}'" in err for name in names)


def test_a_first_pose_that_is_none(capsys):
    assert failure(capsys, "track", "push.mcap", "--first-pose", "a", "0", "0") == (
        "palpate: --first-pose is 'a 0 0'; it must be three numbers, x [m], y [m] and theta [rad]\n"
    )
    for option in ("--first-pose", "--first-pose-sigma"):
        assert palpate("track", "push.mcap", option, "1", "2") == 2
        out, err = capsys.readouterr()
        assert out == "" and f"Missing value for argument '{option}'. Expected 3 values." in err
        assert "NoneType" not in err and "instantiated" not in err
    assert palpate("track", "--first-pose", "0", "0", "-.5", "push.mcap", "--json") == 0
    assert json.loads(Path("runs/push/settings.json").read_text())["first_pose"] == [0.0, 0.0, -0.5]


def test_what_touch_says_is_chosen_and_said(capsys):
    assert palpate("track", "push.mcap") == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("touch is none: there are no images\n")
    assert "tactile none, fixed-lag" in out
    assert json.loads(Path("runs/push/settings.json").read_text())["tactile"] == "none"
    summary = json.loads(Path("runs/push/summary.json").read_text())
    assert (summary["tactile"], summary["tactile_reason"]) == ("none", "there are no images")
    assert palpate("track", "push.mcap", "--tactile", "none", "--force") == 0
    assert "touch is" not in capsys.readouterr().out


def test_unknown_commands_and_options_fail(capsys):
    assert palpate("trak") == 2
    assert "info" in capsys.readouterr().err
    assert palpate("track", "push.mcap", "--smother", "isam2") == 2
    assert "--smoother" in capsys.readouterr().err


def test_option_values_are_those_of_the_library():
    annotations = TrackerSettings.__dataclass_fields__
    assert annotations["tactile"].default == "auto"
    assert set(get_args(options.Tactile)) == set(get_args(Tactile))
    assert set(get_args(options.TactileChoice)) == set(get_args(TactileChoice))
    assert set(get_args(options.SmootherName)) == set(get_args(SmootherName))


def test_debug_shows_the_traceback():
    with pytest.raises(formats.FileError):
        main.main(["track", "missing.mcap", "--debug"])


def test_interrupt_is_130(monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(formats, "load_recording", interrupted)
    assert palpate("info", "push.mcap") == 130


def test_other_exceptions_keep_their_traceback(monkeypatch):
    def bug(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(formats, "load_recording", bug)
    with pytest.raises(ZeroDivisionError):
        main.main(["info", "push.mcap"])


def test_info_shows_what_a_recording_holds(capsys):
    assert palpate("info", "push.mcap") == 0
    out = capsys.readouterr().out
    assert "rectangle, size x 200 mm, size y 100 mm" in out
    assert "40" in out and "30.0" in out and "unbroken" in out


def test_a_file_name_that_is_no_text(monkeypatch):
    odd = Path(os.fsdecode(b"push \xff.mcap"))
    write_recording(pushed(10), odd)
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")  # as a terminal is, where characters are strict
    monkeypatch.setattr(sys, "stdout", out)
    assert palpate("track", str(odd)) == 0
    out.flush()
    assert "run: runs/push \\udcff" in out.buffer.getvalue().decode()  # pyright: ignore[reportAttributeAccessIssue]
    assert sorted(path.name for path in Path(os.fsdecode(b"runs/push \xff")).iterdir()) == sorted(FILES)


def test_info_tells_times_from_the_first_frame_and_counts_what_is_found_often(capsys):
    push = pushed(240)
    truth = push.object_pose.copy()
    truth[12:240:12] = np.nan  # drop-outs farther apart than those that are one
    write_recording(replace(push, time=push.time + 1.7e9, object_pose=truth), "later.mcap")
    assert palpate("info", "later.mcap") == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "0 0.17 0.63 0.47" in lines  # the first contact, in frames 5 to 19
    assert "0.40 - 7.60 drop-out 19 times; first: ground truth is unknown in 1 frame" in lines
    assert sum("drop-out" in line for line in lines) == 2  # once more in the verdict


def test_info_json(capsys):
    assert palpate("info", "push.mcap", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["frames"], found["contact"]) == ("palpate", 40, "measured")
    assert found["shape"] == {"type": "rectangle", "size_x": 0.2, "size_y": 0.1}
    assert [contact["start"] for contact in found["contacts"]] == pytest.approx([5 / 30, 32 / 30])


def test_info_counts_findings_that_repeat(capsys):
    camera = SensorProfile("tiny", radius=0.01, image_height=12, image_width=8)
    damaged = replace(pushed(), sensor=camera, image=(b"no image",) * 40)
    formats.write(damaged, "damaged.mcap")
    assert palpate("info", "damaged.mcap") == 0
    out = capsys.readouterr().out
    assert out.count("do not decode") == 1
    assert "40 times; first:" in out and "image of frame 0" in out


def test_info_json_of_a_recording_whose_truth_drops_out(capsys):
    recording = pushed()
    recording.object_pose[15:25] = np.nan
    formats.write(recording, "lost.mcap")
    assert palpate("info", "lost.mcap", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [finding["breaks"] for finding in found["findings"] if finding["kind"] == "drop-out"] == [True]


def test_convert_loses_nothing_in_silence(capsys):
    camera = SensorProfile("tiny", radius=0.01, image_height=12, image_width=8)
    image = (encode_image(np.zeros((12, 8, 3), np.uint8)),) * 40
    formats.write(replace(pushed(), sensor=camera, image=image), "seen.mcap")
    said = failure(capsys, "convert", "seen.mcap", "seen.json")
    assert all(word in said for word in ("17 of 40 frames", "times", "the sensor", "images", "--lossy"))
    assert not Path("seen.json").exists()
    assert palpate("convert", "seen.mcap", "seen.json", "--lossy") == 0
    assert "without 17 of 40 frames (out of contact or without ground truth), times" in capsys.readouterr().out
    assert len(formats.load_recording("seen.json")) == 23


def test_convert(capsys):
    assert palpate("convert", "push.mcap", "truth.tum", "--lossy") == 0
    assert "truth.tum" in capsys.readouterr().out
    found: Any = formats.read("truth.tum")
    assert np.allclose(found.pose, pushed().object_pose, atol=1e-8)
    assert palpate("convert", "push.mcap", "copy.mcap", "--from", "palpate", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "in": "push.mcap",
        "out": "copy.mcap",
        "holds": "recording",
        "frames": 40,
        "left_out": [],
    }


def test_convert_overwrites_only_with_force(capsys):
    Path("there.tum").write_text("old")
    assert "already exists; --force" in failure(capsys, "convert", "push.mcap", "there.tum")
    assert Path("there.tum").read_text() == "old"
    assert palpate("convert", "push.mcap", "there.tum", "--force", "--lossy") == 0
    capsys.readouterr()
    assert len(formats.read("there.tum")) == 40  # pyright: ignore[reportArgumentType]
    assert ".xyz" in failure(capsys, "convert", "push.mcap", "a.xyz")
    assert "allowed are" in failure(capsys, "convert", "push.mcap", "b.tum", "--from", "magic")
    both = failure(capsys, "convert", "push.mcap", "b.tum", "--from", "palpate", "--shape", "disc")
    assert "--from cannot be combined with options for bags" in both
    assert palpate("convert", "there.tum", "c.mcap") == 0


def test_demo_runs_twice_and_says_where_its_recording_is(capsys, monkeypatch):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    monkeypatch.setattr(demo, "SECONDS", 3.0)
    assert palpate("demo") == 0
    out = capsys.readouterr().out
    assert "final translation error" in out and str(Path("demo-run/figure.png")) in out
    assert palpate("demo", "--json") == 0
    found, settings = json.loads(capsys.readouterr().out), json.loads(Path("demo-run/settings.json").read_text())
    assert (found["frames"], found["tactile"]) == (90, demo.TACTILE)
    (said,) = (line for line in out.splitlines() if "The recording: " in line)
    words, recording = said.split(" The recording: ")
    assert words.endswith(f"seed {demo.SEED}.") and f"seed {demo.SEED}, recording 0" in settings["source"]
    assert formats.load_recording(recording).source == settings["source"]


def test_demo_without_mujoco_is_one_line(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "MuJoCo, which is not installed: pip install palpate[sim]" in failure(capsys, "demo")
    assert not Path("demo-run").exists()


def test_demo_spares_folders_that_are_no_run(capsys):
    Path("demo-run").mkdir()
    Path("demo-run/notes.txt").write_text("mine")
    assert "not replaced" in failure(capsys, "demo")


def run_process(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "palpate.cli.main", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_the_real_process():
    done = run_process("track", "push.mcap", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["frames"] == 40
    assert Path("runs/push/figure.png").read_bytes().startswith(b"\x89PNG")
    failed = run_process("track", "missing.mcap")
    assert (failed.returncode, failed.stdout, failed.stderr) == (2, "", "palpate: missing.mcap: no such file\n")


HEAVY = ["scipy", "shapely", "cv2", "mcap", "rosbags", "gtsam", "matplotlib", "mujoco", "rerun", "joblib"]
HEAVY += ["distributed", "torch", "onnx", "onnxruntime", "onnxscript"]


def test_help_loads_nothing_heavy():
    helped = "from palpate.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    code = f"import sys\n{helped}\nprint([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


def test_a_reader_that_has_seen_enough_gets_no_traceback():
    command = f"{sys.executable} -m palpate.cli.main info push.mcap --json | true"
    found = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True, timeout=60)
    assert found.stderr == ""
