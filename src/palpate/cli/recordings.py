"""`palpate info`, `convert` and `calibrate`: the content of files, other formats of it, and a sensor unit's."""

from dataclasses import asdict
from itertools import repeat
from math import degrees
from pathlib import Path
from typing import Annotated, Any

import palpate
from palpate.cli.console import Report, progress_bar
from palpate.cli.options import Bag, Force, Orientation, Sensor, arg
from palpate.errors import FileError, SettingError
from palpate.files import in_file, new_file, numbers_of, read_json
from palpate.types.choices import DEFAULT_SENSOR


def info(
    file: Annotated[Path, arg("FILE")], /, *, sensor: Sensor = DEFAULT_SENSOR, orientation: Orientation = ""
) -> Report:
    """Show the contents of a recording (rates, gaps, contacts, truth), a bag, a calibration or a run, and its problems.

    Example: palpate info push.mcap

    Args:
        file: A recording in any known format, a bag, a calibration, or the folder of a run.
    """
    from palpate.geometry.shapes import shape_to_dict
    from palpate.io import detect_format
    from palpate.pipeline.check_recording import check_recording

    if (summary := file / "summary.json").exists():
        return Report(file.name, {"file": str(file), "format": "run", **read_json(summary)})
    kind = detect_format(file)
    with progress_bar(f"inspecting {file.name}"):
        if kind is None and file.suffix.lower() == ".npz":
            about = {"format": "calibration", **about_calibration(palpate.load_calibration(file))}
        elif kind == "bag":
            about = {"format": "bag", **_about_bag(file, sensor, orientation)}
        else:
            recording = palpate.load_recording(file, orientation)
            about = {"format": kind, "source": recording.source, "sensor": recording.sensor.name}
            about |= {"shape": shape_to_dict(recording.shape), **check_recording(recording)}
    return Report(file.name, {"file": str(file), **about})


def convert(
    source: Annotated[Path, arg("IN")],
    target: Annotated[Path, arg("OUT")],
    /,
    *,
    force: Force = False,
    bag: Bag = Bag(),
) -> Report:
    """Convert a bag or a recording of another format to a recording of palpate.

    Example: palpate convert robot.bag push.mcap --shape 0.09x0.06

    Args:
        source: A recording in any known format, or a bag.
        target: File to write, .mcap.
    """
    if target.suffix.lower() != ".mcap":
        raise SettingError(f"{target}: extension {target.suffix!r} is of no format to write, allowed is .mcap")
    new_file(target, force)
    with progress_bar(f"converting {source.name}"):
        found = bag.read(source).recording
        palpate.write_recording(found, target, overwrite=force)
    return Report(target.name, {"in": str(source), "out": str(target), "frames": len(found)})


def about_calibration(calibration: "palpate.Calibration") -> dict[str, Any]:
    """Return a calibration as plain data; noise is that of cells of an untouched image over time [grey levels]."""
    import numpy as np

    gel, direction = calibration.background, calibration.direction
    (height, width), pitch = gel.mean.shape[:2], calibration.pixel_pitch
    return {
        "height": height,
        "width": width,
        "noise_levels": float(np.median(gel.noise)) if gel.noise.any() else None,  # a single image has none
        "view": str(calibration.view),
        "is_view_measured": calibration.is_view_known,
        "pixel_pitch_mm": 1e3 * pitch if pitch else None,
        "pixel_pitch_sigma_mm": 1e3 * pitch * calibration.pixel_pitch_sigma if pitch else None,
        "offset_deg": degrees(direction.offset),
        "offset_sigma_deg": degrees(direction.offset_sigma) if direction.offset_sigma is not None else None,
        "scale": direction.scale,
        "scale_sigma": direction.scale_sigma,
        **({name: list(value) for name, value in asdict(calibration.set_up).items()} if calibration.set_up else {}),
    }


def _about_bag(path: Path, sensor: str, orientation: str) -> dict[str, Any]:
    """Return the topics of a bag, what tracking would read, and the command that does or why there is none."""
    from palpate.io.rosbag_reader import contents
    from palpate.io.rosbag_recording import recording_of
    from palpate.pipeline.check_recording import check_recording
    from palpate.types.sensor import known_sensor

    found, choices, profile = contents(path), palpate.BagChoices(orientation=orientation), known_sensor(sensor)
    bag: dict[str, Any] = {"topics": [channel._asdict() | each.about() for channel, each in found.topics.items()]}
    bag["frames"] = {child: " or ".join(stream.frames) for child, stream in found.transforms.items()}
    try:
        recording = recording_of(found, palpate.Disc(0.05), choices, profile).recording
    except FileError as error:
        return bag | {"advice": str(error)}
    damaged = sum(finding["kind"] == "image" for finding in check_recording(recording)["findings"])
    options = (f" --sensor {sensor}" if sensor != DEFAULT_SENSOR else "") + (
        orientation and f" --orientation {orientation}"
    )
    return bag | {
        "source": recording.source,
        "damaged_images": damaged,
        "advice": f"palpate track {found.path}{options} --shape NAME|FILE --first-pose X Y THETA",
    }


