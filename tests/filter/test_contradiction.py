"""What measured poses of the object contradict, by hand: how far, how often, in which words."""

import numpy as np
import pytest
from push_samples import SHAPES, sensor

from palpate.filter.belief import Prior
from palpate.filter.consistency import Diagnosis
from palpate.filter.contradiction import Contradiction, measured_poses
from palpate.graph.contact_geometry import contact_model
from palpate.graph.factors.factor import Step
from palpate.graph.variables import OBJECT_SIZE
from palpate.types.measurements import ObjectPose, Turn

Array = np.ndarray
MODEL = contact_model(SHAPES["rectangle"], sensor(), 0.05)
HERE = np.zeros(3)
EXACT = (0.0, 0.0, 0.0)  # frames that agree
SEEN = np.diag(np.square([4e-3, 4e-3, 1e-3]))


def known(*deviation: float) -> Prior:
    return Prior(HERE, np.zeros(OBJECT_SIZE), np.diag(np.square([*deviation, *[1e-9] * OBJECT_SIZE])))


KNOWN = known(3e-3, 3e-3, 1e-3)
"""With SEEN known to 5 mm along x and y."""
TOUCHED = known(4e-4, 1e-3, 1e-3)


def at(gap: float) -> Array:
    """A sensor pose at which the tip is so far off the left side."""
    return np.array([-0.2363 / 2 - gap, 0.0, 0.0])


def pose(x: float = 0.0, y: float = 0.0, theta: float = 0.0, time: float | None = None) -> ObjectPose:
    return ObjectPose(np.array([x, y, theta]), SEEN, time)


def diagnosed(
    *seen: ObjectPose, frames: int = 3, calibration: tuple[float, float, float] = EXACT, moved: float = 0.0
) -> Diagnosis:
    """After frames in all of which these poses were measured."""
    diagnosis = Diagnosis(MODEL, 3e-4, calibration)
    for _ in range(frames):
        diagnosis.see_object_poses(KNOWN, [(HERE, one) for one in seen], moved)
    return diagnosis


def test_three_of_ten_frames_that_contradict_are_more_than_an_error():
    found, doubts = Contradiction(), []
    for frame in range(16):
        found = found.compared(0.01 * (frame + 1), 5.1 if frame in (1, 3, 5) else 4.9, f"frame {frame}")
        doubts.append(found.doubt)
    # Frames 1, 3 and 5 are all among the last ten from frame 5 to frame 10; 60 mm at frame 5 is the most.
    np.testing.assert_array_equal(doubts, [*[0.0] * 5, *[0.06] * 6, *[0.0] * 5])
    assert found.said == "frame 5" and len(found.apart) == 10


@pytest.mark.parametrize(("off", "contradicts"), [(24.9e-3, False), (25.1e-3, True)])
def test_a_measured_pose_contradicts_from_five_standard_deviations(off, contradicts):
    for seen in (pose(x=off), pose(y=-off)):
        assert bool(diagnosed(seen).contradiction) == contradicts
        assert not diagnosed(seen, frames=2).contradiction


def test_a_contradiction_is_strain_and_widens_the_covariance():
    diagnosis = diagnosed(pose(x=0.03, y=-0.04))
    assert diagnosis.contradiction == (
        "measured object pose is 50 mm and 0 degrees from the estimate, 10 standard deviations"
    )
    assert diagnosis.in_contact(KNOWN) == diagnosis.at_rest(KNOWN) == "strained"
    wanted = KNOWN.pose_covariance + np.diag(np.square([0.05, 0.05, 1.0]))  # c is 50 mm
    np.testing.assert_allclose(diagnosis.covariance(KNOWN), wanted, rtol=1e-9)
    # Frames without a measured pose say nothing; ten that agree end it, and eight of them do.
    diagnosis.see_object_poses(KNOWN, [], 0.0)
    for _ in range(7):
        diagnosis.see_object_poses(KNOWN, [(HERE, pose())], 0.0)
    assert diagnosis.in_contact(KNOWN) == "strained"
    diagnosis.see_object_poses(KNOWN, [(HERE, pose())], 0.0)
    assert diagnosis.in_contact(KNOWN) == "tracking" and diagnosis.at_rest(KNOWN) == "resting"
    np.testing.assert_array_equal(diagnosis.covariance(KNOWN), KNOWN.pose_covariance)


