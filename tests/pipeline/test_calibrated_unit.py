"""What a tracker believes of a unit that was calibrated with presses."""

import numpy as np
import pytest

from palpate.config import NoiseSettings
from palpate.touch.calibration import DirectionCorrection
from palpate.tracker_arguments import with_correction


def test_a_calibration_leaves_of_offset_and_scale_what_it_does_not_know():
    noise = NoiseSettings()
    found = with_correction(noise, DirectionCorrection(0.03, 0.8, 0.004, 0.024)).priors
    assert found.direction_bias == (0.0, 0.004)
    assert found.direction_scale == (0.0, pytest.approx(0.03))  # of what is left after dividing by 0.8
    others = [name for name in vars(found) if name not in ("direction_bias", "direction_scale")]
    assert all(np.array_equal(getattr(found, name), getattr(noise.priors, name)) for name in others)
    old = with_correction(noise, DirectionCorrection(0.03, 0.8, 0.004)).priors
    assert (old.direction_bias, old.direction_scale) == ((0.0, 0.004), noise.priors.direction_scale)
    assert with_correction(noise, DirectionCorrection()) == noise
