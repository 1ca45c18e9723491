"""What is known of one sensor unit, and its file (`.npz`), which `palpate calibrate` writes."""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.archives import read_arrays
from palpate.errors import FileError
from palpate.files import FLAGS, INTEGERS, NUMBERS, checked_array, existing_file, whole_file
from palpate.touch.background import Background
from palpate.touch.light import Levels
from palpate.touch.view import AS_IT_IS, CameraView
from palpate.types.sensor import SensorProfile

VERSION = 4
"""The first had mean and deviation only, the second no sigma of the scale, the third did not say whether the view is
known; noise may be missing."""
_FIELDS = ("mean", "deviation")


@dataclass(frozen=True)
class DirectionCorrection:
    """How the contact directions that a model tells of a unit differ from the true ones: told = offset + scale true.

    An image shows by how much it moved what touches the gel, whatever turned it: so turns have the same scale.
    """

    offset: float = 0.0
    """[rad]"""
    scale: float = 1.0
    """Told change of angle for a true one of 1."""
    offset_sigma: float | None = None
    """Standard deviation of the offset [rad]; None where it was not measured."""
    scale_sigma: float | None = None
    """Standard deviation of the scale; None likewise."""

    def true(self, told: float) -> float:
        """Return the angle [rad] that is meant by a told one."""
        return self.turn(told - self.offset)

    def turn(self, told: Any) -> Any:
        """Return the turns (...) [rad] that are meant by told ones."""
        return told / self.scale

    def variance(self, told: Any) -> Any:
        """Return the variances (...) [rad^2] of true angles or turns from those of told ones."""
        return told / self.scale**2

    def told(self, true: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is told of true angles (N,) [rad]."""
        return self.offset + self.scale * true


AS_TOLD = DirectionCorrection()
"""Directions are what the model tells."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of one sensor unit."""

    background: Background
    """The untouched gel, in the view of the profile."""
    view: CameraView = AS_IT_IS
    """What makes the camera's images those of the profile."""
    direction: DirectionCorrection = AS_TOLD
    """What is off in the directions that touch tells."""
    is_view_known: bool = False
    """Whether presses have shown how images lie, or all that is known is that they are as large as the profile's."""
    file: Path | None = None
    """What it was read from, if from a file."""
    is_sure: bool = False
    """Whether it is of the very stream that it is used for, as what was seen in the same recording is; others are
    doubted until an image looks like the untouched gel."""

    @property
    def hash(self) -> str:
        """What tells it from others, wherever its file is."""
        gel = self.background
        digest = hashlib.sha256(repr((gel.mean.shape, self.view, self.direction, self.is_view_known)).encode())
        for levels in (gel.mean, gel.deviation, gel.noise):
            digest.update(levels.tobytes())
        return digest.hexdigest()


def view_of(calibration: Calibration | None) -> CameraView:
    """Return what a calibration does to a camera's images; nothing without one."""
    return calibration.view if calibration else AS_IT_IS


def correction_of(calibration: Calibration | None) -> DirectionCorrection:
    """Return what a calibration corrects of the directions that touch tells; nothing without one."""
    return calibration.direction if calibration else AS_TOLD


def turned_as(sensor: SensorProfile, calibration: Calibration | None) -> SensorProfile:
    """Return the sensor with images as they lie once they were turned as the calibration says."""
    if view_of(calibration).quarter_turns % 2 == 0:
        return sensor
    return replace(sensor, image_height=sensor.image_width, image_width=sensor.image_height)


def misfit(calibration: Calibration, sensor: SensorProfile) -> str:
    """Return in words that a calibration is of images of another size than a sensor's, which lie as it says.

    Nothing where it is not, and of a sensor without images.
    """
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


def write_calibration(calibration: Calibration, path: Path | str, overwrite: bool = False) -> None:
    """Write the `.npz`, whole or not at all; an existing one is replaced only if `overwrite`."""
    view, direction = calibration.view, calibration.direction
    sigmas = [np.nan if sigma is None else sigma for sigma in (direction.offset_sigma, direction.scale_sigma)]
    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            version=VERSION,
            mean=calibration.background.mean,
            deviation=calibration.background.deviation,
            noise=calibration.background.noise,
            view=[view.quarter_turns, view.mirrored, *view.channels],
            view_known=calibration.is_view_known,
            direction=[direction.offset, direction.scale, *sigmas],
        )


def load_calibration(path: Path | str) -> Calibration:
    """Read a file of `write_calibration`, which runs no code. Raises FileError, in one sentence, on anything else."""
    path = existing_file(path)
    arrays = read_arrays(path)
    try:
        version = int(checked_array("version", arrays["version"], INTEGERS, ())) if "version" in arrays else 1
        if version > VERSION:
            raise FileError(f"version: found {version}, this palpate reads up to {VERSION}")
        if missing := [name for name in _FIELDS if name not in arrays]:
            raise FileError(f"is not a calibration: {' and '.join(missing)} missing; expected mean and deviation")
        mean, deviation = (_levels(name, arrays[name]) for name in _FIELDS)
        if mean.shape != deviation.shape:
            raise FileError(f"deviation: found shape {deviation.shape}, expected {mean.shape} as of mean")
        background = Background(mean, deviation)
        if "noise" in arrays:
            background = replace(background, noise=_levels("noise", arrays["noise"], background.noise.shape))
        view = _view(arrays["view"]) if version > 1 else AS_IT_IS
        direction = _direction(arrays["direction"], count=min(version, 3) + 1) if version > 1 else AS_TOLD
        is_view_known = direction.offset_sigma is not None
        if version > 3:
            is_view_known = bool(checked_array("view_known", arrays["view_known"], FLAGS, ()))
    except KeyError as error:
        raise FileError(f"{path}: is a calibration that lacks {error}") from error
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    return Calibration(background, view, direction, is_view_known, path)


def _levels(name: str, value: NDArray[Any], shape: tuple[int | str, ...] = ("N", "N", 3)) -> Levels:
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


def _direction(value: NDArray[Any], count: int) -> DirectionCorrection:
    offset, scale, *sigmas = checked_array("direction", value, NUMBERS, (count,)).astype(float).tolist()
    if not (np.isfinite(offset) and 0.0 < scale < np.inf and not any(sigma <= 0.0 for sigma in sigmas)):
        raise FileError(f"direction: found {value.tolist()}, expected an offset, a scale above 0 and sigmas above 0")
    return DirectionCorrection(offset, scale, *(None if np.isnan(sigma) else sigma for sigma in sigmas))
