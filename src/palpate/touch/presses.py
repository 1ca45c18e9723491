"""A sensor unit learns itself from presses: how its images lie and what is off in what touch tells.

Something is pressed on the gel, a ball, a rod or an edge, at angles that are known from the robot or the place. The
model is asked in every view that makes the images those of the profile; where left and right are right, what it tells
lies on a line over the true angles. Of presses by hand it is enough to know their order from one side to the other: in
the right view imprints lie in this order, and the model tells angles as they follow from where the imprints are. That
says how images lie, and nothing of what is off.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.touch.background import Image
from palpate.touch.calibration import Calibration, DirectionCorrection
from palpate.touch.colours import unusual_colours
from palpate.touch.detector import ContactDetector
from palpate.touch.difference import COLUMNS, Difference, difference, reduced
from palpate.touch.model import TouchModel
from palpate.touch.untouched import background_of_stills
from palpate.touch.view import CameraView, views
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

FEWEST = 5
"""Presses from which a line and its scatter can be told."""
SPREAD = np.radians(8.0)
"""Between the least and the greatest angle: less does not tell the scale, or left from right [rad]."""
WORST = np.radians(3.0)
"""Scatter about the line beyond which the presses or their angles are not what they are taken for [rad]."""
_SCALE = 0.1  # standard deviation of the scale before anything is pressed
_OFFSET = np.radians(2.0)  # the same of the offset [rad]
_ALIKE = 0.06  # standard deviation of the scale of objects about that of a ball: docs/study/direction_scale.json
_UNLIKE = -math.log(5 * 16)  # log of the odds of a view in which colours are unusual: 1 DIGIT of 17, in 5 other orders
_TRUTH = np.radians(0.3)  # by which the given angles may be off, each by itself [rad]
_IMPRINT = np.radians(1.5)  # the same of angles by the places of imprints, which halos and shadows shift [rad]
_IN_ORDER = 0.9  # correlation of ranks from which imprints lie in an order


@dataclass(frozen=True, eq=False)
class Presses:
    """Images of presses, N of them, as the camera gives them."""

    images: tuple[Image, ...]
    """Each (height, width, 3) RGB."""
    angle: Array
    """Angle of the contact on the tip, (N,) [rad]; see `measurements.ContactDirection`. NaN where nothing is known but
    that presses are in order, from -y to +y."""
    names: tuple[str, ...]
    """What each is called in messages."""

    @property
    def is_measured(self) -> bool:
        """Whether angles are known, and not the order alone."""
        return bool(np.isfinite(self.angle).all())


@dataclass(frozen=True, eq=False)
class PressFit:
    """What presses say of a unit."""

    calibration: Calibration
    """For `Tracker`."""
    angle: Array
    """Angle of each press, (N,) [rad]: as it was given, or by the place of its imprint."""
    told: Array
    """What the model tells of each press in the view found, (N,) [rad]."""
    scatter: float
    """Root of the mean square of what is told about the line [rad]."""


def check_alike(presses: Presses, untouched: Sequence[Image]) -> None:
    """FileError unless there are images of the untouched gel, and all images have one size."""
    if not untouched:
        raise FileError("found no image of the untouched gel; one or more are needed")
    size = untouched[0].shape
    still = [(f"image {number} of the untouched gel", image) for number, image in enumerate(untouched, 1)]
    for name, image in (*zip(presses.names, presses.images, strict=True), *still):
        if image.shape != size:
            raise FileError(f"{name}: image is {image.shape[:2]}, the untouched gel {size[:2]}; rows and columns")


def check_spread(angle: Array) -> None:
    """FileError where angles (N,) [rad] lie too close together to tell left from right."""
    if (spread := float(np.ptp(angle))) < SPREAD:
        found = f"found presses within {np.degrees(spread):.1f} degrees"
        raise FileError(f"{found}; they must be spread over {np.degrees(SPREAD):.0f} degrees or more")


def learn_from_presses(
    presses: Presses, untouched: Sequence[Image], sensor: SensorProfile, model: TouchModel
) -> PressFit:
    """Return what presses say of a unit, given one or more images of its untouched gel as its camera gives them.

    Raises FileError where there are too few, where they lie too close together or do not touch, where images fit the
    profile in no orientation, and where what is told does not lie on a line. Presses in order are of round gels.
    """
    if len(presses.images) < FEWEST:
        raise FileError(f"found {len(presses.images)} presses; at least {FEWEST} are needed")
    if presses.is_measured:
        check_spread(presses.angle)
    elif sensor.flat_width or not sensor.half_width or sensor.half_width > sensor.radius:
        raise FileError(f"presses without angles are of round gels of known width, and {sensor.name!r} has none")
    height, width = sensor.image_height, sensor.image_width
    check_alike(presses, untouched)
    first = untouched[0]
    candidates = list(views(first, height, width))
    if not candidates:
        raise FileError(
            f"images of {first.shape[0]} x {first.shape[1]} px are not those of {sensor.name!r}, "
            f"{height} x {width} px, in any turn"
        )
    fits = [_fit(view, presses, untouched, sensor, model) for view in candidates]
    # The likeliest, were it by ever so little. Presses tell only left from right for sure, but of the views that are
    # left it reads other presses best: to take a simpler one that was nearly as likely made errors a tenth larger on
    # simulated units (`scripts/measure_press_views.py`).
    likely, fit = max(fits, key=lambda each: each[0])
    if not presses.is_measured:
        if likely == -math.inf:
            _check_touched(fit, presses)  # one that shows nothing is in no order either
            raise FileError("imprints lie in the order of the presses in no view; name all that touch, from -y to +y")
        check_spread(fit.angle)
    over, worst = ("the given angles", WORST) if presses.is_measured else ("the places of the imprints", 2.0 * WORST)
    if fit.scatter > worst:
        raise FileError(
            f"what the presses show lies {np.degrees(fit.scatter):.1f} degrees about a line over {over}, "
            f"allowed are {np.degrees(worst):.0f}: are {over} right, and is the untouched gel of this unit, and "
            "untouched?"
        )
    _check_touched(fit, presses)
    return fit


def _fit(
    view: CameraView, presses: Presses, untouched: Sequence[Image], sensor: SensorProfile, model: TouchModel
) -> tuple[float, PressFit]:
    """Return how likely what is told is in a view, and what follows of the unit."""
    background = background_of_stills([view.of(image) for image in untouched])
    mean = reduced(background.mean)
    seen = [difference(view.of(image), mean) for image in presses.images]
    told, variance = np.array([model.look(each).direction for each in seen]).T
    is_measured = presses.is_measured
    angle = presses.angle if is_measured else np.array([imprint_angle(each, sensor) for each in seen])
    variance = variance * model.settings.spread["direction"].scale + (_TRUTH if is_measured else _IMPRINT) ** 2
    # told = offset + scale true, both with priors.
    design = np.stack([np.ones_like(told), angle], axis=1)
    prior = np.array([0.0, 1.0]), np.diag([_OFFSET**-2, _SCALE**-2])
    information = prior[1] + design.T @ (design / variance[:, None])
    offset, scale = np.linalg.solve(information, prior[1] @ prior[0] + design.T @ (told / variance))
    off = told - offset - scale * angle
    cost = off @ (off / variance) + (offset / _OFFSET) ** 2 + ((scale - 1.0) / _SCALE) ** 2 + np.log(variance).sum()
    likely = -0.5 * float(cost) + (_UNLIKE if unusual_colours(view.of(untouched[0]), sensor) else 0.0)
    scatter = float(np.sqrt(np.mean(off**2)))
    if not is_measured:
        ranks = np.argsort(np.argsort(angle))
        likely = likely if np.corrcoef(np.arange(len(angle)), ranks)[0, 1] > _IN_ORDER else -math.inf
        return likely, PressFit(Calibration(background, view, is_view_known=True), angle, told, scatter)
    sigmas = np.sqrt(np.diagonal(np.linalg.inv(information))) * max(1.0, scatter / float(np.sqrt(np.mean(variance))))
    correction = DirectionCorrection(float(offset), float(scale), float(sigmas[0]), math.hypot(sigmas[1], _ALIKE))
    return likely, PressFit(Calibration(background, view, correction, is_view_known=True), angle, told, scatter)


def imprint_angle(seen: Difference, sensor: SensorProfile) -> float:
    """Return the angle on the tip [rad] of the middle of what a difference shows, whatever its colours are.

    NaN where it shows nothing.
    """
    assert sensor.half_width
    strength = np.square(np.abs(seen).sum(axis=2)).sum(axis=0)
    if not strength.any():
        return math.nan
    place = (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS - 1.0
    return math.asin(float(strength @ place / strength.sum()) * sensor.half_width / sensor.radius)


def _check_touched(fit: PressFit, presses: Presses) -> None:
    """FileError on the first press that shows no touch."""
    for name, image in zip(presses.names, presses.images, strict=True):
        detector = ContactDetector(fit.calibration.background)
        if not detector.update(detector.read(fit.calibration.view.of(image))):
            raise FileError(f"{name}: shows no touch against the untouched gel; does that show one?")
