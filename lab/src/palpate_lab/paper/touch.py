"""What each kind of touch measures in a sequence: turns of the sensor on the object, and their noise."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import nn

from palpate.arrays import Array
from palpate.files import read_arrays, whole_file
from palpate_lab.paper.features import keypoints_of
from palpate_lab.paper.graph import compared_frames, tactile_error
from palpate_lab.paper.images import Images, turn_between
from palpate_lab.paper.transform_network import expanded

Indices = NDArray[np.int_]
Turns = dict[int, list[tuple[int, float]]]
"""Turns [rad] of the sensor on the object since so many frames ago, by frame."""
KINDS = ("const", "learnt", "oracle")


def turns_of(network: nn.Module, weights: Array, images: Images) -> tuple[Indices, Indices, dict[str, Array]]:
    """Return the pairs of images that the graph compares, (P,) each, and their turns (P,) [rad] by kind of touch."""
    first = np.searchsorted(images.episode, images.episode).tolist()
    pairs = [(k - back, k) for k in range(len(images.frame)) for back in compared_frames(k - first[k])]
    earlier, later = np.array(pairs, int).reshape(-1, 2).T
    points, classes = keypoints_of(network, images)
    sine = expanded((points[earlier], points[later], 0.5 * (classes[earlier] + classes[later]))) @ weights
    turns = {
        "const": np.zeros(len(pairs)),
        "learnt": np.arcsin(np.clip(sine, -1.0, 1.0)),
        "oracle": turn_between(images, earlier, later),
    }
    return earlier, later, turns


def deviations_of(network: nn.Module, weights: Array, images: Images) -> dict[str, float]:
    """Return the standard deviation of a tactile factor [rad] by kind of touch, from episodes not trained on.

    With it the turn over an episode, from these factors alone, is as uncertain as it is wrong.
    """
    earlier, later, turns = turns_of(network, weights, images)
    first = np.searchsorted(images.episode, images.episode)[later]
    episode = images.episode[later]
    sigmas = {"none": 0.0, "oracle": 1e-3}
    for mode in ("const", "learnt"):
        error = turns[mode] - turns["oracle"]
        ratios = []
        for number in np.unique(episode):
            k = episode == number
            ratios.append(tactile_error((earlier - first)[k], (later - first)[k], error[k]))
        # The median of the absolute ratios of a Gaussian is 1 / 1.4826; most contacts stick, as in training.
        sigmas[mode] = float(1.4826 * np.median(np.abs(ratios)))
    return sigmas


def write_turns(path: Path, network: nn.Module, weights: Array, images: Images) -> None:
    """Write what touch measures in one sequence to a file (.npz)."""
    earlier, later, turns = turns_of(network, weights, images)
    back = later - earlier
    with whole_file(path, overwrite=True) as part, part.open("wb") as file:
        columns: dict[str, Any] = {"frame": images.frame[later], "back": back, **turns}
        np.savez_compressed(file, **columns)


def read_turns(path: Path, kind: str) -> Turns:
    """Return what one kind of touch, of KINDS, measures in a sequence."""
    arrays = read_arrays(path)
    by_frame: Turns = {}
    columns = (arrays[name].tolist() for name in ("frame", "back", kind))
    for frame, back, turn in zip(*columns, strict=True):
        by_frame.setdefault(frame, []).append((back, turn))
    return by_frame
