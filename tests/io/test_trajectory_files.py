"""Trajectories on disk: estimates.csv."""

import csv
from dataclasses import replace

import numpy as np
from recording_samples import trajectory

from palpate import Trajectory
from palpate.io.estimates import write_estimates_csv
from palpate.types.estimate import Answer

COLUMNS = "time,x,y,theta,xx,xy,xtheta,yy,ytheta,thetatheta,contact,status,reason,origins"


def test_csv_round_trip_is_exact(tmp_path):
    path, made = tmp_path / "a.csv", trajectory()
    made = replace(made, reason=('frozen; it may have moved, "or not"', *[""] * (len(made) - 1)))
    write_estimates_csv(made, path)
    with path.open(encoding="utf-8", newline="") as file:
        found = list(csv.DictReader(file))
    numbers = np.array([[float(row[name]) for name in COLUMNS.split(",")[:11]] for row in found])
    upper = made.covariance[:, *np.triu_indices(3)]
    np.testing.assert_array_equal(numbers, np.column_stack([made.time, made.pose, upper, made.contact]))
    assert tuple(row["status"] for row in found) == made.status and tuple(row["reason"] for row in found) == made.reason


def test_csv_header_and_terms(tmp_path):
    path = tmp_path / "a.csv"
    terms = np.array([[[1, 2, 3], [2, 4, 5], [3, 5, 6.0]]])
    made = Trajectory(np.array([0.1]), np.array([[7, 8, 9.0]]), terms, np.array([True]), ("ok",), ("",))
    write_estimates_csv(made, path)
    assert path.read_text() == f"{COLUMNS}\n0.1,7.0,8.0,9.0,1.0,2.0,3.0,4.0,5.0,6.0,1,ok,,\n"


def test_csv_names_the_origins_of_several_answers(tmp_path):
    made = trajectory(3)
    pose, covariance = made.pose[0], made.covariance[0]
    kept, moved = Answer(pose, covariance, 0.5), Answer(pose, covariance, 0.25, "shove")
    write_estimates_csv(made, tmp_path / "a.csv", ((), (kept, moved, moved), ()))
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        assert [row["origins"] for row in csv.DictReader(file)] == ["", "as before 1; shove 2", ""]
