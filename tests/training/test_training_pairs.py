"""Groups and pairs of samples, batches, and what is held out."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from training_samples import samples

from palpate.errors import SettingError
from palpate.training.pairs import CLOSEST, FARTHEST, batch, draw_groups, draw_pairs, turned
from palpate.training.train import split

LENGTHS = [5, 80, 11, 200, 6]


@pytest.mark.parametrize("episodes", [None, [3, 9, 4, 17, 5]])  # counted through, or some of them in any order
def test_groups_are_of_one_contact_and_not_long(episodes):
    given = samples(LENGTHS)
    if episodes:
        given = dataclasses.replace(given, episode=np.array(episodes)[given.episode])
    chosen = draw_groups(given, 4000, 8, np.random.default_rng(0))
    assert chosen.shape == (4000, 8)
    episode, frame = given.episode[chosen], given.frame[chosen]
    assert (episode == episode[:, :1]).all()
    extent = np.ptp(frame, axis=1)
    assert extent.max() == FARTHEST and extent.min() >= 0
    assert len(np.unique(chosen)) == len(given)  # all that there is gets drawn
    assert (np.diff(chosen, axis=1) < 0).any()  # in any order


def test_groups_are_of_all_kinds_equally_often():
    given = samples(LENGTHS)
    given = dataclasses.replace(given, kind=np.array([4, 0, 0, 0, 2])[given.episode])
    chosen = draw_groups(given, 6000, 3, np.random.default_rng(0))
    shares = [np.mean(given.episode[chosen[:, 0]] == each) for each in range(5)]
    # A third of each of the three kinds; of the one that has 80, 11 and 200 frames, as the frames are.
    np.testing.assert_allclose(shares, [1 / 3, 80 / 873, 11 / 873, 200 / 873, 1 / 3], atol=0.02)


def test_pairs_are_of_one_contact_and_10_to_50_apart():
    given = samples(LENGTHS)
    earlier, later = draw_pairs(given, 20_000, np.random.default_rng(0))
    assert (given.episode[earlier] == given.episode[later]).all()
    apart = given.frame[later] - given.frame[earlier]
    assert (apart.min(), apart.max()) == (CLOSEST, FARTHEST) == (10, 50)
    assert set(np.unique(apart)) == set(range(10, 51))
    # Contacts of 5 and 6 frames have none; that of 11 has one.
    assert set(np.unique(given.episode[earlier])) == {1, 2, 3}
    assert {(a, b) for a, b in zip(earlier, later, strict=True) if given.episode[a] == 2} == {(85, 95)}
    again = draw_pairs(given, 20_000, np.random.default_rng(0))
    np.testing.assert_array_equal([earlier, later], again)


def test_no_contact_is_long_enough_for_pairs():
    with pytest.raises(SettingError, match="too few pairs to learn from: no contact has frames 10 apart"):
        draw_pairs(samples([10, 10, 10]), 5, np.random.default_rng(0))


def test_turns_are_those_of_the_sensor_on_the_object():
    given = dataclasses.replace(samples([3]), yaw=np.array([3.0, -3.0, 0.5]))
    # From 3 to -3 it is 2 pi - 6 onwards.
    np.testing.assert_allclose(turned(given, np.array([0, 2]), np.array([1, 0])), [2.0 * np.pi - 6.0, 2.5])


def test_a_batch_looks_like_units_of_other_brightness():
    given = samples([50])
    chosen = np.array([7, 3, 3])
    plain = batch(given, chosen)
    assert plain.shape == (3, 3, 2, 2)
    np.testing.assert_array_equal(plain[:, 0, 0, 0], chosen)  # a difference is its number
    many = batch(given, np.full(5000, 4), np.random.default_rng(0)).numpy()
    assert (np.ptp(many, axis=(2, 3)) == 0.0).all()  # one gain and tint for all of an image
    tint = many[:, :, 0, 0] - many[:, :, 0, 0].mean(axis=1, keepdims=True)
    assert tint.std() * np.sqrt(3 / 2) == pytest.approx(0.05, rel=0.05)
    # 4 times a gain of 0.75 to 1.3, whose deviation is 0.55 / sqrt(12), besides the mean of three tints.
    assert many.mean() == pytest.approx(4 * 1.025, abs=0.03)
    level = many[:, :, 0, 0].mean(axis=1)
    assert level.std() == pytest.approx(np.hypot(4 * 0.55 / np.sqrt(12), 0.05 / np.sqrt(3)), rel=0.03)


# --- holding out ---


def parted(given: Any, share: float = 0.15, seed: int = 0) -> tuple[Any, Any]:
    kept, held = split(given, share, np.random.default_rng(seed))
    assert len(kept) + len(held) == len(given)
    # Every difference is its number: none is lost or in both.
    both = np.concatenate([part.difference[:, 0, 0, 0] for part in (kept, held)])
    np.testing.assert_array_equal(np.sort(both), np.arange(len(given)))
    return kept, held


def test_recordings_are_held_out_whole():
    given = samples([15] * 60, recordings=np.repeat(np.arange(20), 3))
    kept, held = parted(given)
    assert not set(kept.recording) & set(held.recording)
    assert len(set(held.recording)) == 3  # 15 % of 20
    np.testing.assert_array_equal(held.yaw, given.yaw[np.isin(given.recording, held.recording)])
    assert set(parted(given, seed=1)[1].recording) != set(held.recording)
    assert set(parted(given)[1].recording) == set(held.recording)


def test_of_few_recordings_contacts_are_held_out():
    given = samples([30] * 20, recordings=np.repeat(np.arange(5), 4))
    kept, held = parted(given)
    assert not set(kept.episode) & set(held.episode)
    assert len(set(held.episode)) == 3
    assert len(set(parted(given, share=0.001)[1].episode)) == 1  # never none


@pytest.mark.parametrize(
    ("given", "found"),
    [(samples([8] * 12), "96 frames of 12 contacts"), (samples([900]), "900 frames of 1 contacts")],
)
def test_too_little_to_part(given, found):
    with pytest.raises(SettingError, match=f"too few pairs to learn from: {found}; at least 100 frames of 2 contacts"):
        split(given, 0.1, np.random.default_rng(0))
