"""Names of before for the options of bags, until the commands that use them follow."""

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from palpate.cli.options import Bag

if TYPE_CHECKING:
    from palpate.io.rosbag_recording import BagReading
    from palpate.types.recording import Recording

BagOptions: TypeAlias = Bag
BAG_DEFAULTS = Bag()


def read_with(file: Path, options: Bag) -> "Recording | BagReading":
    """See `Bag.read`."""
    return options.read(file)
