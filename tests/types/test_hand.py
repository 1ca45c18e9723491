"""A hand: fingers with names and mounts, checked when it is made."""

import numpy as np
import pytest

from palpate import DIGIT, POINT, Disc, Hand, SensorProfile, SettingError

MOUNTS = {"left": (0.0, 0.02, 0.0), "right": (0.0, -0.02, 0.0)}
PINCH = Hand({"left": DIGIT, "right": DIGIT}, {"left": (0.0, -0.06, np.pi / 2), "right": (0.0, 0.06, -np.pi / 2)})


def test_a_hand_knows_profiles_by_name_and_keeps_the_order_of_its_fingers():
    hand = Hand({"right": "digit", "left": POINT}, MOUNTS)  # pyright: ignore[reportArgumentType]
    assert list(hand.fingers.items()) == [("right", DIGIT), ("left", POINT)]
    assert list(hand.mounts) == ["right", "left"]
    assert hand == Hand({"right": DIGIT, "left": POINT}, dict(reversed(MOUNTS.items())))


def test_fingers_are_where_their_mounts_are_unless_the_frame_says_where():
    hand_pose = np.array([1.0, 2.0, np.pi / 2])
    poses = PINCH.poses(hand_pose)
    np.testing.assert_allclose(poses["left"], (1.06, 2.0, np.pi), atol=1e-12)
    np.testing.assert_allclose(poses["right"], (0.94, 2.0, 0.0), atol=1e-12)
    closer = np.array([0.96, 2.0, 0.0])
    np.testing.assert_allclose(PINCH.poses(hand_pose, {"right": closer})["right"], closer)


def test_gaps_are_those_of_each_finger():
    gaps = PINCH.gaps(np.zeros((1, 3)), np.zeros((1, 3)), Disc(0.05))
    np.testing.assert_allclose([*gaps["left"], *gaps["right"]], 0.01, atol=1e-12)


def test_a_hand_as_one_sensor_has_its_fingers_centres_of_curvature():
    centers = PINCH.whole.centers
    np.testing.assert_allclose(centers, [(0.0, -0.06 - DIGIT.radius), (0.0, 0.06 + DIGIT.radius)], atol=1e-12)
    gap = PINCH.whole.gaps(np.zeros((1, 3)), np.array([[0.0, 0.005, 0.0]]), Disc(0.05))
    np.testing.assert_allclose(gap, 0.005, atol=1e-12)


@pytest.mark.parametrize(
    ("fingers", "mounts", "named"),
    [
        ({}, {}, "no fingers"),
        (["digit"], MOUNTS, "fingers of type list"),
        ({"left": "digit", "right": "digit"}, {"left": MOUNTS["left"]}, "mount of finger 'right'"),
        ({"left": "digit"}, MOUNTS, "finger 'right'.*left"),
        (
            {"left": "digit", "right": "digit"},
            dict.fromkeys(MOUNTS, (0.0, 0.02, 0.0)),
            "'left' and 'right' at one mount",
        ),
        ({"left": "digit", "right": "digit"}, {**MOUNTS, "left": (0.0, 20.0, 0.0)}, "'left'.*millimetres"),
        ({"left": "digit", "right": "digit"}, {**MOUNTS, "left": (0.0, 0.02, 90.0)}, "'left'.*degrees"),
        ({"left": "digit", "right": "digit"}, {**MOUNTS, "left": (0.0, np.nan, 0.0)}, "'left'.*finite"),
        ({"left": "digit", "right": "blob"}, MOUNTS, "'blob'"),
        ({"left/1": "digit"}, {"left/1": (0.0, 0.0, 0.0)}, "'left/1'"),
        ({"left": SensorProfile("two", 0.004, ((0.0, 0.0), (0.0, 0.02)))}, {"left": MOUNTS["left"]}, "'left'.*tips"),
    ],
)
def test_bad_hands_are_refused(fingers, mounts, named):
    with pytest.raises(SettingError, match=named):
        Hand(fingers, mounts)
