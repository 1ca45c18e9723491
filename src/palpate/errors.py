"""The errors palpate raises on bad input. Each message names what is wrong, what was found and what is allowed."""

import re

# Control characters, those that turn the direction of writing, and halves of characters, from names that are no text.
_UNPRINTABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class PalpateError(Exception):
    """Base of all errors that are the input's fault; the command line prints them in one line."""

    def __str__(self) -> str:
        """The message, in which what a file holds is not at length and no control characters."""
        text = printable(super().__str__())
        return text if len(text) <= 1600 else f"{text[:800]} ... {text[-400:]}"


class FileError(PalpateError):
    """A file, or a field in it, is missing or not what it should be."""


class ShapeError(PalpateError):
    """An outline that is no outline: it crosses itself, has no area, or has a wrong size."""


class SettingError(PalpateError):
    """A setting or option with a value that is not allowed, or input that a setting needs and lacks."""


class EstimationError(PalpateError):
    """The estimator cannot go on; the message names the frame and the likely reason."""


class FrameError(EstimationError):
    """A frame cannot be used and is left out: later estimates are the same as if it had not come.

    Only if a pose is refused because it jumps in a contact, what its image showed of the gel is kept.
    """


def printable(text: str) -> str:
    r"""Return the text with characters that are not to reach a terminal written as Python does, such as \x1b."""
    return _UNPRINTABLE.sub(lambda found: ascii(found[0])[1:-1], text)


def one_line(error: BaseException) -> str:
    """Return the message of an error of a library as one short line."""
    return " ".join(str(error).split())[:200] or type(error).__name__
