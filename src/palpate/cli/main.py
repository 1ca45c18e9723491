"""`palpate`: parses the command line, runs a command and turns errors into one line and an exit code."""

import difflib
import gc
import inspect
import io
import logging
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import tyro

from palpate import __version__
from palpate.cli.console import Report, complain
from palpate.cli.recordings import calibrate, convert, info
from palpate.cli.track import demo, live, track, warm_up
from palpate.errors import PalpateError, SettingError, printable

DESCRIPTION = (
    "Finds the pose of an object by touch. Exit codes: 0 done, 2 bad input or usage, 3 some of several files failed. "
    "--version prints the version."
)
FOR_ALL = "With --json it prints one JSON object; with --debug, an error shows its traceback."
"""Options of every command."""


def commands() -> dict[str, Any]:
    """Return all commands by name, in the order of the help."""
    lab = import_module("palpate.lab.commands")
    functions = (
        *(demo, info, track, live, convert, lab.simulate, calibrate, lab.train, lab.paper, lab.evaluate, lab.tune),
        *(lab.truth_print, lab.truth_camera, lab.truth, warm_up),
    )
    return {command.__name__.replace("_", "-"): command for command in functions}


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line, by default that of the process, and return its exit code.

    Raises SystemExit(2) on bad usage.
    """
    _open_closed_streams()
    words = list(sys.argv[1:] if args is None else args)
    if args is None:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a cancelled job leaves files in order, as Ctrl-C
    debug = "--debug" in words
    as_json = "--json" in words
    words = [word for word in words if word not in ("--debug", "--json")]
    if words == ["--version"]:
        print(f"palpate {__version__}")
        return 0
    _set_up_process()
    if words[:1] in ([], ["help"]):
        words = [*words[1:2], "--help"]
    known = commands()
    try:
        report = _run(known, words)
        report.print(as_json)
        sys.stdout.flush()
        return report.code
    except KeyboardInterrupt:
        complain(f"stopped{_way_to_go_on(known, words[0])}")
        return 130
    except BrokenPipeError:  # the reader, such as `head`, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (PalpateError, OSError) as error:  # bad input; a disk that is full or a folder that may not be written to
        if debug:
            raise
        complain(error)
        return 2


def _open_closed_streams() -> None:
    """Replace standard output and error, where the shell has closed them, by the null device."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115


def _set_up_process() -> None:
    """Set up logging, output, threads and the garbage collector for a command."""
    log = logging.StreamHandler()
    log.format = lambda record: printable(f"palpate: {record.getMessage()}")
    logging.basicConfig(handlers=[log], level=logging.WARNING)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may not be text
    # The arrays of a step are too small to be shared between threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    os.environ["MPLBACKEND"] = "agg"  # figures go to files, and that of a notebook is not installed everywhere
    gc.set_threshold(100_000, 20, 20)  # imports make many objects, none of them garbage


def _run(known: dict[str, Any], words: Sequence[str]) -> Report:
    """Run the command that the words begin with. Raises SettingError if there is none, SystemExit for help."""
    name = words[0]
    config = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes)
    if name.startswith("-"):  # the help of all commands, which takes a tenth of a second more than that of one
        tyro.extras.subcommand_cli_from_dict(
            known, prog="palpate", description=f"{DESCRIPTION} {FOR_ALL}", args=words, config=config
        )
    if name not in known:
        similar = difflib.get_close_matches(name, known, 1)
        question = f"did you mean {similar[0]}?" if similar else f"known are {', '.join(known)}"
        raise SettingError(f"there is no command {name!r}; {question}")
    command: Any = known[name]
    description = f"{inspect.cleandoc(command.__doc__).partition('Args:')[0]}{FOR_ALL}"
    return tyro.cli(command, prog=f"palpate {name}", description=description, args=words[1:], config=config)


def _way_to_go_on(known: dict[str, Any], name: str) -> str:
    """Return words on how a command goes on after Ctrl-C, or ""."""
    if name == "paper":
        return "; the same command goes on"
    if "resume" in inspect.signature(known[name]).parameters:
        return "; --resume goes on"
    return ""


if __name__ == "__main__":
    sys.exit(main())
