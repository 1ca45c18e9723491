"""Trajectories on disk: TUM and estimates.csv."""

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import trajectory

from palpate import FileError, Trajectory
from palpate.io.estimates import read_estimates_csv, write_estimates_csv, write_tum

COLUMNS = "time,x,y,theta,xx,xy,xtheta,yy,ytheta,thetatheta,contact,status"  # and reason, since it was added


def test_tum_lines_are_as_the_format_has_them(tmp_path):
    path = tmp_path / "a.tum"
    write_tum(trajectory(1, time=np.array([1.5]), pose=np.array([[1.0, -2.0, np.pi / 2]])), path)
    # A quarter turn about z: qz = qw = sqrt(1/2).
    line = "1.500000000 1.000000000 -2.000000000 0.000000000 0.000000000 0.000000000 0.707106781 0.707106781\n"
    assert path.read_text() == line
    with pytest.raises(FileError, match="already exists"):
        write_tum(trajectory(), path)


def test_csv_round_trip_is_exact(tmp_path):
    path, made = tmp_path / "a.csv", trajectory()
    made = replace(made, reason=('frozen; it may have moved, "or not"', *[""] * (len(made) - 1)))
    write_estimates_csv(made, path)
    found = read_estimates_csv(path)
    for name in ("time", "pose", "contact"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
    # Six terms are kept; the two triangles of the product above differ in the last bit.
    upper = np.triu(made.covariance)
    np.testing.assert_array_equal(found.covariance, upper + np.triu(upper, 1).transpose(0, 2, 1))
    assert (found.status, found.reason) == (made.status, made.reason)


def test_csv_header_and_terms(tmp_path):
    path = tmp_path / "a.csv"
    terms = np.array([[[1, 2, 3], [2, 4, 5], [3, 5, 6.0]]])
    made = Trajectory(np.array([0.1]), np.array([[7, 8, 9.0]]), terms, np.array([True]), ("ok",), ("",))
    write_estimates_csv(made, path)
    assert path.read_text() == f"{COLUMNS},reason\n0.1,7.0,8.0,9.0,1.0,2.0,3.0,4.0,5.0,6.0,1,ok,\n"


GOOD = "0,0,0,0,1,0,0,1,0,1,1,ok"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            GOOD.removesuffix(",ok"),
            f"line 2: found '{GOOD.removesuffix(',ok')}', expected 12 columns",
        ),
        ("0,0,0,x,1,0,0,1,0,1,1,ok", "line 2: found '0,0,0,x"),
        ("0,0,0,0,1,0,0,1,0,1,maybe,ok", "line 2: found .* contact 1 or 0"),
        ("0,0,0,0,1,,,1,,1,1,ok", "line 2: found .* six terms of a covariance"),
        (f"{GOOD}\n0", "line 3: found '0'"),
        (f"{GOOD}\n{GOOD}", "time: frame 1 repeats"),
        ("", "holds no estimates"),
    ],
)
def test_csv_bad_content(tmp_path, rows, message):
    path = tmp_path / "a.csv"
    path.write_text(COLUMNS + "\n" + rows)
    with pytest.raises(FileError, match=message):
        read_estimates_csv(path)
