"""Images of contact episodes with their ground truth, and pairs of them (paper Sec. III and IV-A)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.io import load_recording
from palpate.lab.paper.ellipse import ellipse_features
from palpate.lab.train.samples import geometry_of
from palpate.touch.background import background_of
from palpate.touch.touch_model import KINDS, difference, reduced
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

CLASSES = ("disc", "rect-edges", "rect-corners", "ellip")
"""Classes of contact that the networks are conditioned on, as in the authors' code."""
_CLASS_OF = {"disc": 0, "ellipse": 3, "edge": 1, "near-corner": 2, "corner": 2}
SHORTEST = 5
"""Fewest frames of a contact episode, as in the authors' code."""


@dataclass(frozen=True, eq=False)
class Images:
    """N images of contact, in order of recordings and time."""

    difference: NDArray[np.float16]
    """Difference from the untouched gel, (N, 32, 128, 3)."""
    ellipse: Array
    """Engineered features (N, 6); NaN where no patch is found."""
    relative: Array
    """Sensor pose in the object frame, g = o^-1 e, (N, 3) [m, m, rad]."""
    contact_class: Indices
    """Index in CLASSES, (N,)."""
    episode: Indices
    """Number of the contact episode, counted through all recordings, (N,)."""
    frame: Indices
    """Number of the frame in its recording, (N,)."""

    def of(self, chosen: NDArray[np.bool_]) -> "Images":
        """Return some of the images."""
        return Images(*(getattr(self, each.name)[chosen] for each in fields(self)))


def read_images(path: Path) -> Images:
    """Return the images of all contact episodes of a recording."""
    recording = load_recording(path)
    assert recording.object_pose is not None and recording.contact is not None
    episode = episodes_of(recording)
    frame = np.flatnonzero(episode >= 0)
    untouched = np.flatnonzero(~recording.contact)
    chosen = untouched[np.linspace(0, len(untouched) - 1, min(30, len(untouched))).astype(int)]
    background = background_of([_image(recording, index) for index in chosen.tolist()])
    mean = reduced(background.mean)
    relative = se2.between(recording.object_pose, recording.sensor_pose)[frame]
    _, _, kind = geometry_of(recording, relative)
    images = [_image(recording, index) for index in frame.tolist()]
    return Images(
        np.array([difference(image, mean) for image in images], np.float16).reshape(-1, *mean.shape),
        np.array([ellipse_features(image, background) for image in images]).reshape(-1, 6),
        relative,
        np.array([_CLASS_OF[KINDS[each]] for each in kind], int),
        episode[frame],
        frame,
    )


def episodes_of(recording: Recording) -> Indices:
    """Return the number of the contact episode of each frame (N,), -1 between episodes."""
    assert recording.contact is not None
    edges = np.flatnonzero(np.diff(recording.contact, prepend=False, append=False))
    found, number = np.full(len(recording.time), -1), 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= SHORTEST:
            found[first:last] = number
            number += 1
    return found


def joined(parts: Sequence[Images]) -> Images:
    """Return the images of several recordings, with episodes counted through."""
    counts = [int(part.episode.max(initial=-1)) + 1 for part in parts]
    episode = [part.episode + first for part, first in zip(parts, np.cumsum([0, *counts[:-1]]), strict=True)]
    columns = {each.name: [getattr(part, each.name) for part in parts] for each in fields(Images)}
    columns["episode"] = episode
    return Images(**{name: np.concatenate(column) for name, column in columns.items()})


def draw_pairs(images: Images, count: int, rng: np.random.Generator) -> tuple[Indices, Indices]:
    """Draw pairs (count,) of images of one episode, 10 to 50 frames apart, the earlier first: Omega of Eq. 4."""
    last = np.searchsorted(images.episode, images.episode, side="right") - 1
    earlier = np.flatnonzero(last - np.arange(len(last)) >= 10)
    earlier = rng.choice(earlier, size=count)
    return earlier, earlier + rng.integers(10, np.minimum(last[earlier] - earlier, 50) + 1)


def turn_between(images: Images, earlier: Indices, later: Indices) -> Array:
    """Return the true turn of the sensor on the object between images (P,) [rad]."""
    return se2.wrap(images.relative[later, 2] - images.relative[earlier, 2])


def _image(recording: Recording, index: int) -> NDArray[np.uint8]:
    image = recording[index].image
    assert image is not None
    return image
