"""How a sensor unit looks untouched, from a recording or from images of it."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.touch.background import Background, Image, background_of, check_image
from palpate.touch.detector import START, detector_for
from palpate.types.recording import Recording

NEEDED = 30
"""Frames without contact, one second at 30 Hz: from them a deviation is known to 13 %."""

MARGIN = 2
"""Frames beside a contact that are left out, as the paper does: flags may be late, and gel takes its time."""


def calibrate(recording: Recording, progress: Callable[[int], None] | None = None) -> tuple[Background, int]:
    """Return the background of a recording's frames without contact, and how many they are.

    Its contact flags say which; where it has none, all of them. progress is called with the number of frames done.
    Raises FileError on a recording without images or with fewer than NEEDED frames without contact, and where a touch
    shows in them after all. One that lasts through all frames cannot show.
    """
    images = untouched_images(recording, progress)
    return background_of(images), len(untouched_frames(recording))


def background_of_stills(images: Sequence[Image]) -> Background:
    """Return the background of one or more images of the untouched gel; the deviation of a single one is none."""
    if len(images) > 1:
        return background_of(images)
    check_image(images[0], *images[0].shape[:2])
    return Background(images[0].astype(np.float32), np.zeros(images[0].shape, np.float32))


def untouched_images(recording: Recording, progress: Callable[[int], None] | None = None) -> Iterator[Image]:
    """Yield the images of a recording's frames without contact; see `calibrate`."""
    if recording.image is None:
        raise FileError(f"{_name(recording)}: has no images, a calibration needs touch images")
    frames = untouched_frames(recording)
    if len(frames) < NEEDED:
        raise FileError(
            f"{_name(recording)}: found {len(frames)} frames more than {MARGIN} away from a contact, "
            f"a calibration needs {NEEDED}"
        )
    yield from _checked_images(recording, frames, progress)


def untouched_frames(recording: Recording) -> NDArray[np.int64]:
    """Return the indices of the frames that are more than MARGIN frames away from a contact."""
    if recording.contact is None:
        return np.arange(len(recording))
    near = np.convolve(recording.contact, np.ones(2 * MARGIN + 1))[MARGIN:-MARGIN]  # contacts at most MARGIN away
    return np.flatnonzero(near < 0.5)


def _checked_images(
    recording: Recording, frames: NDArray[np.int64], progress: Callable[[int], None] | None
) -> Iterator[Image]:
    detector = detector_for(recording.sensor)
    for done, index in enumerate(frames.tolist(), 1):
        image = recording[index].image
        assert image is not None
        if detector.update(detector.read(image)):
            raise FileError(
                f"{_name(recording)}: frame {index} is off the first ones in {detector.share:.1%} of its values, as if "
                f"touched; allowed is {START:.0%}: calibrate on frames without contact"
            )
        yield image
        if progress is not None:
            progress(done)


def _name(recording: Recording) -> str:
    return str(recording.file or "recording")
