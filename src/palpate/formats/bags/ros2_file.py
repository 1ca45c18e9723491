"""Reading a bag of ROS 2 that is an SQLite database, or a folder of packed files, by `rosbags`."""

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from palpate.errors import FileError
from palpate.formats.bags.raw import Channel, CutShort, RawMessage
from palpate.formats.bags.unpack import check_unpacked, unpacked

LARGEST_METADATA = 10**6
"""[bytes] of metadata.yaml; a recorder writes some thousand."""

PLAIN = re.compile(
    r"create\s+(table|(unique\s+)?index)\b(?!.*(generated\s+always|\bas\s*\())", re.IGNORECASE | re.DOTALL
)
"""Statements that define nothing which is computed when it is read."""


def bag_metadata(folder: Path) -> str:
    """The text of a bag's metadata.yaml. Raises FileError."""
    path = folder / "metadata.yaml"
    if path.stat().st_size > LARGEST_METADATA:
        raise FileError(f"{path}: has {path.stat().st_size} bytes, allowed are {LARGEST_METADATA}")
    return path.read_bytes().decode("utf-8", errors="replace")


def ros2_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a bag by their times. Raises CutShort where it ends too early, FileError if it is none."""
    from rosbags.rosbag2 import Reader

    if path.is_dir():
        bag_metadata(path)
        check_unpacked(sorted(path.glob("*.zstd")))
    for database in sorted(path.glob("*.db3")) if path.is_dir() else [path]:
        _check_tables(database)
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


def _check_tables(path: Path) -> None:
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


def _leave_packed(reader: Any) -> bool:
    """Keep a reader from unpacking messages, which it would do without bounds; say whether they are packed."""
    within = reader.storage
    if within.metadata.compression_mode != "message":
        return False
    within.metadata = within.metadata._replace(compression_mode=None)
    return True
