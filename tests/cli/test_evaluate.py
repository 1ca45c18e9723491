"""`palpate evaluate`, run on small recordings, and the files that it writes."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

import palpate

FAST = ("--tactile", "none", "oracle")


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Work in a folder with two recordings, where no figures are drawn: that takes seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "250")
    monkeypatch.setattr("palpate_lab.study.figures.write_figures", lambda *_: None)
    Path("recordings").mkdir()
    write("recordings/disc-1.mcap", pushed(20))
    write("recordings/edges-1.mcap", pushed(40))


@pytest.fixture
def evaluate(run_palpate):
    return lambda *words: run_palpate("evaluate", *words)


def write(path: str, recording: Any) -> None:
    palpate.write_recording(recording, path, overwrite=True)


def results(folder: str = "out") -> Any:
    return json.loads(Path(folder, "results.json").read_text(encoding="utf-8"))


def rows(folder: str = "out", table: str = "sequences.csv") -> list[dict[str, str]]:
    with Path(folder, table).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_study_writes_tables(evaluate):
    code, out, err = evaluate("recordings", "--out", "out", *FAST)
    assert (code, err) == (0, "")
    assert "trials 4 kept 0" in " ".join(out.split())
    found = results()
    assert list(found["table"]) == ["disc", "edges", "all groups"]
    row = found["table"]["all groups"]["oracle"]
    assert row["sequences"] == 2 and row["lost"] == 0 and list(row["step_ms"]) == ["p50", "p95", "p99"]
    (shown,) = [line for line in out.splitlines() if line.strip().startswith("oracle")]
    assert "median {median:.3g}, worst {worst:.3g}".format(**row["final_mm"]) in shown
    assert found["settings"]["methods"] == ["none", "oracle"]
    assert found["recordings"]["edges-1.mcap"]["group"] == "edges"
    oracle = [each for each in rows() if each["tactile"] == "oracle"]
    shares, frames = ([float(each[key]) for each in oracle] for key in ("ambiguous_share", "contact_frames"))
    assert row["ambiguous"] == pytest.approx(np.average(shares, weights=frames))
    assert [each["recording"] for each in rows()] == ["disc-1.mcap", "disc-1.mcap", "edges-1.mcap", "edges-1.mcap"]


def test_the_worst_trials_are_drawn(evaluate):
    code, out, err = evaluate("recordings", "--out", "out", *FAST, "--worst", "2")
    assert (code, err) == (0, "")
    worst = sorted(rows(), key=lambda row: -float(row["final_translation_error_mm"]))[:2]
    drawn = sorted(path.name for path in Path("out/worst").iterdir())
    assert drawn == [f"0{rank}-{row['recording']}-{row['tactile']}.png" for rank, row in enumerate(worst, 1)]
    assert Path("out/worst", drawn[0]).read_bytes().startswith(b"\x89PNG") and drawn[1] in out


def test_recordings_without_truth_have_status_and_sigma(evaluate):
    for name in ("disc-1", "edges-1"):
        blind = replace(pushed(20), object_pose=None, first_pose=np.zeros(3), first_pose_sigma=np.full(3, 0.01))
        write(f"recordings/{name}.mcap", blind)
    code, out, _ = evaluate("recordings", "--out", "out", "--tactile", "none")
    assert code == 0 and "final_sigma_mm" in out and "final_mm" not in out
    assert {row["final_status"] for row in rows()} and all(float(row["final_sigma_x"]) > 0.0 for row in rows())


def test_two_studies_are_compared_pair_by_pair(evaluate, run_palpate, fails):
    assert evaluate("recordings", "--out", "a", "--tactile", "none")[0] == 0
    assert evaluate("recordings", "--out", "b", "--tactile", "oracle")[0] == 0
    code, out, err = run_palpate("compare", "a", "b", "--json")
    found = json.loads(out)
    assert (code, err, found["pairs"]) == (0, "", 2)
    key = "final_translation_error_mm"
    one, other = ([float(row[key]) for row in rows(folder)] for folder in ("a", "b"))
    difference = np.subtract(other, one)
    row = found["scores"][key]
    assert row["difference"] == pytest.approx(difference.mean())
    half = 12.706 * difference.std(ddof=1) / np.sqrt(2.0)  # Student's t of one degree of freedom
    assert (row["low"], row["high"]) == pytest.approx((difference.mean() - half, difference.mean() + half), rel=1e-4)
    assert row["better"] == (difference < 0.0).sum() and row["worse"] == (difference > 0.0).sum()
    Path("empty").mkdir()
    assert "empty: holds no runs" in fails("compare", "a", "empty")
    assert "no such folder" in fails("compare", "a", "nowhere")


def test_a_sequence_of_the_study_is_what_palpate_track_finds(evaluate, run_palpate):
    assert evaluate("recordings", "--out", "out", *FAST)[0] == 0
    code, out, _ = run_palpate("track", "recordings/edges-1.mcap", "--tactile", "oracle", "--json")
    alone = json.loads(out)
    (row,) = [each for each in rows() if (each["recording"], each["tactile"]) == ("edges-1.mcap", "oracle")]
    assert code == 0
    for key in ("final_translation_error_mm", "rotation_rmse_deg", "nees_mean", "in_95_contact_share"):
        assert float(row[key]) == alone[key], key


def test_default_methods_and_recordings_that_lack_images(evaluate):
    code, out, err = evaluate("recordings", "--out", "out", "--json")
    printed = json.loads(out)
    assert (code, err) == (0, "") and printed["table"] == results()["table"]
    assert list(printed["table"]["all groups"]) == ["none", "oracle"]
    assert (printed["study"]["trials"], printed["study"]["skipped"]) == (4, 2)
    assert {each["method"] for each in results()["skipped"]} == {"learnt"}
    assert "has no images" in results()["skipped"][0]["reason"]
    assert "has no images, which tactile learnt needs 2" in evaluate("recordings", "--out", "out", "--resume")[1]


def test_knocks_are_scored(evaluate):
    knocked = np.zeros(40, np.bool_)
    knocked[[0, 10]] = True
    write("recordings/edges-1.mcap", replace(pushed(40), extra={"knocked": knocked}))
    out = evaluate("recordings", "--out", "out", "--tactile", "none")[1]
    row = results()["table"]["edges"]["none"]
    assert row["knocks"] == 2 and "knocks" in out
    assert [each["knocks"] for each in rows()] == ["0", "2"]


def test_recordings_are_found_in_subfolders_and_told_from_other_files(evaluate, shared_data):
    Path("recordings/mit").mkdir()
    shutil.copy(next((shared_data / "mit_point_push").glob("*.gz")), "recordings/mit/a.json.gz")
    for name in ("notes.txt", "model.npz", ".hidden.mcap", "x.csv", ".git/y.mcap"):
        path = Path("recordings", name)
        path.parent.mkdir(exist_ok=True)
        path.write_text("something")
    Path("recordings/settings.json").write_text('{"seed": 1}')
    Path("recordings/path.tum").write_text("0 0 0 0 0 0 0 1\n")
    assert evaluate("recordings", "--out", "recordings/out", "--tactile", "none")[0] == 0
    found = results("recordings/out")
    assert list(found["recordings"]) == ["disc-1.mcap", "edges-1.mcap", "mit/a.json.gz"] and found["failed"] == []
    assert list(found["table"]) == ["disc", "edges", "mit", "all groups"]


def test_damaged_recordings_are_named_and_the_others_tracked(evaluate):
    Path("recordings/bad.mcap").write_text("not a recording")
    Path("recordings/empty.json").write_text("")
    code, out, err = evaluate("recordings", "--out", "out", *FAST, "--json")
    assert code == 3 and len(err.splitlines()) == 2
    assert err.startswith("palpate: recordings/bad.mcap: ")
    assert {each["recording"] for each in json.loads(out)["failed"]} == {"bad.mcap", "empty.json"}
    assert len(rows()) == 4


def test_a_study_is_continued_with_the_same_settings_and_files_only(evaluate, fails):
    assert evaluate("recordings", "--out", "out", *FAST)[0] == 0
    files = {path: path.stat().st_mtime_ns for path in Path("out/trials").rglob("*.npz")}
    assert len(files) == 4
    assert "out: is not empty; --resume" in evaluate("recordings", "--out", "out", *FAST)[2]
    write("recordings/disc-2.mcap", pushed(30))
    next(iter(files)).write_bytes(b"cut")
    Path("noise.json").write_text(
        '{"format": "palpate-noise", "version": 4, "noise": {"contact": {"deviation": 2e-3}}}'
    )
    out = evaluate("recordings", "--out", "out", *FAST, "--resume")[1]
    assert "trials 6 kept 3" in " ".join(out.split())
    assert sum(path.stat().st_mtime_ns == stamp for path, stamp in files.items()) == 3
    for option, value, sentence in (
        ("--noise", "noise.json", "out: was made with other settings (noise."),
        ("--hypotheses", "1", "hypotheses was 9, is 1"),
    ):
        assert sentence in fails("evaluate", "recordings", "--out", "out", *FAST, "--resume", option, value)
    write("recordings/disc-1.mcap", pushed(25))
    out = evaluate("recordings", "--out", "out", *FAST, "--resume")[1]
    assert "trials 6 kept 4" in " ".join(out.split())  # one has changed since


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("nowhere",), "nowhere: no such folder of recordings"),
        (("empty",), "empty: holds no recordings"),
        (("recordings", "--workers", "0"), "workers is 0"),
        (("recordings", "--model", "nowhere", "--tactile", "learnt"), "nowhere: no such folder"),
        (("recordings", "--dask", "nowhere", "--tactile", "none"), "no Dask scheduler answers at 'nowhere'"),
        (("recordings", "--tactile", "learnt"), "no recording can be tracked by these methods"),
    ],
)
def test_bad_input_is_one_line(fails, words, sentence):
    Path("empty").mkdir()
    assert sentence in fails("evaluate", *words, "--out", "out")
    assert not Path("out/results.json").exists()


def test_an_interrupt_leaves_a_study_that_can_be_continued(evaluate):
    for index in range(60):  # enough that the interrupt comes long before the end
        shutil.copy("recordings/edges-1.mcap", f"recordings/more-{index}.mcap")
    words = ("evaluate", "recordings", "--out", "out", *FAST, "--workers", "2")
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", *words], start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    while len(list(Path("out").rglob("*.npz"))) < 6:
        assert process.poll() is None
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    there = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*.npz")}
    assert 6 <= len(there) < 124 and not Path("out/results.json").exists()
    for path in list(Path("recordings").glob("more-*")):  # those that were not begun would take long
        if not any(Path("out/trials", mode, f"{path.name}.npz") in there for mode in ("none", "oracle")):
            path.unlink()
    assert evaluate("recordings", "--out", "out", *FAST, "--resume")[0] == 0
    assert results()["study"]["kept"] == len(there)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in there.items())
