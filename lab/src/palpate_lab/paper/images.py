"""Images of contact episodes with their ground truth, engineered features and pairs (paper Sec. III, IV-A and V-B)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array, Image
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate.touch.background import Background
from palpate.touch.touch_model import reduced
from palpate_lab.train.samples import KINDS, difference, gel_at_rest, geometry_of

Indices = NDArray[np.int_]

CLASSES = ("disc", "rect-edges", "rect-corners", "ellip")
"""Classes of contact that the networks are conditioned on, as in the authors' code."""
_CLASS_OF = {"disc": 0, "ellipse": 3, "edge": 1, "near-corner": 2, "corner": 2}


@dataclass(frozen=True, eq=False)
class Images:
    """N images of contact, in order of recordings and time."""

    difference: NDArray[np.float16]
    """Difference from the untouched gel, (N, 32, 128, 3)."""
    ellipse: Array
    """Engineered features (N, 6); NaN where no patch is found."""
    relative: Array
    """Sensor pose in the object frame, g = o^-1 e, (N, 3) [m, m, rad]."""
    sensor_pose: Array
    """Sensor pose in the world, e, (N, 3) [m, m, rad]."""
    contact_class: Indices
    """Index in CLASSES, (N,)."""
    episode: Indices
    """Number of the contact episode, counted through all recordings, (N,)."""
    frame: Indices
    """Number of the frame in its recording, (N,)."""


def episode_numbers(contact: ArrayLike) -> Indices:
    """Number the contact episodes 0, 1, ... of flags (N,); -1 outside contact.

    As in the published system, an episode ends after more than 10 frames without contact and counts from 5 on.
    """
    flags = np.asarray(contact, np.bool_)
    touching = np.flatnonzero(flags)
    run = np.cumsum(np.diff(touching, prepend=-(10**9)) > 11) - 1
    counts = np.bincount(run) >= 5 if len(run) else np.zeros(0, np.bool_)
    episode = np.full(flags.shape, -1, np.int64)
    episode[touching] = np.where(counts, np.cumsum(counts) - 1, -1)[run]
    return episode


def read_images(recording: Recording) -> Images:
    """Return the images of all contact episodes of a recording."""
    assert recording.object_pose is not None and recording.contact is not None

    def image(index: int) -> Image:
        touch_image = recording[index].image
        assert touch_image is not None
        return touch_image

    episode = episode_numbers(recording.contact)
    frame = np.flatnonzero(episode >= 0)
    background, _ = gel_at_rest(recording, image)
    mean = reduced(background.mean)
    relative = se2.between(recording.object_pose, recording.sensor_pose)[frame]
    kind = geometry_of(recording, relative)[2]
    images = [image(index) for index in frame.tolist()]
    return Images(
        np.array([difference(each, mean) for each in images], np.float16).reshape(-1, *mean.shape),
        np.array([ellipse_features(each, background) for each in images]).reshape(-1, 6),
        relative,
        np.asarray(recording.sensor_pose)[frame],
        np.array([_CLASS_OF[KINDS[each]] for each in kind], int),
        episode[frame],
        frame,
    )


def joined(parts: Sequence[Images]) -> Images:
    """Return the images of several recordings, with episodes counted through."""
    counts = [int(part.episode.max(initial=-1)) + 1 for part in parts]
    columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(Images)}
    columns["episode"] = [part.episode + n for part, n in zip(parts, np.cumsum([0, *counts[:-1]]), strict=True)]
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


def patch_outline(image: Image, background: Background) -> NDArray[np.float32] | None:
    """Return the convex outline of the contact patch, (N, 2) pixels (column, row), or None where there is no patch.

    The change from the untouched gel, less what has shifted all of a channel, is averaged over the channels and split
    by Otsu's threshold. The hull of the largest contour is the patch: it fills what a ring or the shading of a slope
    leaves open.
    """
    import cv2

    change = cv2.subtract(image, background.mean, dtype=cv2.CV_32F)
    scale = max(min(image.shape[:2]) / 120, 1.0)  # 120 pixels a side are enough for a patch, with little noise
    change = cv2.resize(change, None, fx=1.0 / scale, fy=1.0 / scale, interpolation=cv2.INTER_AREA)
    change = cv2.GaussianBlur(change, (0, 0), 1.5)
    levels = np.abs(change - np.median(change, axis=(0, 1))).mean(axis=-1)
    step = max(float(levels.max()) / 255.0, 1e-6)
    otsu, _ = cv2.threshold((levels / step).astype(np.uint8), 0.0, 1.0, cv2.THRESH_OTSU)
    patch = (levels > max((otsu + 0.5) * step, 3.0)).astype(np.uint8)  # blurred noise differs by less than 1
    for operation, size in ((cv2.MORPH_OPEN, 3), (cv2.MORPH_CLOSE, 11)):  # a dome shows as a ring, which is closed
        patch = cv2.morphologyEx(patch, operation, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    contours, _ = cv2.findContours(patch, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    hull = cv2.convexHull(max(contours, key=cv2.contourArea))
    if cv2.contourArea(hull) < 40.0:  # 0.9 mm^2 of a DIGIT's pad
        return None
    return ((hull[:, 0] + 0.5) * scale - 0.5).astype(np.float32)


def ellipse_features(image: Image, background: Background) -> Array:
    """Return the ellipse that fits the contact patch best, (6,), all NaN where there is no patch.

    Column and row of the centre, in widths and heights of the image; the full major and minor axes, in widths; cosine
    and sine of the major axis' angle from the columns' direction (right) to the rows' (down), from 0 to below pi. The
    angle of a round patch means nothing.
    """
    import cv2

    outline = patch_outline(image, background)
    if outline is None:
        return np.full(6, np.nan)
    # Points at even steps: a fit would lean to where corners are dense.
    closed = np.concatenate([outline, outline[:1]])
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(closed, axis=0).T)))
    even = [np.interp(np.linspace(0.0, way[-1], 64, endpoint=False), way, each) for each in closed.T]
    (column, row), axes, degrees = cv2.fitEllipse(np.stack(even, axis=-1).astype(np.float32))
    height, width = background.mean.shape[:2]
    # OpenCV gives the angle of the first axis, which is the minor one.
    angle = math.radians(degrees + (90.0 if axes[1] >= axes[0] else 0.0)) % math.pi
    center = (column + 0.5) / width, (row + 0.5) / height
    return np.array([*center, max(axes) / width, min(axes) / width, math.cos(angle), math.sin(angle)])
