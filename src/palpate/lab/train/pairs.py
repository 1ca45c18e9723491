"""Drawing what is learned from: groups of frames of one contact, pairs of them, and batches for the networks."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.lab.train.samples import Samples
from palpate.touch.difference import COLUMNS
from palpate.types.sensor import SensorProfile

Indices = NDArray[np.int_]

CLOSEST, FARTHEST = 10, 50
"""Frames between the two of a pair (paper Sec. IV-A)."""
# By how much brightness, each colour and its shift (in units of the difference) may differ from those seen.
_GAIN, _COLOUR_GAIN, _TINT = (0.7, 1.4), (0.75, 1.3), 0.05
_LASTING, _PASSING, _CELLS = 0.12, 0.06, (4, 8)  # most that clouds differ by (as above), and how fine they are
_LIT = 1.0  # most that the strength of a light varies over the image, logarithm
_AS_IT_IS = 0.5  # share of groups of images that keep their orientation and colours
_MOVED = 0.5  # share of groups of images that are moved over the gel
_REACH, _RISE = 0.8, 4  # how far: columns up to this share of the pad's half width, and rows


def draw_groups(samples: Samples, count: int, size: int, rng: np.random.Generator) -> Indices:
    """Draw groups (count, size) of samples, each of one contact and no more than FARTHEST frames long, in any order.

    All kinds of contact that there are come equally often: true corners are rare, and the hardest to read.
    """
    first, last = _span(samples)
    kinds, kind, each = np.unique(samples.kind, return_inverse=True, return_counts=True)
    place = np.concatenate([[0], np.cumsum(each)[:-1]])[(chosen := rng.integers(len(kinds), size=count))]
    middle = np.argsort(kind, kind="stable")[place + (rng.random(count) * each[chosen]).astype(int)]
    begin = np.maximum(first[middle], middle - rng.integers(FARTHEST + 1, size=count))
    length = np.minimum(begin + FARTHEST, last[middle]) - begin + 1
    return begin[:, None] + (rng.random((count, size)) * length[:, None]).astype(int)


def draw_pairs(samples: Samples, count: int, rng: np.random.Generator) -> tuple[Indices, Indices]:
    """Draw pairs (count,) of samples of one contact, CLOSEST to FARTHEST frames apart, the earlier first.

    Raises SettingError where no contact is long enough.
    """
    _, last = _span(samples)
    earlier = np.flatnonzero(last - np.arange(len(samples)) >= CLOSEST)
    if not len(earlier):
        raise SettingError(f"too few pairs to learn from: no contact has frames {CLOSEST} apart")
    earlier = rng.choice(earlier, size=count)
    most = np.minimum(last[earlier] - earlier, FARTHEST)
    return earlier, earlier + rng.integers(CLOSEST, most + 1)


def turned(samples: Samples, earlier: Indices, later: Indices) -> NDArray[np.float64]:
    """Return by how much the sensor turned on the object between samples [rad]."""
    return se2.wrap(samples.yaw[later] - samples.yaw[earlier])


@dataclass(frozen=True)
class Guise:
    """How images would look in a unit whose light or camera is the other way round, each exact."""

    mirrored: bool = False
    """Left and right exchanged: then angles about the upright axis change their sign."""
    upturned: bool = False
    """Up and down exchanged."""
    channels: tuple[int, int, int] = (0, 1, 2)
    """Which channel each channel shows."""

    @property
    def sign(self) -> float:
        """What angles are multiplied by."""
        return -1.0 if self.mirrored else 1.0


def draw_guise(rng: np.random.Generator) -> Guise:
    """Draw a guise: every other one is that of the images as they are."""
    if rng.random() < _AS_IT_IS:
        return Guise()
    first, second, third = rng.permutation(3).tolist()
    return Guise(bool(rng.random() < 0.5), bool(rng.random() < 0.5), (first, second, third))


def batch(samples: Samples, chosen: Indices) -> Tensor:
    """Return differences (B, 3, 32, 128) of chosen samples (B,)."""
    return _tensor(samples.difference[chosen].astype(np.float32))


@dataclass(frozen=True)
class Seen:
    """Images as networks see them while they learn, and how what is to be told of them has changed with them."""

    difference: Tensor
    """(G F, 3, ROWS, COLUMNS), of G groups of F frames."""
    sign: Tensor
    """What angles of each group are multiplied by, (G, 1)."""
    moved: Tensor
    """By how much the sine of each group's contact directions grew after that, (G, 1)."""

    def direction(self, told: NDArray[np.float64]) -> Tensor:
        """Return the directions (G, F) [rad] that the images show, of the samples' own (G, F) [rad]."""
        return torch.arcsin(self.sign * torch.from_numpy(np.sin(told).astype(np.float32)) + self.moved)

    def place(self, told: NDArray[np.float64]) -> Tensor:
        """Return the places (G, F) [m] that the images of a flat pad show, of the samples' own (G, F) [m]."""
        return self.sign * torch.from_numpy(told.astype(np.float32))

    def turn(self, told: NDArray[np.float64]) -> Tensor:
        """Return the turns (G, F) [rad] that the images show, of the samples' own (G, F) [rad]."""
        return self.sign * torch.from_numpy(told.astype(np.float32))


