"""A touch since before it was known how the gel looks untouched, told from where the sensor was meanwhile."""

from palpate.gate.unfelt import UnfeltTouch

FIRST = 15
"""Images of half a second at 30 Hz, which count as untouched."""
DEVIATION = 0.004
"""[m] of the gap between sensor and object, as a first pose that is known roughly leaves it."""


def seen(gaps: list[float], felt_at: int | None = None) -> list[bool]:
    """What is said at frames with these gaps [m], of a sensor that feels something from a frame on."""
    touch = UnfeltTouch(is_doubtful=True, rate=30.0)
    said = []
    for index, gap in enumerate(gaps):
        touch.now = touch.sees((gap, DEVIATION), felt_at is not None and index >= felt_at, index >= FIRST - 1)
        said.append(touch.now)
    return said


def test_a_sensor_at_the_object_since_the_first_image_that_goes_on_into_it_touches_it():
    gaps = [0.002 - 0.0005 * index for index in range(40)]
    said = seen(gaps)
    assert said == [gap < -0.005 for gap in gaps] and any(said[FIRST:])


def test_one_that_came_from_afar_while_the_gel_was_learnt_does_not():
    """The first pose may be several millimetres off, and the touch is felt then all the same."""
    gaps = [0.03 - 0.0015 * index for index in range(40)]
    assert gaps[FIRST] < 3.0 * DEVIATION and gaps[24] < -0.005
    assert not any(seen(gaps)) and not any(seen(gaps, felt_at=25))


def test_only_the_images_that_are_taken_count():
    """A light that comes on late, or something that moves on the gel, lets the half second begin anew."""
    touch = UnfeltTouch(is_doubtful=True, rate=30.0)
    for gap in [0.05] * 20 + [0.0] * (FIRST - 1):
        assert not touch.sees((gap, DEVIATION), False, False)
    assert not touch.sees((0.0, DEVIATION), False, True) and touch.sees((-0.006, DEVIATION), False, True)


def test_what_is_felt_first_ends_the_doubt():
    gaps = [0.0] * 20 + [-0.01] * 5
    assert any(seen(gaps)) and not any(seen(gaps, felt_at=FIRST))
