"""What `palpate info` says of a bag: topics, rates, gaps, clocks, frames, and what to read from where."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.io.rosbag_reader import Contents, Topic


def show_bag(path: Path, json: bool) -> None:
    """Print what a bag holds."""
    from palpate.cli.console import busy, print_json
    from palpate.io.rosbag_reader import contents

    with busy(f"inspecting {path.name}"):
        found = contents(path)
    images, sensor, advice = _proposal(found)
    if json:
        print_json(
            {
                "file": str(path),
                "format": "bag",
                "cut": found.cut,
                "topics": [_as_dict(topic) for topic in found.topics],
                "frames": found.parents,
                "images": images,
                "sensor_poses": sensor,
                "advice": advice,
            }
        )
    else:
        _show(found, images, sensor, advice)


def _proposal(found: "Contents") -> tuple[str | None, str | None, str]:
    """The topic of images, the source of sensor poses, and what to do next, in a sentence."""
    from palpate.errors import FileError
    from palpate.io.rosbag_recording import BagChoices, check_stamps, mapping, written

    try:
        chosen = mapping(found, BagChoices())
        check_stamps(found, chosen)
    except FileError as error:
        return None, None, str(error)
    advice = f"palpate track {found.path} --shape NAME|FILE --first-pose X Y THETA"
    return chosen.images, written(chosen.sensor), advice


def _as_dict(topic: "Topic") -> dict[str, object]:
    return {
        "topic": topic.channel.topic,
        "type": topic.channel.type,
        "encoding": topic.channel.encoding,
        "messages": topic.count,
        "rate_hz": topic.rate,
        "gaps": topic.gaps,
        "longest_gap_s": topic.longest_gap,
        "clock_offset_s": topic.clock_offset,
        "clock_spread_s": topic.clock_spread,
        "unstamped": topic.unstamped,
    }


def _show(found: "Contents", images: str | None, sensor: str | None, advice: str) -> None:
    from palpate.cli.console import number, print_line, print_table

    rows = []
    for topic in found.topics:
        offset, spread = ((None if each is None else each * 1e3) for each in (topic.clock_offset, topic.clock_spread))
        rows.append(
            (
                topic.channel.topic,
                topic.channel.type or "-",
                topic.channel.encoding,
                str(topic.count),
                number(topic.rate),
                str(topic.gaps),
                number(topic.longest_gap, 3),
                number(offset),
                number(spread),
            )
        )
    columns = ("topic", "type", "encoding", "messages", "Hz", "gaps", "longest [s]", "clock offset [ms]", "spread [ms]")
    print_table(str(found.path), columns, rows, numbers=range(3, len(columns)))
    if found.parents:
        chains = ", ".join(f"{parent} > {child}" for child, parent in sorted(found.parents.items()))
        print_line(f"frames: {chains}")
    if images is not None:
        print_line(f"images: {images}   sensor poses: {sensor}")
    print_line(advice)
