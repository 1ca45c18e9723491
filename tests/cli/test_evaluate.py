import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import types
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from recording_samples import pushed, seen, unit_seen

from palpate.cli import evaluate as evaluate_command
from palpate.cli import main
from palpate.errors import EstimationError
from palpate.io.recording_mcap import read_recording, write_recording
from palpate.lab.study import job as study_job
from palpate.lab.study.results import ALL
from palpate.lab.study.trial import read_trial
from palpate.pipeline.track import track
from palpate.touch.calibration import write_calibration
from palpate.touch.modes import Tactile

FAST = ("--tactile", "none", "constant", "--tactile", "oracle")
REPORT = "palpate.lab.study.report"


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own, where `recordings` holds two."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    Path("recordings").mkdir()
    write_recording(pushed(20), "recordings/disc-1.mcap")
    write_recording(pushed(40), "recordings/edges-1.mcap")


@pytest.fixture(autouse=True)
def reports(monkeypatch) -> list[Any]:
    """Draw no figures, which takes seconds, and return what they would have been drawn from."""
    given: list[Any] = []
    module: Any = types.ModuleType(REPORT)
    module.write_report = lambda *args: given.append(args)
    monkeypatch.setitem(sys.modules, REPORT, module)
    return given


def palpate(*words: str) -> int:
    """Return the exit code of the command line."""
    try:
        return main.main(["evaluate", *words])
    except SystemExit as stop:
        return int(stop.code or 0)


def failure(capsys: Any, *words: str) -> str:
    """Return the one line with which a command fails."""
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("palpate: ") and err.count("\n") == 1
    return err


def results(folder: str = "out") -> Any:
    return json.loads(Path(folder, "results.json").read_text())


def test_the_modes_are_those_of_the_tracker():
    assert set(evaluate_command.TACTILES) == set(get_args(Tactile))
    assert len(evaluate_command.TACTILES) == len(get_args(Tactile))


