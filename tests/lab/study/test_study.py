import dataclasses
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.config import PUBLISHED, ContactSettings, NoiseSettings, TrackerSettings
from palpate.errors import EstimationError, FileError, SettingError
from palpate.geometry.shapes import Disc
from palpate.io.recording_mcap import write_recording
from palpate.lab.study import job as study_job
from palpate.lab.study import study as study_module
from palpate.lab.study.comparison import Figures, Scores, check_common, compare, read_scores
from palpate.lab.study.files import find_recordings, group_of
from palpate.lab.study.job import StudySettings, do_job, slid, trial_of
from palpate.lab.study.results import ALL, flat, recovered, results_of, table, write_results
from palpate.lab.study.study import DIED, run_study
from palpate.lab.study.trial import Method, Trial, read_trial
from palpate.pipeline.track import track

NONE, ORACLE, LEARNT = (Method(tactile, "fixed-lag") for tactile in ("none", "oracle", "learnt"))
SETTINGS = StudySettings((NONE, ORACLE))
NAMES = ("disc-1.mcap", "disc-2.mcap", "edges-1.mcap", "edges-2.mcap")


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own, where `recordings` holds NAMES."""
    monkeypatch.chdir(tmp_path)
    Path("recordings").mkdir()
    for index, name in enumerate(NAMES):
        write_recording(pushed(20 + index), Path("recordings") / name)


def study(settings: StudySettings = SETTINGS, out: str = "out", **options: Any) -> Any:
    return run_study(find_recordings(Path("recordings")), Path(out), settings, **options)


def contents(folder: str) -> dict[str, Any]:
    """Return the files of a folder and when they were written."""
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in Path(folder).rglob("*") if p.is_file()}


def dies(job: Any, settings: Any, model: Any) -> Any:
    """Do a job, but one takes the process with it."""
    if job.name == "disc-2.mcap":
        os._exit(9)
    return do_job(job, settings, model)


def dies_once(job: Any, settings: Any, model: Any) -> Any:
    """Do a job, but the first process that is at one of them dies."""
    died = job.path.parent / "died"
    if job.name == "disc-2.mcap" and not died.exists():
        died.touch()
        os._exit(9)
    return do_job(job, settings, model)


def stumbles(*given: Any, **options: Any) -> Any:
    """Track, but recordings of 21 frames cannot be tracked to the end by the oracle, and those of 22 show a fault."""
    recording, settings, *_ = given
    if len(recording) == 21 and settings.tactile == "oracle":
        raise EstimationError("frame at 0.300 s: the graph\n cannot be solved")
    if len(recording) == 22:
        raise ZeroDivisionError("division by zero")
    return track(*given, **options)


def trial(final_mm: float, method: Method = NONE, group: str = "disc", name: str = "", **summary: Any) -> Trial:
    """Return a trial of four frames, from the second on in contact and off by `final_mm`, sigma 1 mm and 1 mrad."""
    pose = np.zeros((4, 3))
    pose[1:, 0] = final_mm * 1e-3
    told = {
        "scored_frames": 4,
        "final_translation_error_mm": final_mm,
        "final_rotation_error_deg": 1.0,
        "translation_rmse_mm": 0.5 * final_mm,
        "rotation_rmse_deg": 0.5,
        "step_ms": {"p50": final_mm, "p95": 2.0 * final_mm, "p99": 3.0 * final_mm},
    }
    return Trial(
        recording=name or f"{group}-{final_mm:g}.mcap",
        group=group,
        method=method,
        time=np.arange(4.0),
        truth=np.zeros((4, 3)),
        pose=pose,
        covariance=np.broadcast_to(1e-6 * np.eye(3), (4, 3, 3)),
        contact=np.array([False, True, True, False]),
        sensor_pose=np.zeros((4, 3)),
        slid=np.zeros(4),
        step_ms=np.ones(4),
        summary=told | summary,
    )


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("rectangle-edges-1100000.mcap", "rectangle-edges"),
        ("disc_12.mcap", "disc"),
        ("run 3.json.gz", "run"),
        ("t-edges.mcap", "t-edges"),
        ("0007.mcap", "0007"),
        ("mit/StraightLine3.json.gz", "mit"),
        ("real/cmu/log-1.txt", "real/cmu"),
    ],
)
def test_group_is_the_folder_or_the_name_without_its_number(name, group):
    assert group_of(name) == group


def test_recordings_are_found_in_folders_and_told_from_other_files(shared_data):
    mit = next((shared_data / "mit_point_push").glob("*.gz"))
    cmu = next((shared_data / "cmu_two_finger").glob("*.txt"))
    for source, copy in ((mit, "mit/a.json.gz"), (cmu, "cmu/b.txt")):
        (Path("recordings") / copy).parent.mkdir()
        shutil.copy(source, Path("recordings") / copy)
    for name in ("notes.txt", "model.npz", ".hidden.mcap", "x.csv", ".git/y.mcap", "out/z.mcap"):
        path = Path("recordings") / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("something")
    (Path("recordings") / "settings.json").write_text('{"seed": 1}')
    (Path("recordings") / "path.tum").write_text("0 0 0 0 0 0 0 1\n")
    found = find_recordings(Path("recordings"), leave_out=Path("recordings/out"))
    assert list(found) == ["cmu/b.txt", *NAMES, "mit/a.json.gz"]
    for name in ("cut.json", "empty.json", "no.mcap"):  # these are named as broken
        (Path("recordings") / name).write_text("" if name == "empty.json" else '{"q_sliderJS')
    found = find_recordings(Path("recordings"))
    assert {"cut.json", "empty.json", "no.mcap", "out/z.mcap"} < set(found)


def test_a_folder_without_recordings_is_an_error():
    Path("other").mkdir()
    with pytest.raises(FileError, match="other: holds no recordings"):
        find_recordings(Path("other"))
    with pytest.raises(FileError, match="nowhere: no such folder"):
        find_recordings(Path("nowhere"))


def test_a_study_tracks_each_recording_in_each_way_as_track_does():
    done: list[int] = []
    found = study(progress=done.append)
    assert done == [2, 4, 6, 8]
    assert [(each.recording, each.method) for each in found.trials] == [(n, m) for n in NAMES for m in SETTINGS.methods]
    assert (found.kept, found.skipped, found.failed, found.broken) == (0, {}, {}, {})
    facts = {"group": "edges", "frames": 23, "images": False, "truth": True, "source": ""}
    assert facts.items() < found.recordings["edges-2.mcap"].items()
    assert found.recordings["edges-2.mcap"]["seconds"] == pytest.approx(22 / 30)
    assert found.recordings["edges-2.mcap"]["shape"]["type"] == "rectangle"
    alone: Any = track(pushed(23), TrackerSettings(tactile="oracle"))
    last = found.trials[-1]
    assert np.array_equal(last.pose, alone.online.pose) and np.array_equal(last.truth, alone.recording.object_pose)
    assert np.array_equal(last.covariance, alone.online.covariance)
    assert last.summary["translation_rmse_mm"] == alone.summary["translation_rmse_mm"]
    kept = read_trial(Path("out/trials/oracle/edges-2.mcap.npz"))
    assert np.array_equal(kept.pose, last.pose) and kept.summary == last.summary
    assert sorted(path.name for path in Path("out").iterdir()) == ["study.json", "trials"]


def test_two_workers_find_what_one_finds():
    one, two = study(out="one"), study(out="two", workers=2)
    assert [trial.recording for trial in one.trials] == [trial.recording for trial in two.trials]
    for here, there in zip(one.trials, two.trials, strict=True):
        assert np.array_equal(here.pose, there.pose) and np.array_equal(here.covariance, there.covariance)
    assert one.recordings == two.recordings


def test_what_a_recording_lacks_is_skipped_and_told():
    blind = dataclasses.replace(pushed(20), object_pose=None)
    write_recording(blind, "recordings/blind-1.mcap")
    methods = (NONE, ORACLE, LEARNT)
    found = study(StudySettings(methods))
    reasons = {method.tactile: why for (name, method), why in found.skipped.items() if name == "blind-1.mcap"}
    assert set(reasons) == {"none", "oracle", "learnt"}
    assert reasons["none"].startswith("has no ground truth to start from")
    assert found.skipped["disc-1.mcap", LEARNT] == "has no images, which tactile learnt needs"
    assert len(found.trials) == 8 and found.failed == found.broken == {}
    # With a first pose it is tracked, though not scored; the others go on from their ground truth.
    found = study(StudySettings(methods, first_pose=(0.0, 0.0, 3.0)), out="posed")
    reasons = {method.tactile: why for (name, method), why in found.skipped.items() if name == "blind-1.mcap"}
    assert set(reasons) == {"oracle", "learnt"} and reasons["oracle"].startswith("has no ground truth, which")
    alone = next(each for each in found.trials if each.recording == "blind-1.mcap")
    assert alone.pose[0].tolist() == [0.0, 0.0, 3.0] and np.isnan(alone.truth).all()
    assert alone.summary["in_95_final"] is alone.summary["in_95_share"] is None
    assert not found.recordings["blind-1.mcap"]["truth"]
    rows = table(found.trials, methods)
    assert (rows["blind"]["none"]["sequences"], rows["blind"]["none"]["unscored"]) == (0, 1)
    assert rows["blind"]["none"]["final_mm"] == {"median": None, "p75": None, "worst": None}
    assert (rows[ALL]["none"]["sequences"], rows[ALL]["none"]["unscored"]) == (4, 1)
    first = next(each for each in found.trials if each.recording == "disc-1.mcap")
    assert np.array_equal(first.pose[0], pushed(20).object_pose[0])


def test_broken_recordings_do_not_stop_the_others():
    cut = Path("recordings/disc-2.mcap")
    cut.write_bytes(cut.read_bytes()[:5000])
    Path("recordings/edges-0.mcap").write_text("")
    found = study()
    assert set(found.broken) == {"disc-2.mcap", "edges-0.mcap"} and len(found.trials) == 6
    assert found.broken["edges-0.mcap"] == "is empty" and "cut off or damaged" in found.broken["disc-2.mcap"]
    assert "disc-2.mcap" not in found.recordings


def test_failures_of_tracking_are_told_for_each_way(monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(study_job, "track", stumbles)
        found = study()
    assert found.failed == {
        ("disc-2.mcap", ORACLE): "frame at 0.300 s: the graph cannot be solved",
        ("edges-1.mcap", NONE): "ZeroDivisionError: division by zero",
        ("edges-1.mcap", ORACLE): "ZeroDivisionError: division by zero",
    }
    assert len(found.trials) == 5
    again = study(resume=True)  # what failed is tried again
    assert (again.failed, again.kept, len(again.trials)) == ({}, 5, 8)


def test_an_interrupted_study_goes_on_where_it_was():
    def stop(done: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study(progress=stop)
    before = contents("out")
    assert len(before) == 5  # study.json and two trials of two recordings
    Path("out/trials/none/.disc-1.mcap.npz.01234567.part").write_bytes(b"half")
    Path("out/trials/oracle/disc-2.mcap.npz").write_bytes(b"cut")
    with pytest.raises(FileError, match=r"out: is not empty; --resume goes on"):
        study()
    done: list[int] = []
    found = study(resume=True, progress=done.append)
    assert (found.kept, len(found.trials), done) == (3, 8, [4, 6, 8])
    after = contents("out")
    unchanged = {name for name in before if after[name] == before[name]}
    assert unchanged == {"trials/none/disc-1.mcap.npz", "trials/oracle/disc-1.mcap.npz", "trials/none/disc-2.mcap.npz"}
    assert len(after) == 9
    # More ways and recordings may come later; what is there stays.
    write_recording(pushed(30), "recordings/new-1.mcap")
    found = study(StudySettings((NONE, Method("constant", "fixed-lag"))), resume=True)
    assert (found.kept, len(found.trials), len(found.recordings)) == (4, 10, 5)


def test_a_study_goes_on_with_the_same_settings_and_files_only():
    study()
    noise = NoiseSettings(contact=ContactSettings(2e-3))
    said = r"out: was made with other settings \(noise contact deviation was 0.001, is 0.002\)"
    with pytest.raises(SettingError, match=said):
        study(dataclasses.replace(SETTINGS, noise=noise), resume=True)
    with pytest.raises(SettingError, match=r"pressure was 'uniform', is 0.03"):
        study(dataclasses.replace(SETTINGS, pressure=0.03), resume=True)
    with pytest.raises(SettingError, match=r"hypotheses was 9, is 1"):
        study(dataclasses.replace(SETTINGS, hypotheses=1), resume=True)
    with pytest.raises(SettingError, match=r"first_pose_sigma was None, is \[1.0, 1.0, 2.0\]"):
        study(dataclasses.replace(SETTINGS, first_pose_sigma=(1.0, 1.0, 2.0)), resume=True)
    with pytest.raises(SettingError, match=r"first_pose_of_all was False, is True"):
        study(dataclasses.replace(SETTINGS, first_pose_of_all=True), resume=True)
    index = json.loads(Path("out/study.json").read_text())
    for option in ("hypotheses", "first_pose_sigma", "first_pose_of_all"):
        del index["made_with"][option]  # as of earlier versions, which had none of them
    Path("out/study.json").write_text(json.dumps(index))
    with pytest.raises(SettingError, match=r"hypotheses was 9, is 1"):
        study(dataclasses.replace(SETTINGS, hypotheses=1), resume=True)
    assert study(resume=True).kept == 8
    write_recording(pushed(40), "recordings/disc-1.mcap", overwrite=True)
    with pytest.raises(SettingError, match=r"disc-1.mcap: has changed since it was tracked for out"):
        study(resume=True)
    Path("other").mkdir()
    Path("other/thing").touch()
    with pytest.raises(FileError, match="other: is not the folder of a study"):
        study(out="other", resume=True)
    Path("other/study.json").write_text('{"format": "palpate-study", "version": 2}')
    with pytest.raises(FileError, match=r"format is 'palpate-study' of version 2, expected"):
        study(out="other", resume=True)
    Path("other/study.json").write_text('{"format": "palpate-study", "version": 1}')
    with pytest.raises(FileError, match=r"study.json: lacks made_with or recordings"):
        study(out="other", resume=True)
    with pytest.raises(FileError, match=r"thing: cannot be written"):
        study(out="other/thing")


def test_settings_that_cannot_be():
    with pytest.raises(SettingError, match="workers is 0"):
        study(workers=0)
    with pytest.raises(SettingError, match=r"first pose is .*nan"):
        study(dataclasses.replace(SETTINGS, first_pose=(0.0, float("nan"), 0.0)))
    with pytest.raises(SettingError, match=r"first pose sigma is \[0.0, 1.0, 1.0\]; it must be three numbers above 0"):
        study(dataclasses.replace(SETTINGS, first_pose_sigma=(0.0, 1.0, 1.0)))
    with pytest.raises(SettingError, match="hypotheses is 0; allowed is a whole number from 1 on"):
        study(dataclasses.replace(SETTINGS, hypotheses=0))
    assert not Path("out").exists()


def test_settings_reach_the_tracker():
    settings = StudySettings((Method("constant", "isam2"),), PUBLISHED, 0.03)
    found = study(settings)
    alone = track(pushed(20), TrackerSettings("constant", "isam2", PUBLISHED, pressure=0.03))
    assert np.array_equal(found.trials[0].pose, alone.online.pose)
    assert Path("out/trials/constant+isam2/disc-1.mcap.npz").exists()
    found = study(StudySettings((NONE,), first_pose_sigma=(0.01, 0.02, 0.1)), out="rough")
    alone: Any = track(pushed(20), TrackerSettings("none"), first_pose_sigma=(0.01, 0.02, 0.1))
    assert np.array_equal(found.trials[0].covariance, alone.online.covariance)  # from its ground truth
    assert np.array_equal(found.trials[0].pose[0], pushed(20).object_pose[0])
    found = study(StudySettings((NONE,), first_pose=(0.0, 0.0, 3.0), first_pose_of_all=True), out="posed")
    assert {tuple(trial.pose[0]) for trial in found.trials} == {(0.0, 0.0, 3.0)}
    found = study(StudySettings((NONE,), hypotheses=1), out="one")
    alone = track(pushed(20), TrackerSettings("none", hypotheses=1))
    assert np.array_equal(found.trials[0].pose, alone.online.pose)
    assert np.array_equal(found.trials[0].covariance, alone.online.covariance)
    write_recording(pushed(20, shape=Disc(0.09)), "recordings/round-1.mcap")
    found = study(StudySettings((NONE,), pressure="corner"), out="corner")
    assert "pressure of a disc is 'corner'" in found.skipped["round-1.mcap", NONE]


def test_a_worker_that_dies_takes_its_recording_only(monkeypatch, caplog):
    monkeypatch.setattr(study_module, "do_job", dies)
    found = study(workers=2)
    assert found.failed == {("disc-2.mcap", NONE): DIED, ("disc-2.mcap", ORACLE): DIED}
    assert [trial.recording for trial in found.trials] == [name for name in NAMES if "disc-2" not in name for _ in "ab"]
    assert "a process died" in caplog.text
    assert not list(Path("out").rglob(".*.part"))


def test_a_worker_that_dies_once_costs_nothing(monkeypatch):
    monkeypatch.setattr(study_module, "do_job", dies_once)
    found = study(workers=2)
    assert found.failed == {} and len(found.trials) == 8 and Path("recordings/died").exists()


def test_a_cluster_finds_the_same_and_may_lose_workers(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install palpate[cluster]")
    import dask.config

    here = study(out="here")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": "127.0.0.1:0"}
    quiet = {"silence_logs": "CRITICAL"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options, **quiet) as cluster,
    ):
        there = study(out="there", dask=cluster.scheduler_address)
        monkeypatch.setattr(study_module, "do_job", dies)
        lost = study(out="lost", dask=cluster.scheduler_address)
    assert [trial.recording for trial in there.trials] == [trial.recording for trial in here.trials]
    assert all(np.array_equal(a.pose, b.pose) for a, b in zip(here.trials, there.trials, strict=True))
    assert set(lost.failed) == {("disc-2.mcap", NONE), ("disc-2.mcap", ORACLE)} and len(lost.trials) == 6


def test_slid_is_the_way_in_contact_back_and_forth():
    recording = dataclasses.replace(
        pushed(20),
        time=np.arange(20) / 10,
        contact=np.arange(20) >= 2,
        extra={"slip": np.array([5.0, 5.0, 0.01, -0.02, *np.zeros(16)])},
    )
    # 0.1 s at 10 mm/s one way, then 0.1 s at 20 mm/s back.
    assert slid(recording)[:6] == pytest.approx([0.0, 0.0, 0.001, 0.003, 0.003, 0.003])
    found = trial_of(track(recording), "a.mcap", NONE)
    assert found.summary["slid_mm"] == pytest.approx(3.0)
    assert np.isnan(slid(pushed(20))).all()
    assert trial_of(track(pushed(20)), "a.mcap", NONE).summary["slid_mm"] is None


def test_coverage_of_contact_rests_and_final_poses_by_hand():
    # Sigma 1 mm: 1 mm is a NEES of 1, 3 mm one of 9. Frames 1 and 2 are in contact, 3 at rest.
    trials = [trial(1.0), trial(3.0), trial(4.0)]
    trials[1].pose[1] = 0.0
    trials[2].pose[3] = 0.0
    row = table(trials, (NONE,))["disc"]["none"]
    # In contact 2, 1 and 0 of two; at rest and at the end all but one; before the first contact nothing counts.
    assert row["contact_inside_95"] == pytest.approx(3 / 6)
    assert row["rest_inside_95"] == row["final_inside_95"] == pytest.approx(2 / 3)
    assert row["inside_95"] == pytest.approx(5 / 9)
    untouched = dataclasses.replace(trial(2.0), contact=np.zeros(4, bool))
    row = table([untouched], (NONE,))["disc"]["none"]
    assert {row[f"{kind}inside_95"] for kind in ("", "contact_", "rest_", "final_")} == {None}


def knocks(*taken_and_until):
    """Return a summary's part about knocks, each with seconds in contact until recovery and until the next one."""
    taken, until = zip(*taken_and_until, strict=True)
    return {"knocks": len(taken), "knock_recovery_contact_s": list(taken), "knock_contact_s": list(until)}


