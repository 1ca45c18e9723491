"""Contact flags and doubts about ground truth, from geometry."""

import numpy as np

from palpate.io.recording import contact_flags
from palpate_lab.paper.images import episode_numbers


def test_contact_has_hysteresis_and_lasts_through_what_is_not_known():
    gap = np.array([np.nan, 1.8, 1.4, 1.8, np.nan, 2.1, 1.8, np.nan, 1.0]) * 1e-3
    expected = [False, False, True, True, True, False, False, False, True]
    assert contact_flags(gap, 1.5e-3, 2e-3).tolist() == expected


def test_episodes_end_after_more_than_ten_frames_without_contact():
    ten = [1] * 5 + [0] * 10 + [1] * 5
    eleven = [1] * 5 + [0] * 11 + [1] * 5
    assert episode_numbers(ten).tolist() == [0] * 5 + [-1] * 10 + [0] * 5
    assert episode_numbers(eleven).tolist() == [0] * 5 + [-1] * 11 + [1] * 5
    four = [0] + [1] * 4 + [0] * 11 + [1] * 5  # too few for an episode
    assert episode_numbers(four).tolist() == [-1] * 16 + [0] * 5
    assert episode_numbers([]).tolist() == []
