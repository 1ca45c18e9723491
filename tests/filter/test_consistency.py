"""What makes status and covariance: strain, displacement, uncertainty and calibration, by hand."""

import math
from copy import copy
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from push_samples import SHAPES, sensor

from palpate.filter.belief import Prior
from palpate.filter.consistency import (
    REASONS,
    STRAIN_EXPECTED,
    STRAIN_FRAMES,
    STRAIN_LIMIT,
    UNCERTAIN,
    Diagnosis,
    Status,
)
from palpate.geometry import se2
from palpate.graph.contact_geometry import contact_model
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE, OUTLINE_SCALE
from palpate.types.measurements import ContactDirection

Array = np.ndarray
ONE_TIP = contact_model(SHAPES["rectangle"], sensor(), 0.05)
TWO_TIPS = contact_model(SHAPES["rectangle"], sensor(tips=((0.0, 0.02), (0.004, -0.02))), 0.05)
LEFT = -0.2363 / 2  # [m], the rectangle's left side
SURPRISE = 3.0
CONTACT = 3e-4  # [m]
EXACT = (0.0, 0.0, 0.0)  # frames that agree


def known(deviation: tuple[float, float, float] = (4e-4, 1e-3, 1e-3), depth: float = 0.0) -> Prior:
    values = np.zeros(OBJECT_SIZE)
    values[IN_OBJECT[DEPTH]] = depth
    return Prior(np.zeros(3), values, np.diag(np.square([*deviation, *[1e-9] * OBJECT_SIZE])))


ROUGH = known((6e-3, 1e-3, 1e-3))
"""An object that was not found again: more than 5 mm."""


def at(gap: float, y: float = 0.0) -> Array:
    """A sensor pose at which the first tip is so far off the left side."""
    return np.array([LEFT - gap, y, 0.0])


def test_nothing_is_wrong_at_first():
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    assert not diagnosis.displaced
    assert diagnosis.in_contact(known()) == "tracking"
    assert diagnosis.at_rest(known()) == "resting"
    np.testing.assert_array_equal(diagnosis.covariance(known()), known().pose_covariance)
    assert not diagnosis.displacement_covariance().any()


def test_a_gap_is_known_as_well_as_all_that_it_follows_from():
    rng = np.random.default_rng(1)
    root = 1e-3 * rng.normal(size=(3 + OBJECT_SIZE, 3 + OBJECT_SIZE))
    values = np.zeros(OBJECT_SIZE)
    values[IN_OBJECT[DEPTH]], values[IN_OBJECT[OUTLINE_SCALE]] = 3e-4, 0.02
    prior, diagnosis = Prior(np.array([0.3, -0.2, 3.1]), values, root @ root.T), Diagnosis(ONE_TIP, CONTACT, EXACT)
    sensor_pose = se2.compose(prior.pose, at(2e-3, 0.03))
    # 2 mm off the outline, 0.3 mm more until it is as deep as it will be, 2 % of the side's 118 mm less.
    gap, deviation = diagnosis.gap(prior, sensor_pose)
    assert gap == pytest.approx(2.3e-3 + 0.02 * LEFT, abs=1e-6)

    def moved(step: Array) -> float:
        other = replace(prior, pose=se2.compose(prior.pose, se2.exp(step[:3])), values=prior.values + step[3:])
        return diagnosis.gap(other, sensor_pose)[0]

    by_all = np.array([(moved(step) - moved(-step)) / 2e-6 for step in 1e-6 * np.eye(3 + OBJECT_SIZE)])
    assert deviation == pytest.approx(np.sqrt(by_all @ prior.covariance @ by_all + CONTACT**2), rel=1e-3)


