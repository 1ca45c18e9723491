"""`palpate info`, `convert` and `calibrate`: contents of files, conversion, and calibration of a sensor unit."""

import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import repeat
from math import degrees, hypot
from pathlib import Path
from typing import Annotated, Any

import palpate
from palpate.cli.console import Report, progress_bar
from palpate.cli.new_sensor import first_guess, with_scale_of
from palpate.cli.options import Bag, Force, Marker, Orientation, Sensor, arg
from palpate.cli.sources import Source
from palpate.errors import FileError, SettingError, kept_warnings
from palpate.files import in_file, new_file, numbers_of, read_json
from palpate.hints import own_command
from palpate.types.choices import DEFAULT_SENSOR, TableChoices, TrackerChoices

NEEDED = "--shape NAME|AxB|FILE --first-pose X Y THETA"
"""Options of `palpate track` that no bag holds."""


def info(
    file: Annotated[Path, arg("FILE")], /, *, sensor: Sensor = DEFAULT_SENSOR, orientation: Orientation = ""
) -> Report:
    """Show what a recording (rates, gaps, contacts, truth), bag, calibration, model, sensor or run is, and its faults.

    Of a folder of images it shows how to convert it.

    Example: palpate info push.mcap

    Args:
        file: A recording in any known format, a bag, a calibration, the folder of a run, of images or of a touch model,
            the name of a sensor, or its profile (.toml).
    """
    from palpate.geometry.shapes import shape_to_dict
    from palpate.io import detect_format
    from palpate.io.image_folder import about_folder, image_files
    from palpate.io.lerobot import about_dataset, is_lerobot
    from palpate.io.rosbag_reader import is_bag
    from palpate.pipeline.check_recording import check_recording
    from palpate.pipeline.report import run_lines

    known = _about_model(file) or _about_sensor(file)
    if known:
        return Report(file.name, {"file": str(file), **known})
    summary = file / "summary.json"
    if summary.exists():
        found = read_json(summary)
        lines = run_lines(str(file), found, file) if "tactile" in found else ()
        return Report(file.name, {"file": str(file), "format": "run", **found}, lines=lines)
    if is_lerobot(file):
        return Report(file.name, {"file": str(file), **about_dataset(file)})
    if file.is_dir() and not is_bag(file) and image_files(file):
        return Report(file.name, {"file": str(file), **about_folder(file)})
    kind = detect_format(file)
    with progress_bar(f"inspecting {file.name}"):
        if kind is None and file.suffix.lower() == ".npz":
            about = {"format": "calibration", **about_calibration(palpate.load_calibration(file))}
        elif kind == "bag":
            about = {"format": "bag", **_about_bag(file, sensor, orientation)}
        else:
            recording = palpate.load_recording(file, orientation)
            about = {"format": kind, "source": recording.source, "sensor": recording.sensor.name}
            if recording.hand is not None:
                about["mounts"] = {name: list(mount) for name, mount in recording.hand.mounts.items()}
            about |= {
                "shape": shape_to_dict(recording.shape) if recording.is_shape_known else "unknown",
                **check_recording(recording),
            }
    return Report(file.name, {"file": str(file), **about})


def _about_model(folder: Path) -> dict[str, Any] | None:
    """Return a touch model in a folder as plain data; None if there is none."""
    if not (folder / "model.json").exists():
        return None
    model = palpate.TouchModel(folder)
    settings = model.settings
    return {
        "format": "touch model",
        "sensor": settings.sensor,
        "image_height": settings.image_height,
        "image_width": settings.image_width,
        "measures": list(settings.spread),
        "hash": model.hash,
        "comes_with_palpate": model.is_shipped,
    }


def _about_sensor(path: Path) -> dict[str, Any] | None:
    """Return a sensor profile by its name or file as plain data, with its touch model; None for anything else."""
    from palpate.touch.touch_model import SHIPPED_OF
    from palpate.types.sensor import ALIASES, SENSORS
    from palpate.types.sensor_file import known_sensor

    is_name = not path.exists() and str(path).lower() in (*SENSORS, *ALIASES)
    if not is_name and path.suffix.lower() != ".toml":
        return None
    sensor = known_sensor(str(path))
    model = SHIPPED_OF.get(sensor.name)
    return {"format": "sensor", **asdict(sensor), "touch_model": model.name if model else "none of its own"}


