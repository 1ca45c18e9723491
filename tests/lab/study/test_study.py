"""Scores of a study worked out by hand, and processes that die."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate import write_recording
from palpate.lab.study import study as study_module
from palpate.lab.study.recordings import find_recordings, group_of
from palpate.lab.study.results import errors_after_knock, recovered, table, write_rows
from palpate.lab.study.study import run_study
from palpate.lab.study.trial import Method, StudySettings, Trial, track_recording

NONE, ORACLE = Method("none"), Method("oracle")
NAMES = ("disc-1.mcap", "disc-2.mcap", "edges-1.mcap", "edges-2.mcap")


def trial(final_mm: float, method: Method = NONE, group: str = "disc", name: str = "", **summary: Any) -> Trial:
    """Return a trial of four frames, in contact in the second and third, off by `final_mm` with a sigma of 1 mm."""
    pose = np.zeros((4, 3))
    pose[1:, 0] = final_mm * 1e-3
    scores = {
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
        nees=(1e3 * pose[:, 0]) ** 2,
        contact=np.array([False, True, True, False]),
        sensor_pose=np.zeros((4, 3)),
        step_ms=np.ones(4),
        summary=scores | summary,
    )


def knocks(*taken_and_until):
    """Return a summary of knocks, each with seconds in contact until recovery and until the next one."""
    taken, until = zip(*taken_and_until, strict=True)
    return {"knocks": len(taken), "knock_recovery_contact_s": list(taken), "knock_contact_s": list(until)}


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("rectangle-edges-1100000.mcap", "rectangle-edges"),
        ("disc_12.mcap", "disc"),
        ("run 3.json.gz", "run"),
        ("0007.mcap", "0007"),
        ("mit/StraightLine3.json.gz", "mit"),
        ("real/cmu/log-1.txt", "real/cmu"),
    ],
)
def test_group_is_the_folder_or_the_name_without_its_number(name, group):
    assert group_of(name) == group


def test_table_by_hand():
    turned = {1.0: 7.0, 2.0: 8.0, 3.0: 5.0, 60.0: 20.0}
    trials = [trial(mm, final_rotation_error_deg=deg) for mm, deg in turned.items()]
    rows = table([*trials, trial(4.0, group="edges"), trial(9.0, ORACLE)], (NONE, ORACLE))
    assert list(rows) == ["disc", "edges", "all groups"]
    assert [list(row) for row in rows.values()] == [["none", "oracle"], ["none"], ["none", "oracle"]]
    row = rows["disc"]["none"]
    assert (row["sequences"], row["lost"]) == (4, 1)
    # A quarter of the way from 3 to 60 mm is 17.25 mm.
    assert row["final_mm"] == pytest.approx({"median": 2.5, "p75": 17.25, "worst": 60.0})
    assert row["final_deg"] == pytest.approx({"median": 7.5, "p75": 11.0, "worst": 20.0})
    assert (row["rmse_mm"], row["rmse_deg"]) == pytest.approx((1.25, 0.5))
    # NEES of 1, 4, 9 and 3600, three frames each; the first two are inside.
    assert row["nees"] == pytest.approx({"median": 6.5, "mean": 903.5})
    assert (row["inside_95"], row["final_inside_95"]) == (0.5, 0.5)
    assert row["step_ms"] == pytest.approx({"p50": 2.5, "p95": 5.0, "p99": 7.5})
    assert rows["all groups"]["none"]["sequences"] == 5 and table([], (NONE,)) == {}


@pytest.mark.parametrize(("yaw_shows", "lost"), [(True, 1), (False, 0)])
def test_the_yaw_of_a_disc_does_not_lose_it(yaw_shows, lost):
    assert (
        table([trial(1.0, final_rotation_error_deg=31.0, yaw_shows=yaw_shows)], (NONE,))["disc"]["none"]["lost"] == lost
    )


def test_coverage_of_contact_rest_and_final_poses_by_hand():
    trials = [trial(1.0), trial(3.0), trial(4.0)]
    trials[1].nees[1] = 0.0
    trials[2].nees[3] = 0.0
    row = table(trials, (NONE,))["disc"]["none"]
    # In contact 2, 1 and 0 of two; at rest and at the end all but one; nothing counts before the first contact.
    assert row["contact_inside_95"] == pytest.approx(3 / 6)
    assert row["rest_inside_95"] == row["final_inside_95"] == pytest.approx(2 / 3)
    assert row["inside_95"] == pytest.approx(5 / 9)
    row = table([replace(trial(2.0), contact=np.zeros(4, np.bool_))], (NONE,))["disc"]["none"]
    assert {row[f"{kind}inside_95"] for kind in ("", "contact_", "rest_", "final_")} == {None}


def test_silence_ambiguity_and_knocks_in_the_table_by_hand():
    trials = [
        trial(1.0, silently_wrong_share=0.2, silently_wrong_before_touch_share=0.1, **knocks((0.5, 4.0), (2.0, 2.5))),
        trial(2.0, silently_wrong_share=0.0, ambiguous_share=0.5, contact_frames=10, **knocks((2.1, 3.0))),
        trial(3.0, ambiguous_share=0.0, contact_frames=30),
    ]
    row = table(trials, (NONE,))["disc"]["none"]
    assert (row["silently_wrong"], row["silently_wrong_before_touch"], row["knocks"]) == (pytest.approx(0.1), 0.1, 3)
    assert (row["recovery_contact_s"], row["recovered_in_2s"]) == (2.0, pytest.approx(2 / 3))
    assert row["ambiguous"] == pytest.approx(5 / 40)
    unknown = table([trial(3.0)], (NONE,))["disc"]["none"]
    assert (unknown["silently_wrong"], unknown["ambiguous"], unknown["recovered_in_2s"]) == (None, None, None)


@pytest.mark.parametrize(
    ("each", "recovery", "soon"),
    [
        ([(0.5, 3.0), (1.5, 3.0)], 0.5, 1.0),
        ([(1.0, 3.0), (None, 3.0)], 1.0, 0.5),
        ([(None, 3.0)], None, 0.0),
        # Nobody knows of 2 s if half of the knocks are followed up to 1 s only.
        ([(0.5, 3.0), (None, 1.0)], 0.5, None),
        # One of four recovers at 0.5 s; two are followed up to 1 s only, and the last recovers at 1.5 s.
        ([(0.5, 3.0), (None, 1.0), (None, 1.0), (1.5, 3.0)], 1.5, 1.0),
        # One of three is followed up to 0.1 s; one of the two others recovers.
        ([(None, 0.1), (1.0, 3.0), (None, 9.0)], 1.0, 0.5),
    ],
)
def test_recovery_by_hand(each, recovery, soon):
    assert recovered([knocks(*each)]) == {"recovery_contact_s": recovery, "recovered_in_2s": soon}


def test_errors_after_knocks_are_pooled_over_all_knocks():
    later = {"1": [None], "1.5": [None], "2": [None], "3": [None]}
    each = [{"knock_error_mm": {"0.5": errors, **later}} for errors in ([9.0, 1.0, None], [2.0])]
    # Three are known; the median of the recordings' medians would be 3.5.
    assert errors_after_knock([*each, {}]) == {"0.5": 2.0, "1": None, "1.5": None, "2": None, "3": None}


@pytest.mark.parametrize("name", ["=1+1.mcap", "+a.mcap", "-a.mcap", "@a.mcap", "\ta.mcap", "'a.mcap", "a.mcap"])
def test_no_cell_begins_a_formula(tmp_path, name):
    path = tmp_path / "a.csv"
    write_rows(path, [{"recording": name, "mm": -1.5}])
    assert not path.read_text(encoding="utf-8").splitlines()[1].startswith(("=", "+", "-", "@", "\t", '"\t'))
    assert "-1.5" in path.read_text(encoding="utf-8")


# Several processes


def dies(job: Any, settings: Any) -> Any:
    """Track a recording, but one takes the process along."""
    if job[0] == "disc-2.mcap":
        os._exit(9)
    return track_recording(job, settings)


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Run a study of four recordings."""
    monkeypatch.chdir(tmp_path)
    Path("recordings").mkdir()
    for index, name in enumerate(NAMES):
        write_recording(pushed(20 + index), Path("recordings") / name)
    files, settings = find_recordings(Path("recordings")), StudySettings((NONE, ORACLE))
    return lambda out="out", **options: run_study(files, Path(out), settings, **options)


