"""Groups of samples, and batches as other units would see them."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

from palpate import DIGIT, GELSIGHT_MINI
from palpate_lab.train.augment import Augmentation, batch, draw_groups, symmetry, varied_batch
from palpate_lab.train.samples import KINDS, Samples

LENGTHS = [5, 80, 11, 200, 6]
NONE = Augmentation((1.0, 1.0), (1.0, 1.0), 0.0, (0.0, 0.0), 0.0, 0.0, 0.0, 0.0)


def samples(lengths: Any, recordings: Any = None, seed: int = 0) -> Samples:
    """Samples of contacts of these lengths, in these recordings; each difference is its number throughout."""
    lengths = np.asarray(lengths)
    count = int(lengths.sum())
    rng = np.random.default_rng(seed)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    return Samples(
        np.broadcast_to(np.arange(count, dtype=np.float16)[:, None, None, None], (count, 2, 2, 3)),
        episode if recordings is None else np.asarray(recordings)[episode],
        episode,
        rng.uniform(-0.3, 0.3, count),
        rng.uniform(-0.3, 0.3, count),
        rng.uniform(-0.01, 0.01, count),
        rng.integers(len(KINDS), size=count),
        np.full(count, np.nan),
        np.zeros(count),
    )


@pytest.mark.parametrize("episodes", [None, [3, 9, 4, 17, 5]])  # counted through, or some of them in any order
def test_groups_are_short_parts_of_one_contact(episodes):
    given = samples(LENGTHS)
    if episodes:
        given = dataclasses.replace(given, episode=np.array(episodes)[given.episode])
    chosen = draw_groups(given, 4000, 8, np.random.default_rng(0))
    assert (given.episode[chosen] == given.episode[chosen][:, :1]).all()
    assert np.ptp(chosen, axis=1).max() == 50
    assert len(np.unique(chosen)) == len(given)  # every sample gets drawn


def test_kinds_come_equally_often_and_corners_four_times():
    given = samples(LENGTHS)
    given = dataclasses.replace(given, kind=np.array([4, 0, 0, 0, 2])[given.episode])
    chosen = draw_groups(given, 6000, 3, np.random.default_rng(0))
    shares = [np.mean(given.episode[chosen[:, 0]] == each) for each in range(5)]
    np.testing.assert_allclose(shares, [4 / 6, 80 / 1746, 11 / 1746, 200 / 1746, 1 / 6], atol=0.02)


def test_without_changes_a_batch_is_the_samples():
    given, chosen = samples([50]), np.array([[7, 3], [3, 9]])
    seen = varied_batch(given, chosen, DIGIT, np.random.default_rng(0), NONE)
    np.testing.assert_allclose(seen.difference, batch(given, chosen.ravel()))
    np.testing.assert_allclose(seen.direction(given.direction[chosen]), given.direction[chosen], atol=1e-6)


def test_brightness_and_colours_vary():
    changed = dataclasses.replace(Augmentation(), clouds=(0.0, 0.0), light=0.0, fading=0.0, moved=0.0)
    many = varied_batch(
        samples([50]), np.full((625, 8), 4), DIGIT, np.random.default_rng(0), changed
    ).difference.numpy()
    slopes = np.stack([many[..., 1] - many[..., 0], many[..., 1, :] - many[..., 0, :]])
    assert 0.5 * slopes.std() == pytest.approx(0.05, rel=0.05)
    # 4 times the product of gains of 0.7 to 1.4 and 0.75 to 1.3.
    assert many.mean() == pytest.approx(4 * 1.05 * 1.025, rel=0.01)
    spread = np.hypot(0.7 / 1.05, 0.55 / 1.025) / np.sqrt(12)
    assert many.mean(axis=(2, 3)).std() == pytest.approx(4 * 1.05 * 1.025 * spread, rel=0.05)


@pytest.mark.parametrize("signs", [(-1, 1), (1, -1), (0, -1)])
def test_groups_are_flipped_with_their_angles(signs):
    image = np.arange(12, dtype=np.float16).reshape(2, 2, 3)
    given = dataclasses.replace(samples([50]), difference=np.broadcast_to(image, (50, 2, 2, 3)).copy())
    chosen, changed = np.arange(6000).reshape(3000, 2) % 50, dataclasses.replace(NONE, flipped=0.5, signs=signs)
    seen = varied_batch(given, chosen, DIGIT, np.random.default_rng(0), changed)
    looks = seen.difference.permute(0, 2, 3, 1).numpy().reshape(3000, 2, 2, 2, 3)
    np.testing.assert_array_equal(looks[:, 0], looks[:, 1])
    found = {look.tobytes(): float(each) for look, each in zip(looks[:, 0], seen.sign, strict=True)}
    wanted = {
        image[:: 1 - 2 * up, :: 1 - 2 * over][..., order].astype("f4").tobytes(): signs[0] ** over * signs[1] ** up
        for up, over, order in itertools.product((0, 1), (0, 1)[: 1 + abs(signs[0])], itertools.permutations(range(3)))
    }
    assert found == wanted  # all 24, half of them if there are no mirrored ones, and angles change their sign with them


@pytest.mark.parametrize(("way", "signs"), [((1, 0), (-1, 1)), ((0, 1), (1, -1)), ((1, 1), (0, 0))])
def test_presses_show_how_flips_change_directions(way, signs):
    at = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 120, 1, 1))  # of spots, along columns and rows
    row, column = np.mgrid[-1:1:32j, -1:1:128j]
    spot = np.exp(-5.0 * ((column - at[0]) ** 2 + (row - at[1]) ** 2))[..., None] * np.ones(3)
    given = dataclasses.replace(samples([1] * 120), difference=spot, direction=0.2 * np.tensordot(way, at, 1).ravel())
    assert symmetry(given) == signs


def test_groups_are_moved_with_their_directions():
    column_sine = 2 * 0.0092 / 128 / 0.021  # a DIGIT's pad is 18.4 mm wide and bent about 21 mm
    angle = np.radians(4.0)
    spots = np.zeros((50, 32, 128, 3), np.float16)
    spots[:, 16, round(64 + np.sin(angle) / column_sine)] = 1.0
    given = dataclasses.replace(samples([50]), difference=spots, direction=np.full(50, angle))
    chosen, changed = np.arange(1000).reshape(500, 2) % 50, dataclasses.replace(NONE, moved=0.5, flipped=0.5)
    seen = varied_batch(given, chosen, DIGIT, np.random.default_rng(0), changed)
    shown = seen.direction(given.direction[chosen]).numpy()
    row, column = (found.reshape(500, 2) for found in np.nonzero(seen.difference.numpy()[:, 0])[1:])
    # The place of the spot tells the direction: to a column, and to one more where the image is mirrored.
    np.testing.assert_allclose(np.sin(shown), (column - 64) * column_sine, atol=1.6 * column_sine)
    assert 0.4 < (np.abs(np.abs(shown[:, 0]) - angle) > 1e-6).mean() < 0.55
    assert np.abs(np.sin(shown)).max() < 0.8 * 0.0092 / 0.021 and np.ptp(np.sin(shown)) > 0.6
    assert np.ptp(row) == pytest.approx(8, abs=1)


@pytest.mark.parametrize("of", ["clouds", "light"])
def test_clouds_and_light_are_smooth(of):
    changed = dataclasses.replace(NONE, **{of: (0.12, 0.06) if of == "clouds" else 1.0})
    level = 0.0 if of == "clouds" else 1.0
    given = dataclasses.replace(samples([50]), difference=np.full((50, 32, 128, 3), level, np.float16))
    seen = varied_batch(given, np.zeros((400, 2), int), DIGIT, np.random.default_rng(0), changed)
    images = seen.difference.numpy().reshape(400, 2, 3, 32, 128)
    images = np.log(images) if of == "light" else images
    alike, other = (images[:, 0] * images[:, 1]).mean(), 0.5 * ((images[:, 0] - images[:, 1]) ** 2).mean()
    # A strength from 0 to m has a mean square of m^2 / 3, less where it is interpolated between its 4 x 8 points.
    largest = 0.12 if of == "clouds" else 1.0
    assert 0.4 * largest**2 / 3 < alike < largest**2 / 3
    assert 0.4 * 0.06**2 / 3 < other < 0.06**2 / 3 if of == "clouds" else other == 0.0
    assert np.abs(np.diff(images, axis=-1)).mean() < 0.1 * np.abs(images).mean()


def test_over_a_flat_pad_corners_move_with_their_places_and_sides_stay():
    column = 320 * 6.25e-5 / 128  # [m] of the Mini's pad in a column
    spots = np.zeros((50, 32, 128, 3), np.float16)
    spots[:, 16, 74] = 1.0
    for kind, is_moved in (("corner", True), ("edge", False)):
        given = dataclasses.replace(
            samples([50]), difference=spots, place=np.full(50, 10.5 * column), kind=np.full(50, KINDS.index(kind))
        )
        chosen, changed = np.arange(400).reshape(200, 2) % 50, dataclasses.replace(NONE, moved=1.0, flipped=0.5)
        seen = varied_batch(given, chosen, GELSIGHT_MINI, np.random.default_rng(0), changed)
        shown = seen.place(given.place[chosen]).numpy()
        at = np.nonzero(seen.difference.numpy()[:, 0])[2].reshape(200, 2)
        np.testing.assert_allclose(shown, (at - 63.5) * column, atol=1e-6)
        assert (np.ptp(np.abs(shown)) > 0.005) == is_moved
        told, true = seen.direction(given.direction[chosen]).abs().numpy(), np.abs(given.direction[chosen])
        np.testing.assert_allclose(told, true, rtol=1e-5)
