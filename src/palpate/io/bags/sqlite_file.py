"""Databases of ROS 2 from strangers: plain tables only, and what can be read of one that was cut off.

SQLite refuses a file that is shorter than its first page says. Filled up with zeros it is read in the order of writing,
up to the first page that is missing.
"""

import re
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from urllib.parse import quote

from palpate.errors import FileError
from palpate.io.bags.raw import Channel, CutShort, RawMessage
from palpate.limits import BAG

PLAIN = re.compile(
    r"create\s+(table|(unique\s+)?index)\b(?!.*(generated\s+always|\bas\s*\())", re.IGNORECASE | re.DOTALL
)
"""Statements that define nothing which is computed when it is read."""


_TOPICS = "SELECT id, name, type, serialization_format FROM topics"
_MESSAGES = "SELECT topic_id, timestamp, data FROM messages ORDER BY "


def database_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a database by their times, of one that is cut off as they were written.

    Raises CutShort where it is cut off or damaged, FileError where no message stands before that, or it is none.
    """
    is_cut = path.stat().st_size < _whole_size(path)
    count = 0
    try:
        with _filled_up(path) if is_cut else nullcontext(path) as whole, closing(_opened(whole)) as database:
            topics = _topics(path, database)
            for topic, time, data in database.execute(_MESSAGES + ("id" if is_cut else "timestamp")):
                if not isinstance(time, int) or not isinstance(data, bytes):
                    raise ValueError(f"a message is a {type(data).__name__}")
                if topic in topics:
                    yield RawMessage(topics[topic], time, data)
                    count += 1
    except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
        if count:
            raise CutShort(f"{path}: is cut off or damaged after {count} messages") from error
        why = "is cut off before its first message" if is_cut else "cannot be opened"
        raise FileError(f"{path}: {why} ({' '.join(str(error).split())})") from error
    if is_cut:
        raise CutShort(f"{path}: is cut off or damaged after {count} messages")


def _opened(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)


def _topics(path: Path, database: sqlite3.Connection) -> dict[int, Channel]:
    """Topics by their numbers. FileError unless the tables are plain ones: a view can make rows without end."""
    try:
        statements = [row[0] for row in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")]
    except MemoryError:  # what SQLite says of some damaged ones, having asked for hardly any
        raise sqlite3.DatabaseError("its list of tables is damaged") from None
    if unusual := [each for each in statements if not isinstance(each, str) or not PLAIN.match(each)]:
        raise FileError(f"{path}: has a table that is none of a bag's: {str(unusual[0])[:80]!r}")
    rows = database.execute(_TOPICS).fetchall()
    topics = {number: Channel(*map(str, said)) for number, *said in rows}
    if len(topics) < len(rows):
        raise FileError(f"{path}: has several topics of one number")
    return topics


@contextmanager
def _filled_up(path: Path) -> Iterator[Path]:
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
