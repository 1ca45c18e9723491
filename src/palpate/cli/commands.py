"""Commands by name: palpate's own, and those of other distributions, which join by entry points.

A distribution adds a command by an entry point of the group `palpate.commands`: its name is the command's, its object a
function that returns a `Report`. So the laboratory's commands appear once palpate-lab is installed, and palpate imports
nothing of it.
"""

import difflib
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import TypeAlias

from palpate.cli.console import Report
from palpate.cli.read import read
from palpate.cli.recordings import calibrate, convert, info
from palpate.cli.track import live, track, warm_up
from palpate.errors import SettingError

Command: TypeAlias = Callable[..., Report]

GROUP = "palpate.commands"
OWN: dict[str, Command] = {
    "info": info,
    "read": read,
    "track": track,
    "live": live,
    "convert": convert,
    "calibrate": calibrate,
    "warm-up": warm_up,
}
LABORATORY = {
    "demo": "palpate-lab[sim]",
    "simulate": "palpate-lab[sim]",
    "train": "palpate-lab[train]",
    "paper": "palpate-lab[sim,train,paper]",
    "evaluate": "palpate-lab",
    "tune": "palpate-lab",
    "truth-print": "palpate-lab",
    "truth-camera": "palpate-lab",
    "truth": "palpate-lab",
}
"""Commands of palpate-lab, and what to install for each."""
ORDER = (
    *("demo", "info", "read", "track", "live", "convert", "simulate", "calibrate", "train", "paper", "evaluate"),
    *("tune", "truth-print", "truth-camera", "truth", "warm-up"),
)
"""Names in the order of the help; those of others follow."""


def find_command(name: str) -> Command:
    """Return a command. Raises SettingError, which says what to install for one of the laboratory that is missing."""
    if name in OWN:
        return OWN[name]
    added = _added()
    if name in added:
        return _load(added[name])
    if name in LABORATORY:
        requirement = LABORATORY[name]
        raise SettingError(f"palpate {name} needs palpate-lab, which is not installed: pip install '{requirement}'")
    known = [*ORDER, *added]
    near = difflib.get_close_matches(name, known, 1)
    question = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    raise SettingError(f"there is no command {name!r}; {question}")


def installed_commands() -> dict[str, Command]:
    """Return the commands that are installed, by name, in the order of the help. Raises SettingError."""
    added = _added()
    names = [name for name in ORDER if name in OWN or name in added]
    names += sorted(set(added) - set(ORDER))
    return {name: OWN[name] if name in OWN else _load(added[name]) for name in names}


def _added() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _load(entry: EntryPoint) -> Command:
    try:
        return entry.load()
    except (ImportError, AttributeError) as error:
        distribution = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value
        raise SettingError(f"the command {entry.name} of {distribution} cannot be loaded: {error}") from error
