"""Groups and pairs of samples, batches, and what is held out."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from training_samples import samples

from palpate.errors import SettingError
from palpate.lab.train import pairs
from palpate.lab.train.pairs import CLOSEST, FARTHEST, batch, draw_groups, draw_pairs, turned, varied_batch
from palpate.lab.train.train import split
from palpate.types.sensor import DIGIT

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


def test_a_batch_is_what_was_seen():
    chosen = np.array([7, 3, 3])
    plain = batch(samples([50]), chosen)
    assert plain.shape == (3, 3, 2, 2)
    np.testing.assert_array_equal(plain[:, 0, 0, 0], chosen)  # a difference is its number


def clear(monkeypatch: pytest.MonkeyPatch) -> None:
    """No clouds over images, light that is even, and no image is moved."""
    for name in ("_LASTING", "_PASSING", "_LIT", "_MOVED"):
        monkeypatch.setattr(pairs, name, 0.0)


def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Brightness and colours as they are."""
    for name in ("_GAIN", "_COLOUR_GAIN"):
        monkeypatch.setattr(pairs, name, (1.0, 1.0))
    monkeypatch.setattr(pairs, "_TINT", 0.0)


def test_a_varied_batch_looks_like_units_of_other_brightness_and_colours(monkeypatch: pytest.MonkeyPatch):
    clear(monkeypatch)
    seen = varied_batch(samples([50]), np.full((625, 8), 4), DIGIT, np.random.default_rng(0))
    many = seen.difference.numpy()
    assert many.shape == (5000, 3, 2, 2) and seen.sign.shape == (625, 1)
    # Over an image each colour shifts by a tint and a slope across and along, each of 0.05.
    slopes = np.stack([many[..., 1] - many[..., 0], many[..., 1, :] - many[..., 0, :]])
    assert 0.5 * slopes.std() == pytest.approx(0.05, rel=0.05)
    np.testing.assert_allclose(slopes[0, ..., 0], slopes[0, ..., 1], atol=1e-5)
    # 4 times the product of gains of 0.7 to 1.4 and 0.75 to 1.3.
    assert many.mean() == pytest.approx(4 * 1.05 * 1.025, rel=0.01)
    spread = np.hypot(0.7 / 1.05, 0.55 / 1.025) / np.sqrt(12)
    assert many.mean(axis=(2, 3)).std() == pytest.approx(4 * 1.05 * 1.025 * spread, rel=0.05)


def test_a_group_is_in_one_guise_and_its_angles_with_it(monkeypatch: pytest.MonkeyPatch):
    plain(monkeypatch)
    clear(monkeypatch)
    image = np.arange(12, dtype=np.float16).reshape(2, 2, 3)
    given = samples([50])
    given = dataclasses.replace(given, difference=np.broadcast_to(image, (50, 2, 2, 3)).copy())
    seen = varied_batch(given, np.arange(3000 * 2).reshape(3000, 2) % 50, DIGIT, np.random.default_rng(0))
    looks = seen.difference.permute(0, 2, 3, 1).numpy().reshape(3000, 2, 2, 2, 3)
    np.testing.assert_array_equal(looks[:, 0], looks[:, 1])
    found = {look.tobytes(): float(each) for look, each in zip(looks[:, 0], seen.sign, strict=True)}
    wanted = {
        image[:: 1 - 2 * up, :: 1 - 2 * over][..., order].astype(np.float32).tobytes(): 1.0 - 2.0 * over
        for up in (0, 1)
        for over in (0, 1)
        for order in itertools.permutations(range(3))
    }
    assert found == wanted  # all 24, and angles change their sign where left and right do
    as_it_is = (looks[:, 0] == image.astype(np.float32)).all(axis=(1, 2, 3)).mean()
    assert as_it_is == pytest.approx(0.5 + 0.5 / 24, abs=0.03)


