"""The window against SciPy's solution of a whole contact, and its operations on rows."""

from dataclasses import replace

import numpy as np
import pytest
from smoother_samples import PLAIN, ROBUST, TWO_TIPS, batch, contact, felt, scaled_difference, settled, window_of

from palpate import ContactDirection, EstimationError, ObjectPose, Turn
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.layout import IN_SHARED, NAMES
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import DIRECTION_BIAS, DIRECTION_SCALE
from palpate.models.pushing.window import ContactWindow

ENDLESS = 10**6

DIRECTION = NAMES.index("direction")


def apart_from(given, belief: Belief, offsets) -> Belief:
    """The same belief at poses that are off by these (B, 3)."""
    rows = belief.take(np.zeros(len(offsets), int))
    return replace(rows, pose=se2.compose(rows.pose, se2.exp(np.asarray(offsets, float))))


def states(window: ContactWindow, row: int):
    """All that a row says."""
    belief = window.belief().take([row])
    return (
        window.object_path()[row],
        belief.values,
        belief.covariance,
        window.costs()[row],
        window.rows["surprise"][row],
    )


def assert_same(
    window: ContactWindow, row: int, other: ContactWindow, other_row: int = 0, tolerance: float = 0.0
) -> None:
    for one, two in zip(states(window, row), states(other, other_row), strict=True):
        np.testing.assert_allclose(one, two, rtol=tolerance, atol=tolerance)


def without_touch(given, at: int, seen: ObjectPose) -> ContactWindow:
    """The window of a contact in which only one object pose is measured, in step `at`."""
    window = ContactWindow(Graph(settings_record(ROBUST, given.model), given.model), given.prior, Step(given.sensor[0]))
    for t in range(1, len(given.sensor)):
        window.add(Step(given.sensor[t], [seen] if t == at else [], times=[k / 30 for k in range(t + 1)]))
    return window


@pytest.mark.parametrize("touch", ["none", "directions", "turns", "both"])
@pytest.mark.parametrize("tips", [((0.0, 0.0),), TWO_TIPS], ids=["one tip", "two tips"])
def test_a_window_without_a_limit_is_the_batch_solution(touch, tips):
    if len(tips) > 1 and touch != "none":
        pytest.skip("directions and turns are of one tip")
    given = felt(contact(12, PLAIN, tips=tips), touch in ("directions", "both"), touch in ("turns", "both"))
    given = settled(given)
    window, solved = window_of(given, PLAIN, ENDLESS), batch(given, PLAIN)
    mean, covariance = scaled_difference(window.belief(), solved)
    assert mean < 1e-3 and covariance < 1e-2
    wanted = se2.compose(solved.poses[:, 1], se2.inverse(solved.poses[:, 0]))
    off = se2.log(se2.between(window.object_path()[0], wanted))
    assert np.abs(off).max() < 1e-6


def test_a_short_window_is_close_to_the_batch_solution():
    given = settled(felt(contact(30, PLAIN)))
    mean, covariance = scaled_difference(window_of(given, PLAIN, 10).belief(), batch(given, PLAIN))
    assert mean < 0.4 and covariance < 0.4


def test_rows_are_independent_and_can_be_taken_in_any_order():
    given = felt(contact(50, ROBUST))
    beliefs = apart_from(given, given.prior, [[0.0, 0.0, 0.0], [2e-3, -1e-3, 0.02], [-1e-3, 2e-3, -0.03]])
    window = window_of(given, ROBUST, 20, beliefs)
    # Each row is what a window of its own says, but for when Gauss-Newton stops.
    for row in range(3):
        assert_same(window, row, window_of(given, ROBUST, 20, beliefs.take([row])), tolerance=1e-3)
    taken = window_of(given, ROBUST, 20, beliefs)
    taken.take([2, 0, 2])
    for row, before in enumerate([2, 0, 2]):
        assert_same(taken, row, window, before)
    # And they go on alike.
    for one in (window, taken):
        one.add(Step(se2.compose(given.sensor[-1], [1e-3, 0.0, 0.0]), given.said(10)))
    for row, before in enumerate([2, 0, 2]):
        assert_same(taken, row, window, before, tolerance=1e-3)


def test_a_disturbance_leaves_other_rows_as_they_were():
    given = felt(contact(30, ROBUST))
    window, before = window_of(given, ROBUST), window_of(given, ROBUST)
    window.take([0, 0, 0])
    window.disturb([1, 2], 10, np.array([0.01, -0.01]), 0.012)
    assert_same(window, 0, before)
    assert not window.rows["is_lost"].any()
    # Pushing, but for the turn of the object, does not hold in the disturbed steps; the slides are followed.
    along = [window.last(row)["g"][1] for row in range(3)]
    assert abs(along[1] - along[0]) > 1e-3 and abs(along[2] - along[0]) > 1e-3