@pytest.mark.parametrize(("beyond", "displaced"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("depth", [0.0, 3e-4])
def test_a_sensor_within_an_untouched_object(beyond, displaced, depth):
    # The gap, depth and all, is known to hypot(0.4 mm, 0.3 mm) = 0.5 mm: three of them are 1.5 mm.
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known(depth=depth)
    diagnosis.see_rest(prior, at(-beyond * 1.5e-3 - depth))
    assert diagnosis.displaced == displaced
    assert diagnosis.at_rest(prior) == ("displaced" if displaced else "resting")
    assert diagnosis.in_contact(ROUGH) == ("displaced" if displaced else "tracking")
    # Twice what the gap shows, and an angle at c of it.
    length = 2.0 * 1.5e-3 * beyond if displaced else 0.0
    wanted = np.diag(np.square([length, length, length / 0.05]))
    np.testing.assert_allclose(diagnosis.displacement_covariance(), wanted, rtol=1e-3)
    # As far off as one likes is no surprise.
    apart = Diagnosis(ONE_TIP, CONTACT, EXACT)
    apart.see_rest(prior, at(0.3))
    assert not apart.displaced


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("beyond", "displaced"), [(0.99, False), (1.01, True)])
def test_a_touch_where_the_object_should_not_be(beyond, displaced, side):
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known()
    diagnosis.see_first_touch(prior, at(side * beyond * 1.5e-3), [])
    assert diagnosis.displaced == displaced
    assert diagnosis.in_contact(ROUGH) == ("displaced" if displaced else "tracking")


def test_how_well_the_gap_is_known_depends_on_where():
    # 50 mm along the side a turn by 0.02 rad moves the side by 1 mm; in its middle not at all.
    prior = known((4e-4, 1e-3, 0.02))
    for y, displaced in ((0.0, True), (0.05, False)):
        diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
        diagnosis.see_first_touch(prior, at(2.5e-3, y), [])
        assert diagnosis.displaced == displaced
    # The same of an object that stands elsewhere, and of its covariance in its own frame.
    moved = np.array([0.4, -0.3, 2.0])
    for y, displaced in ((0.0, True), (0.05, False)):
        diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
        there = Prior(moved, prior.values, prior.covariance)
        diagnosis.see_first_touch(there, se2.compose(moved, at(2.5e-3, y)), [])
        assert diagnosis.displaced == displaced


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("beyond", "displaced"), [(0.99, False), (1.01, True)])
def test_a_touch_from_where_the_object_should_not_be(beyond, displaced, side):
    # Yaw is known to 0.03 rad, frames agree to 0.02, and the direction is said to 0.06: to 0.07 together.
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, (0.0, 0.0, 0.02)), known((4e-4, 1e-3, 0.03))
    angle = side * beyond * SURPRISE * 0.07
    diagnosis.see_first_touch(prior, at(0.0), [ContactDirection(angle, 0.06**2)])
    assert diagnosis.displaced == displaced
    # The object turned by that much and moved by as much at c.
    turned = np.array([0.05 * angle, 0.05 * angle, angle]) if displaced else np.zeros(3)
    np.testing.assert_allclose(diagnosis.displacement_covariance(), np.diag(np.square(turned)), atol=1e-9)


@pytest.mark.parametrize(("from_corner", "displaced"), [(0.004, False), (0.02, True)])
def test_a_corner_that_may_be_what_is_touched_is_no_surprise(from_corner, displaced):
    # The corner, about which the contact goes over the tip by 5 mm or 0.24 rad, is so near or is not, known to 3 mm.
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known((4e-4, 3e-3, 1e-3))
    corner = at(0.0, 0.1579 / 2 - from_corner)
    diagnosis.see_first_touch(prior, corner, [ContactDirection(-0.4, 0.06**2)])
    assert diagnosis.displaced == displaced


def test_of_several_tips_the_nearest_counts():
    # The second tip stands 4 mm ahead, so that it bears all: the gap is its own and a little more, see `ContactModel`.
    ahead = 4e-3 - 2e-4 * math.log(2.0)
    diagnosis = Diagnosis(TWO_TIPS, CONTACT, EXACT)
    diagnosis.see_first_touch(known(), at(ahead), [])
    assert not diagnosis.displaced
    diagnosis.see_first_touch(known(), at(0.0), [])
    assert diagnosis.displaced
    np.testing.assert_allclose(diagnosis.displacement_covariance()[0, 0], (2.0 * ahead) ** 2, rtol=1e-3)


