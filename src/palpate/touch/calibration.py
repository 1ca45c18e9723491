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

VERSION = 7
PITCHES = 0.625, 1.6
"""Least and greatest pixel pitch that a unit may have, as shares of the profile's: of a DIGIT 25.6 to 10 px/mm."""


VIEWS = tuple(
    CameraView(turns, mirrored, (red, green, blue))
    for red, green, blue in permutations(range(3))
    for mirrored in (False, True)
    for turns in (0, 2)
)
"""Views that keep an image's size, the simplest first; the first four leave channels as they come."""


def check_view(cells: Levels, untouched: Levels, name: str) -> None:
    """Raise SettingError if cells (rows, columns, 3) fit those of the untouched gel, called `name`, far better rotated.

    Most of the gel looks untouched whatever touches it, so medians over the image tell.
    """

    def misfit(view: CameraView) -> float:
        seen = view.of(cells)
        light = np.median(seen / np.maximum(untouched, 1.0), axis=(0, 1))
        return float(np.median(np.abs(seen - light * untouched)))

    off = {view: misfit(view) for view in VIEWS}
    best = min(off, key=off.__getitem__)
    # In the right view the ratio is at most 0.7, and of other units below 3 but for one in 300; in a wrong view 97 in
    # 100 are above. A symmetric gel fits equally well, but for rounding to a grey level.
    if off[AS_IT_IS] > 3.0 * (off[best] + 1.0):
        raise SettingError(
            f"image: lies otherwise than {name}: it fits {best}, {off[best]:.1f} grey levels off in the median and not "
            f"{off[AS_IT_IS]:.1f}"
        )


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


UNCORRECTED = DirectionCorrection()


@dataclass(frozen=True)
class SetUp:
    """Constant errors of a robot that pushes have shown, each with its standard deviation."""

    sideways: Normal
    """Stated place of the sensor minus the true one, along the sensor's y [m]."""
    delay: Normal
    """Time by which images show the gel late [s]."""
    depth: Normal
    """Indentation of the gel, with all constant errors along the push [m]."""
    outline_scale: Normal
    """Relative size error of outlines."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Properties of one sensor unit."""

    background: Background
    """The untouched gel, in the profile's view."""
    view: CameraView = AS_IT_IS
    """Steps that turn the camera's images into the profile's."""
    direction: DirectionCorrection = UNCORRECTED
    """Errors of the contact directions."""
    pixel_pitch: float | None = None
    """Width and height of a pixel on the gel [m]; None if it was not measured."""
    pixel_pitch_sigma: float = 0.0
    """Its standard deviation, as a share of it."""
    set_up: SetUp | None = None
    """Errors of the robot; None without pushes."""
    is_view_known: bool = False
    """Presses or pushes have shown how images lie; otherwise only their size is known."""
    file: Path | None = None
    """Its file, if it was read from one."""
    is_sure: bool = False
    """It comes from the stream that it is used for. Others are doubted until an image looks like the untouched gel."""


def calibrated(sensor: SensorProfile, calibration: Calibration | None) -> SensorProfile:
    """Return the profile with the pixel pitch of a calibrated unit, if that was measured."""
    if calibration is None or calibration.pixel_pitch is None:
        return sensor
    return replace(sensor, pixel_pitch=calibration.pixel_pitch, pixel_pitch_sigma=calibration.pixel_pitch_sigma)


def mismatch(calibration: Calibration, sensor: SensorProfile) -> str:
    """Return a sentence if a calibration cannot be of the sensor, by its images' size or scale; otherwise ""."""
    expected, found = (sensor.image_height, sensor.image_width), calibration.background.mean.shape[:2]
    name = calibration.file or "the calibration"
    shown = calibrated(sensor, calibration).shown / sensor.shown / calibration.direction.scale
    if not PITCHES[0] < shown < PITCHES[1]:
        return (
            f"{name}: is as if an image showed {shown:.2g} times what one of {sensor.name!r} does, allowed are "
            f"{PITCHES[0]:g} to {PITCHES[1]:g}: are angles right, and the units of angles, places, ruler, outlines?"
        )
    if found == expected or not sensor.image_height:
        return ""
    sizes = "{} x {} px; those of sensor {!r} have {} x {}".format(*found, sensor.name, *expected)
    return f"{name}: is of images of {sizes}"


