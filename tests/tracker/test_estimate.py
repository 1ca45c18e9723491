"""Contact point of an estimate, against values worked out by hand."""

import math

import numpy as np
import pytest
from push_samples import SHAPES, sensor
from tracker_samples import settings

from palpate import Frame, Tracker

HALF = 0.2363 / 2  # [m] from the rectangle's centre to its left side


@pytest.mark.parametrize("turn", [0.0, np.pi / 2])
def test_the_contact_is_where_the_tip_touches_the_side(turn):
    """A tip that touches the left side 10 mm above its middle, and the same seen from a turned world."""
    cos, sin = math.cos(turn), math.sin(turn)
    world = np.array([[cos, -sin], [sin, cos]])
    first = np.array([1.0, 2.0, turn])
    touching = np.array([*(first[:2] + world @ [-HALF, 0.01]), turn])
    tracker = Tracker(SHAPES["rectangle"], sensor(), first, settings("none"))
    resting = tracker.update(Frame(0.0, touching - [*(world @ [0.1, 0.0]), 0.0], contact=False))
    assert (resting.contact_point, resting.contact_normal) == (None, None)
    found = tracker.update(Frame(0.1, touching, contact=True))
    assert found.contact_point is not None and found.contact_normal is not None
    np.testing.assert_allclose(found.contact_point, touching[:2], atol=3e-4)  # they are thought to overlap a little
    np.testing.assert_allclose(found.contact_normal, world @ [-1.0, 0.0], atol=0.01)
    assert np.hypot(*found.contact_normal) == pytest.approx(1.0)
