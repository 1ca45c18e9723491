"""Faults of the touch images: camera, light, gel."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.lab.simulate.backdrop import scratch as gel_scratch
from palpate.lab.study.faults.stream import Array, Image, Stream, before_contact, in_contact
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration

_BLOBS = 12  # of which a worn gel's pattern is made
_SCRATCH_WIDTH, _SCRATCH_DEPTH = 3, 60.0  # [px], [grey levels]


def late(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Let images belong to so many frames before."""
    images = [frame.image for frame in stream.frames]
    changed = (replace(frame, image=images[max(index - frames, 0)]) for index, frame in enumerate(stream.frames))
    return replace(stream, frames=tuple(changed)).from_contact()


def frozen(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Show the same image in a contact for some seconds."""
    first = in_contact(stream)
    image = stream.frames[first].image
    assert image is not None
    return _for(stream, first, seconds, lambda _, __: image)


def flat(stream: Stream, rng: np.random.Generator, level: int, seconds: float) -> Stream:
    """Show one grey level, 0 to 255, in a contact for some seconds."""
    return _for(stream, in_contact(stream), seconds, lambda _, image: np.full_like(image, level))


def noise(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Show noise in a contact for some seconds."""
    return _for(stream, in_contact(stream), seconds, lambda _, image: rng.integers(0, 256, image.shape, np.uint8))


def exchanged_channels(stream: Stream, rng: np.random.Generator) -> Stream:
    """Give blue for red, from the first image on."""
    return _all(stream, lambda _, image: np.ascontiguousarray(image[..., ::-1]))


def turned(stream: Stream, rng: np.random.Generator, quarters: int) -> Stream:
    """Turn all images by so many quarters, counter-clockwise."""
    return _all(stream, lambda _, image: np.ascontiguousarray(np.rot90(image, quarters))).from_contact()


def mirrored(stream: Stream, rng: np.random.Generator) -> Stream:
    """Exchange left and right in all images."""
    return _all(stream, lambda _, image: np.ascontiguousarray(image[:, ::-1])).from_contact()


def calibrated(stream: Stream, rng: np.random.Generator) -> Stream:
    """Tell the tracker what the unit looks like untouched, from the images before the first contact: no fault."""
    images = [frame.image for frame in stream.frames[: int(np.argmax(stream.touching))] if frame.image is not None]
    return replace(stream, calibration=Calibration(background_of(images)))


def drifting_light(stream: Stream, rng: np.random.Generator, change: float) -> Stream:
    """Let the light change evenly, by this share at the end."""
    return _all(stream, lambda index, image: _scaled(image, 1.0 + change * index / (len(stream) - 1)))


def light_step(stream: Stream, rng: np.random.Generator, change: float) -> Stream:
    """Let the light change by this share at once, in a contact."""
    return _for(stream, in_contact(stream), np.inf, lambda _, image: _scaled(image, 1.0 + change))


def light_out(stream: Stream, rng: np.random.Generator) -> Stream:
    """Let one of the three lights go out in a contact: a tenth of its channel, which others light, is left."""
    factor = np.ones(3)
    factor[rng.integers(3)] = 0.1
    return _for(stream, in_contact(stream), np.inf, lambda _, image: _scaled(image, factor))


def wear(stream: Stream, rng: np.random.Generator, levels: float) -> Stream:
    """Let a smooth pattern grow on the gel, up to so many grey levels at the end."""
    pattern = _blobs(rng, stream)
    pattern *= levels / np.abs(pattern).max()
    return _all(stream, lambda index, image: _added(image, pattern * (index / (len(stream) - 1))))


def scratch(stream: Stream, rng: np.random.Generator) -> Stream:
    """Draw a dark line over the gel, from one frame in a contact on."""
    image = stream.frames[0].image
    assert image is not None
    height, width = image.shape[:2]
    angle, off = rng.uniform(0.0, np.pi), rng.uniform(-0.2, 0.2) * width
    at = (0.5 * height + off * np.sin(angle), 0.5 * width + off * np.cos(angle))
    line = -_SCRATCH_DEPTH * gel_scratch((height, width), at, angle, _SCRATCH_WIDTH)[..., None]
    return _for(stream, in_contact(stream), np.inf, lambda _, image: _added(image, line))


def outliers(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Show this share of frames in contact the image of another of them, drawn at random."""
    touching = np.flatnonzero(stream.touching)
    images = [stream.frames[index].image for index in touching]
    where = stream.touching & (rng.random(len(stream)) < share)

    def other(_: int, image: Image) -> Image:
        drawn = images[rng.integers(len(images))]
        return image if drawn is None else drawn

    return stream.with_images(where, other).from_frame(int(touching[0]))


def false_contact(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Show images of a touch in the middle of a rest, so many in a row."""
    first, last = before_contact(stream)
    start = (first + last) // 2
    touched = [stream.frames[in_contact(stream) + index].image for index in range(frames)]
    where = _between(stream, start, min(start + frames, last))
    return stream.with_images(where, lambda index, image: _given(touched[index - start], image)).from_frame(start)


def missed_contact(stream: Stream, rng: np.random.Generator, frames: int) -> Stream:
    """Show the untouched gel in a contact, so many frames in a row."""
    start, image = in_contact(stream), stream.frames[before_contact(stream)[0]].image
    where = _between(stream, start, start + frames)
    return stream.with_images(where, lambda _, shown: _given(image, shown)).from_frame(start)


def _all(stream: Stream, change: Callable[[int, Image], Image]) -> Stream:
    return stream.with_images(np.ones(len(stream), np.bool_), change)


def _for(stream: Stream, first: int, seconds: float, change: Callable[[int, Image], Image]) -> Stream:
    begin = stream.arrival[first]
    where = (stream.arrival >= begin) & (stream.arrival < begin + seconds)
    return stream.with_images(where, change).from_frame(first)


def _between(stream: Stream, start: int, end: int) -> np.ndarray:
    index = np.arange(len(stream))
    return (index >= start) & (index < end)


def _given(image: Image | None, otherwise: Image) -> Image:
    return otherwise if image is None else image


def _scaled(image: Image, factor: float | Array) -> Image:
    return np.clip(np.rint(image * factor), 0, 255).astype(np.uint8)


def _added(image: Image, levels: Array) -> Image:
    return np.clip(np.rint(image + levels), 0, 255).astype(np.uint8)


def _blobs(rng: np.random.Generator, stream: Stream) -> Array:
    image = stream.frames[0].image
    assert image is not None
    height, width = image.shape[:2]
    rows, columns = np.indices((height, width))
    pattern = np.zeros((height, width))
    for _ in range(_BLOBS):
        row, column, size = rng.uniform(0, height), rng.uniform(0, width), rng.uniform(0.05, 0.2) * width
        pattern += rng.uniform(-1.0, 1.0) * np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2.0 * size**2))
    return pattern[..., None]
