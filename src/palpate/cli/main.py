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
from palpate.cli.console import complain
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
    found = (
        *(demo, info, track, live, convert, lab.simulate, calibrate, lab.train, lab.paper, lab.evaluate, lab.tune),
        *(lab.truth_print, lab.truth_camera, lab.truth, warm_up),
    )
    return {command.__name__.replace("_", "-"): command for command in found}


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
    known = commands()
    command: Any = known.get(words[0])
    try:
        if not command and not words[0].startswith("-"):
            near = difflib.get_close_matches(words[0], known, 1)
            question = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise SettingError(f"there is no command {words[0]!r}; {question}")
        if not command:  # one alone is quicker, since options of all take a tenth of a second
            tyro.extras.subcommand_cli_from_dict(
                known, prog="palpate", description=f"{DESCRIPTION} {FOR_ALL}", args=words, config=config
            )
        about = f"{inspect.cleandoc(command.__doc__).partition('Args:')[0]}{FOR_ALL}"
        made = tyro.cli(command, prog=f"palpate {words[0]}", description=about, args=words[1:], config=config)
        made.print(as_json)
        sys.stdout.flush()
        return made.code
    except KeyboardInterrupt:
        goes_on = "; --resume goes on" if "resume" in inspect.signature(command).parameters else ""
        complain("stopped" + ("; the same command goes on" if command is known["paper"] else goes_on))
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