def test_the_largest_displacement_stays_until_the_object_is_found():
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    for gap in (-2e-3, -5e-3, -3e-3, 0.2):
        diagnosis.see_rest(known(), at(gap))
    np.testing.assert_allclose(diagnosis.displacement_covariance()[0, 0], (2.0 * 5e-3) ** 2, rtol=1e-3)
    diagnosis.forget_displacement()
    assert not diagnosis.displaced


@pytest.mark.parametrize("number", range(3))
def test_an_object_that_is_found_is_no_longer_displaced(number):
    limit = (0.005, 0.005, 0.1)[number]
    diagnosis = Diagnosis(ONE_TIP, CONTACT, (0.01, 0.01, 0.15))
    diagnosis.see_first_touch(known(), at(5e-3), [])
    for share, status in ((1.01, "displaced"), (0.99, "tracking"), (1.01, "displaced")):
        deviation = [1e-4, 1e-4, 1e-4]
        deviation[number] = share * limit
        found = known((deviation[0], deviation[1], deviation[2]))
        # Calibration, which stays, does not hide it.
        assert diagnosis.in_contact(found) == status
        # Where nothing touches it, nothing finds it.
        assert diagnosis.at_rest(found) == "displaced"
        assert diagnosis.displaced


@pytest.mark.parametrize(("into", "displaced"), [(0.89e-3, False), (0.91e-3, True), (-0.91e-3, False), (-0.2, False)])
@pytest.mark.parametrize("before", [1e-3, -1e-3])
def test_a_sensor_that_goes_on_into_an_object_it_let_go_of(before, into, displaced):
    # However badly the object is known, on one straight side it is as far from the one pose as from the other: three
    # times the noise of 0.3 mm.
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known((0.01, 0.01, 1e-4), depth=2e-4)
    diagnosis.see_after_touch(prior, at(before), at(before - into), 1.0)
    assert diagnosis.displaced == displaced
    assert diagnosis.at_rest(prior) == ("displaced" if displaced else "resting")


def test_an_object_that_went_away_is_farther_off_the_longer_ago():
    # By 0.15 m/s, and by 10 mm at most; twice as much is its standard deviation, and an angle at c of that.
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    for since, length in ((0.01, 1.5e-3), (1 / 30, 5e-3), (0.06, 9e-3), (0.05, 9e-3), (0.07, 10e-3), (5.0, 10e-3)):
        diagnosis.see_after_touch(known(), at(0.0), at(-1e-3), since)
        wanted = np.diag(np.square([2.0 * length, 2.0 * length, 2.0 * length / 0.05]))
        np.testing.assert_allclose(diagnosis.displacement_covariance(), wanted, rtol=1e-9)
    # One that went farther by what the gap shows is farther off.
    diagnosis.see_rest(known(), at(-0.015))
    diagnosis.see_after_touch(known(), at(0.0), at(-0.015), 5.0)
    np.testing.assert_allclose(diagnosis.displacement_covariance()[0, 0], (2.0 * 15e-3) ** 2, rtol=1e-3)


