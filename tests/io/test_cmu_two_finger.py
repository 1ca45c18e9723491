"""CMU pushes, from files made by hand."""

import numpy as np
import pytest
from planar import gaps
from recording_samples import load, runs

from palpate import FileError, Rectangle
from palpate import io as formats


def cmu(lost=range(0)):
    """Two pushes along +x at 20 mm/s, 3 s each, the second 30 mm to the side; the camera is 0.164 s late."""
    rows = ["1495591575.00,500,500,1,0,0,0,1"]
    for action, (start, side) in enumerate([(0.0, 0.0), (10.0, 5.0)]):
        for step in range(100):
            t = 0.03 * step
            hand = action * 60 + 20 * t
            # The tips' centres are at the hand's origin, so the centre of the object is 2.5 + 25.5 mm ahead.
            center = action * 60 + 20 * max(t - 0.164, 0.0) + 28.0
            seen = (0.0, 0.0, 0.0) if action == 0 and step in lost else (center, side + 1.0, 0.0)
            numbers = [1495591576.0 + start + t, *seen, hand, side, 0.0, action + 1]
            rows.append(",".join(f"{number:.6f}" for number in numbers))
    return "\n".join(rows) + "\n"


def test_cmu_is_read(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text(cmu(lost=range(50, 60)))
    assert formats.detect_format(path) == "cmu-two-finger"
    found = load(path)
    assert len(found) == 200
    assert found.time[0] == 0
    assert found.shape == Rectangle(0.051, 0.036)
    # The apexes are 2.5 mm ahead of the hand's origin.
    np.testing.assert_allclose(found.sensor_pose[[0, 99], 0], [0.0025, 0.0025 + 20e-3 * 99 * 0.03], atol=1e-6)
    assert found.contact is not None and found.object_pose is not None
    gap = gaps(found)
    steady = np.r_[6:40, 110:190]
    np.testing.assert_allclose(gap[steady], 0.0, atol=0.02e-3)
    # Rows 51 to 60 of the log, 1.50 to 1.77 s, were seen for 1.336 to 1.606 s. Between 1.47 - 0.164 s and
    # 1.80 - 0.164 s one neighbour is missing: frames 44 (1.32 s) to 54 (1.62 s).
    assert runs(np.isnan(found.object_pose[:, 0])) == [[44, 55]]
    # 1 mm at 20 mm/s is 0.05 s: each action's first two frames (0 and 0.03 s) are clear of the object.
    assert runs(found.contact) == [[2, 100], [102, 200]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3,4,5,6,7,8\n" * 6 + "1,2,3\n", r"line 7: found '1,2,3', expected 8 numbers"),
        ("1,2,3,4,5,6,7,8\n" * 6 + "1,2,3,4,5,6,7,nan\n", "line 7"),
        ("1,2,3,4,5,6,7,8\n", "a single row"),
        ("1,2,3,4,5,6,7,8\n2,0,0,0,1e12,0,0,1\n", "sensor_pose: frame 0 is"),
    ],
)
def test_cmu_bad_content(tmp_path, text, message):
    path = tmp_path / "log.txt"
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        load(path)


def test_cmu_logs_of_other_objects_are_refused(tmp_path):
    path = tmp_path / "log.txt"
    rows = [line.split(",") for line in cmu().splitlines()]
    path.write_text("\n".join(",".join([row[0], f"{float(row[1]) - 8.0}", *row[2:]]) for row in rows))
    with pytest.raises(FileError, match=r"the tips push -8\.0 mm off a rectangle .* other objects are not read"):
        load(path)


def test_cmu_without_a_single_tag(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("".join(f"{0.03 * i},0,0,0,{i},0,0,1\n" for i in range(9)))
    found = load(path)
    assert np.isnan(found.object_pose).all()
    assert not found.contact.any()
