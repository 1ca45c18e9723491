"""Contact flags and doubts about ground truth, from geometry."""

import numpy as np
from recording_samples import runs

from palpate.lab.paper.images import episode_numbers
from palpate.types.recording import contact_flags, spikes


def test_contact_has_hysteresis_and_lasts_through_what_is_not_known():
    gap = np.array([np.nan, 1.8, 1.4, 1.8, np.nan, 2.1, 1.8, np.nan, 1.0]) * 1e-3
    expected = [False, False, True, True, True, False, False, False, True]
    assert contact_flags(gap, 1.5e-3, 2e-3).tolist() == expected


def test_spikes_go_there_and_back():
    pose = np.zeros((12, 3))
    pose[:, 0] = np.repeat(np.arange(4), 3) * 1e-3  # each pose is held for three samples
    pose[3:6, 1] = 0.01
    assert runs(spikes(pose)) == [[3, 6]]
    step = np.zeros((12, 3))
    step[6:, :2] = 0.05
    assert not spikes(step).any()
    turn = np.zeros((12, 3))
    turn[:, 2] = np.repeat([3.1, 3.13, -3.13, -3.1], 3)  # goes through pi, 1.7 degrees a step at most
    assert not spikes(turn).any()
    turn[3:6, 2] = -3.0
    assert runs(spikes(turn)) == [[3, 6]]
    turn[0] = np.nan
    assert runs(spikes(turn)) == [[3, 6]]


def test_episodes_end_after_more_than_ten_frames_without_contact():
    ten = [1] * 5 + [0] * 10 + [1] * 5
    eleven = [1] * 5 + [0] * 11 + [1] * 5
    assert episode_numbers(ten).tolist() == [0] * 5 + [-1] * 10 + [0] * 5
    assert episode_numbers(eleven).tolist() == [0] * 5 + [-1] * 11 + [1] * 5
    four = [0] + [1] * 4 + [0] * 11 + [1] * 5  # too few for an episode
    assert episode_numbers(four).tolist() == [-1] * 16 + [0] * 5
    assert episode_numbers([]).tolist() == []
