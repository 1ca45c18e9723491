"""What a bag holds, found by reading it once from front to end: topics, rates, gaps, clocks and frames."""

import logging
from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.messages import TRANSFORM_TYPES, decoded, is_read, poses_of, stamp_of
from palpate.io.bags.raw import Channel, CutShort, RawMessage

logger = logging.getLogger(__name__)

GAP = 3.0
"""Median intervals after which messages are missing rather than late."""


@dataclass(frozen=True)
class Topic:
    """What messages of one channel there are."""

    channel: Channel
    count: int
    """How many messages there are."""
    rate: float | None
    """Messages per second by the median interval [Hz]; None for fewer than two."""
    gaps: int
    """Intervals of more than GAP median ones."""
    longest_gap: float | None
    """The longest interval [s]; None for fewer than two messages."""
    clock_offset: float | None
    """Header stamps less log times, median [s]; None where messages have no header that is read."""
    clock_spread: float | None
    """Largest less smallest of these differences [s]."""
    unstamped: int
    """How many headers have a stamp of zero."""

    @property
    def static(self) -> bool:
        """Whether these are transforms that hold once and for all."""
        return self.channel.type in TRANSFORM_TYPES and self.channel.topic.endswith("tf_static")


@dataclass(frozen=True)
class Contents:
    """What a bag holds."""

    path: Path
    topics: tuple[Topic, ...]
    """Sorted by name."""
    parents: dict[str, str]
    """The parent of each frame that a transform places."""
    cut: bool
    """Whether the bag ends too early, as when its recorder was killed."""

    def of(self, types: tuple[str, ...]) -> list[Topic]:
        """The topics of these message types that can be read."""
        return [topic for topic in self.topics if topic.channel.type in types and is_read(topic.channel)]


def contents(path: Path) -> Contents:
    """Read a bag through and say what it holds; warns of one that is cut off. Raises FileError if it holds nothing."""
    tallies: dict[Channel, _Tally] = {}
    parents: dict[str, str] = {}
    cut = False
    try:
        for raw in raw_messages(path):
            tally = tallies.setdefault(raw.channel, _Tally())
            tally.log_times.append(raw.log_time)
            if is_read(raw.channel):
                _look_into(path, raw, tally, parents)
    except CutShort as error:
        if not tallies:
            raise FileError(f"{error}; there is no message before that") from error
        cut = True
        count = sum(len(tally.log_times) for tally in tallies.values())
        warn_of_cut(error, count, "messages")
    if not tallies:
        raise FileError(f"{path}: holds no messages")
    topics = tuple(_topic(channel, tally) for channel, tally in sorted(tallies.items()))
    if ignored := [topic.channel for topic in topics if topic.channel.encoding not in ("cdr", "ros1")]:
        names = ", ".join(f"{channel.topic} ({channel.encoding or 'unknown'})" for channel in ignored)
        logger.warning("%s: topics that are no ROS messages are ignored: %s", path, names)
    return Contents(path, topics, parents, cut)


def warn_of_cut(error: CutShort, count: int, what: str) -> None:
    """Say that a bag ends too early and how much of it is read."""
    logger.warning("%s, as when its recorder was killed; the %d %s before it are read", error, count, what)


@dataclass
class _Tally:
    log_times: "array[int]" = field(default_factory=lambda: array("q"))
    offsets: "array[int]" = field(default_factory=lambda: array("q"))
    unstamped: int = 0


def _look_into(path: Path, raw: RawMessage, tally: _Tally, parents: dict[str, str]) -> None:
    try:
        message = decoded(raw)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    stamp = stamp_of(message)
    if stamp is not None:
        tally.offsets.append(stamp - raw.log_time)
        tally.unstamped += stamp == 0
    if raw.channel.type in TRANSFORM_TYPES:
        for pose in poses_of(message):
            if parents.setdefault(pose.child, pose.frame) != pose.frame:
                both = f"{parents[pose.child]} and {pose.frame}"
                raise FileError(f"{path}: frame {pose.child} has two parents, {both}")


def _topic(channel: Channel, tally: _Tally) -> Topic:
    step = np.diff(np.sort(np.array(tally.log_times))) * 1e-9
    median = float(np.median(step)) if len(step) else 0.0
    offsets = np.array(tally.offsets) * 1e-9
    return Topic(
        channel=channel,
        count=len(tally.log_times),
        rate=1.0 / median if median else None,
        gaps=int(np.count_nonzero(step > GAP * median)) if median else 0,
        longest_gap=float(step.max()) if len(step) else None,
        clock_offset=float(np.median(offsets)) if len(offsets) else None,
        clock_spread=float(np.ptp(offsets)) if len(offsets) else None,
        unstamped=tally.unstamped,
    )
