"""Calibration of one sensor unit: its untouched gel, camera view and errors of directions, in a file (`.npz`)."""

from dataclasses import astuple, dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Levels
from palpate.checks import FLAGS, NUMBERS, checked_array
from palpate.config import Normal
from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file, read_arrays, whole_file
from palpate.touch.background import Background
from palpate.touch.cells import cells_of
from palpate.types.images import AS_IT_IS, CameraView
from palpate.types.sensor import SensorProfile

VERSION = 9
PITCHES = 0.625, 1.6
"""Least and greatest pixel pitch that a unit may have, as shares of the profile's: of a DIGIT 25.6 to 10 px/mm."""

VIEWS = tuple(
    CameraView(turns, mirrored, (red, green, blue))
    for red, green, blue in permutations(range(3))
    for mirrored in (False, True)
    for turns in (0, 2)
)
"""Views that keep an image's size, the simplest first; the first four leave the channels in their order."""


def check_view(cells: Levels, untouched: Levels, name: str) -> None:
    """Raise SettingError if cells (rows, columns, 3) fit those of the untouched gel far better in another view.

    Medians over the image decide, as most of the gel looks untouched whatever touches it. `name` is what the error
    calls the untouched gel.
    """

    def misfit(view: CameraView) -> float:
        """Return the median difference from the untouched gel in the image's light [grey levels]."""
        viewed = view.of(cells)
        light = np.median(viewed / np.maximum(untouched, 1.0), axis=(0, 1))
        return float(np.median(np.abs(viewed - light * untouched)))

    misfits = {view: misfit(view) for view in VIEWS}
    best = min(misfits, key=misfits.__getitem__)
    # Measured ratios: at most 0.7 in the right view of the same unit; below 3 in the right view of another unit, but
    # for one in 300; above 3 in 97 of 100 wrong views. The 1 is for a symmetric gel, which fits equally well in two
    # views but for rounding to a grey level.
    if misfits[AS_IT_IS] > 3.0 * (misfits[best] + 1.0):
        raise SettingError(
            f"image: lies otherwise than {name}: it fits {best}, {misfits[best]:.1f} grey levels off in the median and "
            f"not {misfits[AS_IT_IS]:.1f}"
        )


@dataclass(frozen=True)
class DirectionCorrection:
    """Linear error of a unit's contact directions: measured = offset + scale * true.

    Turns have the same scale, as an image shows the motion of the surface whatever caused it.
    """

    offset: float = 0.0
    """[rad]"""
    scale: float = 1.0
    """Measured change of angle over the true one."""
    offset_sigma: float | None = None
    """Standard deviation of the offset [rad]; None if it was not measured."""
    scale_sigma: float | None = None
    """Standard deviation of the scale; None if it was not measured."""


UNCORRECTED = DirectionCorrection()


@dataclass(frozen=True)
class SetUp:
    """Constant errors of a robot's set-up as estimated from pushes, each with its standard deviation."""

    sideways: Normal
    """Stated place of the sensor minus the true one, along the sensor's y [m]."""
    delay: Normal
    """Delay of the images behind the gel [s]."""
    depth: Normal
    """Indentation of the gel; it includes all constant errors along the push [m]."""
    outline_scale: Normal
    """Relative size error of outlines."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Properties of one sensor unit."""

    background: Background
    """The untouched gel, in the profile's view."""
    view: CameraView = AS_IT_IS
    """Rotation, mirroring and order of channels that turn the camera's images into the profile's."""
    direction: DirectionCorrection = UNCORRECTED
    """Errors of the contact directions."""
    pixel_pitch: float | None = None
    """Width and height of a pixel on the gel [m]; None if it was not measured."""
    pixel_pitch_sigma: float = 0.0
    """Standard deviation of the pixel pitch, as a share of it."""
    place_offset: float = 0.0
    """Constant error of places on a flat pad [m]."""
    place_offset_sigma: float | None = None
    """Standard deviation of that [m]; None if it was not measured."""
    place_spread: float = 1.0
    """Factor on the variance of an imprint's middle on a flat pad, as presses show it."""
    set_up: SetUp | None = None
    """Errors of the robot's set-up; None without pushes."""
    is_view_known: bool = False
    """True if presses or pushes have shown how images lie; otherwise only their size is known."""
    file: Path | None = None
    """The file that it was read from, if any."""
    is_sure: bool = False
    """True if it comes from the stream that it is used for; other calibrations are doubted until an image looks like
    the untouched gel."""


def calibrated(sensor: SensorProfile, calibration: Calibration | None) -> SensorProfile:
    """Return the profile with the pixel pitch of a calibrated unit, if that was measured."""
    if calibration is None or calibration.pixel_pitch is None:
        return sensor
    return replace(sensor, pixel_pitch=calibration.pixel_pitch, pixel_pitch_sigma=calibration.pixel_pitch_sigma)


def mismatch(calibration: Calibration, sensor: SensorProfile) -> str:
    """Return a sentence if the size or scale of a calibration's images cannot be the sensor's; otherwise ""."""
    name = calibration.file or "the calibration"
    shown_ratio = calibrated(sensor, calibration).shown / sensor.shown / calibration.direction.scale
    if not PITCHES[0] < shown_ratio < PITCHES[1]:
        return (
            f"{name}: is as if an image showed {shown_ratio:.2g} times what one of {sensor.name!r} does, allowed are "
            f"{PITCHES[0]:g} to {PITCHES[1]:g}: are angles right, and the units of angles, places, ruler, outlines?"
        )
    height, width = calibration.background.mean.shape[:2]
    if not sensor.image_height or (height, width) == (sensor.image_height, sensor.image_width):
        return ""
    expected = f"those of sensor {sensor.name!r} have {sensor.image_height} x {sensor.image_width}"
    return f"{name}: is of images of {height} x {width} px; {expected}"


