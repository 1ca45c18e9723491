"""What makes status and covariance: strain, displacement and uncertainty, by hand."""

import numpy as np
import pytest
from push_samples import SHAPES, sensor

from palpate.estimation.belief import Prior
from palpate.estimation.contact_model import contact_model
from palpate.estimation.diagnosis import STRAIN_EXPECTED, STRAIN_FRAMES, STRAIN_LIMIT, Diagnosis
from palpate.estimation.unknowns import DEPTH, IN_OBJECT, OBJECT_SIZE
from palpate.geometry import se2

Array = np.ndarray
ONE_TIP = contact_model(SHAPES["rectangle"], sensor(), 0.05)
TWO_TIPS = contact_model(SHAPES["rectangle"], sensor(tips=((0.0, 0.02), (0.004, -0.02))), 0.05)
LEFT = -0.2363 / 2  # [m], the rectangle's left side
SURPRISE = 3.0
CONTACT = 3e-4  # [m]


def known(deviation: tuple[float, float, float] = (4e-4, 1e-3, 1e-3), depth: float = 0.0) -> Prior:
    values = np.zeros(OBJECT_SIZE)
    values[IN_OBJECT[DEPTH]] = depth
    return Prior(np.zeros(3), values, np.diag(np.square([*deviation, *[0.1] * OBJECT_SIZE])))


def at(gap: float, y: float = 0.0) -> Array:
    """A sensor pose at which the first tip is so far off the left side."""
    return np.array([LEFT - gap, y, 0.0])


def test_nothing_is_wrong_at_first():
    diagnosis = Diagnosis(ONE_TIP, CONTACT)
    assert not diagnosis.displaced
    assert diagnosis.in_contact(known()) == "tracking"
    assert diagnosis.at_rest() == "resting"
    np.testing.assert_array_equal(diagnosis.covariance(known()), known().pose_covariance)
    assert not diagnosis.displacement_covariance().any()


@pytest.mark.parametrize(("beyond", "displaced"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("depth", [0.0, 3e-4])
def test_a_sensor_within_an_untouched_object(beyond, displaced, depth):
    # The gap, depth and all, is known to hypot(0.4 mm, 0.3 mm) = 0.5 mm: three of them are 1.5 mm.
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT), known(depth=depth)
    diagnosis.see_rest(prior, at(-beyond * 1.5e-3 - depth))
    assert diagnosis.displaced == displaced
    assert diagnosis.at_rest() == diagnosis.in_contact(prior).replace("tracking", "resting")
    assert diagnosis.at_rest() == ("displaced" if displaced else "resting")
    # Twice what the gap shows, and an angle at c of it.
    length = 2.0 * 1.5e-3 * beyond if displaced else 0.0
    wanted = np.diag(np.square([length, length, length / 0.05]))
    np.testing.assert_allclose(diagnosis.displacement_covariance(), wanted, rtol=1e-3)
    # As far off as one likes is no surprise.
    apart = Diagnosis(ONE_TIP, CONTACT)
    apart.see_rest(prior, at(0.3))
    assert not apart.displaced


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("beyond", "displaced"), [(0.99, False), (1.01, True)])
def test_a_touch_where_the_object_should_not_be(beyond, displaced, side):
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT), known()
    diagnosis.see_first_touch(prior, at(side * beyond * 1.5e-3))
    assert diagnosis.displaced == displaced
    assert diagnosis.in_contact(prior) == ("displaced" if displaced else "tracking")


def test_how_well_the_gap_is_known_depends_on_where():
    # 50 mm along the side a turn by 0.02 rad moves the side by 1 mm; in its middle not at all.
    prior = known((4e-4, 1e-3, 0.02))
    for y, displaced in ((0.0, True), (0.05, False)):
        diagnosis = Diagnosis(ONE_TIP, CONTACT)
        diagnosis.see_first_touch(prior, at(2.5e-3, y))
        assert diagnosis.displaced == displaced
    # The same of an object that stands elsewhere, and of its covariance in its own frame.
    moved = np.array([0.4, -0.3, 2.0])
    for y, displaced in ((0.0, True), (0.05, False)):
        diagnosis = Diagnosis(ONE_TIP, CONTACT)
        there = Prior(moved, prior.values, prior.covariance)
        diagnosis.see_first_touch(there, se2.compose(moved, at(2.5e-3, y)))
        assert diagnosis.displaced == displaced


def test_of_several_tips_the_nearest_counts():
    # The second tip stands 4 mm ahead.
    diagnosis = Diagnosis(TWO_TIPS, CONTACT)
    diagnosis.see_first_touch(known(), at(4e-3))
    assert not diagnosis.displaced
    diagnosis.see_first_touch(known(), at(0.0))
    assert diagnosis.displaced
    np.testing.assert_allclose(diagnosis.displacement_covariance()[0, 0], (2.0 * 4e-3) ** 2, rtol=1e-3)


def test_the_largest_displacement_stays_until_the_object_is_found():
    diagnosis = Diagnosis(ONE_TIP, CONTACT)
    for gap in (-2e-3, -5e-3, -3e-3, 0.2):
        diagnosis.see_rest(known(), at(gap))
    np.testing.assert_allclose(diagnosis.displacement_covariance()[0, 0], (2.0 * 5e-3) ** 2, rtol=1e-3)
    diagnosis.forget_displacement()
    assert not diagnosis.displaced


def errors(*of_one_row: float) -> dict[str, Array]:
    return {"sticking": np.array(of_one_row[:2]), "balance": np.array(of_one_row[2:])}


def test_strain_is_the_mean_square_of_the_row_worst_off():
    diagnosis, prior = Diagnosis(ONE_TIP, CONTACT), known()
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
    assert diagnosis.at_rest() == "resting"


def test_errors_of_rows_do_not_add_up():
    diagnosis = Diagnosis(ONE_TIP, CONTACT)
    size = np.sqrt(0.9 * STRAIN_LIMIT)
    for _ in range(2 * STRAIN_FRAMES):
        diagnosis.see_errors(errors(size, -size, size))
    assert diagnosis.in_contact(known()) == "tracking"


def test_strain_is_counted_anew_in_a_new_contact():
    diagnosis = Diagnosis(ONE_TIP, CONTACT)
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
    for share, status in ((0.99, "tracking"), (1.01, "uncertain")):
        deviation = [1e-4, 1e-4, 1e-4]
        deviation[number] = share * limit
        prior = known((deviation[0], deviation[1], deviation[2]))
        assert Diagnosis(ONE_TIP, CONTACT).in_contact(prior) == status
    # Displaced says more.
    diagnosis = Diagnosis(ONE_TIP, CONTACT)
    diagnosis.see_rest(known(), at(-0.05))
    assert diagnosis.in_contact(known((0.1, 0.1, 0.1))) == "displaced"


def test_the_covariance_of_an_unknown_motion():
    found = Diagnosis(ONE_TIP, CONTACT).covariance_of_motion(2e-3)
    np.testing.assert_allclose(found, np.diag(np.square([2e-3, 2e-3, 0.04])))