def test_recovery_and_silence_in_the_table_by_hand():
    knocked = [
        trial(1.0, silently_wrong_share=0.2, silently_wrong_unfelt_share=0.1, **knocks((0.5, 4.0), (2.0, 2.5))),
        trial(2.0, silently_wrong_share=0.0, **knocks((2.1, 3.0))),
        trial(3.0),  # of an earlier version, which did not tell
    ]
    row = table(knocked, (NONE,))["disc"]["none"]
    assert (row["silently_wrong"], row["silently_wrong_unfelt"], row["knocks"]) == (pytest.approx(0.1), 0.1, 3)
    assert (row["recovery_contact_s"], row["recovered_in_2s"]) == (2.0, pytest.approx(2 / 3))


def test_ambiguous_frames_are_a_share_of_all_frames_in_contact():
    told = [
        trial(1.0, ambiguous_share=0.5, contact_frames=10),
        trial(2.0, ambiguous_share=0.0, contact_frames=30, scored_frames=0),  # it takes no truth to tell
        trial(3.0, ambiguous_share=None, contact_frames=0),
        trial(4.0, contact_frames=50),  # of an earlier version, which did not tell
    ]
    assert table(told, (NONE,))["disc"]["none"]["ambiguous"] == pytest.approx(5 / 40)
    assert table(told[2:], (NONE,))["disc"]["none"]["ambiguous"] is None
    assert flat(told[0])["ambiguous_share"] == 0.5


