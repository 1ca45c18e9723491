"""`palpate track` of many recordings: processes, going on after a stop, first poses from a table, and their table."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from recording_samples import BLIND, pushed

import palpate

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture
def three() -> tuple[str, ...]:
    names = ("one.mcap", "two.mcap", "three.mcap")
    for count, name in zip((40, 30, 35), names, strict=True):
        palpate.write_recording(pushed(count), name)
    return names


def summary(name: str, folder: str = "runs") -> Any:
    found = json.loads(Path(folder, name, "summary.json").read_text())
    return {key: value for key, value in found.items() if key not in ("wall_s", "step_ms")}


def test_processes_find_the_same_in_the_order_of_the_files(succeeds, json_of, three):
    succeeds("track", *three, "--out", "alone")
    found = json_of("track", *three, "--out", "shared", "--workers", "2")
    assert list(found["runs"]) == [str(Path("shared", name)) for name in ("one", "two", "three")]
    for name in ("one", "two", "three"):
        assert summary(name, "shared") == summary(name, "alone")


def test_a_file_that_fails_in_a_process_does_not_stop_the_others(run_palpate, three):
    code, out, err = run_palpate("track", *three, "blind.mcap", "--workers", "2", "--json")
    assert code == 3 and err.startswith("palpate: blind.mcap: has no ground truth") and err.count("\n") == 1
    assert len(json.loads(out)["runs"]) == 3 and [each["file"] for each in json.loads(out)["failed"]] == ["blind.mcap"]


def test_resume_keeps_whole_runs_and_makes_the_rest(json_of, run_palpate, three):
    json_of("track", *three[:2])
    stamps = {name: Path("runs", name, "summary.json").stat().st_mtime_ns for name in ("one", "two")}
    palpate.write_recording(pushed(25), "two.mcap", overwrite=True)
    found = json_of("track", *three, "--resume")
    assert found["kept"] == 1 and len(found["runs"]) == 3
    assert Path("runs/one/summary.json").stat().st_mtime_ns == stamps["one"]
    assert summary("two")["frames"] == 25  # its recording has changed
    assert json_of("track", *three, "--resume")["kept"] == 3
    assert json_of("track", *three, "--resume", "--tum")["kept"] == 0  # their trajectories are missing
    assert Path("runs/one/trajectory.tum").exists()
    code, _, err = run_palpate("track", *three, "--resume", "--hypotheses", "3")
    assert code == 3 and err.count("was made by other settings") == 3
    Path("other").mkdir()
    palpate.write_recording(pushed(20), "other/one.mcap")
    assert "holds the run of another recording" in run_palpate("track", "other/one.mcap", "two.mcap", "--resume")[2]


def test_first_poses_come_from_a_table(json_of, run_palpate, fails):
    palpate.write_recording(replace(pushed(30), **BLIND), "other.mcap")
    Path("first.csv").write_text(
        "file,x,y,theta,sigma_x,sigma_y,sigma_theta\nblind.mcap,10mm,0.02,90deg,1cm,0.02,6deg\nother,0.001,0,3,,,\n"
    )
    json_of("track", "blind.mcap", "other.mcap", "--first-poses", "first.csv")
    found, other = (json.loads(Path("runs", name, "settings.json").read_text()) for name in ("blind", "other"))
    assert found["first_pose"] == pytest.approx([0.01, 0.02, 1.5707963])
    assert found["first_pose_sigma"] == pytest.approx([0.01, 0.02, 0.10471976])
    assert other["first_pose"] == [0.001, 0.0, 3.0]
    code, _, err = run_palpate("track", "blind.mcap", "push.mcap", "--first-poses", "first.csv", "--out", "more")
    assert code == 3 and "no row for push.mcap" in err
    Path("first.csv").write_text("file,x,y,theta\nblind.mcap,10mm,0.02,90grad\n")
    assert "first.csv: line 2: found '90grad'" in fails("track", "blind.mcap", "--first-poses", "first.csv")
    assert "--first-poses cannot be combined" in fails(
        "track", "blind.mcap", "--first-poses", "first.csv", "--first-pose-unknown"
    )


def test_runs_without_truth_show_status_and_sigma(succeeds):
    palpate.write_recording(replace(pushed(30), **BLIND), "other.mcap")
    out = succeeds("track", "blind.mcap", "other.mcap", "--first-pose", 0, 0, 3)
    assert "sigma_mm" in out and "status" in out and "error_mm" not in out
    assert summary("blind")["final_status"] in out and " - " not in out
    assert "error_mm" in succeeds("track", "push.mcap", "blind.mcap", "--first-pose", 0, 0, 3, "--out", "both")


def test_files_of_one_name_do_not_share_a_folder(run_palpate):
    Path("other").mkdir()
    palpate.write_recording(pushed(20), "other/push.mcap")
    code, _, err = run_palpate("track", "push.mcap", "other/push.mcap", "--force", "--workers", "2")
    assert code == 3 and "other/push.mcap: " in err and "already exists" in err
    assert summary("push")["frames"] == 40


def test_fewer_workers_than_one(fails):
    assert "workers is 0" in fails("track", "push.mcap", "blind.mcap", "--workers", "0")


def test_workers_are_counted_for_a_single_file_too(fails):
    assert "workers is 0" in fails("track", "push.mcap", "--workers", "0")


def test_the_current_folder_is_no_recording(fails):
    Path("runs").mkdir()
    assert "is a folder of" in fails("track", ".")


def test_times_have_units(run_palpate, fails):
    assert "--seconds: found '5h'" in fails("simulate", "pushes", "--seconds", "5h")
    assert "seconds is 2" in fails("simulate", "pushes", "--seconds", "2000ms")
    assert "--seconds is -5" in fails("live", "--replay", "push.mcap", "--seconds", "-5s")