def calibrate(
    file: Annotated[Path | None, arg("[FILE]", "none")] = None,
    /,
    *,
    out: Annotated[Path, arg("UNIT.npz")],
    presses: Annotated[Path | None, arg("PRESSES.csv", "none")] = None,
    untouched: Annotated[tuple[Path, ...], arg("IMAGE", "none")] = (),
    ruler: Annotated[tuple[str, ...], arg("LENGTH IMAGE", "none")] = (),
    pushes: Annotated[tuple[Path, ...], arg("RECORDING", "none")] = (),
    sensor: Sensor = DEFAULT_SENSOR,
    orientation: Orientation = "",
    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None,
    force: Force = False,
) -> Report:
    """Calibrate a sensor unit: its untouched gel, by a ruler the scale of its images, by presses or pushes the rest.

    Example: palpate calibrate --presses presses.csv --untouched still.png --out unit.npz

    Args:
        file: A recording with images, whose first half second is untouched.
        out: File of the calibration.
        presses: Five or more presses, which also show errors of directions: a CSV of images (column file) at known
            contact angles (column angle_deg) or places along the pad's width (column place_mm) or, with the column file
            alone, by hand in order from -y to +y, which finds left and right only.
        untouched: Images of the untouched gel, in place of FILE.
        ruler: Distance, from middle to middle, of two thin edges or balls that are pressed in side by side across the
            image, as 8mm, and the image that shows them.
        pushes: Three or more recordings of one robot, better ten, without ground truth, of several objects and sides.
            They show the errors of mounting, delay, directions and outlines; UNIT.png draws them. Without FILE or
            images, the first half second of the first one is the untouched gel.
        model: Folder of the touch model that reads presses and pushes.
    """
    from palpate.pipeline.figures import draw, push_figure
    from palpate.pipeline.push_calibration import first_images, learn_from_pushes, read_push
    from palpate.touch.background import background_of, is_moved
    from palpate.touch.calibration import write_calibration
    from palpate.touch.cells import is_grey
    from palpate.touch.pipeline import GREY
    from palpate.touch.press_calibration import learn_from_presses, read_presses, with_ruler
    from palpate.touch.touch_model import shipped_model
    from palpate.types.images import camera_view, fitted, read_image
    from palpate.types.sensor import known_sensor

    if (file and untouched) or not (file or untouched or pushes):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --ruler or --presses")
    if out.suffix.lower() != ".npz":
        raise SettingError(f"{out}: extension {out.suffix!r} is of no calibration, allowed is .npz")
    for each in (out, *([out.with_suffix(".png")] if pushes else [])):
        new_file(each, force)
    pushed = [palpate.load_recording(each, orientation) for each in pushes]
    recorded = [palpate.load_recording(file, orientation)] if file else pushed
    if len(names := sorted({each.sensor.name for each in (*recorded, *pushed)})) > 1:
        raise SettingError(f"calibrate: the recordings are of several sensors, {', '.join(names)}; allowed is one")
    profile = recorded[0].sensor if recorded else known_sensor(sensor)
    size, view = (profile.image_height, profile.image_width), camera_view(orientation)

    def look(path: Path) -> Any:
        with in_file(path):
            if is_grey(image := fitted(read_image(path), size, view)) and presses and model is None:
                raise FileError(GREY)
            return image

    still = [look(each) for each in untouched] or list(first_images(recorded[0]))
    for path, image in zip(untouched or repeat(file or pushes[0]), still, strict=False):
        if is_moved(image, still[0]):
            raise FileError(f"{path}: shows a touch, or another gel than the first image")
    reader: Any = palpate.TouchModel(model) if model else (presses or pushes) and shipped_model(profile.name)
    numbers: dict[str, Any] = {"file": file and str(file), "out": str(out), "untouched": len(still)}
    with in_file(file or (*untouched, *pushes)[0]):
        calibration = palpate.Calibration(background_of(still))
    if ruler:
        length = numbers_of([ruler[0][:-2]]) if len(ruler) == 2 and ruler[0].endswith("mm") else None
        if not (length and length[0] > 0.0):
            raise SettingError(f"--ruler: found {' '.join(ruler)!r}; expected words such as 8mm caliper.png")
        with in_file(ruler[1]):
            calibration = with_ruler(calibration, look(Path(ruler[1])), 1e-3 * length[0], profile)
    if presses:
        pressed = read_presses(presses, look, profile)
        with in_file(presses):
            calibration, scatter = learn_from_presses(pressed, calibration, profile, reader)
        numbers |= {"presses": len(pressed.images), "keeps_left_and_right": calibration.view.keeps_left_and_right}
        numbers["scatter_deg"] = degrees(scatter)
    notes = [] if presses is None else ["Presses find left and right only; up and down may be wrong."]
    if pushed:
        with progress_bar(f"fitting {len(pushed)} pushes"):
            learnt = learn_from_pushes([read_push(each, reader, calibration) for each in pushed], calibration)
        calibration, about = learnt.calibration, learnt.about()
        numbers |= {"pushes": len(pushed), "misfit": learnt.misfit, "robot": about}
        unknown = [name for name, row in about.items() if row["sigma"] > 0.9 * row["sigma_before"]]
        notes += [f"These pushes do not show: {', '.join(unknown)}."] if unknown else []
        draw(out.with_suffix(".png"), lambda file: push_figure(learnt).savefig(file, format="png", dpi=120))
    write_calibration(calibration, out, overwrite=force)
    if presses and not calibration.view.keeps_left_and_right:
        notes += ["Left and right are exchanged, as with wrong signs or order of presses: positive is towards +y."]
    return Report("calibration", numbers | about_calibration(calibration), notes=notes)
