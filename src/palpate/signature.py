"""What tells whether a file is still the one that was read."""

from pathlib import Path

from palpate.errors import FileError


def signature(path: Path) -> list[int]:
    """Return what changes when the file does: its size [bytes] and when it was written [ns]. Raises FileError."""
    try:
        stat = path.stat()
    except FileNotFoundError as error:
        raise FileError(f"{path}: no such file") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    return [stat.st_size, stat.st_mtime_ns]
