"""`palpate track`: the run folder, tables and JSON, options, and errors."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed, seen

import palpate

pytestmark = pytest.mark.usefixtures("folder")

FILES = {"settings.json", "estimates.csv", "summary.json", "figure.png"}


def read(path: str) -> Any:
    return json.loads(Path(path).read_text())


def table(path: str) -> Any:
    """The columns of numbers in a table, without the words at its end."""
    columns = len(np.loadtxt(path, str, delimiter=",", max_rows=1)) - 3 * ("estimates" in path)
    return np.genfromtxt(path, delimiter=",", names=True, usecols=range(columns))


def words(line: str) -> str:
    return " ".join(line.split())


def test_a_run_leaves_a_folder_and_shows_a_table(succeeds):
    out = succeeds("track", "push.mcap", "--tactile", "oracle", "--all")
    assert {path.name for path in Path("runs/push").iterdir()} == FILES
    summary, settings = read("runs/push/summary.json"), read("runs/push/settings.json")
    lines = [words(line) for line in out.splitlines()]
    assert f"in_95_contact_share {summary['in_95_contact_share']:.3g}" in lines
    assert f"final_translation_error_mm {summary['final_translation_error_mm']:.3g}" in lines
    assert (settings["tactile"], settings["smoother"]) == ("oracle", "fixed-lag")
    assert settings["noise"]["contact"]["deviation"] == palpate.NoiseSettings().contact.deviation
    assert settings["first_pose"] == pushed().object_pose[0].tolist()


def test_files_of_a_run_agree_with_the_function_in_python(succeeds):
    run = palpate.track(palpate.load_recording("push.mcap"), palpate.TrackerSettings("oracle"))
    succeeds("track", "push.mcap", "--tactile", "oracle")
    online = table("runs/push/estimates.csv")
    assert online["time"].tolist() == run.recording.time.tolist()
    assert np.column_stack([online["x"], online["y"], online["theta"]]).tolist() == run.online.pose.tolist()
    same = {key: value for key, value in read("runs/push/summary.json").items() if key not in ("wall_s", "step_ms")}
    assert same == {key: run.summary[key] for key in same}


def test_json_is_the_summary_and_nothing_else(json_of):
    found = json_of("track", "push.mcap", "--out", "here", "--smoother", "batch")
    assert found == read("here/summary.json")
    assert (found["frames"], found["tactile"], found["smoother"]) == (40, "none", "batch")
    assert (found["episodes"], found["contact_frames"], found["scored_frames"]) == (2, 23, 40)


def test_the_folder_of_a_run_says_why_it_is_ambiguous(succeeds):
    out = succeeds("track", "push.mcap", "--first-pose-sigma", "0.02", "0.02", "0.3", "--html", "--all")
    with Path("runs/push/estimates.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "ambiguous"]
    # The first pose is known roughly, and nobody shoves the object or doubts how images lie.
    assert rows and all("rough start" in row["origins"] for row in rows)
    assert all("first pose that is known roughly (" in row["reason"] for row in rows)
    assert read("runs/push/summary.json")["ambiguous_by_origin"] == {"rough start": 1.0}
    assert "ambiguous_by_origin rough start 1" in map(words, out.splitlines())
    assert "100%  a first pose that is known roughly" in Path("runs/push/page.html").read_text(encoding="utf-8")


def test_options_reach_the_tracker(succeeds):
    pose = ("--first-pose", "0.001", "0", "-.5", "--first-pose-sigma", "0.02", "0.03", "0.2")
    Path("noise.json").write_text(
        '{"format": "palpate-noise", "version": 4, "noise": {"contact": {"deviation": 2e-3}}}'
    )
    out = succeeds("track", "blind.mcap", "--noise", "noise.json", *pose, "--hypotheses", "1")
    settings = read("runs/blind/settings.json")
    assert (settings["noise"]["contact"]["deviation"], settings["hypotheses"]) == (2e-3, 1)
    assert settings["first_pose"] == [0.001, 0.0, -0.5]
    assert settings["first_pose_sigma"] == [0.02, 0.03, 0.2]
    assert "error" not in out  # there is no truth to score by


def test_a_first_pose_that_is_unknown(succeeds, fails):
    succeeds("track", "--first-pose-unknown", "blind.mcap")
    settings = read("runs/blind/settings.json")
    assert (settings["first_pose"], settings["first_pose_sigma"]) == ([0.0, 0.0, 0.0], [1.0, 1.0, 2.0])
    for option in ("--first-pose", "--first-pose-sigma"):
        error = fails("track", "push.mcap", "--first-pose-unknown", option, "1", "1", "1")
        assert "--first-pose-unknown cannot be combined with" in error and option in error


def test_the_choice_of_touch_is_reported(json_of, succeeds):
    assert "contact only (there are no images)" in succeeds("track", "push.mcap")
    found = json_of("track", "push.mcap", "--force")
    assert (found["tactile"], found["tactile_reason"]) == ("none", "there are no images")
    assert "there are no images" not in succeeds("track", "push.mcap", "--tactile", "none", "--force")


def test_tracking_begins_at_the_first_known_truth():
    recording = pushed(10)
    recording.object_pose[:2] = np.nan
    seen: list[int] = []
    run = palpate.track(recording, progress=seen.append)
    assert run.first_pose.tolist() == recording.object_pose[2].tolist()
    assert seen == list(range(1, 11))


def test_a_frame_that_cannot_be_used_repeats_the_estimate(caplog):
    recording = pushed()
    recording.sensor_pose[7:15:2, 0] += 3.0  # faster than any arm
    run = palpate.track(recording)
    status = np.array(run.online.status)
    assert (status == "faulty").sum() == 4 and len(run.online) == 40
    assert run.online.pose[7].tolist() == run.online.pose[6].tolist()
    assert sum("is skipped" in record.message for record in caplog.records) == 4
    assert len(run.summary["warnings"]) == 4 and run.summary["final_status"] == status[-1]


def test_a_damaged_image_is_a_faulty_frame(run_palpate, caplog, monkeypatch):
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    made = seen(pushed())
    images = [data[: len(data) // 2] if index in (0, 9, 25) else data for index, data in enumerate(made.image)]
    palpate.write_recording(replace(made, image=tuple(images)), "torn.mcap")
    code, out, err = run_palpate("track", "torn.mcap", "--tactile", "none", "--json", "--view")
    assert code == 0, err
    assert opened == [Path("runs/torn/page.html").resolve().as_uri()] and Path("runs/torn/page.html").exists()
    assert json.loads(out)["statuses"]["faulty"] == 3
    assert all(f"torn.mcap: image of frame {index}: " in caplog.text for index in (0, 9, 25))
    assert len(table("runs/torn/estimates.csv")) == 40
    found = json.loads(run_palpate("info", "torn.mcap", "--json")[1])["findings"]
    assert [one["kind"] for one in found if one["kind"] == "image"] == ["image"] * 3


@pytest.mark.parametrize(
    "error", [palpate.EstimationError("no solution"), KeyboardInterrupt(), ZeroDivisionError("bug")]
)
def test_a_run_that_fails_leaves_what_it_had(run_palpate, succeeds, monkeypatch, error):
    update = palpate.Tracker.update

    def failing(tracker: palpate.Tracker, frame: palpate.Frame) -> palpate.Estimate:
        if frame.time > 0.8:
            raise error
        return update(tracker, frame)

    monkeypatch.setattr(palpate.Tracker, "update", failing)
    is_interrupt = isinstance(error, KeyboardInterrupt)
    words = ("track", "push.mcap", "--mcap", *["--html"] * is_interrupt)  # a page takes its time
    if isinstance(error, ZeroDivisionError):
        with pytest.raises(ZeroDivisionError):
            run_palpate(*words)
    else:
        assert run_palpate(*words)[0] == (130 if is_interrupt else 2)
    found = read("runs/push/summary.json")
    assert found["frames"] == len(table("runs/push/estimates.csv")) == 25
    assert "after 25 of 40 frames" in found["ended"] and type(error).__name__ in found["ended"]
    files = {path.name for path in Path("runs/push").iterdir()}
    assert {"figure.png", "estimates.mcap"} <= files and ("page.html" in files) == is_interrupt


def test_a_matplotlib_that_fails_does_not_lose_the_run(run_palpate, monkeypatch):
    monkeypatch.setattr("matplotlib.rcdefaults", lambda: 1 / 0)
    assert run_palpate("track", "push.mcap")[0] == 0 and Path("runs/push/summary.json").exists()


def test_times_below_zero_become_messages(succeeds):
    palpate.write_recording(replace(pushed(), time=pushed().time - 1e5), "before.mcap")
    succeeds("track", "before.mcap", "--mcap")
    assert table("runs/before/estimates.csv")["time"][0] == -1e5 and Path("runs/before/estimates.mcap").exists()


def test_force_replaces_nothing_but_a_run(fails, json_of, run_palpate):
    json_of("track", "push.mcap")
    before = Path("runs/push/summary.json").read_text()
    assert "already exists; --force" in fails("track", "push.mcap", "--smoother", "batch")
    assert Path("runs/push/summary.json").read_text() == before
    assert json_of("track", "push.mcap", "--smoother", "batch", "--force")["smoother"] == "batch"
    Path("runs/push/thesis.tex").write_text("years of work")
    assert "holds 'thesis.tex'" in fails("track", "push.mcap", "--force")
    assert Path("runs/push/thesis.tex").exists()
    assert "is a file" in fails("track", "push.mcap", "--out", "blind.mcap", "--force")
    assert "not the name of a new folder" in fails("track", "push.mcap", "--out", "/")
    Path("runs/push/thesis.tex").unlink()
    Path("link").symlink_to("runs/push")
    assert json_of("track", "push.mcap", "--out", "link", "--force")["smoother"] == "fixed-lag"
    assert Path("link").is_symlink() and '"fixed-lag"' in Path("runs/push/summary.json").read_text()
    code, _, err = run_palpate("track", "push.mcap", Path("push.mcap").absolute(), "--out", "twice", "--force")
    assert code == 3 and "twice/push: already exists" in err  # the run of the first stays


def test_several_files_give_a_folder_each(run_palpate):
    palpate.write_recording(pushed(), "again.mcap")
    code, out, err = run_palpate("track", "push.mcap", "blind.mcap", "again.mcap", "--out", "all", "--json")
    assert code == 3 and err.startswith("palpate: blind.mcap: has no ground truth") and err.count("\n") == 1
    runs = json.loads(out)["runs"]
    assert list(runs) == [str(Path("all/push")), str(Path("all/again"))]
    assert (
        runs["all/push"] == read("all/push/summary.json")
        and {path.name for path in Path("all/again").iterdir()} == FILES
    )
    code, out, _ = run_palpate("track", "push.mcap", "again.mcap")
    assert code == 0 and all(str(Path("runs", name)) in out for name in ("push", "again"))
    assert "a recording or several" in run_palpate("track")[2]


def test_a_run_that_cannot_be_written_leaves_the_old_one(fails, json_of, monkeypatch):
    old = json_of("track", "push.mcap")

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("palpate.pipeline.run_folder.write_estimates_csv", full)
    assert "no space left" in fails("track", "push.mcap", "--force")
    assert read("runs/push/summary.json") == old
    assert [path.name for path in Path("runs").iterdir()] == ["push"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["blind.mcap"], "--first-pose X Y THETA"),
        (["blind.mcap", "--tactile", "oracle", "--first-pose", 0, 0, 0], "no ground truth, which tactile oracle"),
        (["push.mcap", "--tactile", "learnt"], "has no images, which tactile learnt needs"),
        (["push.mcap", "--noise", "loud"], "'palpate' or a file"),
        (["push.mcap", "--hypotheses", 0], "hypotheses is 0"),
        (["push.mcap", "--first-pose-sigma", 0, 1, 1], "it must be three numbers above 0"),
        (["push.mcap", "--tactile", "none", "--model", "m"], "--model m is not used with --tactile none"),
        (["push.mcap", "--time-offset", "-0.1"], "is no bag but a recording"),
        (["push.mcap", "--shape", "disc"], "push.mcap: is no bag but a recording"),
        ([__file__, "--shape", "disc"], "is in no known format"),
        (["/dev/zero"], "/dev/zero: is a pipe or a device, expected a file"),
        (["pipe.mcap"], "pipe.mcap: is a pipe or a device, expected a file"),
    ],
)
def test_bad_input_is_one_line(fails, options, message):
    os.mkfifo("pipe.mcap")  # which nobody writes to
    assert message in fails("track", *options)
    assert not Path("runs").exists()
