"""The errors palpate raises on bad input. Each message names what is wrong, what was found and what is allowed."""

from palpate.printable import printable, shortened


class PalpateError(Exception):
    """Base of all errors that are the input's fault; the command line prints them in one line."""

    def __str__(self) -> str:
        """The message, in which what a file holds is not at length and no control characters."""
        return shortened(printable(super().__str__()))


class FileError(PalpateError):
    """A file, or a field in it, is missing or not what it should be."""


class ShapeError(PalpateError):
    """An outline that is no outline: it crosses itself, has no area, or has a wrong size."""


class SettingError(PalpateError):
    """A setting or option with a value that is not allowed, or input that a setting needs and lacks."""


class EstimationError(PalpateError):
    """The estimator cannot go on; the message names the frame and the likely reason."""


class FrameError(EstimationError):
    """A frame cannot be used and is left out.

    Later estimates are the same to the last digit as if it had not come. One exception: if a pose is refused because it
    leaps in a contact, what that frame's image showed of the gel is kept.
    """