@pytest.mark.parametrize("moved", [(0.0, 0.0, 0.0), (0.4, -0.3, 2.0)])
def test_a_gap_that_is_known_to_change_only_roughly_is_no_sign(moved):
    # 50 mm along the side a turn by 0.02 rad changes the gap by 1 mm: three times hypot(1 mm, 0.3 mm) are 3.13 mm.
    def is_displaced(deviation: tuple[float, float, float], before: Array, now: Array) -> bool:
        diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known(deviation)
        there = Prior(np.array(moved), prior.values, prior.covariance)
        before, now = (se2.compose(np.array(moved), pose) for pose in (before, now))
        diagnosis.see_after_touch(there, before, now, 1.0)
        return diagnosis.displaced

    turning = (1e-3, 1e-3, 0.02)
    assert is_displaced(turning, at(0.0), at(-3.1e-3))
    assert not is_displaced(turning, at(0.0), at(-3.1e-3, 0.05))
    assert is_displaced(turning, at(0.0), at(-3.2e-3, 0.05))
    # Round a corner the gap changes by what is not known along the side, too: its normal turns from -x to -x + y, which
    # are apart by 2 sin(pi / 8) = 0.765; 3 hypot(0.765 * 2 mm, 0.3 mm) are 4.68 mm.
    corner = np.array([LEFT, 0.1579 / 2, 0.0])

    def beyond_corner(gap: float) -> Array:
        out = (0.021 + gap) * np.sqrt(0.5)  # of the tip's centre, which is 21 mm behind the sensor's origin
        return corner + np.array([0.021 - out, out, 0.0])

    shifting = (2e-3, 2e-3, 1e-6)
    assert is_displaced(shifting, at(0.0), at(-4.5e-3))
    assert not is_displaced(shifting, at(0.0), beyond_corner(-4.5e-3))
    assert is_displaced(shifting, at(0.0), beyond_corner(-4.9e-3))


def errors(*of_one_row: float) -> dict[str, Array]:
    return {"sticking": np.array(of_one_row[:2]), "balance": np.array(of_one_row[2:])}


def test_strain_is_the_mean_square_of_the_row_worst_off():
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, EXACT), known()
    size = np.sqrt(1.1 * STRAIN_LIMIT)
    # As if the frames before had none: it takes nearly all of them.
    for frame in range(STRAIN_FRAMES):
        assert diagnosis.in_contact(prior) == ("tracking" if frame < STRAIN_FRAMES / 1.1 else "strained")
        diagnosis.see_errors(errors(0.0, size, 0.0))
    strain = 1.1 * STRAIN_LIMIT / STRAIN_EXPECTED
    np.testing.assert_allclose(diagnosis.covariance(prior), strain * prior.pose_covariance)
    # It stays, for nothing measures what has shifted; the largest counts.
    diagnosis.forget_errors()
    for _ in range(STRAIN_FRAMES):
        diagnosis.see_errors(errors(0.1, 0.0, 0.1))
    assert diagnosis.in_contact(prior) == "strained"
    np.testing.assert_allclose(diagnosis.covariance(prior), strain * prior.pose_covariance)
    assert diagnosis.at_rest(prior) == "resting"


def test_errors_of_rows_do_not_add_up():
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    size = np.sqrt(0.9 * STRAIN_LIMIT)
    for _ in range(2 * STRAIN_FRAMES):
        diagnosis.see_errors(errors(size, -size, size))
    assert diagnosis.in_contact(known()) == "tracking"


