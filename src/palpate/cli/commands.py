"""Commands by name: palpate's own, and those of other distributions, which join by entry points.

A distribution adds a command by an entry point of the group `palpate.commands`: its name is the command's, its object a
function that returns a `Report`. So the laboratory's commands appear once palpate-lab is installed, and palpate imports
nothing of it.
"""

import difflib
import inspect
import shutil
import textwrap
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from palpate.cli.console import Report
from palpate.cli.learnt_outline import outline
from palpate.cli.read import read
from palpate.cli.recordings import calibrate, convert, info
from palpate.cli.track import live, ros2, track, warm_up
from palpate.errors import SettingError
from palpate.hints import install_command, own_command

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Command: TypeAlias = Callable[..., Report | int]
"""A command returns its result, or an exit code if it has printed all itself."""

GROUP = "palpate.commands"
OWN: dict[str, Command] = {
    "info": info,
    "read": read,
    "track": track,
    "live": live,
    "outline": outline,
    "convert": convert,
    "calibrate": calibrate,
    "ros2": ros2,
    "warm-up": warm_up,
}
LABORATORY = {
    "demo": "sim",
    "simulate": "sim",
    "train": "train",
    "paper": "sim,train,paper",
    "evaluate": "",
    "compare": "",
    "tune": "",
    "truth-print": "",
    "truth-camera": "",
    "truth": "",
}
"""Commands of palpate-lab, and the extras that each needs."""
GROUPS = {
    "Track an object": ("demo", "info", "track", "outline", "live"),
    "Your sensor and your data": ("convert", "read", "calibrate", "truth-print", "truth-camera", "truth"),
    "Many recordings": ("simulate", "evaluate", "compare", "tune", "train", "paper"),
    "Set up": ("ros2", "warm-up"),
}
"""Names as the help shows them; commands of other distributions follow in the last group."""
ORDER = [name for names in GROUPS.values() for name in names]


def find_command(name: str) -> Command:
    """Return a command. Raises SettingError, which says what to install for one of the laboratory that is missing."""
    if name in OWN:
        return OWN[name]
    added = _added()
    if name in added:
        return _load(added[name])
    if name in LABORATORY:
        command = install_command(LABORATORY[name], "palpate-lab")
        raise SettingError(f"palpate {name} needs palpate-lab, which is not installed: {command}")
    known = list(dict.fromkeys([*ORDER, *added]))
    near = difflib.get_close_matches(name, known, 1)
    question = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    raise SettingError(f"there is no command {name!r}; {question}")


def installed_commands() -> dict[str, Command]:
    """Return the commands that are installed, by name, in the order of the help. Raises SettingError."""
    added = _added()
    names = [name for name in ORDER if name in OWN or name in added]
    names += sorted(set(added) - set(ORDER))
    return {name: OWN[name] if name in OWN else _load(added[name]) for name in names}


def help_text(description: str) -> str:
    """Return the help of all commands: a line for each that is installed, in groups."""
    summaries = {name: _first_line(command) for name, command in installed_commands().items()}
    others = [name for name in summaries if name not in ORDER]
    width = max(map(len, summaries)) + 2
    columns = min(shutil.get_terminal_size().columns, 110)
    lines = ["usage: palpate COMMAND [OPTIONS]", "", *textwrap.wrap(description, columns)]
    for title, names in GROUPS.items():
        shown = [*names, *others] if title == "Set up" else names
        lines += ["", title]
        for name in shown:
            if name in summaries:
                text = f"  {name.ljust(width)}{summaries[name]}"
                lines += textwrap.wrap(text, columns, subsequent_indent=" " * (width + 2))
    lines += ["", f"{own_command()} COMMAND --help lists the options of a command."]
    return "\n".join(lines)


def _first_line(command: Command) -> str:
    """Return the first sentence of a command's docstring, without its full stop."""
    return inspect.cleandoc(command.__doc__ or "").partition("\n")[0].rstrip(".")


def _added() -> "dict[str, EntryPoint]":
    from importlib.metadata import entry_points  # brings a reader of mails

    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _load(entry: "EntryPoint") -> Command:
    try:
        return entry.load()
    except (ImportError, AttributeError) as error:
        distribution = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value
        raise SettingError(f"the command {entry.name} of {distribution} cannot be loaded: {error}") from error
