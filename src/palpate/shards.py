"""Shards: equal parts of some work, each done by a process of its own that knows nothing of the others."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from palpate.errors import SettingError

Item = TypeVar("Item")


@dataclass(frozen=True)
class Shard:
    """One of several parts of some work."""

    number: int
    """Which one, from 1 to `count`."""
    count: int
    """How many there are."""

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise SettingError(f"shard is {self.number}/{self.count}; allowed are 1/N to N/N")

    def __str__(self) -> str:
        return f"shard-{self.number}-of-{self.count}"


def part_of_work(items: Sequence[Item], shard: Shard | None) -> Sequence[Item]:
    """Return every so manieth of the items, those of a shard; all of them where there is none."""
    return items if shard is None else items[shard.number - 1 :: shard.count]