def test_recovery_by_hand_where_a_knock_is_not_followed_to_the_end():
    assert recovered([knocks((0.5, 3.0), (1.5, 3.0))]) == {"recovery_contact_s": 0.5, "recovered_in_2s": 1.0}
    assert recovered([knocks((1.0, 3.0), (None, 3.0))]) == {"recovery_contact_s": 1.0, "recovered_in_2s": 0.5}
    assert recovered([knocks((None, 3.0))]) == {"recovery_contact_s": None, "recovered_in_2s": 0.0}
    assert recovered([]) == {"recovery_contact_s": None, "recovered_in_2s": None}
    # Nobody knows of 2 s where half of the knocks are followed up to 1 s only.
    assert recovered([knocks((0.5, 3.0), (None, 1.0))]) == {"recovery_contact_s": 0.5, "recovered_in_2s": None}
    # Of four, one recovers at 0.5 s; two are followed up to 1 s only, and the last recovers at 1.5 s: 1 - 3/4 * 0.
    assert recovered([knocks((0.5, 3.0), (None, 1.0), (None, 1.0), (1.5, 3.0))])["recovered_in_2s"] == 1.0
    # Of three, one is followed up to 0.1 s; one of the two others recovers.
    assert recovered([knocks((None, 0.1)), knocks((1.0, 3.0)), knocks((None, 9.0))])["recovered_in_2s"] == 0.5