def convert(
    files: Annotated[tuple[Path, ...], arg("[IN ...] OUT", "required")],
    /,
    *,
    episode: Annotated[int, arg("N")] = 0,
    lerobot: bool = False,
    force: Force = False,
    bag: Bag = Bag(),
    tables: TableChoices = TableChoices(),
) -> Report:
    """Convert a bag, a recording of another format, or a folder of images with a table of poses to a recording.

    Example: palpate convert robot.bag push.mcap --shape 0.09x0.06

    Example: palpate convert --images DIR --image-times t.csv --poses ee.csv --shape 0.09x0.06 push.mcap

    Args:
        files: A recording in any known format, a bag, a dataset of LeRobot, or none if there is --poses; and the file
            to write, .mcap.
        episode: Episode of a dataset of LeRobot.
        lerobot: Write recordings as the episodes of a dataset of LeRobot, a folder.
    """
    sources, target = _sources_and_target(files, bag, tables, lerobot)
    if lerobot:
        return _convert_to_lerobot(sources, target, force, bag)
    source = sources[0]
    if target.suffix.lower() != ".mcap":
        raise SettingError(f"{target}: extension {target.suffix!r} is of no format to write, allowed is .mcap")
    new_file(target, force)
    about: dict[str, Any] = {"in": str(source), "out": str(target)}
    recording = Source(bag, tables, episode).read(source).recording
    palpate.write_recording(recording, target, overwrite=force)
    if source.is_dir() and recording.source:
        about["source"] = recording.source
    return Report(target.name, {**about, "frames": len(recording)})


def _sources_and_target(
    files: Sequence[Path], bag: Bag, tables: TableChoices, are_several: bool
) -> tuple[Sequence[Path], Path]:
    """Return the paths to convert, which may be the folder of --images, and that to write. Raises SettingError."""
    if len(files) == 2 or (len(files) > 2 and are_several):
        return files[:-1], files[-1]
    if len(files) == 1 and tables.poses is not None and bag.choices.images is not None and not are_several:
        return [Path(bag.choices.images)], files[0]
    words = " ".join(map(str, files)) or "no file"
    raise SettingError(f"convert: found {words}; expected IN OUT or, of a folder, --images DIR --poses TABLE and OUT")


def _convert_to_lerobot(sources: Sequence[Path], target: Path, force: bool, bag: Bag) -> Report:
    """Write recordings as a dataset of LeRobot."""
    from palpate.io.lerobot_writer import write_lerobot

    recordings = [bag.read(source).recording for source in sources]
    with progress_bar(f"writing {target.name}", len(recordings)) as bar:
        write_lerobot(recordings, target, force, bar)
    frames = sum(map(len, recordings))
    return Report(target.name, {"in": [*map(str, sources)], "out": str(target), "frames": frames})


def about_calibration(calibration: "palpate.Calibration") -> dict[str, Any]:
    """Return a calibration as plain data; noise is that of cells of an untouched image over time [grey levels]."""
    import numpy as np

    from palpate.touch.markers import find_markers

    gel = calibration.background
    markers = find_markers(gel.mean)
    direction = calibration.direction
    pitch = calibration.pixel_pitch
    height, width = gel.mean.shape[:2]
    set_up = asdict(calibration.set_up) if calibration.set_up else {}
    return {
        "height": height,
        "width": width,
        "noise_levels": float(np.median(gel.noise)) if gel.noise.any() else None,  # a single image has none
        "markers_share": markers.share if markers else 0.0,
        "view": str(calibration.view),
        "is_view_measured": calibration.is_view_known,
        "place_offset_mm": 1e3 * calibration.place_offset,
        "place_offset_sigma_mm": 1e3 * calibration.place_offset_sigma if calibration.place_offset_sigma else None,
        "place_spread": calibration.place_spread,
        "pixel_pitch_mm": 1e3 * pitch if pitch else None,
        "pixel_pitch_sigma_mm": 1e3 * pitch * calibration.pixel_pitch_sigma if pitch else None,
        "offset_deg": degrees(direction.offset),
        "offset_sigma_deg": degrees(direction.offset_sigma) if direction.offset_sigma is not None else None,
        "scale": direction.scale,
        "scale_sigma": direction.scale_sigma,
        **{name: list(value) for name, value in set_up.items()},
    }


