from typing import Any

import numpy as np
import pytest

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.recording.frame import Frame
from palpate.recording.measurements import ContactDirection, Feeling, Turn
from palpate.recording.sensor import POINT
from palpate.touch import modes
from palpate.touch.relative import BACK, Touch, compared_frames

SIGMAS = (1.0, 2.0, 0.02)
CONSTANT = (1.0, 1.0, 0.5)


def no_background() -> Any:
    raise AssertionError("this touch needs no images")


def make_touch(mode: Any) -> Touch:
    return modes.make_touch(mode, POINT, SIGMAS, CONSTANT, None, no_background)


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
    assert all(touch.feel(frame(k, (0, 0, 0))) == Feeling() for k in range(50))
    touch.lift()


def test_constant_touch_says_that_nothing_turned():
    touch = make_touch("constant")
    felt = [touch.feel(frame(k)) for k in range(50)]
    assert felt[0] == Feeling()
    assert all(feeling.direction is feeling.turn is None for feeling in felt)
    for age in (1, 9, 10, 39, 49):
        found: Any = felt[age].relative
        assert found.back.tolist() == compared_frames(age).tolist()
        assert not found.pose.any()
        assert found.pose.shape == (len(found.back), 3)
        assert (found.covariance == np.diag([1.0, 1.0, 0.25])).all()
        assert found.covariance.shape == (len(found.back), 3, 3)
    touch.lift()
    assert touch.feel(frame(50)) == Feeling()
    again: Any = touch.feel(frame(51)).relative
    assert again.back.tolist() == [1]


def test_oracle_by_hand():
    # The object rests at (1, 0) turned by 90 degrees. Sensor at (1, -0.1): 0.1 behind in world y is x = -0.1 for the
    # object. It moves to (1.02, -0.1), turned by 0.1: at (-0.1, -0.02) for the object, and turned as much.
    touch = make_touch("oracle")
    object_pose = (1, 0, np.pi / 2)
    assert touch.feel(frame(0, object_pose, (1, -0.1, np.pi / 2))) == Feeling()
    found: Any = touch.feel(frame(1, object_pose, (1.02, -0.1, np.pi / 2 + 0.1))).relative
    assert found.back.tolist() == [1]
    np.testing.assert_allclose(found.pose, [[0, -0.02, 0.1]], atol=1e-15)
    np.testing.assert_allclose(found.covariance, [np.diag([1.0, 4.0, 4e-4])])


def test_oracle_compares_with_the_frames_it_names():
    rng = np.random.default_rng(1)
    objects, sensors = rng.normal(size=(2, 60, 3))
    touch = make_touch("oracle")
    felt = se2.between(objects, sensors)
    for k in range(60):
        found: Any = touch.feel(frame(k, objects[k], sensors[k])).relative
        if k:
            assert found.back.tolist() == compared_frames(k).tolist()
            np.testing.assert_allclose(found.pose, se2.between(felt[k - found.back], felt[k]), atol=1e-12)


def test_a_frame_of_unknown_truth_says_nothing_then_and_later():
    touch = make_touch("oracle")
    unknown = {12, 15}
    for k in range(60):
        truth = None if k == 12 else (np.nan, 0, 0) if k == 15 else (0, 0, 0.001 * k)
        found = touch.feel(frame(k, truth)).relative
        if k == 0 or k in unknown:
            assert found is None
            continue
        wanted = [back for back in compared_frames(k) if k - back not in unknown]
        if not wanted:
            assert found is None
            continue
        assert found is not None
        assert found.back.tolist() == wanted
        np.testing.assert_allclose(found.pose[:, 2], -0.001 * found.back, atol=1e-15)
        assert len(found.covariance) == len(wanted)


def test_a_lift_makes_the_oracle_forget():
    touch = make_touch("oracle")
    for k in range(20):
        touch.feel(frame(k, (0, 0, 0)))
    touch.lift()
    assert touch.feel(frame(20, (0, 0, 0))) == Feeling()
    found: Any = touch.feel(frame(21, (0, 0, 0.1))).relative
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