def write_calibration(calibration: Calibration, path: Path | str, overwrite: bool = False) -> None:
    """Write the `.npz`, whole or not at all. Raises FileError if the file exists, unless `overwrite` is set."""
    view = calibration.view
    direction = calibration.direction
    sigmas = [np.nan if sigma is None else sigma for sigma in (direction.offset_sigma, direction.scale_sigma)]
    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            version=VERSION,
            mean=calibration.background.mean,
            noise=calibration.background.noise,
            view=[view.quarter_turns, view.mirrored, *view.channels],
            view_known=calibration.is_view_known,
            direction=[direction.offset, direction.scale, *sigmas],
            pixel_pitch=[calibration.pixel_pitch or np.nan, calibration.pixel_pitch_sigma],
            place=[calibration.place_offset, calibration.place_offset_sigma or np.nan],
            place_spread=calibration.place_spread,
            set_up=np.array(astuple(calibration.set_up) if calibration.set_up else [], np.float64),
        )


def load_calibration(path: Path | str) -> Calibration:
    """Read a file of `write_calibration` without running code; raises FileError on anything else."""
    path = existing_file(path)
    arrays = read_arrays(path)
    with in_file(path):
        _check_version(arrays)
        mean = _levels("mean", arrays["mean"], ("N", "N", 3))
        noise = _levels("noise", arrays["noise"], cells_of(mean).shape)
        view = _VIEWS_BY_NUMBERS.get(tuple(_numbers(arrays, "view", 5)))
        offset, scale, *sigmas = _numbers(arrays, "direction", 4)
        pitch, pitch_sigma = _numbers(arrays, "pixel_pitch", 2)
        arrays.setdefault("place", np.array([0.0, np.nan]))  # of an earlier version
        place_offset, place_sigma = _numbers(arrays, "place", 2)
        arrays.setdefault("place_spread", np.array(1.0))
        place_spread = float(checked_array("place_spread", arrays["place_spread"], NUMBERS, ()))
        set_up = arrays.get("set_up", np.empty(0))
        is_direction = np.isfinite(offset) and 0.0 < scale < np.inf and not any(sigma <= 0.0 for sigma in sigmas)
        is_place = abs(place_offset) <= 0.01 and not place_sigma <= 0.0
        is_pitch = (np.isnan(pitch) or 1e-6 <= pitch <= 1e-2) and 0.0 <= pitch_sigma <= 0.5
        for name, is_right, allowed in (
            ("set_up", _is_set_up(set_up), "nothing, or four numbers up to 1 with sigmas above 0"),
            ("view", view is not None, "quarter turns 0 or 2, 0 or 1, and channels 0, 1, 2"),
            ("direction", is_direction, "an offset, a scale above 0 and sigmas above 0"),
            ("place", is_place, "an offset of at most 0.01 m and a sigma above 0"),
            ("place_spread", 0.01 <= place_spread <= 1e4, "a factor from 0.01 to 10000"),
            ("pixel_pitch", is_pitch, "a length from 1e-6 to 0.01 m and a sigma from 0 to 0.5"),
        ):
            if not is_right:
                raise FileError(f"{name}: found {arrays[name].tolist()}, expected {allowed}")
        return Calibration(
            Background(mean, noise),
            view or AS_IT_IS,
            DirectionCorrection(offset, scale, _none_for_nan(sigmas[0]), _none_for_nan(sigmas[1])),
            _none_for_nan(pitch),
            pitch_sigma,
            place_offset,
            _none_for_nan(place_sigma),
            place_spread,
            SetUp(*map(tuple, set_up.astype(float).tolist())) if set_up.size else None,
            is_view_known=bool(checked_array("view_known", arrays["view_known"], FLAGS, ())),
            file=path,
        )


_VIEWS_BY_NUMBERS: dict[Any, CameraView] = {(view.quarter_turns, view.mirrored, *view.channels): view for view in VIEWS}
"""Views by the numbers that stand for them in a file."""


def _check_version(arrays: dict[str, NDArray[Any]]) -> None:
    """Raise FileError unless the arrays are those of a calibration, of a version that can be read."""
    for name in ("version", "mean", "noise", "view", "view_known", "direction", "pixel_pitch"):
        if name not in arrays:
            raise FileError(f"is no calibration of palpate calibrate, {name!r} is missing")
    version = int(checked_array("version", arrays["version"], NUMBERS, ()))
    if version not in (5, 6, 7, 8, VERSION):  # 5 has no set-up, those below 8 no place, 8 no spread of places
        raise FileError(f"version: found {version}, expected {VERSION}; calibrate the unit anew")


def _numbers(arrays: dict[str, NDArray[Any]], name: str, count: int) -> list[float]:
    return checked_array(name, arrays[name], NUMBERS, (count,)).astype(float).tolist()


def _none_for_nan(number: float) -> float | None:
    return None if np.isnan(number) else number


def _is_set_up(numbers: NDArray[Any]) -> bool:
    """Return true if an array is empty, or holds mean and standard deviation of the four errors of a set-up."""
    if numbers.dtype.kind != "f":
        return False
    if not numbers.size:
        return True
    return numbers.shape == (4, 2) and bool((np.abs(numbers) <= 1.0).all() and (numbers[:, 1:] > 0.0).all())


def _levels(name: str, value: NDArray[Any], shape: tuple[int | str, ...]) -> Levels:
    levels = checked_array(name, value, NUMBERS, shape)
    if levels.dtype != np.float32 or not levels.size or not ((levels >= 0.0) & (levels <= 255.0)).all():
        raise FileError(f"{name}: found {levels.dtype}, or values that are not grey levels from 0 to 255, in float32")
    return levels