def _about_bag(path: Path, sensor: str, orientation: str) -> dict[str, Any]:
    """Return the topics of a bag, what tracking would read, and the command for it or the reason why there is none."""
    from palpate.io.rosbag_reader import contents
    from palpate.io.rosbag_recording import likely_choices, other_poses, recording_of
    from palpate.pipeline.check_recording import check_recording
    from palpate.types.sensor_file import known_sensor

    with kept_warnings() as warnings:
        bag = contents(path)
    choices = likely_choices(bag, palpate.BagChoices(orientation=orientation))
    about: dict[str, Any] = {"topics": [channel._asdict() | stream.about() for channel, stream in bag.topics.items()]}
    if bag.transforms:  # without, a line "frames none" would read as if the bag had no images
        about["frames"] = {child: " or ".join(stream.frames) for child, stream in bag.transforms.items()}
    options = _options_of(bag, sensor, choices)
    profile = known_sensor(sensor)
    try:
        with kept_warnings() as more:
            recording = recording_of(bag, palpate.Disc(0.05), choices, profile).recording.warned(warnings)
        recording = recording.warned(more)
    except FileError as error:
        begin = f"with {' '.join(options)}: " if options else ""
        return about | {"advice": f"{begin}{error}{'' if choices.images else _hand_advice(bag)}"}
    findings = check_recording(recording)["findings"]
    damaged = sum(finding["kind"] == "image" for finding in findings)
    others = other_poses(bag, choices.sensor_poses)
    return about | {
        "source": recording.source,
        "damaged_images": damaged,
        "findings": findings,
        "advice": " ".join([own_command(), "track", shlex.quote(str(bag.path)), *options, NEEDED]),
        "other_poses": f"{', '.join(others)}; --object-poses names ground truth" if others else None,
    }


def _options_of(bag: Any, sensor: str, choices: "palpate.BagChoices") -> list[str]:
    """Return the options by which a bag is read, but for those that are the defaults."""
    from palpate.io.ros_messages import IMAGE_TYPES
    from palpate.io.rosbag_recording import other_poses

    others = other_poses(bag, choices.sensor_poses)
    words: list[str] = []
    if choices.images and len(bag.of(IMAGE_TYPES)) > 1:
        words += ["--images", shlex.quote(choices.images)]
    if choices.sensor_poses and others:
        words += ["--sensor-poses", shlex.quote(choices.sensor_poses)]
    if sensor != DEFAULT_SENSOR:
        words += ["--sensor", shlex.quote(sensor)]
    if choices.orientation:
        words += ["--orientation", choices.orientation]
    return words


def _hand_advice(bag: Any) -> str:
    """Return the command for a bag of a hand, if it has images of several topics; else ""."""
    from palpate.io.ros_messages import IMAGE_TYPES

    topics = [*bag.of(IMAGE_TYPES)]
    if len(topics) < 2:
        return ""
    pairs = ",".join(f"{name}={topic}" for name, topic in zip(finger_names(topics), topics, strict=True))
    mounts = " ".join(f"{name}=X,Y,YAW" for name in finger_names(topics))
    command = f"{own_command()} track {shlex.quote(str(bag.path))} --images {pairs} --mounts {mounts}"
    return f"; or, if they are of the fingers of a hand: {command} {NEEDED}"


