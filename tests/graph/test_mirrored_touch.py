"""Touch images that may be mirrored: both answers are kept until weights decide."""

import math

import numpy as np
import planar
import pytest
from push_samples import contact_directions, in_two_contacts, model_of

from palpate import ContactDirection, TrackerSettings
from palpate.filter.hypothesis_bank import HypothesisBank

FIRST_SIGMA = np.array([0.02, 0.02, math.radians(10.0)])
FELT = 0.03  # [rad]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_weights_decide_if_touch_images_are_mirrored(sign):
    o, e, contact = in_two_contacts("rectangle", 60)
    angles = sign * contact_directions(planar.between(o, e), model_of("rectangle"))
    bank = HypothesisBank(model_of("rectangle"), TrackerSettings(), o[0], np.diag(FIRST_SIGMA**2), may_be_mirrored=True)
    for k, (pose, angle) in enumerate(zip(e, angles, strict=True)):
        if contact[k]:
            bank.contact_step(pose, [ContactDirection(float(angle), FELT**2)], k / 30.0, from_touch=1)
        else:
            bank.end_contact()
            bank.rest_step(pose, (), k / 30.0)
        assert not bank.is_mirrored or k > 5  # a few frames cannot tell
    assert bank.is_mirrored == (sign < 0.0)
    assert np.hypot(*(bank.report(9.0).pose - o[-1])[:2]) < 5e-3
