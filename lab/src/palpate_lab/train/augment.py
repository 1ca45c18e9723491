"""Batches of differences as other sensor units would see them, touched elsewhere."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from torch import Tensor, nn

from palpate.arrays import Array
from palpate.touch.touch_model import COLUMNS
from palpate.types.sensor import SensorProfile
from palpate_lab.train.samples import KINDS, Samples

Indices = NDArray[np.int_]


@dataclass(frozen=True)
class Augmentation:
    """Ranges of the random changes of training images."""

    gain: tuple[float, float] = (0.7, 1.4)
    """Factor on all colours of an image."""
    colour_gain: tuple[float, float] = (0.75, 1.3)
    """Factor on each colour of an image."""
    tint: float = 0.05
    """Standard deviation of the shift of each colour, and of its slopes over the image [of a difference]."""
    clouds: tuple[float, float] = (0.2, 0.06)
    """Most by which smooth clouds change a group of images, and each image by itself [of a difference]."""
    light: float = 1.0
    """Most by which the strength of each colour's light varies over the image [logarithm]."""
    fading: float = 0.5
    """Standard deviation of the fall of each colour's light from the middle of a flat pad to a side [logarithm]; that
    of a round one, as simulated units have it, is enough."""
    flipped: float = 0.5
    """Share of groups in another orientation, with other channels."""
    moved: float = 0.5
    """Share of groups that are moved over the gel."""
    reach: float = 0.8
    """Share of the pad's half width to which contacts are moved."""
    rise: int = 4
    """Rows by which contacts are moved up or down."""
    signs: tuple[int, int] = (-1, 1)
    """Factors on angles and places where images are mirrored and where they are upturned; 0 where they never are."""


ONE_UNIT = Augmentation(gain=(0.85, 1.15), colour_gain=(0.9, 1.1), clouds=(0.1, 0.03), light=0.4, moved=0.0)
"""Changes of images of one unit, which are known in their light."""


@dataclass(frozen=True)
class Batch:
    """Images as the networks see them during training, and how their labels have changed with them."""

    difference: Tensor
    """(G F, 3, ROWS, COLUMNS), of G groups of F frames."""
    sign: Tensor
    """Factor on angles and places of each group, (G, 1), by how its images are flipped."""
    moved: Tensor
    """Increase of the sine of each group's contact directions after that, (G, 1); on a flat pad of its places [m]."""
    is_flat: bool = False
    """True for a flat pad."""

    def direction(self, label: Array) -> Tensor:
        """Return the directions (G, F) [rad] that the images show, from the samples' own."""
        if self.is_flat:
            return self.signed(label)
        return torch.arcsin(self.signed(np.sin(label)) + self.moved)

    def place(self, label: Array) -> Tensor:
        """Return the places (G, F) [m] that the images of a flat pad show, from the samples' own."""
        return self.signed(label) + self.moved

    def signed(self, label: Array) -> Tensor:
        """Return the turns (G, F) that the images show, from the samples' own."""
        return self.sign * torch.from_numpy(label.astype(np.float32))


def draw_groups(samples: Samples, count: int, size: int, rng: np.random.Generator, longest: int = 50) -> Indices:
    """Draw groups (count, size) of samples, each of one contact and at most `longest` frames long, in any order.

    All kinds of contact come equally often, true corners four times as often: they are the hardest to read.
    """
    starts = np.flatnonzero(np.diff(samples.episode, prepend=-1))
    ends = np.append(starts[1:], len(samples)) - 1
    contact = np.searchsorted(starts, np.arange(len(samples)), side="right") - 1  # of each sample
    kinds, kind, counts = np.unique(samples.kind, return_inverse=True, return_counts=True)
    share = np.where(kinds == KINDS.index("corner"), 4.0, 1.0)
    chosen = rng.choice(len(kinds), size=count, p=share / share.sum())
    first_of_kind = np.concatenate([[0], np.cumsum(counts)[:-1]])[chosen]
    by_kind = np.argsort(kind, kind="stable")
    middle = by_kind[first_of_kind + (rng.random(count) * counts[chosen]).astype(int)]
    begin = np.maximum(starts[contact[middle]], middle - rng.integers(longest + 1, size=count))
    length = np.minimum(begin + longest, ends[contact[middle]]) - begin + 1
    return begin[:, None] + (rng.random((count, size)) * length[:, None]).astype(int)


def batch(samples: Samples, chosen: Indices) -> Tensor:
    """Return differences (B, 3, 32, 128) of chosen samples (B,), as they are."""
    return _tensor(samples.difference[chosen].astype(np.float32))


