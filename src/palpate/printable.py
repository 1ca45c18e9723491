"""Text from files and users made safe to print: nothing in it moves the cursor or colours the terminal."""

import logging
import re

# Control characters, those that turn the direction of writing, and halves of characters, which names of files hold
# whose bytes are no text.
_UNPRINTABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    r"""The text with each character that is not to reach a terminal written as Python writes it, such as \x1b."""
    return _UNPRINTABLE.sub(lambda found: ascii(found[0])[1:-1], text)


def shortened(text: str, most: int = 1600) -> str:
    """Return the text, without its middle where it is too long for a message, as when it quotes a name of 150 kB."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 4 :]}"


def one_line(error: Exception) -> str:
    """Return the message of an error of a library as one short line."""
    return " ".join(str(error).split())[:200]


class PrintableFormatter(logging.Formatter):
    """Formats messages of the log so that they can be printed."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a message."""
        return printable(super().format(record))