@pytest.mark.parametrize("slide", [0.02, -0.02])
def test_a_slide_by_hand_is_found_by_a_disturbed_row(slide):
    """The object is moved along its side in the last steps, touch turned by nothing: only a disturbance allows it."""
    given = contact(40, ROBUST)
    g = given.truth.copy()
    g[-10:, 1] += np.linspace(0.0, slide, 11)[1:]
    o = se2.compose(given.sensor[-1], se2.inverse(g[-1]))
    window = without_touch(given, 40, ObjectPose(o, np.diag([1e-6, 1e-6, 1e-4])))
    window.take([0, 0])
    window.disturb([1], 10, np.array([-slide]), 0.012)
    costs = window.costs()[..., :2].sum(axis=(1, 2))
    assert costs[1] < costs[0] - 5.0


def test_mirrored_touch_is_read_with_the_opposite_sign():
    given = felt(contact(30, ROBUST))
    factors = settings_record(ROBUST, given.model)

    def mirrored(t):
        kinds = ContactDirection, Turn
        return [replace(one, angle=-one.angle) for one in given.said(t) if isinstance(one, kinds)]

    both = given.prior.take([0, 0])
    first = Step(given.sensor[0], given.said(0), from_touch=2)
    window = ContactWindow(Graph(factors, given.model), both, first, sign=np.array([1.0, -1.0]))
    as_told = ContactWindow(Graph(factors, given.model), given.prior, Step(given.sensor[0], mirrored(0)))
    camera = ContactDirection(0.01, 1.0)  # of somebody else: not mirrored
    for t in range(1, 31):
        window.add(Step(given.sensor[t], [*given.said(t), camera], from_touch=len(given.said(t))))
        as_told.add(Step(given.sensor[t], [*mirrored(t), camera]))
    assert_same(window, 1, as_told)


def test_a_late_measurement_belongs_to_the_step_of_its_time():
    given = contact(30, ROBUST)
    truth = se2.compose(given.sensor, se2.inverse(given.truth))
    off = truth[10] + [0.002, 0.0, 0.0]
    on_time = without_touch(given, 10, ObjectPose(off, 1e-8 * np.eye(3)))
    late = without_touch(given, 30, ObjectPose(off, 1e-8 * np.eye(3), 10 / 30))
    np.testing.assert_allclose(late.object_path()[0, 10], off, atol=2e-4)
    np.testing.assert_allclose(late.object_path(), on_time.object_path(), atol=2e-4)


def test_a_belief_that_is_no_gaussian_has_no_solution():
    given = contact(2, ROBUST)
    factors, beliefs = settings_record(ROBUST, given.model), given.prior.take([0, 0])
    beliefs.covariance[1, 0, 0] = -1.0
    with pytest.raises(EstimationError, match="indeterminate"):
        ContactWindow(Graph(factors, given.model), beliefs.take([1]), Step(given.sensor[0]))
    window = ContactWindow(Graph(factors, given.model), beliefs, Step(given.sensor[0]))
    assert window.rows["is_lost"].tolist() == [False, True]


def test_costs_and_surprise_by_hand():
    """One measurement: half the square of the direction's error, and of the sensor's and contact's, which are small."""
    given = contact(4, ROBUST)
    window = ContactWindow(Graph(settings_record(ROBUST, given.model), given.model), given.prior, Step(given.sensor[0]))
    for step in range(1, 5):
        assert (window.rows["surprise"] == 0.0).all()
        said = [ContactDirection(0.3, 1e-4), Turn(0.1, 1e-4)] if step == 4 else []
        window.add(Step(given.sensor[step], said))
    (measured, _pushing, is_ignored), last = window.costs()[0, -1], window.last(0)
    assert is_ignored == 0.0
    innovation, predicted, stated = window.rows["innovations"][0, DIRECTION, 0]
    noise = ROBUST.direction
    surprise = innovation**2 / (predicted + noise.share * max(1e-4, noise.floor**2))
    assert stated == 1e-4 and last["surprise"][DIRECTION] == pytest.approx(surprise)
    assert window.rows["surprise"][0, DIRECTION] == pytest.approx(surprise / 5)  # of five steps
    seen = np.angle(-last["touch"]["normal"] * np.exp(-1j * last["g"][2]))
    bias, scale = (window.rows["shared"][0, IN_SHARED[each].start] for each in (DIRECTION_BIAS, DIRECTION_SCALE))
    assert noise.kernel is not None
    square = (seen + scale * np.sin(seen) + bias - 0.3) ** 2 / (noise.share * max(1e-4, noise.floor**2))
    cost = 0.5 * noise.kernel**2 * np.log1p(square / noise.kernel**2)
    assert measured == pytest.approx(cost, rel=0.3) and measured > cost
