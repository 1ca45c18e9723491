"""Calibration of one sensor unit: untouched gel, camera view and errors of directions, and its file (`.npz`)."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FLAGS, INTEGERS, NUMBERS, checked_array
from palpate.errors import FileError, SettingError
from palpate.files import existing_file, read_arrays, whole_file
from palpate.touch.background import Background, Image, background_of
from palpate.touch.camera_view import AS_IT_IS, CameraView
from palpate.touch.cells import Levels
from palpate.touch.contact_detector import START, ContactDetector
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

VERSION = 4
NEEDED = 30
"""Frames without contact that a calibration needs: from one second a deviation is known to 13 %."""
MARGIN = 2
"""Frames beside a contact that are left out, as in the paper: flags may be late, and gel takes its time."""


@dataclass(frozen=True)
class DirectionCorrection:
    """Linear error of a unit's contact directions: measured = offset + scale true.

    An image shows the motion of the surface whatever caused it, so turns have the same scale.
    """

    offset: float = 0.0
    """[rad]"""
    scale: float = 1.0
    """Measured change of angle for a true one of 1."""
    offset_sigma: float | None = None
    """Standard deviation of the offset [rad]; None if it was not measured."""
    scale_sigma: float | None = None
    """Standard deviation of the scale; None likewise."""

    def true(self, measured: float) -> float:
        """Return the true angle [rad] of a measured one."""
        return self.turn(measured - self.offset)

    def turn(self, measured: Any) -> Any:
        """Return the true turns (...) [rad] of measured ones."""
        return measured / self.scale

    def variance(self, measured: Any) -> Any:
        """Return the variances (...) [rad^2] of true angles or turns from those of measured ones."""
        return measured / self.scale**2

    def measured(self, true: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the measured angles (N,) [rad] of true ones."""
        return self.offset + self.scale * true


UNCORRECTED = DirectionCorrection()


@dataclass(frozen=True, eq=False)
class Calibration:
    """Properties of one sensor unit."""

    background: Background
    """The untouched gel, in the profile's view."""
    view: CameraView = AS_IT_IS
    """Steps that turn the camera's images into the profile's."""
    direction: DirectionCorrection = UNCORRECTED
    """Errors of the contact directions."""
    is_view_known: bool = False
    """Presses have shown how images lie; otherwise only their size is known."""
    file: Path | None = None
    """Its file, if it was read from one."""
    is_sure: bool = False
    """It comes from the stream that it is used for. Others are doubted until an image looks like the untouched gel."""

    @property
    def hash(self) -> str:
        """Hash of its content."""
        gel = self.background
        digest = hashlib.sha256(repr((gel.mean.shape, self.view, self.direction, self.is_view_known)).encode())
        for levels in (gel.mean, gel.deviation, gel.noise):
            digest.update(levels.tobytes())
        return digest.hexdigest()


def view_of(calibration: Calibration | None) -> CameraView:
    """Return a calibration's camera view; without one, images stay as they are."""
    return calibration.view if calibration else AS_IT_IS


def correction_of(calibration: Calibration | None) -> DirectionCorrection:
    """Return a calibration's correction of directions; without one, none."""
    return calibration.direction if calibration else UNCORRECTED


def turned_as(sensor: SensorProfile, calibration: Calibration | None) -> SensorProfile:
    """Return the sensor with the size of its images before the calibration's rotation."""
    if view_of(calibration).quarter_turns % 2 == 0:
        return sensor
    return replace(sensor, image_height=sensor.image_width, image_width=sensor.image_height)


def misfit(calibration: Calibration, sensor: SensorProfile) -> str:
    """Return a sentence if a calibration has images of another size than the sensor's; otherwise ""."""
    expected, found = (sensor.image_height, sensor.image_width), calibration.background.mean.shape[:2]
    if found == expected or not sensor.image_height:
        return ""
    turns = calibration.view.quarter_turns
    name = calibration.file or "the calibration"
    turned = f", turned by {90 * turns} degrees as it says," if turns % 2 else ""
    return (
        f"{name}: is of images of {found[0]} x {found[1]} px; those of sensor {sensor.name!r}{turned} "
        f"have {expected[0]} x {expected[1]}"
    )


def detector_for(sensor: SensorProfile, calibration: Calibration | None = None) -> ContactDetector:
    """Return the contact detector of a sensor, for images in the profile's view.

    Raises SettingError if the calibration has images of another size.
    """
    size = (sensor.image_height, sensor.image_width) if sensor.image_height else None
    if calibration is None:
        return ContactDetector(None, size, sensor.rate)
    if wrong := misfit(calibration, sensor):
        raise SettingError(wrong)
    doubted = "" if calibration.is_sure else str(calibration.file or "the calibration")
    return ContactDetector(calibration.background, size, sensor.rate, doubted)


