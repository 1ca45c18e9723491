from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.touch import modes
from palpate.touch.relative import BACK, Touch, compared_frames
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, Measurement, RelativePoses, Turn
from palpate.types.sensor import POINT

SIGMAS = (1.0, 2.0, 0.02)
CONSTANT = (1.0, 1.0, 0.5)


def no_background() -> Any:
    raise AssertionError("this touch needs no images")


def make_touch(mode: Any) -> Touch:
    return modes.make_touch(mode, POINT, SIGMAS, CONSTANT, None, no_background)


def only(said: Sequence[Measurement]) -> RelativePoses:
    """The relative poses, which are all that is said."""
    (found,) = said
    assert isinstance(found, RelativePoses)
    return found


def frame(k: int, object_pose: Any = None, sensor_pose: Any = (0.0, 0.0, 0.0)) -> Frame:
    truth = None if object_pose is None else np.array(object_pose, dtype=float)
    return Frame(k / 30, np.array(sensor_pose, dtype=float), contact=True, object_pose=truth)


@pytest.mark.parametrize(
    ("age", "back"),
    [
        (0, []),
        (1, [1]),
        (9, [9]),
        (10, [10]),
        (12, [10, 11, 12]),
        (39, range(10, 40)),
        (40, range(10, 40)),
        (1000, range(10, 40)),
    ],
)
def test_compared_frames(age, back):
    found = compared_frames(age)
    assert found.dtype.kind == "i"
    assert sorted(found.tolist()) == list(back)
    # Never before the contact, and always with the first frame while that is within reach.
    assert (age in found) == (0 < age <= BACK[-1])


def test_no_touch_says_nothing():
    touch = make_touch("none")
    assert not any(touch.measure(frame(k, (0, 0, 0))) for k in range(50))
    touch.end_contact()


def test_constant_touch_says_that_nothing_turned():
    touch = make_touch("constant")
    said = [touch.measure(frame(k)) for k in range(50)]
    assert not said[0]
    assert all(isinstance(one, RelativePoses) for measurements in said for one in measurements)
    for age in (1, 9, 10, 39, 49):
        found = only(said[age])
        assert found.back.tolist() == compared_frames(age).tolist()
        assert not found.pose.any()
        assert found.pose.shape == (len(found.back), 3)
        assert (found.covariance == np.diag([1.0, 1.0, 0.25])).all()
        assert found.covariance.shape == (len(found.back), 3, 3)
    touch.end_contact()
    assert not touch.measure(frame(50))
    again = only(touch.measure(frame(51)))
    assert again.back.tolist() == [1]


def test_oracle_by_hand():
    # The object rests at (1, 0) turned by 90 degrees. Sensor at (1, -0.1): 0.1 behind in world y is x = -0.1 for the
    # object. It moves to (1.02, -0.1), turned by 0.1: at (-0.1, -0.02) for the object, and turned as much.
    touch = make_touch("oracle")
    object_pose = (1, 0, np.pi / 2)
    assert not touch.measure(frame(0, object_pose, (1, -0.1, np.pi / 2)))
    found = only(touch.measure(frame(1, object_pose, (1.02, -0.1, np.pi / 2 + 0.1))))
    assert found.back.tolist() == [1]
    np.testing.assert_allclose(found.pose, [[0, -0.02, 0.1]], atol=1e-15)
    np.testing.assert_allclose(found.covariance, [np.diag([1.0, 4.0, 4e-4])])


def test_oracle_compares_with_the_frames_it_names():
    rng = np.random.default_rng(1)
    objects, sensors = rng.normal(size=(2, 60, 3))
    touch = make_touch("oracle")
    felt = se2.between(objects, sensors)
    for k in range(60):
        said = touch.measure(frame(k, objects[k], sensors[k]))
        if k:
            found = only(said)
            assert found.back.tolist() == compared_frames(k).tolist()
            np.testing.assert_allclose(found.pose, se2.between(felt[k - found.back], felt[k]), atol=1e-12)


def test_a_frame_of_unknown_truth_says_nothing_then_and_later():
    touch = make_touch("oracle")
    unknown = {12, 15}
    for k in range(60):
        truth = None if k == 12 else (np.nan, 0, 0) if k == 15 else (0, 0, 0.001 * k)
        said = touch.measure(frame(k, truth))
        if k == 0 or k in unknown:
            assert not said
            continue
        wanted = [back for back in compared_frames(k) if k - back not in unknown]
        if not wanted:
            assert not said
            continue
        found = only(said)
        assert found.back.tolist() == wanted
        np.testing.assert_allclose(found.pose[:, 2], -0.001 * found.back, atol=1e-15)
        assert len(found.covariance) == len(wanted)


def test_the_end_of_a_contact_makes_the_oracle_forget():
    touch = make_touch("oracle")
    for k in range(20):
        touch.measure(frame(k, (0, 0, 0)))
    touch.end_contact()
    assert not touch.measure(frame(20, (0, 0, 0)))
    found = only(touch.measure(frame(21, (0, 0, 0.1))))
    assert found.back.tolist() == [1]
    np.testing.assert_allclose(found.pose, [[0, 0, -0.1]])


def test_an_unknown_mode_names_the_allowed_ones():
    mode: Any = "learned"
    with pytest.raises(SettingError, match="'learned'; allowed are none, constant, oracle"):
        make_touch(mode)


@pytest.mark.parametrize("kind", [ContactDirection, Turn])
@pytest.mark.parametrize(("angle", "variance"), [(np.nan, 1.0), (0.1, 0.0), (0.1, -1.0), (0.1, np.nan), (0.1, np.inf)])
def test_an_angle_that_cannot_be_used_is_refused_where_it_is_made(kind, angle, variance):
    with pytest.raises(EstimationError, match=r"has angle .* and variance .*; they must be finite"):
        kind(angle, variance)
