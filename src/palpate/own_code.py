"""What users bring along: entry points in packages of their own, by the name of a group."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from palpate.errors import SettingError


@cache
def own_code(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group that are installed, by their names."""
    return {each.name: each for each in entry_points(group=group)}


def loaded(entry: EntryPoint) -> Any:
    """Return what an entry point stands for. Raises SettingError, which names it, where that cannot be loaded."""
    try:
        return entry.load()
    except Exception as error:  # whatever a user's module raises
        raise SettingError(f"{called(entry)} cannot be loaded: {words_of(error)}") from error


def called(entry: EntryPoint) -> str:
    """Return what to call an entry point in a message."""
    return f"entry point {entry.name!r} of {entry.group} ({entry.value})"


def words_of(error: Exception) -> str:
    """Return an error of somebody else's code on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
