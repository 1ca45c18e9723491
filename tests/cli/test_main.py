"""The command line as a whole: exit codes, help, printing, and `palpate demo`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import palpate

COMMANDS = (
    *("demo", "info", "track", "live", "convert", "simulate", "calibrate", "train", "evaluate", "tune"),
    *("truth-print", "truth-camera", "truth"),
)
HEAVY = (
    *("numpy", "scipy", "shapely", "cv2", "mcap", "rosbags", "gtsam", "matplotlib", "mujoco"),
    *("distributed", "torch", "onnx", "onnxruntime", "onnxscript", "numba"),
)

pytestmark = pytest.mark.usefixtures("folder")


def process(*words: str, **options) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, timeout=60, **options)


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
    assert subprocess.run(["sh", "-c", words], timeout=60).returncode == 0
    assert Path("runs/push/figure.png").exists() and palpate.load_recording("push.mcap")


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
    assert "final_translation_error_mm" in out and str(Path("demo-run/figure.png")) in out
    found, settings = (json.loads(Path("demo-run", f"{name}.json").read_text()) for name in ("summary", "settings"))
    assert (found["frames"], found["tactile"]) == (450, "learnt")
    assert palpate.load_recording("demo-run/recording.mcap").source == settings["source"]


def test_demo_fails_in_one_line(fails, monkeypatch):
    Path("demo-run").mkdir()
    Path("demo-run/notes.txt").write_text("mine")
    assert "not replaced" in fails("demo")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "mujoco, which is not installed: pip install 'palpate-lab[sim]'" in fails("demo", "--out", "other")
    assert not Path("other").exists()