def same_but_the_one_that_died(found: Any, alone: Any) -> bool:
    others = [each for each in alone.trials if each.recording != "disc-2.mcap"]
    assert [(each.recording, each.method) for each in found.trials] == [
        (each.recording, each.method) for each in others
    ]
    assert set(found.failed) == {("disc-2.mcap", NONE), ("disc-2.mcap", ORACLE)}
    assert "process died" in found.failed["disc-2.mcap", NONE]
    return all(np.array_equal(here.pose, there.pose) for here, there in zip(found.trials, others, strict=True))


def test_two_workers_find_what_one_finds_and_one_that_dies_takes_its_recording_only(study, monkeypatch):
    alone = study("alone")
    assert [(each.recording, each.method) for each in alone.trials] == [(n, m) for n in NAMES for m in (NONE, ORACLE)]
    monkeypatch.setattr(study_module, "track_recording", dies)
    assert same_but_the_one_that_died(study("two", workers=2), alone)


def test_a_cluster_finds_the_same_and_may_lose_workers(study, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install palpate[cluster]")
    import dask.config

    alone = study("alone")
    monkeypatch.setattr(study_module, "track_recording", dies)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": "127.0.0.1:0"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options, silence_logs="CRITICAL") as cluster,
    ):
        assert same_but_the_one_that_died(study("cluster", dask=cluster.scheduler_address), alone)
