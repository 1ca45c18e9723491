"""`palpate info`: what a recording holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from palpate.cli.options import JsonOption

if TYPE_CHECKING:
    from palpate.pipeline.check_recording import Inspection
    from palpate.types.recording import Recording


def info(
    file: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(help="A recording in any known format, a bag, or a calibration.")
    ],
    /,
    *,
    json: JsonOption = False,
) -> int:
    """What a recording holds: rates, gaps, contacts, ground truth, and what is wrong with it.

    Of a bag of ROS messages: its topics, rates, gaps and clocks, and what would be read from where. Of a calibration:
    its images, how they lie, and what is off in directions.
    """
    from palpate import io as formats
    from palpate.cli.bag_info import show_bag
    from palpate.cli.calibration_info import show_calibration
    from palpate.cli.console import busy, print_json
    from palpate.geometry.shapes import shape_to_dict
    from palpate.pipeline.check_recording import inspect_recording
    from palpate.types.sensor import sensor_to_dict

    if formats.detect_format(file) is None and file.suffix.lower() == ".npz":
        show_calibration(file, json)
        return 0
    if formats.detect_format(file) in ("bag", "estimates-mcap"):
        show_bag(file, json)
        return 0
    with busy(f"inspecting {file.name}"):
        recording = formats.load_recording(file)
        inspection = inspect_recording(recording)
    if json:
        print_json(
            {
                "file": str(file),
                "format": formats.detect_format(file),
                "source": recording.source,
                "shape": shape_to_dict(recording.shape),
                "sensor": sensor_to_dict(recording.sensor),
                "pose_sources": recording.frames,
                **inspection.to_dict(),
            }
        )
    else:
        _show(file, recording, inspection)
    return 0


def _show(file: Path, recording: "Recording", inspection: "Inspection") -> None:
    from palpate.cli.console import number, print_line, print_table
    from palpate.geometry.shapes import shape_to_dict
    from palpate.pipeline.check_recording import counted

    begin = recording.time[0]
    shape = shape_to_dict(recording.shape)
    sizes = ", ".join(
        f"{name.replace('_', ' ')} {value * 1e3:g} mm" for name, value in shape.items() if isinstance(value, float)
    )
    corners = f"{len(shape['vertices'])} corners" if "vertices" in shape else sizes
    jitter = None if inspection.jitter is None else inspection.jitter * 1e3
    share = None if inspection.contact_share is None else inspection.contact_share * 100
    size, grey = inspection.image_size, ", grey" if inspection.is_grey else ""
    rows = [
        ("source", recording.source or "-", ""),
        ("object", f"{shape['type']}, {corners}", ""),
        ("sensor", recording.sensor.name, ""),
        ("frames", str(inspection.frames), ""),
        ("duration", number(inspection.duration, 2), "s"),
        ("rate, median", number(inspection.rate), "Hz"),
        ("jitter", number(jitter, 2), "ms"),
        ("contact", inspection.contact, ""),
        ("contact share", number(share, 0), "%"),
        ("ground truth share", number(inspection.truth_share * 100, 0), "%"),
        ("images", f"{inspection.images} of {size[0]} x {size[1]} px{grey}" if size else "none", ""),
        *((f"{name} is", words, "") for name, words in recording.frames.items()),
    ]
    print_table(str(file), ("what", "value", "unit"), rows)
    contacts = (
        (str(index), number(contact.start - begin, 2), number(contact.end - begin, 2), number(contact.seconds, 2))
        for index, contact in enumerate(inspection.contacts)
    )
    if inspection.contacts:
        print_table("Contacts", ("no.", "start [s]", "end [s]", "seconds"), contacts, numbers=(0, 1, 2, 3))
    if inspection.findings:
        findings = (
            (f"{number(finding.start - begin, 2)} - {number(finding.end - begin, 2)}", finding.kind, finding.sentence)
            for finding in counted(inspection.findings)
        )
        print_table("Findings", ("time [s]", "kind", "what"), findings)
    print_line(inspection.verdict)