def varied_batch(
    samples: Samples, chosen: Indices, sensor: SensorProfile, rng: np.random.Generator, by: Augmentation | None = None
) -> Batch:
    """Return differences of groups of samples (G, F) as of other units, touched elsewhere.

    A group is of one unit. Half of the groups are moved over the gel, so that the place of an imprint, and not the
    light there, has to tell the direction. Clouds stand for errors of the untouched gel. Each colour's light varies
    over the image: on real gels a light from the left hardly reaches the right.
    """
    by = by or Augmentation()
    groups, size = chosen.shape
    difference = samples.difference[chosen].astype(np.float32)
    drawn = rng.random((2, 2, groups)) < np.array([0.5, 2.0 * by.flipped])[:, None]
    mirrored, upturned = drawn.all(axis=1) & (np.array(by.signs)[:, None] != 0)
    sign = (np.where(mirrored, by.signs[0], 1.0) * np.where(upturned, by.signs[1], 1.0))[:, None]
    right, down = _draw_moves(samples, chosen, sign, sensor, rng, by)
    for g in range(groups):
        flipped = difference[g][:, :: -1 if upturned[g] else 1, :: -1 if mirrored[g] else 1]
        channels = rng.permutation(3) if rng.random() < by.flipped else np.arange(3)
        difference[g] = moved(flipped[..., channels], int(right[g]), int(down[g]))
    rows = np.linspace(-1.0, 1.0, difference.shape[2], dtype=np.float32)
    columns = np.linspace(-1.0, 1.0, difference.shape[3], dtype=np.float32)
    per_image = (groups * size, 1, 1, 1)
    per_colour = (groups * size, 1, 1, 3)
    gain = rng.uniform(*by.gain, per_image) * rng.uniform(*by.colour_gain, per_colour)
    tint, across, along = rng.normal(0.0, by.tint, (3, *per_colour)).astype(np.float32)
    shift = tint + across * columns[:, None] + along * rows[:, None, None]
    difference = difference.reshape(-1, *difference.shape[2:]) * gain.astype(np.float32) + shift
    shape = difference.shape[1:3]
    lasting = _clouds(groups, by.clouds[0], shape, rng)
    passing = _clouds(groups * size, by.clouds[1], shape, rng)
    fall = rng.normal(0.0, by.fading if sensor.flat_width else 0.0, (2, groups, 1, 1, 3)).astype(np.float32)
    fading = _tensor(fall[0] * columns[:, None] + fall[1] * rows[:, None, None])
    light = (_clouds(groups, by.light, shape, rng) + fading).exp()
    seen = (_tensor(difference) + lasting.repeat_interleave(size, dim=0) + passing) * light.repeat_interleave(size, 0)
    by_columns = (right * _per_column(sensor))[:, None].astype(np.float32)
    return Batch(seen, torch.from_numpy(sign.astype(np.float32)), torch.from_numpy(by_columns), sensor.flat_width > 0.0)


def symmetry(samples: Samples) -> tuple[int, int]:
    """Return the factors on directions where images of a unit are mirrored and upturned; 0 where it looks otherwise.

    Kernel ridge regression predicts each direction from the other images, once for each pair of factors. Summing the
    kernel over flipped images gives its predictions that symmetry. The factors with the least error are returned.
    """
    seen = samples.difference.astype(np.float32).reshape(len(samples), -1, COLUMNS // 4, 4, 3).mean(axis=3)
    flipped = [each.reshape(len(seen), -1) for each in (seen, seen[:, :, ::-1], seen[:, ::-1], seen[:, ::-1, ::-1])]
    apart = np.array([cdist(flipped[0], each, "sqeuclidean") for each in flipped])
    same, mirrored, upturned, both = np.exp(-apart / apart[0].mean()) + 1.0
    errors = {}
    for across, down in product((-1, 0, 1), repeat=2):
        kernel = same + across * mirrored + down * upturned + across * down * both
        inverse = np.linalg.inv(kernel + 0.01 * np.eye(len(seen)))
        errors[across, down] = np.abs(inverse @ samples.direction / np.diag(inverse)).mean()
    return min(errors, key=errors.__getitem__)


def moved(images: NDArray[np.float32], right: int, down: int) -> NDArray[np.float32]:
    """Return images (F, R, C, 3) moved by columns and rows, zero where they came from."""
    out = np.roll(images, (down, right), axis=(1, 2))
    out[:, slice(0, down) if down >= 0 else slice(down, None)] = 0.0
    out[:, :, slice(0, right) if right >= 0 else slice(right, None)] = 0.0
    return out


def _per_column(sensor: SensorProfile) -> float:
    """Increase of the sine of a contact's direction, or of its place on a flat pad [m], from one column to the next."""
    if sensor.flat_width:
        return sensor.shown * 2.0 * (sensor.half_width or 0.0) / COLUMNS
    return 2.0 * (sensor.half_width or 0.0) / sensor.radius / COLUMNS if sensor.radius else 0.0


def _draw_moves(
    samples: Samples, chosen: Indices, sign: Array, sensor: SensorProfile, rng: np.random.Generator, by: Augmentation
) -> tuple[Indices, Indices]:
    """Draw columns and rows (G,) to move groups by, such that contacts stay on the pad.

    Over a flat pad only corners move: the imprint of a side ends where the pad does.
    """
    groups = len(chosen)
    step = _per_column(sensor)
    moving = rng.random(groups) < by.moved
    down = np.where(moving, rng.integers(-by.rise, by.rise + 1, groups), 0)
    if not step:
        return np.zeros(groups, int), down
    if sensor.flat_width:
        where = samples.place[chosen]
        moving &= (samples.kind[chosen] == KINDS.index("corner")).all(axis=1)
    else:
        where = np.sin(samples.direction[chosen])
    most = by.reach * COLUMNS / 2.0
    where = sign * where / step
    first = where.min(axis=1)
    last = where.max(axis=1)
    right = np.round(-most - first + rng.random(groups) * (2.0 * most - last + first))
    moving &= np.maximum(-first, last) < most  # contacts beyond the reach already stay there
    return np.where(moving, right, 0.0).astype(int), down


def _clouds(count: int, most: float, size: tuple[int, ...], rng: np.random.Generator) -> Tensor:
    """Draw smooth images (count, 3, *size), each of any strength up to `most`."""
    cells = rng.uniform(0.0, most, (count, 1, 1, 1)) * rng.normal(size=(count, 3, 4, 8))
    return nn.functional.interpolate(torch.from_numpy(cells.astype(np.float32)), size, mode="bicubic")


def _tensor(difference: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(difference).permute(0, 3, 1, 2)  # channels last in memory, which is faster here
