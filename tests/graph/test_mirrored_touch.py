"""Touch images that may be mirrored: both answers are kept until weights decide."""

import math

import numpy as np
import planar
import pytest
from push_samples import contact_directions, in_two_contacts, model_of

from palpate import ContactDirection, Frame, TrackerSettings
from palpate.hypotheses.filter import MultiHypothesisFilter

FIRST_SIGMA = np.array([0.02, 0.02, math.radians(10.0)])
FELT = 0.03  # [rad]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_weights_decide_if_touch_images_are_mirrored(sign):
    o, e, contact = in_two_contacts("rectangle", 60)
    angles = sign * contact_directions(planar.between(o, e), model_of("rectangle"))
    first_covariance = np.diag(FIRST_SIGMA**2)
    estimator = MultiHypothesisFilter(
        model_of("rectangle"), TrackerSettings(), o[0], first_covariance, may_be_mirrored=True
    )
    last = None
    for k, (pose, angle) in enumerate(zip(e, angles, strict=True)):
        frame = Frame(k / 30.0, pose, contact=bool(contact[k]))
        if not contact[k]:
            estimator.end_contact()
        last = estimator.step(frame, [ContactDirection(float(angle), FELT**2)] if contact[k] else ())
        assert not estimator.is_mirrored or k > 5  # a few frames cannot tell
        if k == 5:
            assert set(last.rows.origins) >= {"rough start", "mirrored images"}
    assert last is not None
    assert estimator.is_mirrored == (sign < 0.0)
    assert np.hypot(*(last.rows.belief.pose[0] - o[-1])[:2]) < 5e-3