def errors_then(*errors: float | None) -> dict[str, Any]:
    """Return a summary's errors [mm] half a second after each knock; they are known then only."""
    unknown = [None] * len(errors)
    return {"knock_error_mm": {"0.5": [*errors], "1": unknown, "1.5": unknown, "2": unknown, "3": unknown}}


def test_errors_after_knocks_are_pooled_over_all_knocks():
    trials = [trial(1.0, **errors_then(9.0, 1.0, None)), trial(2.0, **errors_then(2.0)), trial(3.0), trial(4.0, ORACLE)]
    rows = table(trials, (NONE, ORACLE))["disc"]
    # Three are known; the median of the recordings' medians would be 3.5.
    assert rows["none"]["error_after_knock_mm"] == {"0.5": 2.0, "1": None, "1.5": None, "2": None, "3": None}
    assert set(rows["oracle"]["error_after_knock_mm"].values()) == {None}
    row = flat(trials[0])
    assert (row["error_after_knock_mm_0.5"], row["error_after_knock_mm_3"]) == (5.0, None)
    assert "knock_error_mm" not in row


def test_knocks_that_nothing_tells_of():
    knocked = [trial(3.0)] * 3
    row = table(knocked[2:], (NONE,))["disc"]["none"]
    assert (row["silently_wrong"], row["knocks"], row["recovered_in_2s"]) == (None, 0, None)