def test_strain_is_counted_anew_in_a_new_contact():
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    size = np.sqrt(1.5 * STRAIN_LIMIT)
    for _ in range(3):
        for _ in range(STRAIN_FRAMES // 2):
            diagnosis.see_errors(errors(size, 0.0, 0.0))
        diagnosis.see_errors({})  # the first step of a contact has none
        diagnosis.forget_errors()
    assert diagnosis.in_contact(known()) == "tracking"


@pytest.mark.parametrize("number", range(3))
def test_a_covariance_so_large_that_it_is_a_guess(number):
    limit = (0.02, 0.02, 0.2)[number]
    assert UNCERTAIN[number] == limit
    for share, touched, untouched in ((0.99, "tracking", "resting"), (1.01, "uncertain", "uncertain")):
        deviation = [1e-4, 1e-4, 1e-4]
        deviation[number] = share * limit
        prior = known((deviation[0], deviation[1], deviation[2]))
        diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
        assert diagnosis.in_contact(prior) == touched
        assert diagnosis.at_rest(prior) == untouched
        # The same where strain makes it as large as that: variances by nine.
        part = known((deviation[0] / 3.0, deviation[1] / 3.0, deviation[2] / 3.0))
        assert diagnosis.at_rest(part) == "resting"
        for _ in range(STRAIN_FRAMES):
            diagnosis.see_errors(errors(np.sqrt(9.0 * STRAIN_EXPECTED), 0.0, 0.0))
        assert diagnosis.at_rest(part) == untouched
        assert diagnosis.in_contact(part) == touched.replace("tracking", "strained")
    # Displaced says more.
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    diagnosis.see_rest(known(), at(-0.05))
    assert diagnosis.in_contact(known((0.1, 0.1, 0.1))) == "displaced"
    assert diagnosis.at_rest(known((0.1, 0.1, 0.1))) == "displaced"


def test_the_covariance_of_an_unknown_motion():
    found = Diagnosis(ONE_TIP, CONTACT, EXACT).covariance_of_motion(2e-3)
    np.testing.assert_allclose(found, np.diag(np.square([2e-3, 2e-3, 0.04])))


CALIBRATION = (1e-3, 2e-3, 9e-3)


def test_calibration_is_part_of_what_is_reported():
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT, CALIBRATION), known()
    calibration = np.diag([1e-6, 4e-6, 81e-6])
    np.testing.assert_allclose(diagnosis.covariance(prior), prior.pose_covariance + calibration, rtol=1e-12)
    # Strain puts pushing in doubt, and not how frames agree.
    for _ in range(STRAIN_FRAMES):
        diagnosis.see_errors(errors(np.sqrt(9.0 * STRAIN_EXPECTED), 0.0, 0.0))
    np.testing.assert_allclose(diagnosis.covariance(prior), 9.0 * prior.pose_covariance + calibration, rtol=1e-12)
    # So large a one is a guess whatever else is known.
    assert Diagnosis(ONE_TIP, CONTACT, (0.0, 0.0, 0.21)).in_contact(prior) == "uncertain"


@pytest.mark.parametrize("gap", [0.99, 1.01])
def test_calibration_is_part_of_nothing_else(gap):
    # A displaced object is seen as well as with frames that agree: beyond three times hypot(0.4 mm, 0.3 mm).
    prior = known()
    for calibration in (EXACT, CALIBRATION):
        resting, touched = (Diagnosis(ONE_TIP, CONTACT, calibration) for _ in range(2))
        resting.see_rest(prior, at(-gap * 1.5e-3))
        touched.see_first_touch(prior, at(gap * 1.5e-3), [])
        assert resting.displaced == touched.displaced == (gap > 1.0)
        length = 2.0 * 1.5e-3 * gap if gap > 1.0 else 0.0
        np.testing.assert_allclose(resting.displacement_covariance()[0, 0], length**2, rtol=1e-3)
        np.testing.assert_allclose(resting.covariance_of_motion(2e-3), np.diag(np.square([2e-3, 2e-3, 0.04])))
    np.testing.assert_array_equal(prior.covariance, known().covariance)


def test_a_copy_goes_its_own_way():
    diagnosis = Diagnosis(ONE_TIP, CONTACT, EXACT)
    size = np.sqrt(1.5 * STRAIN_LIMIT)
    for _ in range(STRAIN_FRAMES // 2):
        diagnosis.see_errors(errors(size, 0.0, 0.0))
    other = copy(diagnosis)
    for _ in range(STRAIN_FRAMES // 2):
        other.see_errors(errors(size, 0.0, 0.0))
    other.see_rest(known(), at(-5e-3))
    # Half of the frames were counted before, the other half by one of them.
    assert other.displaced and not diagnosis.displaced
    np.testing.assert_allclose(
        other.covariance(known()), 1.5 * STRAIN_LIMIT / STRAIN_EXPECTED * known().pose_covariance
    )
    np.testing.assert_array_equal(diagnosis.covariance(known()), known().pose_covariance)
    diagnosis.see_errors(errors(size, 0.0, 0.0))
    assert diagnosis.in_contact(known()) == "tracking"


def test_every_status_has_a_reason():
    assert set(REASONS) == set(get_args(Status))
    assert [status for status, reason in REASONS.items() if not reason] == ["resting", "tracking"]
