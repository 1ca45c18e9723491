"""Whether the clocks of a bag's topics go together."""

from palpate.errors import FileError
from palpate.io.bags.choices import Mapping, topics_of
from palpate.io.bags.contents import Contents

APART = 1.0
"""[s] by which header stamps and times of recording may differ more in one topic than in another, or at one time than
at another; messages wait no longer until they are recorded."""


def check_stamps(found: Contents, chosen: Mapping) -> None:
    """FileError unless the header stamps of what is read are set, do not leap, and are by one clock."""
    way_out = "--clock log takes the times of recording"
    offsets: dict[str, float] = {}
    for topic in topics_of(found, chosen):
        if topic.clock_offset is None or topic.clock_spread is None or topic.static:
            continue
        name = topic.channel.topic
        # The first message by a clock that starts at zero is no fault.
        if topic.unstamped > 1 or topic.unstamped == topic.count:
            raise FileError(f"{found.path}: {topic.unstamped} headers in {name} have a stamp of zero; {way_out}")
        if topic.clock_spread > APART:
            raise FileError(
                f"{found.path}: the header stamps in {name} leap by {topic.clock_spread:.1f} s against the times of "
                f"recording; {way_out}"
            )
        offsets[name] = topic.clock_offset
    of_images = offsets[chosen.images]
    for name, offset in offsets.items():
        if abs(offset - of_images) > APART:
            raise FileError(
                f"{found.path}: clocks differ: header stamps are {of_images:+.3f} s off the times of recording in "
                f"{chosen.images}, {offset:+.3f} s in {name}; {way_out}"
            )