def test_table_by_hand():
    turned = {1.0: 7.0, 2.0: 8.0, 3.0: 5.0, 60.0: 20.0}
    trials = [trial(mm, final_rotation_error_deg=deg) for mm, deg in turned.items()] + [
        trial(4.0, group="edges"),
        trial(9.0, ORACLE),
    ]
    rows = table(trials, (NONE, ORACLE))
    assert list(rows) == ["disc", "edges", ALL] and list(rows["disc"]) == ["none", "oracle"]
    row = rows["disc"]["none"]
    assert row["sequences"] == 4 and row["lost"] == 1
    # A quarter of the way from 3 to 60 mm is 17.25 mm.
    assert row["final_mm"] == pytest.approx({"median": 2.5, "p75": 17.25, "worst": 60.0})
    assert row["final_deg"] == pytest.approx({"median": 7.5, "p75": 11.0, "worst": 20.0})
    assert (row["rmse_mm"], row["rmse_deg"]) == pytest.approx((1.25, 0.5))
    # NEES of 1, 4, 9 and 3600, three frames each; the first two are inside.
    assert row["nees"] == pytest.approx({"median": 6.5, "mean": 903.5})
    assert (row["inside_95"], row["final_inside_95"]) == (0.5, 0.5)
    assert row["step_ms"] == pytest.approx({"p50": 2.5, "p95": 5.0, "p99": 7.5})
    assert rows[ALL]["none"]["sequences"] == 5 and rows[ALL]["none"]["final_mm"]["median"] == pytest.approx(3.0)
    assert list(rows["edges"]) == ["none"]
    assert table([], (NONE,)) == {}
    for yaw_shows, lost in ((True, 1), (False, 0)):
        turned = trial(1.0, final_rotation_error_deg=31.0, yaw_shows=yaw_shows)
        assert table([turned], (NONE,))["disc"]["none"]["lost"] == lost


