"""What iSAM2 does besides what all smoothers do: factors whose weights change are replaced."""

import gtsam
import numpy as np
import pytest
from push_samples import noisy, tips_of
from smoother_samples import ROBUST, Contact, contact, fed, felt, known_at

from palpate.geometry import se2
from palpate.graph import make_smoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.pushing import ANGLE_STEPS
from palpate.recording.measurements import ContactDirection

Array = np.ndarray
START = np.array([-0.2363 / 2, 0.0, 0.0])


def sliding(steps: int, share: float, seed: int = 0) -> Contact:
    """A tip that slides along the left side of a resting rectangle: so much of its 1 mm a step goes along the side."""
    rng = np.random.default_rng(seed)
    sensor = START + 1e-3 * np.arange(steps + 1)[:, None] * [0.0, share, 0.0]
    directions = [ContactDirection(float(angle), 0.03**2) for angle in rng.normal(0.0, 0.03, steps + 1)]
    known = known_at(np.zeros(3), ROBUST)
    nothing = [None] * (steps + 1)
    measured = noisy(sensor, ROBUST.sensor, rng)
    return Contact(sensor, tips_of("rectangle"), measured, known, list(nothing), list(directions), list(nothing))


def custom_factors(smoother: Isam2Smoother) -> int:
    factors = smoother._isam.getFactorsUnsafe()
    there = [factors.at(place) for place in range(factors.size()) if factors.exists(place)]
    return sum(isinstance(factor, gtsam.CustomFactor) for factor in there)


@pytest.mark.parametrize("given", [felt(contact(15, ROBUST)), sliding(15, 1.0)], ids=["sticks", "slides"])
def test_a_step_has_one_factor_however_often_it_is_replaced(given):
    smoother = Isam2Smoother(given.tips, ROBUST)
    fed(smoother, given)
    assert custom_factors(smoother) == 16
    assert [step.now for step in smoother._recent] == list(range(15 - ANGLE_STEPS, 16))
    places = [step.place for step in smoother._recent]
    assert len(set(places)) == len(places)
    assert max(places) > 2 * 15  # a factor and a prior a step would be as many; there were more, which are gone


def test_where_the_contact_slides_it_says_what_the_fixed_lag_does():
    given = sliding(20, 1.0)
    lagged, incremental = (
        fed(make_smoother(name, given.tips, ROBUST), given).belief() for name in ("fixed-lag", "isam2")
    )
    deviation = np.sqrt(np.diag(lagged.covariance))
    assert lagged.g[1] > 10e-3  # of 20 mm
    assert (np.abs(se2.log(se2.between(lagged.g, incremental.g))) < 0.5 * deviation[:3]).all()
    ratio = np.sqrt(np.diag(incremental.covariance)) / deviation
    assert (ratio > 0.7).all()
    assert (ratio < 1.4).all()