def finger_names(topics: Sequence[str]) -> list[str]:
    """Return names of fingers for topics: the first part of each that differs, or finger_1 and so on."""
    for parts in zip(*(topic.strip("/").split("/") for topic in topics), strict=False):
        names = [part for part in parts if part.isidentifier() and part.isascii()]
        if len(set(names)) == len(topics):
            return names
    return [f"finger_{number}" for number in range(1, len(topics) + 1)]


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
    markers: Marker = TrackerChoices.markers,
    new_sensor: Annotated[Path | None, arg("SENSOR.toml", "none")] = None,
    gel: Annotated[str | None, arg("flat|RADIUS", "none; --new-sensor needs it")] = None,
    force: Force = False,
) -> Report:
    """Calibrate a sensor unit: its untouched gel, by a ruler the scale of its images, by presses or pushes the rest.

    Example: palpate calibrate --presses presses.csv --untouched still.png --out unit.npz

    Args:
        file: A recording with images, whose first half second is untouched.
        out: File of the calibration; of a hand left=LEFT.npz,right=RIGHT.npz, of the untouched gels in its FILE.
        presses: Three or more presses, better five, which also show errors of directions and places: a CSV of images
            (column file) at known contact angles (column angle_deg) or places along the pad's width (column place_mm)
            or, with the column file alone, by hand in order from -y to +y, which finds left and right only.
        untouched: Images of the untouched gel, in place of FILE.
        ruler: Distance, from middle to middle, of two thin edges or balls that are pressed in side by side across the
            image, as 8mm, and the image that shows them.
        pushes: Three or more recordings of one robot, better ten, without ground truth, of several objects and sides.
            They show the errors of mounting, delay, directions and outlines; UNIT.png draws them. Without FILE or
            images, the first half second of the first one is the untouched gel.
        model: Folder of the touch model that reads presses and pushes.
        new_sensor: Write the profile of a sensor that palpate does not know, from --untouched, --ruler and --gel. What
            takes --sensor takes this file.
        gel: Shape of that sensor's gel: flat, or the radius of its dome, as 21mm.
    """
    from palpate.pipeline.push_calibration import first_images
    from palpate.touch.background import background_of
    from palpate.touch.calibration import write_calibration
    from palpate.types.sensor_file import write_sensor

    if "=" in str(out):
        return _calibrate_hand(file, str(out), orientation, bool(untouched or ruler or presses or pushes), force)
    _check_sources(file, untouched, pushes)
    figure = out.with_suffix(".png") if pushes else None
    _check_outputs(out, figure, force)
    pushed = [_of_one_sensor(palpate.load_recording(path, orientation)) for path in pushes]
    recorded = [_of_one_sensor(palpate.load_recording(file, orientation))] if file else pushed
    profile = _sensor_of([*recorded, *pushed], sensor)
    if new_sensor is not None:
        _check_new_sensor(new_sensor, untouched, ruler, presses or pushes, force)
        profile = first_guess(new_sensor.stem, gel, untouched[0], orientation)
    elif gel is not None:
        raise SettingError(f"--gel {gel} is of a new sensor; give --new-sensor SENSOR.toml, too")
    reader = _reader_of(profile, model, presses, pushes)
    look = partial(image_of, profile, orientation, bool(presses) and reader is not None and model is None)
    still = [look(path) for path in untouched] or list(first_images(recorded[0]))
    check_still(still, untouched or repeat(file or pushes[0]))
    numbers: dict[str, Any] = {"file": file and str(file), "out": str(out), "untouched": len(still)}
    notes: list[str] = []
    with in_file(file or (*untouched, *pushes)[0]):
        calibration = palpate.Calibration(background_of(still))
    if ruler:
        calibration = _by_ruler(ruler, look, calibration, profile)
    if new_sensor is not None:
        profile = with_scale_of(calibration, profile)
        write_sensor(profile, new_sensor, overwrite=force)
        notes.append(f"sensor: {new_sensor}, for --sensor; no touch model is of it until --model names one")
    if presses:
        calibration, of_presses = _by_presses(presses, look, calibration, profile, reader, markers == "auto")
        numbers |= of_presses
        notes.append(_certainty_in_words(of_presses, calibration.direction.scale_sigma is not None))
        notes.append("Presses find left and right only; up and down may be wrong.")
    if figure:
        calibration, of_pushes, unknown = _by_pushes(pushed, calibration, reader, figure)
        numbers |= of_pushes
        if unknown:
            notes.append(f"These pushes do not show: {', '.join(unknown)}.")
    write_calibration(calibration, out, overwrite=force)
    if presses and not calibration.view.keeps_left_and_right:
        notes.append("Left and right are exchanged, as with wrong signs or order of presses: positive is towards +y.")
    return Report("calibration", numbers | about_calibration(calibration), notes=notes)


def _check_sources(file: Path | None, untouched: Sequence[Path], pushes: Sequence[Path]) -> None:
    """Raise SettingError unless there are images of an untouched gel, and of one source."""
    if (file and untouched) or not (file or untouched or pushes):
        raise SettingError("calibrate: give either a recording or --untouched images, also with --ruler or --presses")


