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
from typing import Any

import tyro

from palpate import __version__
from palpate.cli.commands import find_command, installed_commands
from palpate.cli.console import complain
from palpate.errors import PalpateError, printable

DESCRIPTION = (
    "Finds the pose of an object by touch. Exit codes: 0 done, 2 bad input or usage, 3 some of several files failed. "
    "--version prints the version."
)
FOR_ALL = "With --json it prints one JSON object; with --debug, an error shows its traceback."
"""Options of every command."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line, by default that of the process, and return its exit code.

    Raises SystemExit(2) on bad usage.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    words = list(sys.argv[1:] if args is None else args)
    if args is None:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a cancelled job leaves files in order, as Ctrl-C
    debug, as_json = "--debug" in words, "--json" in words
    words = [word for word in words if word not in ("--debug", "--json")]
    if words == ["--version"]:
        print(f"palpate {__version__}")
        return 0
    log = logging.StreamHandler()
    log.format = lambda record: printable(f"palpate: {record.getMessage()}")
    logging.basicConfig(handlers=[log], level=logging.WARNING)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may not be text
    # A step's arrays are too small to be shared between threads, and what imports make is no garbage.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    os.environ["MPLBACKEND"] = "agg"  # figures go to files, and that of a notebook is not installed everywhere
    gc.set_threshold(100_000, 20, 20)
    config = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes)
    if words[:1] in ([], ["help"]):
        words = [*words[1:2], "--help"]
    command: Any = None
    try:
        if words[0].startswith("-"):  # one command alone is quicker, since options of all take a tenth of a second
            tyro.extras.subcommand_cli_from_dict(
                installed_commands(), prog="palpate", description=f"{DESCRIPTION} {FOR_ALL}", args=words, config=config
            )
        command = find_command(words[0])
        about = f"{inspect.cleandoc(command.__doc__).partition('Args:')[0]}{FOR_ALL}"
        made = tyro.cli(command, prog=f"palpate {words[0]}", description=about, args=words[1:], config=config)
        made.print(as_json)
        sys.stdout.flush()
        return made.code
    except KeyboardInterrupt as stop:
        can_resume = command is not None and "resume" in inspect.signature(command).parameters
        hint = str(stop) or ("--resume goes on" if can_resume else "")
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


if __name__ == "__main__":
    sys.exit(main())