def test_results_hold_everything_as_plain_data():
    Path("recordings/edges-0.mcap").write_text("")
    settings = StudySettings((NONE, LEARNT))
    found = study(settings)
    found.trials[0].summary["final_translation_error_mm"] = 51.0
    results = results_of(found, settings, None, Path("recordings"), 1, "palpate evaluate")
    write_results(Path("out"), results, found.trials)
    read = json.loads(Path("out/results.json").read_text())
    assert read == json.loads(json.dumps(results))
    counts = {"recordings": 4, "trials": 4, "skipped": 4, "failed": 0, "broken": 1, "kept": 0}
    assert counts.items() < read["study"].items()
    assert [(each["recording"], each["method"], each["final_mm"]) for each in read["lost"]] == [
        ("disc-1.mcap", "none", 51.0)
    ]
    assert read["broken"] == [{"recording": "edges-0.mcap", "error": "is empty"}]
    assert read["skipped"][0]["method"] == "learnt"
    assert (read["settings"]["noise_preset"], read["settings"]["noise"]["contact"]["deviation"]) == ("palpate", 1e-3)
    lines = Path("out/sequences.csv").read_text().splitlines()
    assert len(lines) == 5 and lines[0].startswith("recording,group,tactile,smoother,lost,frames")
    assert lines[1].startswith("disc-1.mcap,disc,none,fixed-lag,True,20")
    assert {"in_95_contact_share", "in_95_rest_share", "in_95_final", "silently_wrong_share", "knocks"} < set(
        lines[0].split(",")
    )
    knocked = flat(trial(1.0, **knocks((1.0, 4.0), (3.0, 4.0))))
    assert (knocked["recovery_contact_s"], knocked["recovered_in_2s"]) == (1.0, 0.5)
    assert "knock_recovery_contact_s" not in knocked