def _calibrate_hand(file: Path | None, out: str, orientation: str, has_more: bool, force: bool) -> Report:
    """Write the untouched gel of each finger of a hand into a file of its own. Raises PalpateError, writing none."""
    from palpate.pipeline.push_calibration import first_images
    from palpate.touch.background import background_of
    from palpate.touch.calibration import write_calibration
    from palpate.types.hand import by_finger, check_names

    if file is None or has_more:
        raise SettingError(
            f"--out {out}: is of a hand, which takes a recording alone; untouched images, rulers, presses and pushes "
            "are of one unit: calibrate each finger by itself with them"
        )
    files = {finger: Path(name) for finger, name in by_finger("--out", out).items()}
    for path in files.values():
        _check_outputs(path, None, force)
    recording = palpate.load_recording(file, orientation)
    if recording.hand is None:
        raise SettingError(f"{file}: is of one sensor; allowed is --out UNIT.npz")
    check_names("--out", files, recording.hand.fingers)
    made: dict[str, palpate.Calibration] = {}
    for finger in files:
        still = list(first_images(recording, finger))
        with in_file(file), in_file(f"finger {finger}"):
            check_still(still, repeat(file))
            made[finger] = palpate.Calibration(background_of(still))
    for finger, path in files.items():
        write_calibration(made[finger], path, overwrite=force)
    about = {finger: {"out": str(files[finger]), **about_calibration(each)} for finger, each in made.items()}
    return Report("calibrations", {"file": str(file), "fingers": about})


def _of_one_sensor(recording: "palpate.Recording") -> "palpate.Recording":
    """Return a recording. Raises SettingError if it is of a hand."""
    if recording.hand is not None:
        raise SettingError(f"{recording.file}: is of a hand; of one, allowed is --out left=LEFT.npz,right=RIGHT.npz")
    return recording


def _check_outputs(out: Path, figure: Path | None, force: bool) -> None:
    """Raise PalpateError unless the files of a calibration can be written."""
    if out.suffix.lower() != ".npz":
        raise SettingError(f"{out}: extension {out.suffix!r} is of no calibration, allowed is .npz")
    new_file(out, force)
    if figure:
        new_file(figure, force)


def _check_new_sensor(path: Path, untouched: Sequence[Path], ruler: Sequence[str], others: object, force: bool) -> None:
    """Raise PalpateError unless the profile of a new sensor can be measured and written."""
    if path.suffix.lower() != ".toml":
        raise SettingError(f"{path}: extension {path.suffix!r} is of no sensor profile, allowed is .toml")
    if not untouched or not ruler or others:
        raise SettingError("--new-sensor takes --untouched, --ruler and --gel; presses and pushes are of a known one")
    new_file(path, force)


def _sensor_of(recordings: Sequence["palpate.Recording"], name: str) -> "palpate.SensorProfile":
    """Return the one sensor of recordings or, without any, that of a name. Raises SettingError if there are several."""
    from palpate.types.sensor_file import known_sensor

    if not recordings:
        return known_sensor(name)
    names = sorted({recording.sensor.name for recording in recordings})
    if len(names) > 1:
        raise SettingError(f"calibrate: the recordings are of several sensors, {', '.join(names)}; allowed is one")
    return recordings[0].sensor


def image_of(profile: "palpate.SensorProfile", orientation: str, needs_colours: bool, path: Path) -> Any:
    """Return the image in a file as the profile has it. Raises FileError, also if it lacks the colours it needs."""
    from palpate.touch.cells import is_grey
    from palpate.touch.reader import GREY
    from palpate.types.images import camera_view, fitted, read_image

    size = (profile.image_height, profile.image_width)
    view = camera_view(orientation or profile.orientation)
    with in_file(path):
        image = fitted(read_image(path), size, view)
        if needs_colours and is_grey(image):
            raise FileError(GREY)
        return image


def check_still(images: Sequence[Any], paths: Iterable[Path]) -> None:
    """Raise FileError, which names the path, if an image of the untouched gel differs from the first."""
    from palpate.touch.background import is_moved

    for path, image in zip(paths, images, strict=False):
        if is_moved(image, images[0]):
            raise FileError(f"{path}: shows a touch, or another gel than the first image")


def _by_ruler(
    words: Sequence[str], look: Callable[[Path], Any], calibration: "palpate.Calibration", profile: Any
) -> "palpate.Calibration":
    """Return a calibration with the pixel pitch by a ruler, whose length and image are the words of --ruler."""
    from palpate.touch.press_calibration import with_ruler

    millimetres = numbers_of([words[0][:-2]]) if len(words) == 2 and words[0].endswith("mm") else None
    if not millimetres or millimetres[0] <= 0.0:
        raise SettingError(f"--ruler: found {' '.join(words)!r}; expected words such as 8mm caliper.png")
    with in_file(words[1]):
        return with_ruler(calibration, look(Path(words[1])), 1e-3 * millimetres[0], profile)