def test_a_study_leaves_tables_and_a_report(capsys, reports):
    assert palpate("recordings", "--out", "out", *FAST) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert all(word in out for word in ("none", "constant", "oracle", "6 trials", str(Path("out/report.html"))))
    found = results()
    row = found["table"][ALL]["oracle"]
    shares = [f"{100 * row[f'{kind}inside_95']:.0f}" for kind in ("", "contact_", "rest_", "final_")]
    shown, steps = [line.split() for line in out.splitlines() if line.strip().startswith("oracle")]
    assert " ".join(shown).split(") ")[-1].startswith(" ".join(shares))
    assert list(row["step_ms"]) == ["p50", "p95", "p99"] and row["ambiguous"] > 0.0
    assert steps[1:] == [f"{100 * row['ambiguous']:.0f}", *(f"{ms:.1f}" for ms in row["step_ms"].values())]
    assert "after knocks" not in out
    assert found["settings"]["methods"] == ["none", "constant", "oracle"]
    assert found["command"] == "palpate evaluate recordings --out out --tactile none constant oracle"
    assert list(found["table"]) == ["disc", "edges", ALL]
    ((folder, given, trials),) = reports
    assert (folder, len(trials)) == (Path("out"), 6)
    assert json.loads(json.dumps(given)) == found
    with Path("out/sequences.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["tactile"] == "oracle"]
    shares, frames = ([float(each[key]) for each in rows] for key in ("ambiguous_share", "contact_frames"))
    assert row["ambiguous"] == pytest.approx(np.average(shares, weights=frames))
    assert len(Path("out/sequences.csv").read_text().splitlines()) == 7


def test_recovery_is_shown_where_there_are_knocks(capsys):
    told = np.zeros(40, np.bool_)
    told[0] = told[10] = True
    write_recording(replace(pushed(40), extra={"knocked": told}), "recordings/edges-1.mcap", overwrite=True)
    assert palpate("recordings", "--out", "out", "--tactile", "none", "constant") == 0
    out = capsys.readouterr().out
    row = results()["table"]["edges"]["none"]
    errors = list(row["error_after_knock_mm"].values())
    assert errors[0] > 5.0 and "after knocks" in out
    (shown,) = [line.split() for line in out.splitlines() if line.split()[:2] == ["none", "2"]]
    # At first the pose is as given, and so near up to the second knock. The recording ends a second after that.
    assert shown[2:7] == [f"{errors[0]:.1f}", f"{errors[1]:.1f}", "-", "-", "-"]
    assert shown[7:] == ["0.00", "-", f"{100 * row['silently_wrong_unfelt']:.0f}"]
    with Path("out/sequences.csv").open(newline="") as file:
        rows = {(row["recording"], row["tactile"]): row for row in csv.DictReader(file)}
    assert rows["edges-1.mcap", "none"]["knocks"] == "2" and rows["disc-1.mcap", "none"]["knocks"] == "0"
    assert float(rows["edges-1.mcap", "none"]["error_after_knock_mm_0.5"]) == errors[0]
    for key, shown in (("recovery_contact_s", "0.0"), ("recovered_in_2s", ""), ("error_after_knock_mm_3", "")):
        assert (rows["edges-1.mcap", "none"][key], rows["disc-1.mcap", "none"][key]) == (shown, "")


def test_the_page_is_drawn_from_what_was_found(monkeypatch):
    monkeypatch.delitem(sys.modules, REPORT)
    assert palpate("recordings", "--out", "out", "--tactile", "none", "oracle") == 0
    page = Path("out/report.html").read_text()
    assert "oracle" in page and "edges" in page
    assert list(Path("out/figures").glob("*.png"))


def test_all_modes_unless_told_and_what_lacks_images_is_no_failure(capsys):
    assert palpate("recordings", "--out", "out", "--json") == 0
    out, err = capsys.readouterr()
    printed = json.loads(out)
    assert err == ""
    assert (printed["study"]["trials"], printed["study"]["skipped"]) == (6, 10)
    assert list(printed["table"][ALL]) == ["none", "constant", "oracle"]
    assert printed["table"] == results()["table"]
    assert {each["reason"] for each in results()["skipped"] if each["method"] == "learnt-turn"} == {
        "has no images, which tactile learnt-turn needs"
    }


def test_images_are_felt():
    recordings = pytest.importorskip("palpate.lab.simulate.recordings")
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    shapes = pytest.importorskip("palpate.geometry.objects").SHAPES
    made = recordings.simulate_recording(shapes["disc"], "disc", 3, 3.0)
    Path("images").mkdir()
    write_recording(made, "images/disc-3.mcap")
    assert palpate("images", "--out", "out", "--tactile", "learnt", "oracle") == 0
    row = results()["table"]["disc"]["learnt"]
    assert row["sequences"] == 1 and row["final_mm"]["worst"] < 10.0
    assert results()["recordings"]["disc-3.mcap"]["images"]


def test_smoothers_multiply(capsys):
    words = ("--tactile", "none", "--smoother", "isam2", "fixed-lag", "--smoother", "isam2")
    assert palpate("recordings", "--out", "out", *words) == 0
    assert results()["settings"]["methods"] == ["none, isam2", "none"]
    assert Path("out/trials/none+isam2/disc-1.mcap.npz").exists()


def test_options_reach_the_tracker():
    words = ("--noise", "published", "--pressure", "0.03", "--first-pose", "0", "0", "3", "--tactile", "none")
    push = read_recording("recordings/disc-1.mcap")
    write_recording(replace(push, object_pose=None, episode=None), "recordings/blind-1.mcap")
    assert palpate("recordings", "--out", "out", *words) == 0
    found = results()
    settings = found["settings"]
    assert (settings["noise_preset"], settings["pressure"]) == ("published", 0.03)
    assert settings["first_pose"] == [0.0, 0.0, 3.0]
    assert found["command"].endswith("--tactile none --noise published --pressure 0.03 --first-pose 0.0 0.0 3.0")
    assert found["table"]["blind"]["none"]["unscored"] == 1
    assert not found["recordings"]["blind-1.mcap"]["truth"]


def test_a_first_pose_that_is_known_roughly_or_not_at_all(capsys):
    rough = ("recordings", "--out", "rough", "--tactile", "none", "--first-pose-sigma", "0.02", "0.03", "0.2")
    assert palpate(*rough) == 0
    assert results("rough")["settings"]["first_pose_sigma"] == [0.02, 0.03, 0.2]
    assert results("rough")["command"] == f"palpate evaluate {' '.join(rough)}"
    trial = read_trial(Path("rough/trials/none/disc-1.mcap.npz"))
    assert np.array_equal(trial.pose[0], trial.truth[0])
    capsys.readouterr()
    unknown = ("recordings", "--out", "unknown", "--tactile", "none", "--first-pose-unknown")
    assert palpate(*unknown) == 0
    assert results("unknown")["command"] == f"palpate evaluate {' '.join(unknown)}"
    for name in ("disc-1", "edges-1"):  # though their ground truth is known
        trial = read_trial(Path(f"unknown/trials/none/{name}.mcap.npz"))
        assert trial.pose[0].tolist() == [0.0, 0.0, 0.0] and trial.summary["scored_frames"]
    capsys.readouterr()
    assert "first_pose was [0.0, 0.0, 0.0], is None" in failure(capsys, *unknown[:-1], "--resume")
    for option in ("--first-pose", "--first-pose-sigma"):
        said = failure(capsys, *unknown, "--resume", option, "1", "1", "1")
        assert f"--first-pose-unknown says that nothing is known of the first pose, and {option} is given" in said


def test_what_is_known_of_the_sensor_unit_reaches_the_tracker_and_the_report(capsys):
    Path("images").mkdir()
    write_recording(seen(pushed(40)), "images/edges-1.mcap")
    for name, level in (("unit", 100.0), ("same", 100.0), ("other", 101.0)):
        write_calibration(unit_seen(level), f"{name}.npz")
    words = ("images", "--tactile", "none", "--out")
    assert palpate(*words, "without") == palpate(*words, "with", "--calibration", "unit.npz") == 0
    contacts = [read_trial(Path(out, "trials/none/edges-1.mcap.npz")).contact for out in ("without", "with")]
    # Without it the first half second, in which there is a touch, counts as untouched.
    assert [contact[:15].any() for contact in contacts] == [False, True]
    assert results("without")["settings"]["calibration"] is None
    assert results("with")["settings"]["calibration"]["file"] == "unit.npz"
    assert results("with")["command"] == "palpate evaluate images --out with --tactile none --calibration unit.npz"
    capsys.readouterr()
    for unit in ((), ("--calibration", "other.npz")):
        assert "was made with other settings (calibration was" in failure(capsys, *words, "with", "--resume", *unit)
    assert palpate(*words, "with", "--resume", "--calibration", "same.npz") == 0
    assert results("with")["study"]["kept"] == 1


def test_studies_with_one_answer_are_compared_with_those_with_several(capsys):
    assert palpate("recordings", "--out", "nine", "--tactile", "none") == 0
    one = ("recordings", "--out", "one", "--tactile", "none", "--hypotheses", "1")
    assert palpate(*one, "--against", "nine") == 0
    assert (results("nine")["settings"]["hypotheses"], results("one")["settings"]["hypotheses"]) == (9, 1)
    assert results("one")["command"] == f"palpate evaluate {' '.join(one)} --against nine"
    assert results("one")["against"]["methods"]["none"]["sequences"] == 2
    capsys.readouterr()
    assert "hypotheses was 1, is 9" in failure(capsys, *one[:-2], "--resume")


def test_broken_and_failed_ones_are_named_and_counted(capsys, monkeypatch, reports):
    def stumble(recording: Any, settings: Any, *args: Any, **options: Any) -> Any:
        if len(recording) == 40 and settings.tactile != "none":
            raise EstimationError("frame at 0.300 s: cannot be solved")
        return track(recording, settings, *args, **options)

    monkeypatch.setattr(study_job, "track", stumble)
    Path("recordings/bad.mcap").write_text("not HDF5")
    assert palpate("recordings", "--out", "out", *FAST, "--json") == 3
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("palpate: recordings/bad.mcap: ")
    assert lines[1] == "palpate: recordings/edges-1.mcap by constant, oracle: frame at 0.300 s: cannot be solved"
    printed, found = json.loads(out), results()
    assert printed["broken"] == found["broken"] and found["broken"][0]["recording"] == "bad.mcap"
    assert [each["method"] for each in found["failed"]] == ["constant", "oracle"]
    assert (found["study"]["broken"], found["study"]["failed"], len(reports[0][2])) == (1, 2, 4)


def test_nothing_but_broken_ones(capsys, reports):
    Path("bad").mkdir()
    Path("bad/one.mcap").write_text("not HDF5")
    assert palpate("bad", "--out", "out", *FAST) == 3
    assert "1 broken" in capsys.readouterr().out
    assert results()["table"] == {} and reports == []


def test_nothing_that_can_be_tracked(capsys):
    said = failure(capsys, "recordings", "--out", "out", "--tactile", "learnt", "learnt-turn")
    assert "nothing in it can be tracked in these ways; the first reason: disc-1.mcap has no images" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nowhere",), "nowhere: no such folder of recordings"),
        (("empty",), "empty: holds no recordings"),
        (("recordings", "--workers", "0"), "workers is 0; allowed is 1 or more"),
        (("recordings", "--noise", "loud"), "noise is 'loud'"),
        (("recordings", "--pressure", "flat"), "--pressure is 'flat'"),
        (("recordings", "--model", "nowhere", "--tactile", "learnt"), "nowhere: no such folder; a touch model"),
        (("recordings", "--model", "m", "--tactile", "none"), "--model m is not used with --tactile none"),
        (("recordings", "--against", "empty"), "empty: is not the folder of a study"),
        (("recordings", "--first-pose", "nan", "0", "0"), "first pose is (nan, 0.0, 0.0)"),
        (("recordings", "--first-pose-sigma", "0", "1", "1"), "first pose sigma is [0.0, 1.0, 1.0]"),
        (("recordings", "--calibration", "nowhere.npz"), "nowhere.npz: no such file"),
        (("recordings", "--hypotheses", "0"), "hypotheses is 0; allowed is a whole number from 1 on"),
        (("recordings", "--dask", "nowhere", "--tactile", "none"), "no Dask scheduler answers at 'nowhere'"),
    ],
)
def test_bad_input_is_one_line(capsys, words, said):
    Path("empty").mkdir()
    assert said in failure(capsys, *words, "--out", "out")
    assert not Path("out/results.json").exists()


