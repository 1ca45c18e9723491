"""The errors palpate raises on bad input. Each message names what is wrong, what was found and what is allowed.

Warnings go to the logger "palpate"; `kept_warnings` keeps them where they belong to a recording or a run.
"""

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

# Control characters, characters that change the direction of writing, and halves of characters, as in names of files
# that are not text.
_UNPRINTABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class PalpateError(Exception):
    """Base of all errors that are caused by the input; the command line prints them in one line."""

    def __str__(self) -> str:
        """The message, shortened and without control characters, since it may quote what a file holds."""
        text = printable(super().__str__())
        return text if len(text) <= 1600 else f"{text[:800]} ... {text[-400:]}"


class FileError(PalpateError):
    """A file, or a field in it, is missing or not what it should be."""


class ShapeError(PalpateError):
    """An outline that cannot be used: it crosses itself, has no area, or has a wrong size."""


class SettingError(PalpateError):
    """A setting or option with a value that is not allowed, or that needs input which is missing."""


class EstimationError(PalpateError):
    """The estimator cannot go on; the message names the frame and the likely reason."""


class FrameError(EstimationError):
    """A frame cannot be used and is left out: later estimates are the same as if it had not come.

    There is one exception: if its pose is refused because it jumps in a contact, its image still counts as one of the
    gel.
    """


def printable(text: str) -> str:
    r"""Return the text with characters that must not reach a terminal written as escapes, such as \x1b."""
    return _UNPRINTABLE.sub(lambda match: ascii(match[0])[1:-1], text)


def one_line(error: BaseException) -> str:
    """Return the message of a library's error as one short line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


_listening: list[list[str]] = []
"""Lists that receive warnings now, of blocks one in another."""


class _Listener(logging.Handler):
    """Handler that keeps warnings in all lists, and shows them as if it were not there."""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a warning; show it where no other handler takes it."""
        for kept in _listening:
            kept.append(record.getMessage())
        if not logging.root.handlers and logging.lastResort:  # it is not called where any handler takes the record
            logging.lastResort.handle(record)


_LISTENER = _Listener(logging.WARNING)


@contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Yield a list that receives palpate's warnings while the block runs; they are shown as before."""
    kept: list[str] = []
    logging.getLogger("palpate").addHandler(_LISTENER)  # which is added once
    _listening.append(kept)
    try:
        yield kept
    finally:
        _listening[:] = [other for other in _listening if other is not kept]
        if not _listening:
            logging.getLogger("palpate").removeHandler(_LISTENER)