def _reader_of(profile: Any, model: Path | None, presses: Path | None, pushes: Sequence[Path]) -> Any:
    """Return the touch model that reads presses and pushes; None where middles of imprints on a flat pad do."""
    from palpate.touch.touch_model import SHIPPED_OF, shipped_model

    if model:
        return palpate.TouchModel(model)
    is_needed = pushes or (presses and not profile.flat_width)
    return shipped_model(profile.name) if is_needed or profile.name in SHIPPED_OF else None


def _by_presses(
    path: Path,
    look: Callable[[Path], Any],
    calibration: "palpate.Calibration",
    profile: Any,
    model: Any,
    seek_markers: bool,
) -> tuple["palpate.Calibration", dict[str, Any]]:
    """Return a calibration by presses in a table, and its numbers for people."""
    from palpate.touch.press_calibration import learn_from_presses, read_presses

    pressed = read_presses(path, look, profile)
    with in_file(path):
        calibration, scatter = learn_from_presses(pressed, calibration, profile, model, seek_markers)
    return calibration, {
        "presses": len(pressed.images),
        "keeps_left_and_right": calibration.view.keeps_left_and_right,
        **({"scatter_deg": degrees(scatter)} if pressed.place is None else {"scatter_mm": 1e3 * scatter}),
        **certainty(calibration, profile),
    }


def certainty(calibration: "palpate.Calibration", profile: "palpate.SensorProfile") -> dict[str, float]:
    """Return the standard deviation that a calibration by presses leaves, half-way from the middle to the side."""
    half_way = 0.25 * (calibration.pixel_pitch or profile.pixel_pitch or 0.0) * profile.image_width  # [m]
    direction = calibration.direction
    if calibration.place_offset_sigma is not None:
        sigma = hypot(calibration.place_offset_sigma, half_way * calibration.pixel_pitch_sigma)
        return {"calibrated_to_mm": 1e3 * sigma}
    if direction.offset_sigma is None or direction.scale_sigma is None:
        return {}
    angle = half_way / max(profile.radius, half_way)
    return {"calibrated_to_deg": degrees(hypot(direction.offset_sigma, direction.scale_sigma * angle))}


def _certainty_in_words(numbers: dict[str, Any], is_scale_known: bool) -> str:
    """Return words on a calibration by presses; `is_scale_known` if they told the scale of directions, too."""
    count = numbers["presses"]
    if "calibrated_to_mm" in numbers:
        known = f"places to {numbers['calibrated_to_mm']:.2f} mm (1 sigma)"
    elif "calibrated_to_deg" in numbers:
        known = f"directions to {numbers['calibrated_to_deg']:.1f} degrees (1 sigma)"
    elif is_scale_known:  # by places on a round gel
        return f"After {count} presses the view and the scale of directions are known; angles would tell their offset."
    else:
        return f"After {count} presses the view is known; places or angles would tell errors of directions, too."
    return f"After {count} presses, half-way to the side, {known} but for the noise of an image."


def _by_pushes(
    recordings: Sequence["palpate.Recording"], calibration: "palpate.Calibration", model: Any, figure: Path
) -> tuple["palpate.Calibration", dict[str, Any], list[str]]:
    """Return a calibration by pushes, its numbers for people, and the names of those that pushes do not show.

    Writes a figure of them.
    """
    from palpate.pipeline.figures import draw
    from palpate.pipeline.push_calibration import learn_from_pushes, read_push
    from palpate.pipeline.push_figure import push_figure

    with progress_bar(f"fitting {len(recordings)} pushes"):
        fit = learn_from_pushes([read_push(recording, model, calibration) for recording in recordings], calibration)
    about = fit.about()
    unknown = [name for name, row in about.items() if row["sigma"] > 0.9 * row["sigma_before"]]
    draw(figure, lambda file: push_figure(fit).savefig(file, format="png", dpi=120))
    return fit.calibration, {"pushes": len(recordings), "misfit": fit.misfit, "robot": about}, unknown
