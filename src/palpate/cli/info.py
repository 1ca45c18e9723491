"""`palpate info`: contents of a recording, a bag or a calibration."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import Json, positional

if TYPE_CHECKING:
    from palpate.io.rosbag_reader import Contents
    from palpate.touch.calibration import Calibration


def info(
    file: Annotated[
        tyro.conf.Positional[Path], positional("FILE", "A recording in any known format, a bag, or a calibration.")
    ],
    /,
    *,
    json: Json = False,
) -> int:
    """Show the contents of a recording (rates, gaps, contacts, truth), a bag or a calibration, and problems in it.

    Example: palpate info push.mcap
    """
    from palpate import io as formats

    kind = formats.detect_format(file)
    if kind is None and file.suffix.lower() == ".npz":
        _show_calibration(file, json)
    elif kind in ("bag", "estimates-mcap"):
        _show_bag(file, json)
    else:
        _show_recording(file, kind, json)
    return 0


def noise_levels(calibration: "Calibration") -> float | None:
    """Return the median change of an untouched image over time [grey levels]; None if it is of a single image."""
    import numpy as np

    deviation = calibration.background.deviation
    return float(np.median(deviation)) if deviation.any() else None


def _show_recording(file: Path, kind: str | None, json: bool) -> None:
    from palpate import io as formats
    from palpate.cli.console import busy, number, print_json, print_line, print_table
    from palpate.geometry.shapes import shape_to_dict
    from palpate.pipeline.check_recording import check_recording, counted
    from palpate.types.sensor import sensor_to_dict

    with busy(f"inspecting {file.name}"):
        recording = formats.load_recording(file)
        found = check_recording(recording)
    shape = shape_to_dict(recording.shape)
    if json:
        about = {"file": str(file), "format": kind, "source": recording.source, "shape": shape}
        sources = {"sensor": sensor_to_dict(recording.sensor), "pose_sources": recording.frames}
        print_json({**about, **sources, **found})
        return
    begin = recording.time[0]
    sizes = ", ".join(
        f"{name.replace('_', ' ')} {value * 1e3:g} mm" for name, value in shape.items() if isinstance(value, float)
    )
    corners = f"{len(shape['vertices'])} corners" if "vertices" in shape else sizes
    size, grey = found["image_size"], ", grey" if found["is_grey"] else ""
    jitter, contact_share = found["jitter"], found["contact_share"]
    rows = [
        ("source", recording.source or "-", ""),
        ("object", f"{shape['type']}, {corners}", ""),
        ("sensor", recording.sensor.name, ""),
        ("frames", str(found["frames"]), ""),
        ("duration", number(found["duration"], 2), "s"),
        ("rate, median", number(found["rate"]), "Hz"),
        ("jitter", number(jitter and jitter * 1e3, 2), "ms"),
        ("contact", found["contact"], ""),
        ("contact share", number(contact_share and contact_share * 100, 0), "%"),
        ("ground truth share", number(found["truth_share"] * 100, 0), "%"),
        ("images", f"{found['images']} of {size[0]} x {size[1]} px{grey}" if size else "none", ""),
        *((f"{name} is", words, "") for name, words in recording.frames.items()),
    ]
    print_table(str(file), ("property", "value", "unit"), rows)
    if found["contacts"]:
        contacts = (
            (str(index), *(number(one[key] - begin, 2) for key in ("start", "end")), number(one["seconds"], 2))
            for index, one in enumerate(found["contacts"])
        )
        print_table("Contacts", ("no.", "start [s]", "end [s]", "seconds"), contacts, numbers=(0, 1, 2, 3))
    if found["findings"]:
        findings = (
            (f"{number(one['start'] - begin, 2)} - {number(one['end'] - begin, 2)}", one["kind"], one["sentence"])
            for one in counted(found["findings"])
        )
        print_table("Findings", ("time [s]", "kind", "description"), findings)
    print_line(found["verdict"])


def _show_bag(path: Path, json: bool) -> None:
    from palpate.cli.console import busy, number, print_json, print_line, print_table
    from palpate.io.rosbag_reader import contents

    with busy(f"inspecting {path.name}"):
        found = contents(path)
    images, sensor, advice = _bag_mapping(found)
    topics: list[dict[str, Any]] = [
        {
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
        for topic in found.topics
    ]
    if json:
        bag = {"file": str(path), "format": "bag", "cut": found.cut, "topics": topics, "frames": found.parents}
        print_json({**bag, "images": images, "sensor_poses": sensor, "advice": advice})
        return
    clocks = ("clock_offset_s", "clock_spread_s")
    rows = [
        (
            topic["topic"],
            topic["type"] or "-",
            topic["encoding"],
            str(topic["messages"]),
            number(topic["rate_hz"]),
            str(topic["gaps"]),
            number(topic["longest_gap_s"], 3),
            *(number(None if topic[clock] is None else topic[clock] * 1e3) for clock in clocks),
        )
        for topic in topics
    ]
    columns = ("topic", "type", "encoding", "messages", "Hz", "gaps", "longest [s]", "clock offset [ms]", "spread [ms]")
    print_table(str(path), columns, rows, numbers=range(3, len(columns)))
    if found.parents:
        chains = ", ".join(f"{parent} > {child}" for child, parent in sorted(found.parents.items()))
        print_line(f"frames: {chains}")
    if images is not None:
        print_line(f"images: {images}   sensor poses: {sensor}")
    print_line(advice)


def _bag_mapping(found: "Contents") -> tuple[str | None, str | None, str]:
    """Return the topic of images, the source of sensor poses, and the command to track the bag or why it cannot be."""
    from palpate.errors import FileError
    from palpate.io.rosbag_recording import BagChoices, check_stamps, mapping, written

    try:
        chosen = mapping(found, BagChoices())
        check_stamps(found, chosen)
    except FileError as error:
        return None, None, str(error)
    advice = f"palpate track {found.path} --shape NAME|FILE --first-pose X Y THETA"
    return chosen.images, written(chosen.sensor), advice


def _show_calibration(path: Path, json: bool) -> None:
    from math import degrees

    from palpate.cli.console import number, print_json, print_table
    from palpate.touch.calibration import load_calibration

    calibration = load_calibration(path)
    height, width = calibration.background.mean.shape[:2]
    view, direction, noise = calibration.view, calibration.direction, noise_levels(calibration)
    sigma = None if direction.offset_sigma is None else degrees(direction.offset_sigma)
    if json:
        size = {"file": str(path), "format": "calibration", "height": height, "width": width, "noise_levels": noise}
        offset = {"view": str(view), "offset_deg": degrees(direction.offset), "offset_sigma_deg": sigma}
        print_json({**size, **offset, "scale": direction.scale, "scale_sigma": direction.scale_sigma})
        return
    correction = "not measured"
    if sigma is not None:
        correction = f"{degrees(direction.offset):+.2f} ± {sigma:.2f} degrees and {direction.scale - 1.0:+.1%}"
        correction += "" if direction.scale_sigma is None else f" ± {direction.scale_sigma:.1%}"
    rows = [
        ("untouched gel", f"{height} x {width} px"),
        ("noise", "unknown from a single image" if noise is None else f"{number(noise)} grey levels"),
        ("orientation of images", str(view) if calibration.is_view_known else "not measured, used as they are"),
        ("directions are off by", correction),
    ]
    print_table(str(path), ("property", "value"), rows)
