from dataclasses import replace

import h5py
import numpy as np
import pytest
from recording_samples import pushed

from palpate.errors import FileError
from palpate.formats.palpate_h5 import read_recording, write_recording


def test_extra_rows_come_back(tmp_path):
    made = replace(
        pushed(3), extra={"force": np.array([0.0, np.nan, 2.0]), "clean": np.ones((3, 3)), "on": np.ones(3, bool)}
    )
    write_recording(made, tmp_path / "a.h5")
    back = read_recording(tmp_path / "a.h5").extra
    assert back.keys() == made.extra.keys()
    for name, value in made.extra.items():
        assert back[name].dtype == value.dtype
        assert np.array_equal(back[name], value, equal_nan=True)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["extra"]  # as in a file from before there were any
    assert read_recording(tmp_path / "a.h5").extra == {}


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("force", np.ones(2), r"extra/force: found shape \(2,\), expected \(3,\)"),
        ("pose", np.ones((4, 3)), r"extra/pose: found shape \(4, 3\), expected \(3, 3\)"),
        ("words", np.array(["a", "b", "c"]), "extra/words: found values of type <U1, expected numbers or booleans"),
        ("a/b", np.ones(3), "extra: found the name 'a/b'"),
    ],
)
def test_extra_rows_that_do_not_fit(name, value, said):
    with pytest.raises(FileError, match=said):
        replace(pushed(3), extra={name: value})


def test_a_damaged_extra_is_said(tmp_path):
    write_recording(pushed(3), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["extra"] = np.ones(3)
    with pytest.raises(FileError, match=r"a\.h5: extra: found a dataset, expected a group"):
        read_recording(tmp_path / "a.h5")