def varied_batch(
    samples: Samples, chosen: Indices, sensor: SensorProfile, rng: np.random.Generator, is_lit: bool = True
) -> Seen:
    """Return differences of groups of samples (G, F) as of other units, touched elsewhere.

    Each group is of one unit in one guise; brightness, colours and their slopes over the image differ from those seen.
    Half of the groups are moved over the gel: what turns the contact by an angle moves the imprint, so that its place,
    and not the light there, has to tell the direction. Besides, clouds lie over the image, for all of a group and for
    each by itself: the untouched gel is never known exactly, and a gel gives way a little everywhere. Without them, a
    network reads much into what is nothing. With `is_lit`, each colour's light is stronger here and weaker there: on
    real gels a light from the left hardly reaches the right, where an imprint then lacks a flank and a shadow.
    """
    groups, size = chosen.shape
    difference = samples.difference[chosen].astype(np.float32)
    guises = [draw_guise(rng) for _ in range(groups)]
    sign = np.array([guise.sign for guise in guises])[:, None]
    right, down = _moves(sign * np.sin(samples.direction[chosen]), sensor, rng)
    for group, guise in enumerate(guises):
        flipped = difference[group][:, :: -1 if guise.upturned else 1, :: -1 if guise.mirrored else 1]
        difference[group] = _moved(flipped[..., guise.channels], int(right[group]), int(down[group]))
    rows, columns = (np.linspace(-1.0, 1.0, count, dtype=np.float32) for count in difference.shape[2:4])
    each = (groups * size, 1, 1, 3)
    gain = rng.uniform(*_GAIN, (*each[:3], 1)) * rng.uniform(*_COLOUR_GAIN, each)
    tint, across, along = rng.normal(0.0, _TINT, (3, *each)).astype(np.float32)
    shift = tint + across * columns[:, None] + along * rows[:, None, None]
    difference = difference.reshape(-1, *difference.shape[2:]) * gain.astype(np.float32) + shift
    clouds = _clouds(groups, _LASTING, rng).repeat_interleave(size, dim=0) + _clouds(groups * size, _PASSING, rng)
    seen = _tensor(difference) + _spread(clouds, difference.shape[1:3])
    if is_lit:
        light = _spread(_clouds(groups, _LIT, rng), difference.shape[1:3]).exp()
        seen = seen * light.repeat_interleave(size, dim=0)
    moved = (right * _column_sine(sensor))[:, None].astype(np.float32)
    return Seen(seen, torch.from_numpy(sign.astype(np.float32)), torch.from_numpy(moved))


def _column_sine(sensor: SensorProfile) -> float:
    """By how much the sine of a contact's direction grows from one column of a difference to the next.

    0 where it does not: on a flat pad, whose imprints of a side belong to its edges.
    """
    if sensor.flat_width:
        return 0.0
    return 2.0 * sensor.half_width / sensor.radius / COLUMNS if sensor.half_width and sensor.radius else 0.0


def _moves(sine: NDArray[np.float64], sensor: SensorProfile, rng: np.random.Generator) -> tuple[Indices, Indices]:
    """Draw columns and rows (G,) to move groups by, such that contacts of this sine (G, F) stay on the pad."""
    groups, step = len(sine), _column_sine(sensor)
    moving = rng.random(groups) < _MOVED
    down = np.where(moving, rng.integers(-_RISE, _RISE + 1, groups), 0)
    if not step:
        return np.zeros(groups, int), down
    most = _REACH * COLUMNS / 2.0
    first, last = sine.min(axis=1) / step, sine.max(axis=1) / step
    right = np.round(-most - first + rng.random(groups) * (2.0 * most - last + first))
    moving &= np.maximum(-first, last) < most  # what is beyond the reach already stays there
    return np.where(moving, right, 0.0).astype(int), down


def _moved(images: NDArray[np.float32], right: int, down: int) -> NDArray[np.float32]:
    """Return images (F, R, C, 3) moved by columns and rows; where they came from, nothing is seen."""
    out = np.zeros_like(images)
    to_rows, from_rows = _overlap(down, images.shape[1])
    to_columns, from_columns = _overlap(right, images.shape[2])
    out[:, to_rows, to_columns] = images[:, from_rows, from_columns]
    return out


def _overlap(by: int, length: int) -> tuple[slice, slice]:
    """Where things end up, and where they were, when moved within a length."""
    return slice(max(by, 0), length + min(by, 0)), slice(max(-by, 0), length - max(by, 0))


def _clouds(count: int, most: float, rng: np.random.Generator) -> Tensor:
    """Draw smooth values (count, 3, 4, 8) of any strength up to this one, to be spread over an image."""
    strength = rng.uniform(0.0, most, (count, 1, 1, 1))
    return torch.from_numpy((strength * rng.normal(size=(count, 3, *_CELLS))).astype(np.float32))


def _spread(clouds: Tensor, size: tuple[int, ...]) -> Tensor:
    """Return clouds (count, 3, 4, 8) as they lie over images of this size, (count, 3, *size)."""
    return nn.functional.interpolate(clouds, size, mode="bicubic", align_corners=False)


def _tensor(difference: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(difference).permute(0, 3, 1, 2)  # channels last in memory, which is faster here


def _span(samples: Samples) -> tuple[Indices, Indices]:
    """First and last sample (N,) of the contact that each sample belongs to."""
    starts = np.flatnonzero(np.diff(samples.episode, prepend=-1))
    ends = np.append(starts[1:], len(samples)) - 1
    contact = np.cumsum(np.isin(np.arange(len(samples)), starts)) - 1
    return starts[contact], ends[contact]
