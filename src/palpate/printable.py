"""Text from anywhere as it may be printed: nothing in it moves the cursor or colours the terminal."""

import logging
import re

# Control characters, those that turn the direction of writing, and halves of characters, which names of files hold
# whose bytes are no text.
_UNPRINTABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")

_LONGEST = 1600  # characters of a message


def printable(text: str) -> str:
    r"""The text with each character that is not to reach a terminal written as Python writes it, such as \x1b."""
    return _UNPRINTABLE.sub(lambda found: ascii(found[0])[1:-1], text)


def shortened(text: str) -> str:
    """The text without its middle where it is too long for a message, as where it quotes a name of 150 kB."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 4 :]}"


def one_line(error: Exception) -> str:
    """What an error of a library says, in one line that is not too long, to be part of a sentence."""
    return " ".join(str(error).split())[:200]


class PrintableFormatter(logging.Formatter):
    """Formats messages of the log so that they can be printed."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a message."""
        return printable(super().format(record))
