"""Making a calibration: untouched gel, pixel pitch by a ruler, and by presses the camera view and errors of directions.

A ball, rod or edge is pressed on the gel at known angles or places. The model is asked in every view of the right size;
in the right one, measured angles lie on a line over the true ones. Of presses by hand the order from one side to the
other is enough: imprints lie in it in the right view. That shows the view, and none of the errors.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.arrays import Array, Image
from palpate.errors import FileError
from palpate.files import in_file, numbers_of, read_table
from palpate.touch.background import Background
from palpate.touch.calibration import PITCHES, VIEWS, Calibration, DirectionCorrection, calibrated, mismatch
from palpate.touch.cells import area_means
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.pipeline import angle_factor
from palpate.touch.touch_model import COLUMNS, Difference, TouchModel, difference_in_light, reduced
from palpate.types.images import CameraView, read_image
from palpate.types.sensor import SensorProfile

FEWEST = 5  # presses that show a line and its scatter
SPREAD = np.radians(8.0)  # [rad] between least and greatest angle that a model needs, or presses in order
WORST = np.radians(3.0)  # [rad] scatter about the line from which presses or angles are wrong
_OFFSET, _SCALE = np.radians(2.0), 0.1  # standard deviations of offset [rad] and scale before any press
_OTHER_OBJECTS = 0.06  # standard deviation of the scale of objects about that of a ball
LEFT_OR_RIGHT = 3.0
"""Log likelihood of one over the other that makes it known."""
_TRUTH, _IMPRINT = np.radians(0.3), np.radians(1.5)  # [rad] errors of given angles, and of angles by imprints
_IN_ORDER = 0.9  # correlation of ranks from which imprints lie in an order
_ALIKE = 0.25  # correlation of two imprints; nearly all simulated ones have more, and a single one at most 0.15
_RULER = 0.04, 1e-4  # errors of a distance of imprints: as a share, from their flanks, and [m]


def with_ruler(calibration: Calibration, image: Image, length: float, sensor: SensorProfile) -> Calibration:
    """Return a calibration with the pixel pitch that an image of a ruler shows, taken as its untouched gel was.

    A ruler is two edges or balls of one kind, pressed in side by side along the image's columns, `length` [m] apart on
    the gel. Raises FileError where the image does not show two imprints.
    """
    from scipy.ndimage import gaussian_filter1d

    if sensor.pixel_pitch is None:
        raise FileError(f"a ruler measures images of a pad, and {sensor.name!r} has none")
    rows, columns = max(image.shape[0] // 10, 1), image.shape[1]
    seen, known = (area_means(each, rows, columns).sum(axis=0) for each in (image, calibration.background.mean))
    profile = gaussian_filter1d(seen - known, 0.008 * columns, axis=0, mode="constant")  # by two pixels of a DIGIT
    alike = np.sum([np.correlate(channel, channel, "full")[columns - 1 :] for channel in profile.T], axis=0)
    alike *= 2.0 / max(alike[0], 1e-9)
    least, most = (round(length / (share * sensor.pixel_pitch)) for share in reversed(PITCHES))
    least, most = max(least, 1), min(most, round(0.9 * columns))  # columns between two imprints
    if most - least < 2 or length > 2.0 * (sensor.half_width or length):
        found = f"a ruler of {1e3 * length:g} mm is not what an image of {sensor.name!r} shows"
        raise FileError(f"{found}, some {1e3 * sensor.pixel_pitch * columns:.0f} mm")
    best = least + int(np.argmax(alike[least : most + 1]))
    if not alike[best] > _ALIKE or best in (least, most):
        raise FileError(
            f"found no two imprints of the ruler side by side {1e3 * length:g} mm apart: are they one, or is the "
            "length another?"
        )
    # Rendered edges and balls are found 3 % too far apart on a flat gel; on a round one their inner flanks are deeper.
    angle = 0.0 if sensor.flat_width else length / sensor.radius
    pitch, sigma = length / ((0.97 + 0.3 * angle) * best), math.hypot(_RULER[0], _RULER[1] / length)
    found = replace(calibration, pixel_pitch=pitch, pixel_pitch_sigma=sigma)
    # An image that shows less than the pad cuts off sides: their directions are read too near to the middle.
    scale = 1.0 if sensor.flat_width else 1.0 - 0.35 * max(0.9 - calibrated(sensor, found).shown, 0.0)
    return replace(found, direction=DirectionCorrection(scale=scale, scale_sigma=math.hypot(_OTHER_OBJECTS, sigma)))


@dataclass(frozen=True, eq=False)
class Presses:
    """Images of N presses, as the camera gives them."""

    images: tuple[Image, ...]
    """Each (height, width, 3) RGB."""
    angle: Array
    """Contact direction, (N,) [rad], see `measurements.ContactDirection`; NaN if only their order from -y is known."""
    names: tuple[str, ...]
    """Name of each in messages."""
    are_relative: bool = False
    """Angles are from anywhere, not from the middle of the gel."""


def read_presses(
    path: Path, look: Callable[[Path], Image] = read_image, sensor: SensorProfile | None = None
) -> Presses:
    """Read a CSV with columns file and angle_deg, and its images relative to the folder; raises FileError.

    `look` reads an image. With the sensor, places (place_mm) may stand for angles; presses in order need neither.
    """
    needed, optional = (("file",), ("angle_deg", "place_mm")) if sensor else (("file", "angle_deg"), ())
    rows = read_table(path, needed, optional)
    given = [at for at in (1, 2) if any(any(cells[at : at + 1]) for _, cells in rows)] or [1] * (sensor is None)
    if len(given) > 1:
        raise FileError(f"{path}: found the columns angle_deg and place_mm; one of them is needed")
    column, most, unit = "angle_deg", 90.0, "degrees"
    if sensor and given == [2]:
        column, most, unit = "place_mm", 1e3 * (0.0 if sensor.flat_width else sensor.radius), "mm on a round gel"
    numbers, images = np.full(len(rows), np.nan), {}
    for index, (line, (name, *cells)) in enumerate(rows):
        with in_file(f"{path}: line {line}"):
            for at in given:
                numbers[index] = (numbers_of(cells[at - 1 : at]) or [np.nan])[0]
                if not abs(numbers[index]) <= most:
                    raise FileError(f"{column} is {cells[at - 1]!r}; expected -{most:g} to {most:g} {unit}")
            if not name.isprintable() or not name or name in images:
                raise FileError(f"file is {name!r}; expected the name of an image, each once")
            images[name] = look(path.parent / name)
    angles = np.arcsin(1e-3 * numbers / sensor.radius) if sensor and given == [2] else np.radians(numbers)
    return Presses(tuple(images.values()), angles, tuple(images), given == [2])


def check_spread(angle: Array) -> None:
    """Raise FileError if angles (N,) [rad] are too close together to tell left from right."""
    if (spread := float(np.ptp(angle))) < SPREAD:
        found = f"found presses within {np.degrees(spread):.1f} degrees"
        raise FileError(f"{found}; they must be spread over {np.degrees(SPREAD):.0f} degrees or more")


def learn_from_presses(
    presses: Presses, calibration: Calibration, sensor: SensorProfile, model: TouchModel
) -> tuple[Calibration, float]:
    """Return a calibration with what presses show besides, and the scatter of directions about the line [rad].

    All images, also of the untouched gel, are as the camera gives them, in the profile's size. Raises FileError if
    presses are too few, too close together, show no touch or lie on no line. Presses in order need a round gel.
    """
    if len(presses.images) < FEWEST:
        raise FileError(f"found {len(presses.images)} presses; at least {FEWEST} are needed")
    is_measured = bool(np.isfinite(presses.angle).all())
    if not is_measured and (sensor.flat_width or not sensor.half_width or sensor.half_width > sensor.radius):
        raise FileError(f"presses without angles are of round gels of known width, and {sensor.name!r} has none")
    # The likeliest view, by however little: presses tell only left from right for sure, but a simpler view that was
    # nearly as likely would make errors a tenth larger. A model reads exchanged channels as well.
    fits = [_fit(view, presses, calibration, sensor, model) for view in VIEWS[:4]]
    log_likelihood, found, angle, scatter = max(fits, key=lambda fit: fit[0])
    side = found.view.keeps_left_and_right
    exchanged = max(fit[0] for fit in fits if fit[1].view.keeps_left_and_right != side)
    for name, image in zip(presses.names, presses.images, strict=True):
        with in_file(name):
            detector = ContactDetector(sensor, replace(found, direction=calibration.direction))
            if not detector.update(detector.read(image)):
                raise FileError("shows no touch against the untouched gel; does that show one?")
    if log_likelihood == -math.inf:
        raise FileError("imprints lie in the order of the presses in no view; name all that touch, from -y to +y")
    if not is_measured:
        check_spread(angle)
    given = f"the given {'places in mm' if presses.are_relative else 'angles in degrees'}"
    over, worst = (given, WORST) if is_measured else ("the places of the imprints", 2.0 * WORST)
    if scatter > worst:
        raise FileError(
            f"what the presses show lies {np.degrees(scatter):.1f} degrees about a line over {over}, which make "
            f"{np.degrees(np.ptp(angle)):.2g} degrees in all; allowed are {np.degrees(worst):.0f}: are they right, and "
            "is the untouched gel of this unit, and untouched?"
        )
    if wrong := mismatch(found, sensor):
        raise FileError(wrong)
    if log_likelihood - exchanged < LEFT_OR_RIGHT:
        within = f"found presses within {np.degrees(np.ptp(angle)):.1f} degrees"
        raise FileError(f"{within}, less than noise can tell left from right by; add some farther apart")
    return found, scatter


def _fit(
    view: CameraView, presses: Presses, calibration: Calibration, sensor: SensorProfile, model: TouchModel
) -> tuple[float, Calibration, Array, float]:
    """Return log likelihood, calibration, angle of each press [rad] and scatter about the line [rad] in a view."""
    gel, is_measured = calibration.background, np.isfinite(presses.angle).all()
    gel = Background(view.of(gel.mean), view.of(gel.noise))
    calibration = replace(calibration, background=gel, view=view, is_view_known=True)
    unit, mean = calibrated(sensor, calibration), reduced(gel.mean)
    seen = [difference_in_light(view.of(image), mean) for image in presses.images]
    measured, variance = np.array([model.read(each)["direction"] for each in seen]).T
    measured *= angle_factor(model, unit)
    angle = presses.angle if is_measured else np.array([imprint_angle(each, unit) for each in seen])
    of_offset = 1.0 if presses.are_relative else _OFFSET  # [rad]
    of_scale = math.hypot(_SCALE, unit.pixel_pitch_sigma)
    variance = variance * model.settings.spread["direction"].scale + (_TRUTH if is_measured else _IMPRINT) ** 2
    # measured = offset + scale true, with priors on both as two more rows.
    weight = 1.0 / np.sqrt(np.append(variance, (of_offset**2, of_scale**2)))
    design = np.stack([np.append(np.ones_like(angle), (1.0, 0.0)), np.append(angle, (0.0, 1.0))], axis=1)
    rows, wanted = weight[:, None] * design, weight * np.append(measured, (0.0, 1.0))
    offset, scale = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    off = wanted - rows @ (offset, scale)
    log_likelihood = -0.5 * float(off @ off + np.log(variance).sum())
    scatter = float(np.sqrt(np.mean(np.square(measured - offset - scale * angle))))
    correction = calibration.direction
    if is_measured:
        inflation = max(1.0, scatter / float(np.sqrt(np.mean(variance))))
        sigmas = np.sqrt(np.diagonal(np.linalg.inv(rows.T @ rows))) * inflation
        start = (0.0, None) if presses.are_relative else (float(offset), float(sigmas[0]))
        correction = DirectionCorrection(start[0], float(scale), start[1], math.hypot(sigmas[1], _OTHER_OBJECTS))
    else:
        ranks = np.argsort(np.argsort(angle))
        if not np.corrcoef(np.arange(len(angle)), ranks)[0, 1] > _IN_ORDER:
            log_likelihood = -math.inf
    return log_likelihood, replace(calibration, direction=correction), angle, scatter


def imprint_angle(seen: Difference, sensor: SensorProfile) -> float:
    """Return the angle on the tip [rad] of the middle of an imprint, whatever its colours; NaN if there is none."""
    assert sensor.half_width
    strength = np.square(np.abs(seen).sum(axis=2)).sum(axis=0)
    if not strength.any():
        return math.nan
    column = (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS - 1.0
    return math.asin(float(strength @ column / strength.sum()) * sensor.shown * sensor.half_width / sensor.radius)
