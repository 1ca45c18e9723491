"""Making a calibration: the untouched gel from a recording, and from presses the camera view and errors of directions.

A ball, rod or edge is pressed on the gel at angles known from the robot or the place. The model is asked in every view
of the right size; in the right one, measured angles lie on a line over the true ones. Of presses by hand the order from
one side to the other is enough: in the right view imprints lie in this order, and their places give the angles. That
shows the view, and none of the errors.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import numbers_of, read_table
from palpate.touch.background import background_of
from palpate.touch.calibration import AS_IT_IS, UNCORRECTED, Calibration, CameraView, DirectionCorrection, views
from palpate.touch.cells import Image
from palpate.touch.contact_detector import START, ContactDetector
from palpate.touch.touch_model import COLUMNS, Difference, TouchModel, difference, reduced
from palpate.types.images import read_image
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

NEEDED = 30
"""Frames without contact that a calibration needs: from one second a deviation is known to 13 %."""
MARGIN = 2
"""Frames beside a contact that are left out, as in the paper: flags may be late, and gel takes its time."""
FEWEST = 5  # presses that show a line and its scatter
SPREAD = np.radians(8.0)  # [rad] between least and greatest angle: less does not tell the scale, or left from right
WORST = np.radians(3.0)  # [rad] scatter about the line from which presses or angles are wrong
_OFFSET, _SCALE = np.radians(2.0), 0.1  # standard deviations of offset [rad] and scale before any press
_OTHER_OBJECTS = 0.06  # standard deviation of the scale of objects about that of a ball
_TRUTH, _IMPRINT = np.radians(0.3), np.radians(1.5)  # [rad] errors of given angles, and of angles by imprints
_IN_ORDER = 0.9  # correlation of ranks from which imprints lie in an order


def untouched_frames(recording: Recording) -> NDArray[np.int64]:
    """Return the indices of the frames more than MARGIN frames away from a contact; without flags, all."""
    if recording.contact is None:
        return np.arange(len(recording))
    near = np.convolve(recording.contact, np.ones(2 * MARGIN + 1))[MARGIN:-MARGIN]  # contacts within the margin
    return np.flatnonzero(near < 0.5)


def untouched_images(recording: Recording) -> Iterator[Image]:
    """Yield the images of a recording's frames without contact.

    Raises FileError without images, with fewer than NEEDED such frames, or if a touch that begins or ends shows.
    """
    name = recording.file or "recording"
    if recording.image is None:
        raise FileError(f"{name}: has no images, a calibration needs touch images")
    frames = untouched_frames(recording)
    if len(frames) < NEEDED:
        found = f"found {len(frames)} frames more than {MARGIN} away from a contact"
        raise FileError(f"{name}: {found}, a calibration needs {NEEDED}")
    detector = ContactDetector(recording.sensor)
    for index in frames.tolist():
        image = recording[index].image
        assert image is not None
        if detector.update(detector.read(image)):
            raise FileError(
                f"{name}: frame {index} is off the first ones in {detector.share:.1%} of its values, as if touched; "
                f"allowed is {START:.0%}: calibrate on frames without contact"
            )
        yield image


@dataclass(frozen=True, eq=False)
class Presses:
    """Images of N presses, as the camera gives them."""

    images: tuple[Image, ...]
    """Each (height, width, 3) RGB."""
    angle: Array
    """Contact direction, (N,) [rad]; see `measurements.ContactDirection`. NaN if only their order is known, from -y to
    +y."""
    names: tuple[str, ...]
    """Name of each in messages."""

    @property
    def is_measured(self) -> bool:
        """Angles are known, and not the order alone."""
        return bool(np.isfinite(self.angle).all())


def read_presses(path: Path, look: Callable[[Path], Image] = read_image, in_order: bool = False) -> Presses:
    """Read a CSV with columns file and angle_deg, and its images relative to the folder; raises FileError.

    `look` reads an image. A table without angles, of presses in order, is allowed only with `in_order`.
    """
    rows = read_table(path, ("file",) if in_order else ("file", "angle_deg"), "angle_deg" if in_order else "")
    has_angles = any(angle for _, (_, angle) in rows)
    angles, images = np.full(len(rows), np.nan), []
    for index, (line, (name, angle)) in enumerate(rows):
        if has_angles:
            angles[index] = (numbers_of([angle]) or [np.nan])[0]
            if not abs(angles[index]) <= 90.0:
                raise FileError(f"{path}: line {line}: angle_deg is {angle!r}; expected -90 to 90 degrees")
        if not name.isprintable() or not name:
            raise FileError(f"{path}: line {line}: file is {name!r}; expected the name of an image")
        images.append(look(path.parent / name))
    return Presses(tuple(images), np.radians(angles), tuple(name for _, (name, _) in rows))


@dataclass(frozen=True, eq=False)
class PressFit:
    """Result of a calibration by presses."""

    calibration: Calibration
    """For `Tracker`."""
    angle: Array
    """Angle of each press, (N,) [rad]: as given, or by the place of its imprint."""
    measured: Array
    """Contact direction that the model measures of each press, (N,) [rad]."""
    scatter: float
    """Root mean square distance of the measured directions from the line [rad]."""


def check_alike(presses: Presses, untouched: Sequence[Image]) -> None:
    """Raise FileError unless there are images of the untouched gel, and all images have one size."""
    if not untouched:
        raise FileError("found no image of the untouched gel; one or more are needed")
    names = (*presses.names, *(f"image {number} of the untouched gel" for number in range(1, 1 + len(untouched))))
    size = untouched[0].shape
    for name, image in zip(names, (*presses.images, *untouched), strict=True):
        if image.shape != size:
            raise FileError(f"{name}: image is {image.shape[:2]}, the untouched gel {size[:2]}; rows and columns")


def check_spread(angle: Array) -> None:
    """Raise FileError if angles (N,) [rad] are too close together to tell left from right."""
    if (spread := float(np.ptp(angle))) < SPREAD:
        found = f"found presses within {np.degrees(spread):.1f} degrees"
        raise FileError(f"{found}; they must be spread over {np.degrees(SPREAD):.0f} degrees or more")


def learn_from_presses(
    presses: Presses, untouched: Sequence[Image], sensor: SensorProfile, model: TouchModel
) -> PressFit:
    """Return the calibration by presses, given one or more images of the untouched gel as the camera gives them.

    Raises FileError if presses are too few, too close together, show no touch or do not lie on a line, or if images
    have another size than the profile's. Presses in order need a round gel.
    """
    if len(presses.images) < FEWEST:
        raise FileError(f"found {len(presses.images)} presses; at least {FEWEST} are needed")
    if presses.is_measured:
        check_spread(presses.angle)
    elif sensor.flat_width or not sensor.half_width or sensor.half_width > sensor.radius:
        raise FileError(f"presses without angles are of round gels of known width, and {sensor.name!r} has none")
    height, width = sensor.image_height, sensor.image_width
    check_alike(presses, untouched)
    # A model reads exchanged channels as well, so these stay as they come.
    candidates = [view for view in views(untouched[0].shape, height, width) if view.channels == AS_IT_IS.channels]
    if not candidates:
        found = "images of {} x {} px".format(*untouched[0].shape)
        raise FileError(f"{found} are not those of {sensor.name!r}, {height} x {width} px, in any turn")
    # The likeliest view, by however little: presses tell only left from right for sure, but a simpler view that was
    # nearly as likely would make errors a tenth larger.
    fits = [_fit(view, presses, untouched, sensor, model) for view in candidates]
    log_likelihood, fit = max(fits, key=lambda each: each[0])
    for name, image in zip(presses.names, presses.images, strict=True):
        detector = ContactDetector(sensor, replace(fit.calibration, is_sure=True))
        if not detector.update(detector.read(image)):
            raise FileError(f"{name}: shows no touch against the untouched gel; does that show one?")
    if log_likelihood == -math.inf:
        raise FileError("imprints lie in the order of the presses in no view; name all that touch, from -y to +y")
    check_spread(fit.angle)
    over, worst = ("the given angles", WORST) if presses.is_measured else ("the places of the imprints", 2.0 * WORST)
    if fit.scatter > worst:
        raise FileError(
            f"what the presses show lies {np.degrees(fit.scatter):.1f} degrees about a line over {over}, "
            f"allowed are {np.degrees(worst):.0f}: are {over} right, and is the untouched gel of this unit, and "
            "untouched?"
        )
    return fit


def _fit(
    view: CameraView, presses: Presses, untouched: Sequence[Image], sensor: SensorProfile, model: TouchModel
) -> tuple[float, PressFit]:
    """Return the log likelihood of the presses in a view, and the calibration that follows."""
    background = background_of(view.of(image) for image in untouched)
    mean = reduced(background.mean)
    seen = [difference(view.of(image), mean) for image in presses.images]
    measured, variance = np.array([model.read(each).direction for each in seen]).T
    is_measured = presses.is_measured
    angle = presses.angle if is_measured else np.array([imprint_angle(each, sensor) for each in seen])
    variance = variance * model.settings.spread["direction"].scale + (_TRUTH if is_measured else _IMPRINT) ** 2
    # measured = offset + scale true, with priors on both.
    design = np.stack([np.ones_like(measured), angle], axis=1)
    prior = np.array([0.0, 1.0]), np.diag([_OFFSET**-2, _SCALE**-2])
    information = prior[1] + design.T @ (design / variance[:, None])
    offset, scale = np.linalg.solve(information, prior[1] @ prior[0] + design.T @ (measured / variance))
    off = measured - offset - scale * angle
    cost = off @ (off / variance) + (offset / _OFFSET) ** 2 + ((scale - 1.0) / _SCALE) ** 2 + np.log(variance).sum()
    log_likelihood, scatter = -0.5 * float(cost), float(np.sqrt(np.mean(off**2)))
    correction = UNCORRECTED
    if is_measured:
        inflation = max(1.0, scatter / float(np.sqrt(np.mean(variance))))
        sigmas = np.sqrt(np.diagonal(np.linalg.inv(information))) * inflation
        scale_sigma = math.hypot(sigmas[1], _OTHER_OBJECTS)
        correction = DirectionCorrection(float(offset), float(scale), float(sigmas[0]), scale_sigma)
    else:
        ranks = np.argsort(np.argsort(angle))
        if not np.corrcoef(np.arange(len(angle)), ranks)[0, 1] > _IN_ORDER:
            log_likelihood = -math.inf
    calibration = Calibration(background, view, correction, is_view_known=True)
    return log_likelihood, PressFit(calibration, angle, measured, scatter)


def imprint_angle(seen: Difference, sensor: SensorProfile) -> float:
    """Return the angle on the tip [rad] of the middle of an imprint, whatever its colours; NaN if there is none."""
    assert sensor.half_width
    strength = np.square(np.abs(seen).sum(axis=2)).sum(axis=0)
    if not strength.any():
        return math.nan
    column = (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS - 1.0
    return math.asin(float(strength @ column / strength.sum()) * sensor.half_width / sensor.radius)
