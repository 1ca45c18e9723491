"""A contact at the pad's rim, which no image shows: it goes on while the sensor moves into the object."""

import numpy as np
import pytest

from palpate import track
from palpate.geometry.named_shapes import SHAPES
from palpate.input.unseen_contact import UnseenContact
from palpate.touch.contact_detector import touched
from palpate.types.measurements import ContactDirection, ContactPlace

FAINT = 0.006
"""Share of an image's values that shows a touch which fades."""


def contact(angle: float, share: float = FAINT, sigma: float = 0.05) -> UnseenContact:
    """Contact whose last image showed this direction [rad]."""
    unseen = UnseenContact()
    unseen.see([ContactDirection(angle, sigma**2)], share)
    return unseen


@pytest.mark.parametrize("angle", [0.5, -0.5])
def test_it_goes_on_at_either_side_of_the_pad_while_the_sensor_moves_in(angle):
    unseen = contact(angle)
    assert all(unseen.goes_on(-4e-4) for _ in range(60))
    assert unseen.goes_on(1e-4)  # noise of a pose


def test_it_ends_where_the_sensor_moves_out_at_once_or_slowly():
    assert not contact(0.5).goes_on(1e-3)
    slowly = contact(0.5)
    assert [slowly.goes_on(1e-4) for _ in range(10)].count(True) < 10
    assert not slowly.goes_on(1e-4)


def test_a_touch_in_the_middle_of_the_pad_or_a_strong_one_was_taken_away():
    assert not contact(0.1).goes_on(-4e-4)
    assert not contact(0.5, share=0.1).goes_on(-4e-4)


def test_the_last_sure_direction_counts():
    unseen = contact(0.5)
    unseen.see([ContactDirection(0.0, 0.7**2)], FAINT)  # what fades is read as the middle, and is not sure
    assert unseen.goes_on(-4e-4)
    unseen.see([ContactDirection(0.0, 0.05**2)], FAINT)
    assert not unseen.goes_on(-4e-4)


def test_it_says_nothing_without_directions():
    unseen = UnseenContact()
    unseen.see([ContactPlace(5e-3, 1e-6)], FAINT)
    assert not unseen.goes_on(-4e-4)


def test_a_push_that_slides_onto_the_rim_is_in_contact_to_its_end():
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    from palpate_lab.simulate.recordings import Simulation

    recording = Simulation(SHAPES["ellipse"], "ellipse", seed=301, seconds=6.0, ideal=True).run()
    assert recording.contact is not None and recording.image is not None
    true = recording.contact
    seen = touched(recording.image, recording.sensor)
    assert np.sum(true & ~seen) > 50  # the images lose it
    found = track(recording).online.contact
    assert np.sum(true & ~found) <= 2 and np.sum(found & ~true) <= 2
