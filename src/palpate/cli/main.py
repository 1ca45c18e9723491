"""`palpate`: parses the command line, runs a command and turns errors into one line and an exit code."""

import gc
import inspect
import io
import logging
import os
import signal
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import tyro

from palpate import __version__
from palpate.cli.commands import Command, find_command, help_text, installed_commands
from palpate.cli.console import Report, complain, progress_log
from palpate.cli.quantities import REGISTRY
from palpate.cli.recordings import convert
from palpate.cli.track import ros2
from palpate.errors import PalpateError, printable

DESCRIPTION = (
    "Finds the pose of an object by touch. Exit codes: 0 done, 2 bad input or usage, 3 some of several files failed. "
    "--version prints the version."
)
FOR_ALL = (
    "With --all it shows all rows and numbers, with --json it prints one JSON object, with --quiet only errors; with "
    "-v it says what it does, and with --debug an error shows its traceback."
)
"""Options of every command."""
FLAGS = ("--all", "--json", "--quiet", "-v", "--debug")
_CONFIG = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line, by default that of the process, and return its exit code.

    Raises SystemExit(2) on bad usage.
    """
    _open_closed_streams()
    words = list(sys.argv[1:] if args is None else args)
    if args is None:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a cancelled job leaves files in order, as Ctrl-C
    flags = {word for word in words if word in FLAGS}
    words = [word for word in words if word not in FLAGS]
    _set_up_process(flags)
    if words[:1] in ([], ["help"]):
        words = [*words[1:2], "--help"]
    command: Command | None = None
    try:
        if words[0].startswith("-"):
            return _show_help(words)
        command = find_command(words[0])
        return _finish(_run(command, words), flags)
    except KeyboardInterrupt as stop:
        hint = str(stop) or _way_to_go_on(command)
        complain(f"stopped; {hint}" if hint else "stopped")
        return 130
    except BrokenPipeError:  # the reader, such as `head`, has ended
        _drop_output()
        return 1
    except (PalpateError, OSError) as error:  # bad input; a disk that is full or a folder that may not be written to
        if "--debug" in flags:
            raise
        complain("the current folder does not exist any more" if _is_folder_gone() else error)
        try:
            sys.stdout.flush()
        except OSError:  # what is buffered would fail once more at the end, with another exit code
            _drop_output()
        return 2


def _drop_output() -> None:
    """Send what standard output still holds nowhere, as where it goes takes no more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _is_folder_gone() -> bool:
    """Return true if the current folder has been removed, of which no error of the system speaks."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _open_closed_streams() -> None:
    """Replace standard output and error, where the shell has closed them, by the null device."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115


def _set_up_process(flags: Collection[str]) -> None:
    """Set up logging, output, threads and the garbage collector for a command with these flags."""
    log = logging.StreamHandler()
    log.format = lambda record: printable(f"palpate: {record.getMessage()}")
    log.setLevel(logging.ERROR if "--quiet" in flags else logging.NOTSET)  # a run keeps the warnings all the same
    logging.basicConfig(handlers=[log], level=logging.WARNING)
    logging.getLogger("palpate").setLevel(logging.INFO if "-v" in flags else logging.NOTSET)
    logging.getLogger("palpate.io.outlines").setLevel(logging.INFO)  # an outline's size tells if the right one was read
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # of a home that is not writable, and other settings
    progress_log.setLevel(logging.ERROR if "--quiet" in flags else logging.INFO)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may not be text
    # The arrays of a step are too small to be shared between threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    os.environ["MPLBACKEND"] = "agg"  # figures go to files, and that of a notebook is not installed everywhere
    gc.set_threshold(100_000, 20, 20)  # imports make many objects, none of them garbage


def _finish(report: Report | int, flags: Collection[str]) -> int:
    """Print a result as flags ask for it, and return the exit code."""
    if isinstance(report, int):
        return report
    if "--json" in flags or "--quiet" not in flags:
        report.print("--json" in flags, "--all" in flags)
    sys.stdout.flush()
    return report.code


def _show_help(words: Sequence[str]) -> int:
    """Show the help of all commands or the version, or take options of tyro for tab completion, which raise SystemExit.

    These are such as --tyro-print-completion bash.
    """
    if words[0] in ("-h", "--help"):
        print(help_text(f"{DESCRIPTION} {FOR_ALL}"), flush=True)
        return 0
    if words == ["--version"]:
        print(f"palpate {__version__}", flush=True)
        return 0
    options: Any = {"config": _CONFIG, "registry": REGISTRY}
    tyro.extras.subcommand_cli_from_dict(installed_commands(), prog="palpate", args=words, **options)
    return 0


def _run(command: Command, words: Sequence[str]) -> Report | int:
    """Run a command with words that begin with its name. Raises SystemExit for help and on bad usage."""
    if command is ros2:
        return ros2(*words[1:])
    description = f"{inspect.cleandoc(command.__doc__ or '').partition('Args:')[0]}{FOR_ALL}"
    prog = f"palpate {words[0]}"
    args = _files_together(words[1:]) if command is convert else words[1:]
    try:
        return tyro.cli(command, prog=prog, description=description, args=args, config=_CONFIG, registry=REGISTRY)
    except SystemExit:  # help is shown; a full disk is named now, as at the end it changes the exit code
        sys.stdout.flush()
        raise


def _files_together(words: Sequence[str]) -> Sequence[str]:
    """Return words of `palpate convert IN --options OUT.mcap` with OUT beside IN, as tyro takes them."""
    first, *options = words or [""]
    is_apart = len(options) > 2 and options[-1].endswith(".mcap") and not options[-2].startswith("-")
    if first.startswith("-") or not is_apart or not options[0].startswith("-"):
        return words
    return [first, options[-1], *options[:-1]]


def _way_to_go_on(command: Command | None) -> str:
    """Return words on how a command goes on after Ctrl-C, or ""."""
    if command is not None and "resume" in inspect.signature(command).parameters:
        return "--resume goes on"
    return ""


if __name__ == "__main__":
    sys.exit(main())