def test_comparison_by_hand():
    def finals(mm: float, deg: float, name: str) -> Trial:
        return trial(mm, name=name, final_rotation_error_deg=deg, translation_rmse_mm=mm / 4)

    before: Scores = {
        (f"{name}.mcap", NONE): {"final_mm": mm, "final_deg": deg, "rmse_mm": mm / 4, "rmse_deg": 0.5}
        for name, mm, deg in (("a", 4.0, 1.0), ("b", 4.0, 1.0), ("c", 4.0, 1.0), ("d", 4.0, 1.0), ("gone", 9.0, 9.0))
    }
    after = [finals(3.0, 1.5, "a.mcap"), finals(4.09, 0.91, "b.mcap"), finals(4.0, 3.0, "c.mcap")]
    after.append(finals(9.0, 1.0, "d.mcap"))
    after.append(finals(1.0, 1.0, "new.mcap"))
    found = compare(Path("old"), before, after)
    change = found["methods"]["none"]
    # a: a millimetre better, half a degree worse; b: the same; c and d: 2 degrees and 5 mm worse.
    assert [change[key] for key in ("sequences", "better", "same", "worse")] == [4, 1, 1, 2]
    assert [each["recording"] for each in change["improved"]] == ["a.mcap"]
    assert [each["recording"] for each in change["worsened"]] == ["d.mcap", "c.mcap"]
    assert change["improved"][0]["change"] == pytest.approx(-0.5)
    assert change["final_mm"] == pytest.approx({"before": 4.0, "after": 4.045})
    assert change["rmse_mm"] == pytest.approx({"before": 1.0, "after": 1.01125})
    assert len(found["sequences"]) == 4 and found["folder"] == "old"
    assert change["in_95_contact_share"] == {"before": None, "after": None}


