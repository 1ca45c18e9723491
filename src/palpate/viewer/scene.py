"""A recording and, where it was tracked, its estimates, as views show them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import read_json
from palpate.io import load_recording
from palpate.io.trajectories import read_estimates_csv
from palpate.pipeline.first_release import first_release
from palpate.pipeline.run_folder import read_answers
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, load_calibration, turned_as
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.touch_model import difference_in_light, reduced
from palpate.types.estimate import Estimate, Status
from palpate.types.recording import Recording

Image = NDArray[np.uint8]

# Okabe and Ito's palette, which people with any colour vision can tell apart.
COLOURS = {
    "truth": "#8C8C8C",
    "estimate": "#0E86CC",
    "sensor": "#D55E00",
    "contact": "#E69F00",
    "others": "#CC79A7",
}
STATUS_COLOURS: dict[Status, str] = {
    "tracking": "#009E73",
    "resting": "#A6B8C2",
    "ambiguous": "#E69F00",
    "strained": "#D55E00",
    "uncertain": "#F0E442",
    "displaced": "#CC79A7",
    "indeterminate": "#7F3FBF",
    "faulty": "#B00020",
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A recording of N frames and its estimates."""

    name: str
    """Name for people."""
    recording: Recording
    estimates: Sequence[Estimate] = ()
    """Estimate at each frame, with its answers where there are several; none for a recording that was not tracked."""
    calibration: Calibration | None = None
    """Calibration of the sensor unit."""


def load_scene(path: Path) -> Scene:
    """Read the folder of a run, or a recording of any known format; raises FileError."""
    if not path.is_dir():
        return Scene(path.name, load_recording(path))
    if not (path / "settings.json").exists():
        raise FileError(f"{path}: is no run of palpate track: there is no settings.json in it")
    settings = read_json(path / "settings.json")
    if not isinstance(file := settings.get("recording"), str):
        raise FileError(f"{path / 'settings.json'}: recording is {file!r}, expected the name of a file")
    recording = load_recording(path / file)
    online = read_estimates_csv(path / "estimates.csv")
    if online.covariance is None or online.contact is None or online.status is None:
        raise FileError(f"{path / 'estimates.csv'}: lacks covariance, contact or status, which palpate track writes")
    if not np.array_equal(online.time, recording.time):
        raise FileError(
            f"{path}: its {len(online)} estimates are not of the {len(recording)} frames of {recording.file}, "
            "which is another recording now; track it again"
        )
    answers = read_answers(path / "answers.csv", online.time)
    columns = online.time, online.pose, online.covariance, online.contact, online.status
    estimates = tuple(map(Estimate, *columns, online.reason or repeat(""), answers))
    calibration = None
    if unit := settings.get("calibration"):
        calibration = load_calibration(str(unit))
    elif "untouched_from_s" in read_json(path / "summary.json"):  # it began in contact
        release = first_release(recording)
        calibration = release and release.calibration
    return Scene(path.resolve().name, recording, estimates, calibration)


def touch_images(recording: Recording, calibration: Calibration | None) -> Iterator[tuple[Image, Image | None]]:
    """Yield each touch image, turned as the profile's are, and its difference from the untouched gel.

    The difference is taken as tracking takes it, from the gel before the contact; it is None while that is unknown.
    """
    detector = ContactDetector(turned_as(recording.sensor, calibration), calibration)
    untouched = detector.background
    for index in range(len(recording)):
        try:
            frame = recording[index]
        except FileError:  # a damaged image
            yield np.zeros((recording.sensor.image_height, recording.sensor.image_width, 3), np.uint8), None
            continue
        assert frame.image is not None
        image = detector.read(frame.image)
        if not detector.update(image):
            untouched = detector.background
        yield image, None if untouched is None else difference_image(image, untouched)


def difference_image(image: Image, untouched: Background) -> Image:
    """Return the touch model's input as an image of the same size: 128 is untouched, 80 levels are a change by 1."""
    import cv2

    levels = 128.0 + 80.0 * difference_in_light(image, reduced(untouched.mean))
    levels = np.clip(levels, 0.0, 255.0).astype(np.uint8)
    return np.asarray(cv2.resize(levels, image.shape[1::-1], interpolation=cv2.INTER_NEAREST), np.uint8)


def jpeg(image: Image, width: int | None = None) -> bytes:
    """Return an RGB image as JPEG, reduced to a width [px] if one is given."""
    import cv2

    if width is not None and width < image.shape[1]:
        size = (width, round(image.shape[0] * width / image.shape[1]))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return data.tobytes()
