"""Databases of SQLite from strangers: plain tables only, and what can be read of one that was cut off.

SQLite refuses a file that is shorter than its first page says. Filled up with zeros it is read in the order of writing,
up to the first page that is missing.
"""

import re
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from palpate.errors import FileError
from palpate.limits import BAG

PLAIN = re.compile(
    r"create\s+(table|(unique\s+)?index)\b(?!.*(generated\s+always|\bas\s*\())", re.IGNORECASE | re.DOTALL
)
"""Statements that define nothing which is computed when it is read."""


def check_tables(path: Path) -> None:
    """FileError unless the tables of a database are plain ones: a view can make rows without end."""
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)) as database:
            statements = [row[0] for row in database.execute("select sql from sqlite_master where sql is not null")]
            if unusual := [each for each in statements if not isinstance(each, str) or not PLAIN.match(each)]:
                raise FileError(f"{path}: has a table that is none of a bag's: {str(unusual[0])[:80]!r}")
            topics = database.execute("select count(*), count(distinct id) from topics").fetchone()
            if topics[0] != topics[1]:
                raise FileError(f"{path}: has several topics of one number")
    except (sqlite3.Error, UnicodeError, OverflowError) as error:
        raise FileError(f"{path}: cannot be opened ({' '.join(str(error).split())})") from error


def is_cut(path: Path) -> bool:
    """Whether a file is shorter than its first page says."""
    return path.stat().st_size < _whole_size(path)


@contextmanager
def filled_up(path: Path) -> Iterator[Path]:
    """A copy of a database that was cut off, with zeros for what is missing. Raises FileError beyond the limit."""
    BAG.check(_whole_size(path), f"{path}: a database")
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        shutil.copyfile(path, whole)
        with whole.open("r+b") as file:
            file.truncate(_whole_size(path))
        yield whole


def _whole_size(path: Path) -> int:
    """How large the first page says that the file is [bytes]: pages and their size, of which 1 is 65536."""
    with path.open("rb") as file:
        first = file.read(32)
    page = int.from_bytes(first[16:18], "big")
    return int.from_bytes(first[28:32], "big") * (65536 if page == 1 else page)
