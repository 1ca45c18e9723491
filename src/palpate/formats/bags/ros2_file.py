"""Messages of a ROS 2 bag that is no MCAP, as `rosbags` reads them; those of a `.db3` that was cut off, as SQLite can.

SQLite refuses a file that is shorter than its first page says. Filled up with zeros it is read in the order of writing,
up to the first page that is missing.
"""

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from palpate.errors import FileError
from palpate.formats.bags.raw import Channel, CutShort, RawMessage


def ros2_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a bag. Raises CutShort where it ends too early, FileError where it cannot be opened."""
    from rosbags.rosbag2 import Reader

    reader = Reader(path)
    try:
        reader.open()
    except Exception as error:  # the errors of SQLite, of YAML and of the reader
        if path.is_file() and path.stat().st_size < _whole_size(path):
            yield from _messages_of_cut(path)
        raise FileError(f"{path}: cannot be opened ({' '.join(str(error).split())})") from error
    count = 0
    try:
        for connection, time, data in reader.messages():
            yield RawMessage(Channel(connection.topic, connection.msgtype, "cdr"), time, bytes(data))
            count += 1
    except Exception as error:
        raise CutShort(f"{path}: is cut off or damaged after {count} messages") from error
    finally:
        reader.close()


def _whole_size(path: Path) -> int:
    """How large the first page says that a file of SQLite is [bytes]: pages and their size, of which 1 is 65536."""
    with path.open("rb") as file:
        first = file.read(32)
    page = int.from_bytes(first[16:18], "big")
    return int.from_bytes(first[28:32], "big") * (65536 if page == 1 else page)


def _messages_of_cut(path: Path) -> Iterator[RawMessage]:
    """Those in front of the cut; then raises CutShort, or nothing where there are none."""
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        shutil.copyfile(path, whole)
        with whole.open("r+b") as file:
            file.truncate(_whole_size(path))
        try:
            with closing(sqlite3.connect(whole)) as database:
                topics = {number: (name, type_) for number, name, type_ in database.execute(_TOPICS)}
                for topic, time, data in database.execute(_MESSAGES):
                    name, type_ = topics[topic]
                    yield RawMessage(Channel(name, type_, "cdr"), time, data)
                    count += 1
        except (sqlite3.Error, KeyError, TypeError) as error:
            if count:
                raise CutShort(f"{path}: is cut off or damaged after {count} messages") from error


_TOPICS = "SELECT id, name, type FROM topics"
_MESSAGES = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
