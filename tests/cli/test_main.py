"""The command line as a whole: exit codes, help, printing, and `palpate demo`."""

import json
import os
import subprocess
import sys
from itertools import count, pairwise
from pathlib import Path

import pytest

import palpate

COMMANDS = (
    *("demo", "info", "track", "live", "convert", "simulate", "calibrate", "train", "evaluate", "tune"),
    *("truth-print", "truth-camera", "truth", "compare", "ros2"),
)
HEAVY = (
    *("numpy", "scipy", "shapely", "cv2", "mcap", "rosbags", "gtsam", "matplotlib", "mujoco"),
    *("distributed", "torch", "onnx", "onnxruntime", "onnxscript", "numba"),
)

pytestmark = pytest.mark.usefixtures("folder")


def process(*words: str, **options) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, timeout=180, **options)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_of_each_command(run_palpate, command):
    code, out, err = run_palpate(command, "--help")
    assert (code, err) == (0, "")
    assert f"Example: palpate {command} " in out or f"Example: palpate {command}\n" in out


def test_help_is_quick_and_loads_nothing_heavy():
    helped = "from palpate.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    code = f"import sys\n{helped}\nprint([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]" and all(command in done.stdout for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_nothing_of_its_code(run_palpate, command):
    out = run_palpate(command, "--help")[1]
    for word in ("bag.choices", "{None", "None|", "NoneType", "[bold", "{FLOAT", "STR}"):
        assert word not in out, word


def test_the_help_has_four_groups_and_each_command_once(run_palpate):
    lines = run_palpate("--help")[1].splitlines()
    titles = [line for before, line in pairwise(lines) if not before and line and line[0].isupper()]
    assert len(titles) >= 4 and all(sum(line.startswith(f"  {name} ") for line in lines) == 1 for name in COMMANDS)


def test_the_node_explains_itself_without_ros(run_palpate, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    code, out, err = run_palpate("ros2", "--help")
    assert (code, err) == (0, "") and "first_pose_sigma" in out
    assert "rclpy" in fails("ros2", "--ros-args", "-p", "shape:=disc")


def test_completion_is_printed(run_palpate):
    code, out, _ = run_palpate("--tyro-print-completion", "bash")
    assert code == 0 and "complete" in out


def test_a_command_that_is_quiet_prints_errors_only(run_palpate, fails):
    assert run_palpate("track", "push.mcap", "--quiet") == (0, "", "")
    assert "already exists" in fails("track", "push.mcap", "--quiet")
    assert json.loads(run_palpate("track", "push.mcap", "--quiet", "--force", "--json")[1])["frames"] == 40


def test_verbose_says_what_it_does(caplog, run_palpate):
    assert run_palpate("track", "push.mcap", "-v")[0] == 0
    assert "reading push.mcap" in caplog.text and "first pose" in caplog.text


def test_where_there_is_no_terminal_a_line_comes_now_and_then(run_palpate, monkeypatch):
    assert run_palpate("track", "push.mcap")[2] == ""  # it takes less than a minute
    monkeypatch.setattr("palpate.cli.console.monotonic", count(0.0, 61.0).__next__)
    err = run_palpate("track", "push.mcap", "--force")[2]
    assert "push.mcap: 40 of 40" in err


def test_hints_are_quoted_and_work_without_palpate_on_the_path(fails, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    Path("part.dxf").write_text("0\nEOF\n")
    error = fails("truth-print", "sheets.pdf", "--shape", "part.dxf")
    assert f"{sys.executable} -m pip install '" in error and "[outlines]'" in error


def test_mujoco_of_two_makers_packages_is_named(fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setattr("palpate_lab.version", {"mujoco": "3.17.0", "mujoco-core": "4.0.1"}.__getitem__)
    error = fails("demo", "--out", "other")
    assert "uninstall -y mujoco mujoco-core && " in error and "install 'mujoco-core==4.0.1'" in error


def test_the_real_process():
    done = process("palpate", "track", "push.mcap", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["frames"] == 40
    assert Path("runs/push/figure.png").read_bytes().startswith(b"\x89PNG")
    failed = process("palpate", "track", "missing.mcap")
    assert (failed.returncode, failed.stdout, failed.stderr) == (2, "", "palpate: missing.mcap: no such file\n")
    piped = f"{sys.executable} -m palpate info push.mcap --json | true"
    assert subprocess.run(["bash", "-c", piped], capture_output=True, text=True).stderr == ""


def test_closed_outputs_do_not_end_a_run():
    words = f"{sys.executable} -m palpate track push.mcap >&- 2>&-"
    assert subprocess.run(["sh", "-c", words], timeout=180).returncode == 0
    assert Path("runs/push/figure.png").exists() and palpate.load_recording("push.mcap")


def test_a_folder_that_was_removed_is_named(fails, monkeypatch):
    Path("gone").mkdir()
    file = Path("push.mcap").resolve()
    monkeypatch.chdir("gone")
    Path("../gone").resolve().rmdir()
    assert "current folder" in fails("track", file)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["--version"], ["--help"], ["track", "--help"], ["help", "info"]], ids=" ".join)
def test_a_disk_that_is_full_is_named_by_version_and_help_too(unbuffered, words):
    """Python flushes a buffered output once more at the end, and would exit with 120."""
    words = [sys.executable, "-m", "palpate", *words]
    surroundings = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, env=surroundings)
    assert done.returncode == 2 and done.stderr.count(b"\n") == 1


def test_an_interrupt_while_modules_load_is_one_line():
    Path("tyro.py").write_text("raise KeyboardInterrupt\n")
    done = process("palpate", "info", "push.mcap")
    assert done.returncode in (130, -2) and done.stderr == "palpate: stopped\n"  # which shells show alike


def test_errors_and_exit_codes(run_palpate, monkeypatch):
    assert run_palpate("--version") == (0, f"palpate {palpate.__version__}\n", "")
    for word, meant in ("trak", "track"), ("truth_print", "truth-print"), ("Info", "info"):
        assert run_palpate(word) == (2, "", f"palpate: there is no command {word!r}; did you mean {meant}?\n")
    assert "convert" in run_palpate("words")[2]
    assert run_palpate("help", "info") == run_palpate("info", "--help") and run_palpate() == run_palpate("--help")
    for words, option in (("--smother", "batch"), "--smoother"), (("--first-pose", "1", "2"), "--first-pose"):
        code, _, err = run_palpate("track", "push.mcap", *words)
        assert code == 2 and option in err
    with pytest.raises(palpate.FileError):
        run_palpate("track", "missing.mcap", "--debug")

    def raising(error: BaseException):
        def load(*_: object) -> None:
            raise error

        return load

    monkeypatch.setattr("palpate.load_recording", raising(KeyboardInterrupt()))
    assert run_palpate("info", "push.mcap")[0] == 130
    monkeypatch.setattr("palpate.load_recording", raising(OSError("disk is gone")))
    assert run_palpate("info", "push.mcap") == (2, "", "palpate: disk is gone\n")
    monkeypatch.setattr("palpate.load_recording", raising(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):  # a bug keeps its traceback
        run_palpate("info", "push.mcap")


def test_another_distribution_adds_a_command_by_an_entry_point(tmp_path, monkeypatch, run_palpate):
    monkeypatch.syspath_prepend(tmp_path)
    metadata = tmp_path / "feelings-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: feelings\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[palpate.commands]\nfeel = feelings:feel\nbroken = feelings:absent\n")
    (tmp_path / "feelings.py").write_text(
        "from palpate.cli.console import Report\n"
        "def feel(*, softly: bool = False) -> Report:\n"
        '    """Feel.\n\n    Args:\n        softly: How.\n    """\n'
        '    return Report("feeling", {"softly": softly})\n'
    )
    code, out, _ = run_palpate("feel", "--softly", "--json")
    assert (code, json.loads(out)) == (0, {"softly": True})
    assert run_palpate("fel")[2].endswith("did you mean feel?\n")
    code, _, err = run_palpate("broken")
    assert code == 2 and "feelings 1.0" in err and "absent" in err and err.count("\n") == 1


def test_demo_replaces_its_run_and_names_its_recording(succeeds):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    Path("demo-run").mkdir()
    Path("demo-run/summary.json").write_text("an earlier one")
    out = succeeds("demo")
    assert "final error" in out and str(Path("demo-run/figure.png")) in out
    found, settings = (json.loads(Path("demo-run", f"{name}.json").read_text()) for name in ("summary", "settings"))
    assert (found["frames"], found["tactile"]) == (450, "learnt")
    assert palpate.load_recording("demo-run/recording.mcap").source == settings["source"]


def test_demo_fails_in_one_line(fails, monkeypatch):
    Path("demo-run").mkdir()
    Path("demo-run/notes.txt").write_text("mine")
    assert "not replaced" in fails("demo")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    error = fails("demo", "--out", "other")
    assert "mujoco, which is not installed: " in error and "pip install '" in error and "[sim]'" in error
    assert not Path("other").exists()
