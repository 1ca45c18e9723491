"""Scores of a study worked out by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate_lab.study.results import table
from palpate_lab.study.study import Trial


def trial(final_mm: float, method: str = "none", group: str = "disc", **summary: Any) -> Trial:
    """Return a trial of four frames, in contact in the second and third, off by `final_mm` with a sigma of 1 mm."""
    pose = np.zeros((4, 3))
    pose[1:, 0] = final_mm * 1e-3
    scores = {
        "frames": 4,
        "statuses": {"tracking": 4},
        "scored_frames": 4,
        "final_translation_error_mm": final_mm,
        "final_rotation_error_deg": 1.0,
        "final_sigma": [1e-3, 1e-3, 0.01],
        "nats": 10.0 * final_mm,
        "step_ms": {"p50": final_mm, "p95": 2.0 * final_mm, "p99": 3.0 * final_mm},
    }
    return Trial(
        recording=f"{group}-{final_mm:g}.mcap",
        method=method,
        file=[0, 0],
        group=group,
        shape={},
        source="",
        summary=scores | summary,
        time=np.arange(4.0),
        truth=np.zeros((4, 3)),
        pose=pose,
        nees=(1e3 * pose[:, 0]) ** 2,
        contact=np.array([False, True, True, False]),
        step_ms=np.ones(4),
    )


def test_table_by_hand():
    turned = {1.0: 7.0, 2.0: 8.0, 3.0: 5.0, 60.0: 20.0}
    trials = [trial(mm, final_rotation_error_deg=deg) for mm, deg in turned.items()]
    rows = table([*trials, trial(4.0, group="edges"), trial(9.0, "oracle")], ("none", "oracle"))
    assert list(rows) == ["disc", "edges", "all groups"]
    assert [list(row) for row in rows.values()] == [["none", "oracle"], ["none"], ["none", "oracle"]]
    row = rows["disc"]["none"]
    assert (row["sequences"], row["lost"]) == (4, 1)
    assert row["final_mm"] == {"median": 2.5, "worst": 60.0} and row["final_deg"] == {"median": 7.5, "worst": 20.0}
    # NEES of 1, 4, 9 and 3600, three frames each; the first two are inside.
    assert row["nees"] == pytest.approx({"median": 6.5, "mean": 903.5})
    assert (row["inside_95"], row["final_inside_95"]) == (0.5, 0.5)
    assert row["nats"] == pytest.approx(165.0)  # of 10, 20, 30 and 600
    assert row["step_ms"] == pytest.approx({"p50": 2.5, "p95": 5.0, "p99": 7.5})
    assert rows["all groups"]["none"]["sequences"] == 5 and table([], ("none",)) == {}
    for yaw_shows in (True, False):  # the yaw of a disc does not lose it
        turned = trial(1.0, final_rotation_error_deg=31.0, yaw_shows=yaw_shows)
        assert table([turned], ("none",))["disc"]["none"]["lost"] == yaw_shows


def test_coverage_of_contact_rest_and_final_poses_by_hand():
    trials = [trial(1.0), trial(3.0), trial(4.0)]
    trials[1].nees[1] = 0.0
    trials[2].nees[3] = 0.0
    row = table(trials, ("none",))["disc"]["none"]
    # In contact 2, 1 and 0 of two; at rest and at the end all but one; nothing counts before the first contact.
    assert row["contact_inside_95"] == pytest.approx(3 / 6)
    assert row["rest_inside_95"] == row["final_inside_95"] == pytest.approx(2 / 3)
    assert row["inside_95"] == pytest.approx(5 / 9)
    row = table([replace(trial(2.0), contact=np.zeros(4, np.bool_))], ("none",))["disc"]["none"]
    assert {row[f"{kind}inside_95"] for kind in ("", "contact_", "rest_", "final_")} == {None}


def test_silence_ambiguity_and_knocks_in_the_table_by_hand():
    trials = [
        trial(1.0, silently_wrong_share=0.2, knocks=2),
        trial(2.0, silently_wrong_share=0.0, ambiguous_share=0.5, contact_frames=10, knocks=1),
        trial(3.0, ambiguous_share=0.0, contact_frames=30),
    ]
    row = table(trials, ("none",))["disc"]["none"]
    assert (row["silently_wrong"], row["knocks"]) == (pytest.approx(0.1), 3)
    assert row["ambiguous"] == pytest.approx(5 / 40)
    unknown = table([trial(3.0)], ("none",))["disc"]["none"]
    assert (unknown["silently_wrong"], unknown["ambiguous"]) == (None, None)
