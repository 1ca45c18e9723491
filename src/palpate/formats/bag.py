"""Bags of ROS messages: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag); `bags/` reads and writes them.

A bag of others tells no outline, so `read` takes none; `bags.bag_recording.read_bag` reads it with an outline.
"""

from pathlib import Path

from palpate.errors import FileError
from palpate.formats.bags.containers import container_of, existing_bag
from palpate.recording.recording import Recording
from palpate.recording.trajectory import Trajectory

NAME = "bag"
DESCRIPTION = "bag of ROS messages: MCAP (.mcap), ROS 2 (.db3 or its folder), ROS 1 (.bag)"


def detect(path: Path) -> bool:
    """Whether it is one of these, by its first bytes."""
    return container_of(path) is not None


def read(path: Path) -> Recording | Trajectory:
    """Read what palpate wrote. Raises FileError on any other bag."""
    path = existing_bag(path)
    raise FileError(
        f"{path}: is a bag of ROS messages, which tell no outline of the object: give --shape, in Python "
        "palpate.read_bag"
    )
