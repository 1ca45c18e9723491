"""`palpate info`, `convert` and `view`: the content of files, and other formats of it, of which one is Rerun's."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.cli.console import print_line, progress_bar, report
from palpate.cli.options import Bag, Force, Json, Orientation, Sensor, arg, check_new
from palpate.errors import FileError, SettingError, printable

if TYPE_CHECKING:
    from palpate.touch.calibration import Calibration


def info(
    file: Annotated[Path, arg("FILE")],
    /,
    *,
    sensor: Sensor = "digit",
    orientation: Orientation = "",
    json: Json = False,
) -> int:
    """Show the contents of a recording (rates, gaps, contacts, truth), a bag or a calibration, and problems in it.

    Example: palpate info push.mcap

    Args:
        file: A recording in any known format, a bag, or a calibration.
    """
    from palpate import io as formats
    from palpate.geometry.shapes import shape_to_dict
    from palpate.pipeline.check_recording import check_recording

    kind = formats.detect_format(file)
    if kind is None and file.suffix.lower() == ".npz":
        from palpate.touch.calibration import load_calibration

        about = about_calibration(load_calibration(file))
        report(json, file.name, {"file": str(file), "format": "calibration", **about})
    elif kind == "bag":
        with progress_bar(f"inspecting {file.name}"):
            about = _about_bag(file, sensor, orientation)
        report(json, file.name, {"file": str(file), "format": "bag", **about})
    else:
        with progress_bar(f"inspecting {file.name}"):
            recording = formats.load_recording(file).oriented(orientation)
            found = check_recording(recording)
        about = {"file": str(file), "format": kind, "source": recording.source, "sensor": recording.sensor.name}
        report(json, file.name, about | {"shape": shape_to_dict(recording.shape)} | found)
    return 0


def convert(
    source: Annotated[Path, arg("IN")],
    target: Annotated[Path, arg("OUT")],
    /,
    *,
    force: Force = False,
    json: Json = False,
    bag: Bag = Bag(),
) -> int:
    """Convert a bag or a recording of another format to a recording of palpate.

    Example: palpate convert robot.bag push.mcap --shape 0.09x0.06

    Args:
        source: A recording in any known format, or a bag.
        target: File to write, .mcap.
    """
    from palpate.io.recording_mcap import write_recording

    if target.suffix.lower() != ".mcap":
        raise SettingError(f"{target}: extension {target.suffix!r} is of no format to write, allowed is .mcap")
    check_new(target, force)
    with progress_bar(f"converting {source.name}"):
        found = bag.read(source)[0]
        write_recording(found, target, overwrite=force)
    report(json, target.name, {"in": str(source), "out": str(target), "frames": len(found)})
    return 0


def view(
    path: Annotated[Path, arg("RUN|RECORDING")],
    /,
    *,
    save: Annotated[Path | None, arg("FILE.rrd", "<name>.rrd")] = None,
    force: Force = False,
) -> int:
    """Write a run or a recording for Rerun: the push from above, touch and status over time.

    Example: palpate view runs/push && rerun push.rrd

    Args:
        path: Folder of a run, or a recording in any known format.
        save: File to write.
    """
    from palpate.viewer.rerun_view import write_view

    file = save or Path(f"{printable(path.resolve().stem)}.rrd")
    check_new(file, force)
    with progress_bar(f"reading {path.name}"):
        write_view(path, file, force)
    print_line(f"{file}: open it with `rerun {file}`, which a computer with a display and rerun-sdk 0.41 has")
    return 0


def about_calibration(calibration: "Calibration") -> dict[str, Any]:
    """Return a calibration as plain data; noise is the median change of an untouched image over time [grey levels]."""
    import numpy as np

    gel, direction = calibration.background, calibration.direction
    height, width = gel.mean.shape[:2]
    pitch = calibration.pixel_pitch
    return {
        "height": height,
        "width": width,
        "noise_levels": float(np.median(gel.deviation)) if gel.deviation.any() else None,  # a single image has none
        "view": str(calibration.view),
        "is_view_measured": calibration.is_view_known,
        "pixel_pitch_mm": 1e3 * pitch if pitch else None,
        "pixel_pitch_sigma_mm": 1e3 * pitch * calibration.pixel_pitch_sigma if pitch else None,
        "offset_deg": degrees(direction.offset),
        "offset_sigma_deg": degrees(direction.offset_sigma) if direction.offset_sigma is not None else None,
        "scale": direction.scale,
        "scale_sigma": direction.scale_sigma,
    }


def _about_bag(path: Path, sensor: str, orientation: str) -> dict[str, Any]:
    """Return the topics of a bag, what tracking would read, and the command that does or why there is none."""
    from palpate.geometry.shapes import Disc
    from palpate.io.rosbag_reader import contents
    from palpate.io.rosbag_recording import BagChoices, recording_of
    from palpate.pipeline.check_recording import check_recording
    from palpate.types.sensor import known_sensor

    found, choices, profile = contents(path), BagChoices(orientation=orientation), known_sensor(sensor)
    bag: dict[str, Any] = {"topics": [topic.about() for topic in found.topics]}
    bag["frames"] = {child: " or ".join(stream.frames) for child, stream in found.transforms.items()}
    try:
        recording = recording_of(found, Disc(0.05), choices, profile).recording
    except FileError as error:
        others = "" if sensor != "digit" else "; for images of a GelSight Mini, --sensor gelsight-mini"
        return bag | {"advice": f"{error}{others}"}
    damaged = sum(finding["kind"] == "image" for finding in check_recording(recording)["findings"])
    options = (f" --sensor {sensor}" if sensor != "digit" else "") + (orientation and f" --orientation {orientation}")
    return bag | {
        "source": recording.source,
        "damaged_images": damaged,
        "advice": f"palpate track {found.path}{options} --shape NAME|FILE --first-pose X Y THETA",
    }