def test_unknown_mode(capsys):
    assert palpate("recordings", "--out", "out", "--tactile", "smell") == 2
    assert "smell" in capsys.readouterr().err
    assert not Path("out").exists()


def test_a_report_is_not_overwritten_but_resumed(capsys):
    assert palpate("recordings", "--out", "recordings/out", *FAST) == 0
    capsys.readouterr()
    assert "recordings/out: is not empty; --resume goes on" in failure(capsys, "recordings", "--out", "recordings/out")
    stamp = Path("recordings/out/trials/none/disc-1.mcap.npz").stat().st_mtime_ns
    write_recording(pushed(30), "recordings/disc-2.mcap")
    assert palpate("recordings", "--out", "recordings/out", *FAST, "--resume") == 0
    assert "9 trials, 6 kept" in capsys.readouterr().out
    assert Path("recordings/out/trials/none/disc-1.mcap.npz").stat().st_mtime_ns == stamp


def test_against_an_earlier_study(capsys, reports):
    assert palpate("recordings", "--out", "old", *FAST) == 0
    capsys.readouterr()
    assert palpate("recordings", "--out", "new", *FAST, "--noise", "published", "--against", "old") == 0
    assert "worse" in capsys.readouterr().out
    found = results("new")
    assert found["command"].endswith("--against old")
    assert found["against"]["folder"] == "old" and set(found["against"]["methods"]) == {"none", "constant", "oracle"}
    change = found["against"]["methods"]["oracle"]
    assert change["sequences"] == change["better"] + change["worse"] + change["same"] == 2
    assert change["final_mm"]["before"] == pytest.approx(results("old")["table"][ALL]["oracle"]["final_mm"]["median"])
    assert change["final_mm"]["after"] == pytest.approx(found["table"][ALL]["oracle"]["final_mm"]["median"])
    assert reports[-1][1]["against"] == found["against"]
    Path("others").mkdir()
    write_recording(pushed(20), "others/else-1.mcap")
    said = failure(capsys, "others", "--out", "none", *FAST, "--against", "old")
    assert "--against old: has no recording and method in common" in said
    assert not Path("none").exists()