def test_of_several_measured_poses_the_worst_is_named():
    said = diagnosed(pose(), pose(x=0.05), pose(y=0.03)).contradiction
    assert said == "measured object pose 2 of 3 is 50 mm and 0 degrees from the estimate, 10 standard deviations"


def test_a_turn_contradicts_too():
    # Known and seen to 1 mrad, together to 1.414 mrad: 0.1 rad are 71 of them, and 5 mm at the distance c.
    diagnosis = diagnosed(pose(theta=0.1))
    assert diagnosis.contradiction == (
        "measured object pose is 0 mm and 6 degrees from the estimate, 71 standard deviations"
    )
    np.testing.assert_allclose(diagnosis.contradiction_covariance()[0, 0], 5e-3**2, rtol=1e-6)


def test_what_the_object_may_have_moved_and_how_frames_agree_is_allowed_for():
    # 12 mm beside the 5 mm are 13 mm: five of them are 65 mm.
    for off, contradicts in ((64e-3, False), (66e-3, True)):
        assert bool(diagnosed(pose(x=off), moved=0.012).contradiction) == contradicts
        assert bool(diagnosed(pose(x=off), calibration=(0.012, 0.012, 0.0)).contradiction) == contradicts


@pytest.mark.parametrize(("gap", "contradicts"), [(2.4e-3, False), (2.6e-3, True), (-2.6e-3, True), (0.05, True)])
def test_an_outline_far_from_where_the_sensor_touches_it(gap, contradicts):
    # The gap is known to hypot(0.4 mm, 0.3 mm) = 0.5 mm: five of them are 2.5 mm.
    diagnosis = Diagnosis(MODEL, 3e-4, EXACT)
    for _ in range(3):
        assert diagnosis.in_contact(TOUCHED) == "tracking"
        diagnosis.see_touched_outline(TOUCHED, at(gap), is_measured=True)
    assert (diagnosis.in_contact(TOUCHED) == "strained") == contradicts
    if gap == 0.05:
        said = "measured object poses put the outline 50 mm from where the sensor touches it, 100 standard deviations"
        assert diagnosis.contradiction == said
    # It goes on to be compared without measured poses, until it is over.
    for _ in range(8):
        assert (diagnosis.in_contact(TOUCHED) == "strained") == contradicts
        diagnosis.see_touched_outline(TOUCHED, at(0.0), is_measured=False)
    assert diagnosis.in_contact(TOUCHED) == "tracking"


def test_a_gap_says_nothing_where_no_pose_is_measured():
    diagnosis = Diagnosis(MODEL, 3e-4, EXACT)
    for _ in range(10):
        diagnosis.see_touched_outline(TOUCHED, at(0.05), is_measured=False)
    assert not diagnosis.contradiction and not diagnosis.contradiction_covariance().any()


def test_a_measured_pose_is_compared_with_that_of_its_time():
    thought = [np.array([x, 0.0, 0.0]) for x in (0.1, 0.2, 0.3)]
    said = [pose(), pose(time=1.0), pose(time=1.11), pose(time=1.2), pose(time=0.9), pose(time=1.3), Turn(0.0, 1.0)]
    found = measured_poses(Step(HERE, HERE, said, [1.0, 1.1, 1.2]), thought)
    # Those of a time that is not at hand are left out.
    assert [one for _, one in found] == said[:4]
    assert [then[0] for then, _ in found] == [0.3, 0.1, 0.2, 0.3]