def test_a_group_is_moved_over_the_gel_and_its_directions_with_it(monkeypatch: pytest.MonkeyPatch):
    plain(monkeypatch)
    for name in ("_LASTING", "_PASSING", "_LIT"):
        monkeypatch.setattr(pairs, name, 0.0)
    column_sine = 2 * 0.0092 / 128 / 0.021  # a DIGIT's pad is 18.4 mm wide and bent about 21 mm
    given, angle = samples([50]), np.radians(4.0)
    spots = np.zeros((50, 32, 128, 3), np.float16)
    spots[:, 16, round(64 + np.sin(angle) / column_sine)] = 1.0
    given = dataclasses.replace(given, difference=spots, direction=np.full(50, angle))
    chosen = np.arange(500 * 2).reshape(500, 2) % 50
    seen = varied_batch(given, chosen, DIGIT, np.random.default_rng(0))
    told = seen.direction(given.direction[chosen]).numpy()
    row, column = (found.reshape(500, 2) for found in np.nonzero(seen.difference.numpy()[:, 0])[1:])
    # Where the spot is tells the direction: to a column, and to one more where the image is mirrored.
    np.testing.assert_allclose(np.sin(told), (column - 64) * column_sine, atol=1.6 * column_sine)
    assert (told[:, 0] == told[:, 1]).all() and (row[:, 0] == row[:, 1]).all()
    assert 0.4 < (np.abs(np.abs(told[:, 0]) - angle) > 1e-6).mean() < 0.55  # half of them, but for moves of nothing
    assert np.abs(np.sin(told)).max() < 0.8 * 0.0092 / 0.021 and np.ptp(np.sin(told)) > 0.6
    assert np.ptp(row) == pytest.approx(8, abs=1)
    steep = dataclasses.replace(given, direction=np.full(50, 0.5))  # beyond the reach: its sine is 0.48
    told = varied_batch(steep, chosen, DIGIT, np.random.default_rng(0)).direction(steep.direction[chosen]).numpy()
    np.testing.assert_allclose(np.abs(told), 0.5, atol=1e-6)
    turn = np.linspace(0.0, 0.1, 1000).reshape(500, 2)
    np.testing.assert_allclose(seen.turn(turn), seen.sign.numpy() * turn, atol=1e-6)


def test_clouds_are_smooth_and_some_last_all_through_a_group(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pairs, "_TINT", 0.0)
    monkeypatch.setattr(pairs, "_LIT", 0.0)
    given = samples([50])
    given = dataclasses.replace(given, difference=np.zeros((50, 32, 128, 3), np.float16))
    seen = varied_batch(given, np.zeros((400, 2), int), DIGIT, np.random.default_rng(0))
    clouds = seen.difference.numpy().reshape(400, 2, 3, 32, 128)
    assert abs(clouds.mean()) < 2e-3
    # Of two images of a group what is alike has at most 0.12, what is not 0.06; a strength from 0 to m has a mean
    # square of m^2 / 3. Between its 4 x 8 points a cloud is an average, so that less is left of it.
    alike, other = (clouds[:, 0] * clouds[:, 1]).mean(), 0.5 * ((clouds[:, 0] - clouds[:, 1]) ** 2).mean()
    assert 0.4 * 0.12**2 / 3 < alike < 0.12**2 / 3 and 0.4 * 0.06**2 / 3 < other < 0.06**2 / 3
    assert np.abs(np.diff(clouds, axis=-1)).mean() < 0.1 * np.abs(clouds).mean()


def test_each_light_is_stronger_here_and_weaker_there_all_through_a_group(monkeypatch: pytest.MonkeyPatch):
    lit = pairs._LIT
    clear(monkeypatch)
    plain(monkeypatch)
    monkeypatch.setattr(pairs, "_LIT", lit)
    given = dataclasses.replace(samples([50]), difference=np.ones((50, 32, 128, 3), np.float16))
    seen = varied_batch(given, np.zeros((400, 2), int), DIGIT, np.random.default_rng(0))
    strength = np.log(seen.difference.numpy().reshape(400, 2, 3, 32, 128))
    np.testing.assert_array_equal(strength[:, 0], strength[:, 1])
    # As of clouds: a strength of 0 to 1, whose mean square is a third, and averages between 4 x 8 points.
    assert 0.4 / 3 < (strength**2).mean() < 1 / 3 and abs(strength.mean()) < 0.02
    assert abs((strength[:, 0, 0] * strength[:, 0, 1]).mean()) < 0.02  # each colour has a light of its own
    unlit = varied_batch(given, np.zeros((4, 2), int), DIGIT, np.random.default_rng(0), is_lit=False)
    assert (unlit.difference == 1.0).all()
    assert np.abs(np.diff(strength, axis=-1)).mean() < 0.1 * np.abs(strength).mean()


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
