"""`palpate`: parses the command line, runs a command and turns errors into one line and an exit code."""

import gc
import inspect
import io
import logging
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import tyro

from palpate import __version__
from palpate.cli.commands import Command, find_command, installed_commands
from palpate.cli.console import Report, complain
from palpate.errors import PalpateError, printable

DESCRIPTION = (
    "Finds the pose of an object by touch. Exit codes: 0 done, 2 bad input or usage, 3 some of several files failed. "
    "--version prints the version."
)
FOR_ALL = "With --json it prints one JSON object; with --debug, an error shows its traceback."
"""Options of every command."""
_CONFIG = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes)


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
    command: Command | None = None
    try:
        if words[0].startswith("-"):
            _show_help(words)
        command = find_command(words[0])
        report = _run(command, words)
        report.print(as_json)
        sys.stdout.flush()
        return report.code
    except KeyboardInterrupt as stop:
        hint = str(stop) or _way_to_go_on(command)
        complain(f"stopped; {hint}" if hint else "stopped")
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
    logging.getLogger("palpate.io.outlines").setLevel(logging.INFO)  # an outline's size tells if the right one was read
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may not be text
    # The arrays of a step are too small to be shared between threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    os.environ["MPLBACKEND"] = "agg"  # figures go to files, and that of a notebook is not installed everywhere
    gc.set_threshold(100_000, 20, 20)  # imports make many objects, none of them garbage


def _show_help(words: Sequence[str]) -> None:
    """Show the help of all commands and raise SystemExit. It takes a tenth of a second more than that of one."""
    tyro.extras.subcommand_cli_from_dict(
        installed_commands(), prog="palpate", description=f"{DESCRIPTION} {FOR_ALL}", args=words, config=_CONFIG
    )


def _run(command: Command, words: Sequence[str]) -> Report:
    """Run a command with words that begin with its name. Raises SystemExit for help and on bad usage."""
    description = f"{inspect.cleandoc(command.__doc__ or '').partition('Args:')[0]}{FOR_ALL}"
    return tyro.cli(command, prog=f"palpate {words[0]}", description=description, args=words[1:], config=_CONFIG)


def _way_to_go_on(command: Command | None) -> str:
    """Return words on how a command goes on after Ctrl-C, or ""."""
    if command is not None and "resume" in inspect.signature(command).parameters:
        return "--resume goes on"
    return ""


if __name__ == "__main__":
    sys.exit(main())