def write_calibration(calibration: Calibration, path: Path | str, overwrite: bool = False) -> None:
    """Write the `.npz`, whole or not at all."""
    view, direction, gel = calibration.view, calibration.direction, calibration.background
    sigmas = [np.nan if sigma is None else sigma for sigma in (direction.offset_sigma, direction.scale_sigma)]
    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            version=VERSION,
            mean=gel.mean,
            noise=gel.noise,
            view=[view.quarter_turns, view.mirrored, *view.channels],
            view_known=calibration.is_view_known,
            direction=[direction.offset, direction.scale, *sigmas],
            pixel_pitch=[calibration.pixel_pitch or np.nan, calibration.pixel_pitch_sigma],
            set_up=np.array(astuple(calibration.set_up) if calibration.set_up else [], np.float64),
        )


def load_calibration(path: Path | str) -> Calibration:
    """Read a file of `write_calibration` without running code; raises FileError on anything else."""
    path = existing_file(path)
    arrays = read_arrays(path)
    with in_file(path):
        names = ("version", "mean", "noise", "view", "view_known", "direction", "pixel_pitch")
        if missing := [name for name in names if name not in arrays]:
            raise FileError(f"is no calibration of palpate calibrate, {missing[0]!r} is missing")
        version = int(checked_array("version", arrays["version"], NUMBERS, ()))
        if version not in (5, 6, VERSION):  # 5 is without pushes
            raise FileError(f"version: found {version}, expected {VERSION}; calibrate the unit anew")
        set_up = arrays.get("set_up", np.empty(0))
        mean = _levels("mean", arrays["mean"], ("N", "N", 3))
        background = Background(mean, _levels("noise", arrays["noise"], cells_of(mean).shape))

        def numbers(name: str, count: int) -> list[float]:
            return checked_array(name, arrays[name], NUMBERS, (count,)).astype(float).tolist()

        views: dict[Any, CameraView] = {(each.quarter_turns, each.mirrored, *each.channels): each for each in VIEWS}
        view = views.get(tuple(numbers("view", 5)))
        offset, scale, *sigmas = numbers("direction", 4)
        pitch, pitch_sigma = numbers("pixel_pitch", 2)
        is_direction = np.isfinite(offset) and 0.0 < scale < np.inf and not any(sigma <= 0.0 for sigma in sigmas)
        is_pitch = (np.isnan(pitch) or 1e-6 <= pitch <= 1e-2) and 0.0 <= pitch_sigma <= 0.5
        is_set_up = set_up.dtype.kind == "f" and (not set_up.size or set_up.shape == (4, 2))
        is_set_up = is_set_up and (np.abs(set_up) <= 1.0).all() and (set_up[..., 1:] > 0.0).all()
        for name, is_right, allowed in (
            ("set_up", is_set_up, "nothing, or four numbers up to 1 with sigmas above 0"),
            ("view", view, "quarter turns 0 or 2, 0 or 1, and channels 0, 1, 2"),
            ("direction", is_direction, "an offset, a scale above 0 and sigmas above 0"),
            ("pixel_pitch", is_pitch, "a length from 1e-6 to 0.01 m and a sigma from 0 to 0.5"),
        ):
            if not is_right:
                raise FileError(f"{name}: found {arrays[name].tolist()}, expected {allowed}")
        return Calibration(
            background,
            view or AS_IT_IS,
            DirectionCorrection(offset, scale, *(None if np.isnan(sigma) else sigma for sigma in sigmas)),
            None if np.isnan(pitch) else pitch,
            pitch_sigma,
            SetUp(*map(tuple, set_up.astype(float).tolist())) if set_up.size else None,
            is_view_known=bool(checked_array("view_known", arrays["view_known"], FLAGS, ())),
            file=path,
        )


def _levels(name: str, value: NDArray[Any], shape: tuple[int | str, ...]) -> Levels:
    levels = checked_array(name, value, NUMBERS, shape)
    if levels.dtype != np.float32 or not levels.size or not ((levels >= 0.0) & (levels <= 255.0)).all():
        raise FileError(f"{name}: found {levels.dtype}, or values that are not grey levels from 0 to 255, in float32")
    return levels