def test_coverage_is_compared_where_both_studies_tell_it():
    told: list[Figures] = [{"in_95_final": 1.0, "recovery_contact_s": 3.0}, {"in_95_final": 0.0}, {"in_95_final": None}]
    errors: Figures = {"final_mm": 4.0, "final_deg": 1.0, "rmse_mm": 1.0, "rmse_deg": 0.5}
    before: Scores = {(f"{number}.mcap", NONE): errors | more for number, more in enumerate(told)}
    after = [trial(4.0, name=f"{number}.mcap", in_95_final=True, **knocks((number + 1.0, 9.0))) for number in range(3)]
    change = compare(Path("old"), before, after)["methods"]["none"]
    assert change["in_95_final"] == {"before": 0.5, "after": 1.0}
    assert change["recovery_contact_s"] == {"before": 3.0, "after": 1.0}
    assert change["in_95_rest_share"] == {"before": None, "after": None}


def test_scores_are_those_that_a_study_wrote():
    found = study()
    with pytest.raises(FileError, match="out: holds a study that is not done"):
        read_scores(Path("out"))
    results = results_of(found, SETTINGS, None, Path("recordings"), 1, "")
    write_results(Path("out"), results, found.trials)
    scores = read_scores(Path("out"))
    assert len(scores) == 8
    summary = found.trials[0].summary
    assert scores["disc-1.mcap", NONE]["final_mm"] == summary["final_translation_error_mm"]
    assert scores["disc-1.mcap", NONE]["in_95_contact_share"] == summary["in_95_contact_share"] is not None
    assert scores["disc-1.mcap", NONE]["in_95_final"] == summary["in_95_final"]
    assert scores["disc-1.mcap", NONE]["recovery_contact_s"] is None
    check_common(Path("out"), scores, ["disc-1.mcap", "x.mcap"], [NONE])
    for names, methods in ((["x.mcap"], [NONE]), (["disc-1.mcap"], [LEARNT])):
        with pytest.raises(SettingError, match="--against out: has no recording and method in common"):
            check_common(Path("out"), scores, names, methods)
    with pytest.raises(FileError, match="recordings: is not the folder of a study"):
        read_scores(Path("recordings"))
    old = "recording,tactile,smoother,final_translation_error_mm,final_rotation_error_deg,translation_rmse_mm"
    Path("out/sequences.csv").write_text(f"{old},rotation_rmse_deg\na.mcap,none,fixed-lag,1,2,3,4\n")
    scores = read_scores(Path("out"))["a.mcap", NONE]  # of a version that knew no coverage
    assert (scores["final_mm"], scores["rmse_deg"]) == (1.0, 4.0)
    assert scores["in_95_contact_share"] is scores["in_95_final"] is scores["silently_wrong_share"] is None
    Path("out/sequences.csv").write_text("recording,tactile\na,b\n")
    with pytest.raises(FileError, match=r"sequences.csv: is not a table of sequences"):
        read_scores(Path("out"))