def calibrate(recording: Recording, progress: Callable[[int], None] | None = None) -> tuple[Background, int]:
    """Return the background of a recording's frames without contact, and their number.

    Contact flags select them; without flags it is all frames. `progress` is called with the number of frames done.
    Raises FileError without images, with fewer than NEEDED such frames, or if a touch that begins or ends shows.
    """
    return background_of(untouched_images(recording, progress)), len(untouched_frames(recording))


def untouched_frames(recording: Recording) -> NDArray[np.int64]:
    """Return the indices of the frames more than MARGIN frames away from a contact."""
    if recording.contact is None:
        return np.arange(len(recording))
    near = np.convolve(recording.contact, np.ones(2 * MARGIN + 1))[MARGIN:-MARGIN]  # contacts within the margin
    return np.flatnonzero(near < 0.5)


def untouched_images(recording: Recording, progress: Callable[[int], None] | None = None) -> Iterator[Image]:
    """Yield the images of a recording's frames without contact; see `calibrate`."""
    name = recording.file or "recording"
    if recording.image is None:
        raise FileError(f"{name}: has no images, a calibration needs touch images")
    frames = untouched_frames(recording)
    if len(frames) < NEEDED:
        found = f"found {len(frames)} frames more than {MARGIN} away from a contact"
        raise FileError(f"{name}: {found}, a calibration needs {NEEDED}")
    detector = detector_for(recording.sensor)
    for done, index in enumerate(frames.tolist(), 1):
        image = recording[index].image
        assert image is not None
        if detector.update(detector.read(image)):
            raise FileError(
                f"{name}: frame {index} is off the first ones in {detector.share:.1%} of its values, as if touched; "
                f"allowed is {START:.0%}: calibrate on frames without contact"
            )
        yield image
        if progress is not None:
            progress(done)


def write_calibration(calibration: Calibration, path: Path | str, overwrite: bool = False) -> None:
    """Write the `.npz`, whole or not at all."""
    view, direction, gel = calibration.view, calibration.direction, calibration.background
    sigmas = [np.nan if sigma is None else sigma for sigma in (direction.offset_sigma, direction.scale_sigma)]
    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            version=VERSION,
            mean=gel.mean,
            deviation=gel.deviation,
            noise=gel.noise,
            view=[view.quarter_turns, view.mirrored, *view.channels],
            view_known=calibration.is_view_known,
            direction=[direction.offset, direction.scale, *sigmas],
        )


def load_calibration(path: Path | str) -> Calibration:
    """Read a file of `write_calibration` without running code; raises FileError on anything else."""
    path = existing_file(path)
    arrays = read_arrays(path)
    try:
        version = int(checked_array("version", arrays["version"], INTEGERS, ()))
        if version != VERSION:
            raise FileError(f"version: found {version}, expected {VERSION}; calibrate the unit anew")
        mean = _levels("mean", arrays["mean"], ("N", "N", 3))
        background = Background(mean, _levels("deviation", arrays["deviation"], mean.shape))
        background = replace(background, noise=_levels("noise", arrays["noise"], background.noise.shape))
        view, direction = _view(arrays["view"]), _direction(arrays["direction"])
        is_view_known = bool(checked_array("view_known", arrays["view_known"], FLAGS, ()))
    except KeyError as error:
        raise FileError(f"{path}: is no calibration of palpate calibrate, {error} is missing") from error
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    return Calibration(background, view, direction, is_view_known, path)


def _levels(name: str, value: NDArray[Any], shape: tuple[int | str, ...]) -> Levels:
    levels = checked_array(name, value, NUMBERS, shape)
    if levels.dtype != np.float32:
        raise FileError(f"{name}: found values of type {levels.dtype}, expected float32")
    if not levels.size or not ((levels >= 0.0) & (levels <= 255.0)).all():
        raise FileError(f"{name}: found no values, or some that are not grey levels from 0 to 255")
    return levels


def _view(value: NDArray[Any]) -> CameraView:
    turns, mirrored, *channels = checked_array("view", value, NUMBERS, (5,)).tolist()
    if turns not in range(4) or mirrored not in (0, 1) or sorted(channels) != [0, 1, 2]:
        raise FileError(f"view: found {value.tolist()}, expected quarter turns 0 to 3, 0 or 1, and channels 0, 1, 2")
    red, green, blue = (int(channel) for channel in channels)
    return CameraView(int(turns), bool(mirrored), (red, green, blue))


def _direction(value: NDArray[Any]) -> DirectionCorrection:
    offset, scale, *sigmas = checked_array("direction", value, NUMBERS, (4,)).astype(float).tolist()
    if not (np.isfinite(offset) and 0.0 < scale < np.inf and not any(sigma <= 0.0 for sigma in sigmas)):
        raise FileError(f"direction: found {value.tolist()}, expected an offset, a scale above 0 and sigmas above 0")
    return DirectionCorrection(offset, scale, *(None if np.isnan(sigma) else sigma for sigma in sigmas))
