"""The untouched gel of a recording that begins in contact, seen at the first moment without."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.touch.background import (
    UNLIKE,
    Background,
    Image,
    background_of,
    first_frames,
    has_markers,
    is_dark,
    without_markers,
)
from palpate.touch.calibration import Calibration
from palpate.touch.cells import Levels, cells_of, share_unlike
from palpate.touch.contact_detector import START
from palpate.types.recording import Recording

_MOMENTS = 60  # half seconds that are looked at at most, evenly spread over the recording
_LOOKS = 4  # frames of each
_PLAINER = 0.15  # in how far it has to be plainer than those it is unlike; chance makes less
_THAN_FIRST = 0.45  # and plainer than the first half second, for a touch that lasts comes back as well
_SEEN = 2  # times that the untouched gel is seen at least
_APART = np.float32(4.0)  # [grey levels] between cells that differ
_SOFT = 10.0  # [grey levels] added before logarithms are taken, for dark cells are noise


@dataclass(frozen=True, eq=False)
class Lift:
    """The first moment without contact, of half a second."""

    background: Background
    """How the gel looks."""
    time: float
    """When it begins, from the first frame on [s]."""

    @property
    def calibration(self) -> Calibration:
        """What is known of the unit by that, for the recording that it was seen in."""
        return Calibration(self.background, is_sure=True)


def lift_of(recording: Recording) -> Lift | None:
    """Return the first moment without contact of a recording that begins in contact; None where it does not.

    Whether the first half second shows a touch, all half seconds of the recording tell together. A touch adds an
    imprint to what is seen of the gel, and the curvature of the picture grows by that of the imprint, for the gel's own
    texture has nothing to do with it: the untouched gel is plainer than what it is unlike. And it is what comes back.
    None also where nothing is seen that does, as in a recording that never lets go.
    """
    length = first_frames(recording.sensor.rate)
    starts = np.arange(0, len(recording) - length + 1, length)
    if recording.image is None or len(starts) < 2:
        return None
    starts = starts[np.unique(np.linspace(0, len(starts) - 1, _MOMENTS).round().astype(int))]
    looks = [_looks(recording, start, length) for start in starts.tolist()]
    moments = np.array(looks).mean(axis=1)
    unlike = np.array([[_is_unlike(one, other) for one in moments] for other in moments])
    than_each = _plainer(moments)
    plainer = np.sum(than_each * unlike, axis=1) / np.maximum(np.sum(unlike, axis=1), 1)
    seen = np.sum(~unlike, axis=1)
    may_be = (plainer > _PLAINER) & (seen >= _SEEN) & [_is_steady(each) for each in looks]
    may_be &= than_each[:, 0] > _THAN_FIRST
    if not may_be.any():
        return None
    untouched = int(np.argmax(may_be * plainer * seen))
    if not any(_is_unlike(cells, moments[untouched]) for cells in looks[0]):
        return None
    first = int(starts[np.argmax(may_be & ~unlike[untouched])])
    background = background_of(_image(recording, index) for index in range(first, first + length))
    return Lift(background, float(recording.time[first] - recording.time[0]))


def _is_steady(looks: Sequence[Levels]) -> bool:
    """Whether half a second is neither black nor does something move on the gel."""
    return not any(is_dark(cells) or share_unlike(cells, looks[0], UNLIKE) > START for cells in looks)


def _looks(recording: Recording, start: int, length: int) -> list[Levels]:
    """The cells of some frames of half a second, without markers."""
    chosen = start + np.linspace(0, length - 1, _LOOKS).round().astype(int)
    images = [_image(recording, index) for index in chosen.tolist()]
    is_marked = has_markers(images[0])
    return [cells_of(without_markers(image) if is_marked else image) for image in images]


def _is_unlike(cells: Levels, others: Levels) -> bool:
    return share_unlike(cells, others, _APART) > START


def _plainer(moments: Levels) -> NDArray[np.float64]:
    """Return in how far each moment is plainer than each other: 1 where only that is touched, -1 where only it is."""
    curved = np.array([_curvature(cells) for cells in moments])
    strength = np.sum(np.square(curved), axis=1)
    apart = strength[:, None] + strength - 2.0 * curved @ curved.T
    return np.clip((strength - strength[:, None]) / np.maximum(apart, 1e-12), -1.0, 1.0)


def _curvature(cells: Levels) -> NDArray[np.float64]:
    """The Laplacian of the logarithm of what is seen: light that differs evenly leaves it as it is."""
    seen = np.pad(np.log(cells.astype(np.float64) + _SOFT), ((1, 1), (1, 1), (0, 0)), mode="edge")
    middle = seen[1:-1, 1:-1]
    return (4.0 * middle - seen[:-2, 1:-1] - seen[2:, 1:-1] - seen[1:-1, :-2] - seen[1:-1, 2:]).ravel()


def _image(recording: Recording, index: int) -> Image:
    image = recording[index].image
    assert image is not None
    return image
