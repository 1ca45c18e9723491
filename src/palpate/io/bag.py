"""Bags of ROS messages: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag); `bags/` reads and writes them.

Only MCAP is written; it holds all of a recording or a trajectory. A bag of others tells no outline of the object, so
`bags.bag_recording.read_bag` reads it, with one.
"""

from pathlib import Path

from palpate.errors import FileError
from palpate.io.bags.containers import check_installed, container_of, existing_bag
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

NAME = "bag"
DESCRIPTION = "bag of ROS messages: MCAP (.mcap), ROS 2 (.db3 or its folder), ROS 1 (.bag)"


def detect(path: Path) -> bool:
    """Whether it is one of these, by its first bytes."""
    return container_of(path) is not None


def read(path: Path) -> Recording | Trajectory:
    """Read what palpate wrote. Raises FileError on any other bag."""
    path = existing_bag(path)
    found = read_own(path)
    if found is None:
        raise FileError(
            f"{path}: is a bag of ROS messages, which tell no outline of the object; palpate track and convert take it "
            "by --shape, in Python palpate.read_bag"
        )
    return found


def read_own(path: Path) -> Recording | Trajectory | None:
    """What palpate wrote into a bag; None if the bag is another's. Raises FileError where it is damaged."""
    from palpate.io.bags.estimates_mcap import read_estimates_mcap
    from palpate.io.bags.live_mcap import read_live_mcap
    from palpate.io.bags.recording_mcap import read_recording_mcap

    check_installed()
    if container_of(path) != "mcap":
        return None
    return read_recording_mcap(path) or read_live_mcap(path) or read_estimates_mcap(path)


def write(data: Recording | Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write an MCAP. Raises FileError if the file exists and `overwrite` is not set."""
    from palpate.io.bags.estimates_mcap import write_estimates_mcap
    from palpate.io.bags.recording_mcap import write_recording_mcap

    if isinstance(data, Recording):
        write_recording_mcap(data, path, overwrite)
    else:
        write_estimates_mcap(data, path, overwrite)
