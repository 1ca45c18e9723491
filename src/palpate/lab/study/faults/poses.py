"""Faults of the measured sensor pose, and of where the object is."""

from dataclasses import replace

import numpy as np

from palpate.geometry import se2
from palpate.lab.study.faults.stream import Array, Stream, before_contact, in_contact


def not_numbers(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Lose the pose, which is NaN then, for some seconds of a contact."""
    first, poses = in_contact(stream), stream.poses
    poses[_while(stream, first, seconds)] = np.nan
    return stream.with_poses(poses).from_frame(first)


def frozen(stream: Stream, rng: np.random.Generator, seconds: float) -> Stream:
    """Let the pose stand still in a contact for some seconds while the sensor moves on."""
    first, poses = in_contact(stream), stream.poses
    poses[_while(stream, first, seconds)] = poses[first]
    return stream.with_poses(poses).from_frame(first)


def spike(stream: Stream, rng: np.random.Generator, length: float, count: int = 1) -> Stream:
    """Put the pose off by a length [m], in any direction, at so many frames in contact."""
    first, poses = in_contact(stream), stream.poses
    later = np.flatnonzero(stream.touching & (np.arange(len(stream)) >= first))
    hit = np.append(first, rng.choice(later[1:], count - 1, replace=False))
    angle = rng.uniform(-np.pi, np.pi, count)
    poses[hit, :2] += length * np.column_stack([np.cos(angle), np.sin(angle)])
    return stream.with_poses(poses).from_frame(first)


def noisy(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Add normal noise to the poses of all frames [m], [deg]."""
    deviation = (length, length, np.radians(degrees))
    return stream.with_poses(stream.poses + rng.normal(size=(len(stream), 3)) * deviation)


def misplaced(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Let what is told to be the sensor be a place beside it, in any direction: extrinsics off [m], [deg]."""
    return stream.with_poses(se2.compose(stream.poses, _off(rng, length, degrees))).from_contact()


def moved_untouched(stream: Stream, rng: np.random.Generator, length: float, degrees: float) -> Stream:
    """Move the object between two contacts, in any direction; the sensor goes where it is then.

    That cannot be known before it touches the object again.
    """
    first, last = before_contact(stream)
    truth = stream.frames[last].object_pose
    assert truth is not None
    moved = se2.compose(truth, _off(rng, length, degrees))
    motion = se2.compose(moved, se2.inverse(truth))
    middle = (first + last) // 2
    # The sensor's detour is spread over the rest, as a hand's or a planner's would be.
    part = np.clip((np.arange(len(stream)) - first) / max(last - first, 1), 0.0, 1.0)
    part = part * part * (3.0 - 2.0 * part)
    poses = se2.compose(se2.exp(part[:, None] * se2.log(motion)), stream.poses)
    frames = [
        frame
        if index < middle or frame.object_pose is None
        else replace(frame, object_pose=se2.compose(motion, frame.object_pose))
        for index, frame in enumerate(stream.frames)
    ]
    return replace(stream, frames=tuple(frames)).with_poses(poses).from_frame(last + 1)


def pushed_aside(stream: Stream, rng: np.random.Generator) -> Stream:
    """Let be seen that something else pushes the object while the sensor touches it, as it was recorded."""
    return stream.from_frame(next(frame for frame in stream.shoved if stream.touching[frame]))


def _while(stream: Stream, first: int, seconds: float) -> slice:
    return slice(first, int(np.searchsorted(stream.arrival, stream.arrival[first] + seconds)))


def _off(rng: np.random.Generator, length: float, degrees: float) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    turned = np.radians(degrees) * rng.choice([-1.0, 1.0])
    return np.array([length * np.cos(angle), length * np.sin(angle), turned])
