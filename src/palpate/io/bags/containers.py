"""The three containers of bags, told by their first bytes, and the messages in them."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from palpate.errors import FileError, SettingError
from palpate.files import existing_file
from palpate.io.bags.mcap_file import MAGIC, mcap_messages
from palpate.io.bags.raw import RawMessage
from palpate.io.bags.ros1_file import FIRST_LINE, ros1_messages
from palpate.io.bags.ros2_folder import bag_files, folder_messages
from palpate.io.bags.sqlite_file import database_messages
from palpate.limits import MESSAGES

Container = Literal["mcap", "ros2", "ros1"]
"""MCAP; SQLite or a folder of ROS 2; a bag of ROS 1."""

FIRST_BYTES: dict[Container, bytes] = {"mcap": MAGIC, "ros2": b"SQLite format 3\x00", "ros1": FIRST_LINE}


LATEST = 2**62
"""[ns] A message that was recorded later, after the year 2116, is damaged."""


def container_of(path: Path) -> Container | None:
    """Which container a file or the folder of a ROS 2 bag is, or None."""
    if (path / "metadata.yaml").is_file():
        return "ros2"
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except OSError:
        return None
    return next((name for name, first in FIRST_BYTES.items() if start.startswith(first)), None)


def existing_bag(path: Path | str) -> Path:
    """`path`, if a file with content or the folder of a ROS 2 bag is there; FileError if not."""
    path = Path(path)
    if (path / "metadata.yaml").is_file():
        return path
    if path.is_dir() and (parts := bag_files(path)):
        raise FileError(
            f"{path}: is a folder without metadata.yaml, as a recorder leaves it that was killed; give {parts[0]}"
        )
    return existing_file(path)


def raw_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a bag, as they stand in its container.

    Raises CutShort after the last one that can be read if the bag ends too early, FileError if it is none.
    """
    path = existing_bag(path)
    check_installed()
    container = container_of(path)
    if container is None:
        raise FileError(f"{path}: is no bag; known are MCAP, ROS 2 .db3 or its folder, and ROS 1 .bag")
    if path.is_dir():
        messages = folder_messages(path)
    else:
        messages = {"mcap": mcap_messages, "ros1": ros1_messages, "ros2": database_messages}[container](path)
    most = MESSAGES.value
    for count, raw in enumerate(messages, 1):
        if count > most:
            raise FileError(f"{path}: holds more than {most} messages, {MESSAGES.words}")
        if not 0 <= raw.log_time < LATEST:
            topic = raw.channel.topic
            raise FileError(f"{path}: {topic}: a message was recorded at {raw.log_time} ns, past any clock")
        yield raw


def check_installed() -> None:
    """SettingError unless what reads and writes bags is installed."""
    for name in ("mcap", "rosbags"):
        if find_spec(name) is None:
            raise SettingError(
                f"reading and writing bags needs {name}, which is not installed: pip install palpate[ros]"
            )
