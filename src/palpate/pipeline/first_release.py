"""The first release of a recording that begins in contact, where images show the untouched gel.

Half seconds of the recording, 60 at most, are compared. A touch adds an imprint to the gel's own texture, so the
untouched gel has less curvature than the images that it differs from; and it is what images come back to.
"""

import logging
from contextlib import suppress

import numpy as np

from palpate.arrays import Array, Image, Levels
from palpate.errors import FileError
from palpate.touch.background import UNLIKE, background_of, first_frames, has_markers, without_markers
from palpate.touch.calibration import Calibration
from palpate.touch.cells import cells_of, compare, is_dark
from palpate.touch.contact_detector import START
from palpate.types.recording import Recording

logger = logging.getLogger(__name__)


def release_after_start(
    recording: Recording, first_pose: Array, first_pose_sigma: Array, tactile: str
) -> Calibration | None:
    """Return the untouched gel of a recording that begins in contact, as its first pose (3,) allows; else None."""
    if recording.image is None or tactile not in ("auto", "learnt"):
        return None
    count = min(first_frames(recording.sensor.rate), len(recording))
    gap = recording.sensor.gaps(recording.sensor_pose[:count], np.tile(first_pose, (count, 1)), recording.shape)
    if gap.min() > 5e-3 + 3.0 * np.hypot(*first_pose_sigma[:2]) or (first := first_release(recording)) is None:
        return None
    name, start = recording.file or "the recording", recording.time[first] - recording.time[0]
    logger.warning("%s: begins in contact; the untouched gel is taken from %.2f s on", name, start)
    return Calibration(background_of(_image(recording, index) for index in range(first, first + count)), is_sure=True)


def first_release(recording: Recording) -> int | None:
    """Return the start of the first half second without contact, if images show contact before it; else None."""
    length = first_frames(recording.sensor.rate)
    starts = np.arange(0, len(recording) - length + 1, length)
    if recording.image is None or len(starts) < 2:
        return None
    starts = starts[np.unique(np.linspace(0, len(starts) - 1, 60).round().astype(int))]
    looks = [_looks(recording, start, length) for start in starts.tolist()]
    moments = np.array(looks).mean(axis=1)
    unlike = np.array([[_is_unlike(one, other) for one in moments] for other in moments])
    than_each = _plainer(moments)
    plainer = np.sum(than_each * unlike, axis=1) / np.maximum(np.sum(unlike, axis=1), 1)
    seen = np.sum(~unlike, axis=1)
    # Neither black nor moving. The least differences in plainness, to others and to the first half second, are of
    # recorded pushes.
    steady = [not any(is_dark(one) or compare(one, look[0], UNLIKE) > START for one in look) for look in looks]
    may_be = (plainer > 0.15) & (than_each[:, 0] > 0.45) & (seen >= 2) & steady
    if not may_be.any():
        return None
    untouched = int(np.argmax(may_be * plainer * seen))
    if not any(_is_unlike(cells, moments[untouched]) for cells in looks[0]):
        return None
    return int(starts[np.argmax(may_be & ~unlike[untouched])])


def _looks(recording: Recording, start: int, length: int) -> list[Levels]:
    """Return the cells of the first and the last image of half a second, without markers."""
    images = [_image(recording, index) for index in (start, start + length - 1)]
    is_marked = has_markers(images[0])
    return [cells_of(without_markers(image) if is_marked else image) for image in images]


def _is_unlike(cells: Levels, others: Levels) -> bool:
    return compare(cells, others, np.float32(4.0)) > START  # [grey levels] between cells


def _plainer(moments: Levels) -> Array:
    """Return by how much each of N moments is plainer than each other, (N, N): 1 if only the other is touched.

    A touch curves the image: its measure is the Laplacian of the logarithm, which even light does not change.
    """
    soft = 10.0  # [grey levels], since dark cells are noise
    seen = np.pad(np.log(moments.astype(np.float64) + soft), ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    curved = 4.0 * seen[:, 1:-1, 1:-1] - seen[:, :-2, 1:-1] - seen[:, 2:, 1:-1] - seen[:, 1:-1, :-2] - seen[:, 1:-1, 2:]
    curved = curved.reshape(len(moments), -1)
    strength = np.sum(np.square(curved), axis=1)
    apart = strength[:, None] + strength - 2.0 * curved @ curved.T
    return np.clip((strength - strength[:, None]) / np.maximum(apart, 1e-12), -1.0, 1.0)


def _image(recording: Recording, index: int) -> Image:
    """Return an image, or the next one that is not damaged; raises FileError if there is none."""
    for each in range(index, len(recording)):
        with suppress(FileError):
            image = recording[each].image
            assert image is not None
            return image
    raise FileError(f"{recording.file or 'the recording'}: all images from frame {index} on are damaged")
