"""Reading a bag of ROS 2 that is an SQLite database, or a folder of packed files, by `rosbags`."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from palpate.errors import FileError
from palpate.formats.bags.raw import Channel, CutShort, RawMessage
from palpate.formats.bags.sqlite_file import check_tables, filled_up, is_cut
from palpate.formats.bags.unpack import check_unpacked, unpacked

LARGEST_METADATA = 10**6
"""[bytes] of metadata.yaml; a recorder writes some thousand."""


def bag_metadata(folder: Path) -> str:
    """The text of a bag's metadata.yaml. Raises FileError."""
    path = folder / "metadata.yaml"
    if path.stat().st_size > LARGEST_METADATA:
        raise FileError(f"{path}: has {path.stat().st_size} bytes, allowed are {LARGEST_METADATA}")
    return path.read_bytes().decode("utf-8", errors="replace")


def ros2_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a bag by their times. Raises CutShort where it ends too early, FileError if it is none."""
    from rosbags.rosbag2 import Reader

    if path.is_file() and is_cut(path):
        yield from _messages_of_cut(path)
    if path.is_dir():
        bag_metadata(path)
        check_unpacked(sorted(path.glob("*.zstd")))
    for database in sorted(path.glob("*.db3")) if path.is_dir() else [path]:
        check_tables(database)
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # the errors of SQLite, of YAML and of the reader
        raise FileError(f"{path}: cannot be opened ({' '.join(str(error).split())})") from error
    count = 0
    try:
        packed = _leave_packed(reader)
        for connection, time, data in reader.messages():
            if not isinstance(time, int) or not isinstance(data, bytes):
                raise ValueError(f"a message is a {type(data).__name__}")
            plain = unpacked("zstd", data) if packed else data
            yield RawMessage(Channel(connection.topic, connection.msgtype, "cdr"), time, plain)
            count += 1
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    except Exception as error:
        raise CutShort(f"{path}: is cut off or damaged after {count} messages") from error
    finally:
        reader.close()


def _messages_of_cut(path: Path) -> Iterator[RawMessage]:
    """Those in front of the cut; then raises CutShort, or FileError where there are none."""
    count = 0
    with filled_up(path) as whole:
        try:
            with closing(sqlite3.connect(whole)) as database:
                check_tables(whole)
                topics = {number: (name, type_) for number, name, type_ in database.execute(_TOPICS)}
                for topic, time, data in database.execute(_MESSAGES):
                    name, type_ = topics[topic]
                    if not isinstance(time, int) or not isinstance(data, bytes):
                        raise ValueError(f"a message is a {type(data).__name__}")
                    yield RawMessage(Channel(name, type_, "cdr"), time, data)
                    count += 1
        except (sqlite3.Error, FileError, KeyError, TypeError, ValueError) as error:
            if not count:
                raise FileError(f"{path}: is cut off before its first message") from error
    raise CutShort(f"{path}: is cut off or damaged after {count} messages")


def _leave_packed(reader: Any) -> bool:
    """Keep a reader from unpacking messages, which it would do without bounds; say whether they are packed."""
    within = reader.storage
    if within.metadata.compression_mode != "message":
        return False
    within.metadata = within.metadata._replace(compression_mode=None)
    return True


_TOPICS = "SELECT id, name, type FROM topics"
_MESSAGES = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
