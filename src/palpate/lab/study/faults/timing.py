"""Faults of when frames arrive: lost, repeated and exchanged ones, and stamps that lie."""

import numpy as np

from palpate.lab.study.faults.stream import Stream, in_contact


def dropped(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Lose this share of all frames, but never the first, on which the first pose rests."""
    kept = rng.random(len(stream)) >= share
    kept[0] = True
    return stream.of(np.flatnonzero(kept))


def burst(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Lose all frames of some seconds of a contact."""
    first = in_contact(stream)
    lost = (stream.arrival >= stream.arrival[first]) & (stream.arrival < stream.arrival[first] + seconds)
    changed = stream.of(np.flatnonzero(~lost))
    return changed.from_frame(min(first, len(changed) - 1))


def repeated(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Send this share of all frames twice."""
    return stream.of(np.repeat(np.arange(len(stream)), 1 + (rng.random(len(stream)) < share)))


def exchanged(stream: Stream, rng: np.random.Generator, share: float) -> Stream:
    """Send this share of all frames after the one that follows them."""
    order = np.arange(len(stream)) + 1.5 * (rng.random(len(stream)) < share)
    order[0] = 0.0
    return stream.of(np.argsort(order, kind="stable"))


def slower(stream: Stream, rng: np.random.Generator, every: int) -> Stream:
    """Send one frame of so many only: a sensor of another rate than its profile says."""
    return stream.of(np.arange(0, len(stream), every))


def jittered(stream: Stream, rng: np.random.Generator, deviation: float) -> Stream:
    """Let stamps be off by a normal law [s]."""
    return stream.with_times(stream.times + rng.normal(0.0, deviation, len(stream)))


def leapt(stream: Stream, rng: np.random.Generator, seconds: float, for_good: bool) -> Stream:
    """Let the clock leap in a contact, for one frame or for good."""
    first, times = in_contact(stream), stream.times
    times[first : None if for_good else first + 1] += seconds
    return stream.with_times(times).from_frame(first)


def nanoseconds(stream: Stream, rng: np.random.Generator, late: bool) -> Stream:
    """Give nanoseconds for seconds, from the first frame or from one in a contact on."""
    first = in_contact(stream) if late else 0
    times = stream.times
    times[first:] *= 1e9
    return stream.with_times(times).from_frame(first)