def test_an_interrupt_leaves_what_can_be_resumed():
    for index in range(60):  # enough that the interrupt comes long before the end
        shutil.copy("recordings/edges-1.mcap", f"recordings/more-{index}.mcap")
    words = ("evaluate", "recordings", "--out", "out", *FAST, "--workers", "2")
    code = (
        "import sys, types; module = types.ModuleType('palpate.lab.study.report'); "
        "module.write_report = print; sys.modules[module.__name__] = module; "
        "from palpate.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    environment = os.environ | {"PYTHONWARNINGS": "error"}
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words], start_new_session=True, stderr=subprocess.PIPE, env=environment, text=True
    )
    until = time.monotonic() + 60
    while len(list(Path("out").rglob("*.npz"))) < 6 and time.monotonic() < until:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert not list(Path("out").rglob(".*.part"))
    there = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*.npz")}
    assert 6 <= len(there) < 186 and not Path("out/results.json").exists()
    for path in list(Path("recordings").glob("more-*"))[4:]:  # enough is enough
        if not any(Path("out/trials", mode, f"{path.name}.npz") in there for mode in ("none", "constant", "oracle")):
            path.unlink()
    assert palpate("recordings", "--out", "out", *FAST, "--resume") == 0
    assert results()["study"]["kept"] == len(there)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in there.items())
