"""Calibration of a unit by presses and a ruler: camera view, errors of contact directions, and pixel pitch.

A ball, rod or edge is pressed on the gel at known angles or places. The touch model reads the images in every view of
the right size; in the right view the measured angles, of a flat pad the measured places, lie on a line over the true
ones. On a flat pad the slope of that line is the scale of the images. For presses by hand on a round gel it is enough
to know their order from one side to the other: in the right view imprints lie in that order. Such presses show the
view, but not the errors of directions.
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
from palpate.touch.imprint_middle import place_on_unit
from palpate.touch.markers import check_markers, find_markers, without_markers
from palpate.touch.reader import angle_factor
from palpate.touch.touch_model import COLUMNS, Difference, TouchModel, difference_in_light, no_shipped_model, reduced
from palpate.types.images import CameraView, read_image
from palpate.types.sensor import SensorProfile

FEWEST = 3  # presses that show a line and its scatter
SPREAD = np.radians(8.0)  # [rad] least range of the angles of presses, given or in order
WORST = np.radians(3.0)  # [rad] largest scatter about the line; more means wrong presses or angles
LEFT_OR_RIGHT = 3.0
"""Least difference of the log likelihoods of a view and of its mirror image that decides between them."""
_OFFSET_SIGMA = np.radians(2.0)  # [rad] standard deviation of the offset before any press
_GIVEN_ANGLE_SIGMA = np.radians(0.3)  # [rad] error of given angles
_IMPRINT_ANGLE_SIGMA = np.radians(1.5)  # [rad] error of angles that imprints show


@dataclass(frozen=True)
class _Limits:
    """Deviations and limits of what presses show."""

    scale_sigma: float = 0.1
    """Standard deviation of the scale before any press."""
    other_objects_sigma: float = 0.06
    """Standard deviation of the scale of other objects about that of a ball."""
    whole_sides: float = 0.8
    """Share of a round pad's width that shows its imprints of flat sides as they are."""
    cut_off_sigma: float = 1.4
    """More of that deviation for each share that is not shown: balls are whole, and sides are cut off."""
    least_rank_correlation: float = 0.9
    """Of imprints that lie in the order of their presses."""
    least_correlation: float = 0.25
    """Of the two imprints of a ruler: nearly all simulated ones have more, a single one has 0.15."""
    ruler_relative_sigma: float = 0.04
    """Error of the distance of two imprints as a share of it, from their flanks."""
    ruler_sigma: float = 1e-4
    """[m] further error of that distance."""


_LIMITS = _Limits()


@dataclass(frozen=True)
class PlaceSettings:
    """Errors of given places on a flat pad."""

    place_scale_sigma: float = 0.005
    """Standard deviation of the scale of given places, of a slide or a ruler, which no press shows."""
    worst_place: float = 1e-3
    """Largest scatter about the line [m]; more means wrong presses or places."""
    given_place_sigma: float = 6e-5
    """Error of given places [m], as of a slide, or of marks in an image by a pixel. What they are off beyond it counts
    as scatter of the middles, as presses cannot tell one from the other."""
    presses_before: float = 3.0
    """Count of presses that what is known before any is worth, for the spread of an imprint's middle."""
    from_middle: float = 1.5e-3
    """Largest constant error of places [m], five times the usual; if given places are farther off, they are measured
    from elsewhere than the middle of the pad."""


_PLACES = PlaceSettings()


def with_ruler(calibration: Calibration, image: Image, length: float, sensor: SensorProfile) -> Calibration:
    """Return a calibration with the pixel pitch that an image of a ruler shows, taken as its untouched gel was.

    A ruler is two edges or balls of one kind, pressed in side by side along the image's columns, `length` [m] apart on
    the gel. Raises FileError where the image does not show two imprints.
    """
    if sensor.pixel_pitch is None:
        raise FileError(f"a ruler measures images of a pad, and {sensor.name!r} has none")
    distance = _distance_of_imprints(image, calibration, length, sensor)
    # Rendered edges and balls are found 3 % too far apart on a flat gel; on a round one their inner flanks are deeper.
    angle = 0.0 if sensor.flat_width else length / sensor.radius
    pitch = length / ((0.97 + 0.3 * angle) * distance)
    pitch_sigma = math.hypot(_LIMITS.ruler_relative_sigma, _LIMITS.ruler_sigma / length)
    measured = replace(calibration, pixel_pitch=pitch, pixel_pitch_sigma=pitch_sigma)
    # An image that shows less than the pad cuts off its sides: their directions are read too near to the middle.
    scale = 1.0 if sensor.flat_width else 1.0 - 0.35 * max(0.9 - calibrated(sensor, measured).shown, 0.0)
    scale_sigma = math.hypot(_LIMITS.other_objects_sigma, pitch_sigma)
    return replace(measured, direction=DirectionCorrection(scale=scale, scale_sigma=scale_sigma))


def _distance_of_imprints(image: Image, calibration: Calibration, length: float, sensor: SensorProfile) -> int:
    """Return the distance [px] of two imprints side by side, `length` [m] apart, by the autocorrelation of columns."""
    from scipy.ndimage import gaussian_filter1d

    assert sensor.pixel_pitch is not None
    rows = max(image.shape[0] // 10, 1)
    columns = image.shape[1]
    levels = area_means(image, rows, columns).sum(axis=0)
    untouched_levels = area_means(calibration.background.mean, rows, columns).sum(axis=0)
    smoothing = 0.008 * columns  # [px], two pixels of a DIGIT
    profile = gaussian_filter1d(levels - untouched_levels, smoothing, axis=0, mode="constant")
    correlation = np.sum([np.correlate(channel, channel, "full")[columns - 1 :] for channel in profile.T], axis=0)
    correlation *= 2.0 / max(correlation[0], 1e-9)
    least = max(round(length / (PITCHES[1] * sensor.pixel_pitch)), 1)
    most = min(round(length / (PITCHES[0] * sensor.pixel_pitch)), round(0.9 * columns))
    is_wider_than_pad = sensor.half_width is not None and length > 2.0 * sensor.half_width
    if most - least < 2 or is_wider_than_pad:
        problem = f"a ruler of {1e3 * length:g} mm is not what an image of {sensor.name!r} shows"
        raise FileError(f"{problem}, some {1e3 * sensor.pixel_pitch * columns:.0f} mm")
    best = least + int(np.argmax(correlation[least : most + 1]))
    if not correlation[best] > _LIMITS.least_correlation or best in (least, most):
        raise FileError(
            f"found no two imprints of the ruler side by side {1e3 * length:g} mm apart: are they one, or is the "
            "length another?"
        )
    return best


@dataclass(frozen=True, eq=False)
class Presses:
    """Images of N presses, as the camera gives them."""

    images: tuple[Image, ...]
    """Each (height, width, 3) RGB."""
    angle: Array
    """Contact direction, (N,) [rad], see `measurements.ContactDirection`; NaN if only their order from -y is known."""
    names: tuple[str, ...]
    """Name of each press in messages."""
    are_relative: bool = False
    """True if angles are measured from an unknown one, not from the middle of the gel."""
    place: Array | None = None
    """Where along y of a flat pad it is touched, (N,) [m], from anywhere; None if angles or the order are known."""


def read_presses(
    path: Path, look: Callable[[Path], Image] = read_image, sensor: SensorProfile | None = None
) -> Presses:
    """Read a CSV with columns file and angle_deg, and its images relative to the folder; raises FileError.

    `look` reads an image. If the sensor is given, the column place_mm may stand in place of angle_deg, or neither for
    presses in order.
    """
    if sensor is None:
        rows = read_table(path, ("file", "angle_deg"))
    else:
        rows = read_table(path, ("file",), ("angle_deg", "place_mm"))
    has_angles = sensor is None or any(cells[1] for _, cells in rows)
    has_places = sensor is not None and any(cells[2] for _, cells in rows)
    if has_angles and has_places:
        raise FileError(f"{path}: found the columns angle_deg and place_mm; one of them is needed")
    angles = np.full(len(rows), np.nan)
    are_on_flat_pad = has_places and sensor is not None and sensor.flat_width > 0.0
    places = np.zeros(len(rows))
    images: dict[str, Image] = {}
    for index, (line, (name, *cells)) in enumerate(rows):
        with in_file(f"{path}: line {line}"):
            if has_angles:
                angles[index] = np.radians(_number_up_to(90.0, cells[0], "angle_deg", "degrees"))
            elif are_on_flat_pad:
                places[index] = 1e-3 * _number_up_to(1e4, cells[1], "place_mm", "mm")
            elif has_places and sensor is not None:
                place = _number_up_to(1e3 * sensor.radius, cells[1], "place_mm", "mm on a round gel")
                angles[index] = np.arcsin(1e-3 * place / sensor.radius)
            if not name.isprintable() or not name or name in images:
                raise FileError(f"file is {name!r}; expected the name of an image, each once")
            images[name] = look(path.parent / name)
    given = places if are_on_flat_pad else None
    return Presses(tuple(images.values()), angles, tuple(images), are_relative=has_places, place=given)


def _number_up_to(most: float, cell: str, column: str, unit: str) -> float:
    """Return the number in a cell of a table, from -most to most. Raises FileError on anything else."""
    numbers = numbers_of([cell])
    if not numbers or not abs(numbers[0]) <= most:
        raise FileError(f"{column} is {cell!r}; expected -{most:g} to {most:g} {unit}")
    return numbers[0]


def check_spread(angle: Array) -> None:
    """Raise FileError if angles (N,) [rad] are too close together to tell left from right."""
    spread = float(np.ptp(angle))
    if spread < SPREAD:
        problem = f"found presses within {np.degrees(spread):.1f} degrees"
        raise FileError(f"{problem}; they must be spread over {np.degrees(SPREAD):.0f} degrees or more")


@dataclass(frozen=True, eq=False)
class _ViewFit:
    """Presses as they are read in one view."""

    log_likelihood: float
    """Log likelihood of what is measured; -inf if imprints do not lie in the order of the presses."""
    calibration: Calibration
    """The calibration with this view, and with the errors of directions or places if true ones were given."""
    angle: Array
    """Angle of each press, (N,) [rad], as given or as its imprint shows it; on a flat pad its place [m]."""
    scatter: float
    """Scatter of the measured directions about the line [rad], on a flat pad of places [m]."""


def learn_from_presses(
    presses: Presses,
    calibration: Calibration,
    sensor: SensorProfile,
    model: TouchModel | None,
    seek_markers: bool = True,
) -> tuple[Calibration, float]:
    """Return a calibration with the view and errors that presses show, and the scatter of directions [rad].

    On a flat pad at given places it is the scatter of places [m]. All images, also of the untouched gel, are as the
    camera gives them, in the profile's size. Whole imprints at given places on a flat pad need no model. Raises
    FileError if presses are too few, too close together, show no touch or lie on no line. Presses in order need a round
    gel.
    """
    if len(presses.images) < FEWEST:
        raise FileError(f"found {len(presses.images)} presses; at least {FEWEST} are needed")
    is_given = presses.place is not None or bool(np.isfinite(presses.angle).all())
    if not is_given and (sensor.flat_width or not sensor.half_width or sensor.half_width > sensor.radius):
        raise FileError(f"presses without angles are of round gels of known width, and {sensor.name!r} has none")
    # The likeliest view is taken, by however little: presses only tell left from right for sure, but preferring a
    # simpler view that was nearly as likely would make errors a tenth larger. Orders of channels are not tried, as a
    # model reads exchanged channels as well.
    bare_presses, bare = _without_markers(presses, calibration) if seek_markers else (presses, calibration)
    if presses.place is not None:
        fits = [_fit_places_in_view(view, bare_presses, bare, sensor, model) for view in VIEWS[:4]]
    elif model is not None:
        fits = [_fit_in_view(view, bare_presses, bare, sensor, model) for view in VIEWS[:4]]
    else:
        raise FileError(no_shipped_model(sensor.name))
    best = max(fits, key=lambda fit: fit.log_likelihood)
    uncorrected = {"direction": calibration.direction, "pixel_pitch": calibration.pixel_pitch}
    _check_touched(bare_presses, replace(best.calibration, **uncorrected), sensor)
    if best.log_likelihood == -math.inf:
        raise FileError("imprints lie in the order of the presses in no view; name all that touch, from -y to +y")
    if not is_given:
        check_spread(best.angle)
    _check_scatter(best, presses)
    wrong = mismatch(best.calibration, sensor)
    if wrong:
        raise FileError(wrong)
    side = best.calibration.view.keeps_left_and_right
    exchanged = max(fit.log_likelihood for fit in fits if fit.calibration.view.keeps_left_and_right != side)
    if best.log_likelihood - exchanged < LEFT_OR_RIGHT:
        range_ = float(np.ptp(best.angle))
        size = f"{np.degrees(range_):.1f} degrees" if presses.place is None else f"{1e3 * range_:.1f} mm"
        within = f"found presses within {size}"
        raise FileError(f"{within}, less than noise can tell left from right by; add some farther apart")
    view = best.calibration.view
    gel = Background(view.of(calibration.background.mean), view.of(calibration.background.noise))
    return replace(best.calibration, background=gel), best.scatter


def _without_markers(presses: Presses, calibration: Calibration) -> tuple[Presses, Calibration]:
    """Return presses and the untouched gel without markers. Raises FileError if a press has others than the gel."""
    gel = calibration.background
    markers = find_markers(gel.mean)
    for name, image in zip(presses.names, presses.images, strict=True):
        with in_file(name):
            check_markers(image, gel.mean, markers)
    images = tuple(without_markers(image, markers) for image in presses.images)
    bare = replace(gel, mean=without_markers(gel.mean, markers))
    return replace(presses, images=images), replace(calibration, background=bare)


def _check_touched(presses: Presses, calibration: Calibration, sensor: SensorProfile) -> None:
    """Raise FileError if the image of a press shows no touch."""
    for name, image in zip(presses.names, presses.images, strict=True):
        with in_file(name):
            detector = ContactDetector(sensor, calibration, seek_markers=False)
            if not detector.update(detector.read(image)):
                raise FileError("shows no touch against the untouched gel; does that show one?")


def _check_scatter(fit: _ViewFit, presses: Presses) -> None:
    """Raise FileError if measured directions scatter too far about the line over the angles of the presses."""
    if presses.place is not None:
        if fit.scatter > _PLACES.worst_place:
            raise FileError(
                f"place_mm: what the presses show lies {1e3 * fit.scatter:.1f} mm about a line over the given places, "
                f"which span {1e3 * np.ptp(presses.place):.2g} mm; allowed is {1e3 * _PLACES.worst_place:g} mm: are "
                "they right, and is the untouched gel of this unit, and untouched?"
            )
        return
    if not np.isfinite(presses.angle).all():
        over = "the places of the imprints"
        worst = 2.0 * WORST
    else:
        over = "the given places in mm" if presses.are_relative else "the given angles in degrees"
        worst = WORST
    if fit.scatter > worst:
        raise FileError(
            f"what the presses show lies {np.degrees(fit.scatter):.1f} degrees about a line over {over}, which make "
            f"{np.degrees(np.ptp(fit.angle)):.2g} degrees in all; allowed are {np.degrees(worst):.0f}: are they right, "
            "and is the untouched gel of this unit, and untouched?"
        )


def _fit_in_view(
    view: CameraView, presses: Presses, calibration: Calibration, sensor: SensorProfile, model: TouchModel
) -> _ViewFit:
    """Fit a line through the directions that a model measures in a view, over the angles of the presses."""
    has_angles = bool(np.isfinite(presses.angle).all())
    calibration, differences = _in_view(view, presses, calibration)
    unit = calibrated(sensor, calibration)
    readings = np.array([model.read(difference)["direction"] for difference in differences])
    measured = readings[:, 0] * angle_factor(model, unit)
    variance = readings[:, 1] * model.settings.spread["direction"].scale
    if has_angles:
        angle = presses.angle
        variance = variance + _GIVEN_ANGLE_SIGMA**2
    else:
        angle = np.array([imprint_angle(difference, unit) for difference in differences])
        variance = variance + _IMPRINT_ANGLE_SIGMA**2
    offset_sigma = 1.0 if presses.are_relative else _OFFSET_SIGMA  # [rad]
    scale_sigma = math.hypot(_LIMITS.scale_sigma, unit.pixel_pitch_sigma)
    (offset, scale), sigmas, log_likelihood = _fitted_line(angle, measured, variance, (offset_sigma, scale_sigma))
    scatter = float(np.sqrt(np.mean(np.square(measured - offset - scale * angle))))
    if not has_angles:
        if not _are_in_order(angle):
            log_likelihood = -math.inf
        return _ViewFit(log_likelihood, calibration, angle, scatter)
    inflation = max(1.0, scatter / float(np.sqrt(np.mean(variance))))
    cut_off = _LIMITS.cut_off_sigma * max(_LIMITS.whole_sides - unit.shown / float(scale), 0.0) if scale > 0.0 else 0.0
    correction = DirectionCorrection(
        offset=0.0 if presses.are_relative else float(offset),
        scale=float(scale),
        offset_sigma=None if presses.are_relative else float(sigmas[0] * inflation),
        scale_sigma=math.hypot(sigmas[1] * inflation, _LIMITS.other_objects_sigma, cut_off * scale),
    )
    return _ViewFit(log_likelihood, replace(calibration, direction=correction), angle, scatter)


def _fit_places_in_view(
    view: CameraView, presses: Presses, calibration: Calibration, sensor: SensorProfile, model: TouchModel | None
) -> _ViewFit:
    """Fit a line through the places that a flat pad shows in a view, over those of the presses."""
    assert presses.place is not None
    calibration, differences = _in_view(view, presses, calibration)
    unit = calibrated(sensor, calibration)
    readings = [place_on_unit(model, difference, unit) for difference in differences]
    places = [reading for reading in readings if reading is not None]
    if len(places) < len(readings):
        name = presses.names[readings.index(None)]
        raise FileError(
            f"{name}: shows no whole imprint of equal sides, and no touch model reads its place; leave it out"
        )
    measured, variance = np.array(places).T
    place = presses.place - presses.place.mean()  # so that places from far away lose no digits
    prior_sigmas = (1.0, math.hypot(_LIMITS.scale_sigma, unit.pixel_pitch_sigma))
    given = _PLACES.given_place_sigma**2
    # Views are compared by one noise: with a scatter of its own, a wrong one would seem likely as well.
    (offset, scale), _, log_likelihood = _fitted_line(place, measured, variance + given, prior_sigmas)
    spread = _spread_of_middles(measured - offset - scale * place, variance)
    (offset, scale), sigmas, _ = _fitted_line(place, measured, spread * variance + given, prior_sigmas)
    scatter = float(np.sqrt(np.mean(np.square(measured - offset - scale * place))))
    assert unit.pixel_pitch is not None
    scale = float(np.clip(scale, 0.01, 10.0))  # beyond that units are wrong, which `mismatch` says
    pitch_sigma = min(math.hypot(float(sigmas[1]) / scale, _PLACES.place_scale_sigma), 0.5)
    calibration = replace(
        calibration, pixel_pitch=unit.pixel_pitch / scale, pixel_pitch_sigma=pitch_sigma, place_spread=spread
    )
    middle = float(presses.place.mean())
    from_middle = float(offset / scale - middle)
    if abs(from_middle) < _PLACES.from_middle:
        offset_sigma = math.hypot(sigmas[0] / scale, pitch_sigma * middle)
        calibration = replace(calibration, place_offset=from_middle, place_offset_sigma=offset_sigma)
    return _ViewFit(log_likelihood, calibration, presses.place, scatter)


def _spread_of_middles(residual: Array, variance: Array) -> float:
    """Return the factor on the variance [m^2] of middles that residuals (N,) [m] about a line of places show.

    A residual holds the error of a middle and that of the given place. Only what of it is the middle's counts, or
    the more presses lie on a line within the error of given places, the surer single middles would seem.
    """
    given = _PLACES.given_place_sigma**2
    free = len(residual) - 2  # a line takes two
    spread = 1.0
    for _ in range(30):  # by then it has settled
        share = spread * variance / (spread * variance + given)
        square = np.square(share * residual) * len(residual) / free + share * given
        spread = (_PLACES.presses_before + free * float(np.mean(square / variance))) / (_PLACES.presses_before + free)
    return spread


def _in_view(view: CameraView, presses: Presses, calibration: Calibration) -> tuple[Calibration, list[Difference]]:
    """Return a calibration in a view, and the differences (ROWS, COLUMNS, 3) of the presses from its untouched gel."""
    gel = Background(view.of(calibration.background.mean), view.of(calibration.background.noise))
    mean = reduced(gel.mean)
    differences = [difference_in_light(view.of(image), mean) for image in presses.images]
    return replace(calibration, background=gel, view=view, is_view_known=True), differences


def _fitted_line(
    angle: Array, measured: Array, variance: Array, prior_sigmas: tuple[float, float]
) -> tuple[Array, Array, float]:
    """Fit measured = offset + scale * angle by weighted least squares, with priors of offset 0 and scale 1.

    Returns offset [rad] and scale, their standard deviations, and the log likelihood.
    """
    # The priors are two more rows.
    weight = 1.0 / np.sqrt(np.append(variance, np.square(prior_sigmas)))
    design = np.stack([np.append(np.ones_like(angle), (1.0, 0.0)), np.append(angle, (0.0, 1.0))], axis=1)
    rows = weight[:, None] * design
    wanted = weight * np.append(measured, (0.0, 1.0))
    line: Array = np.linalg.lstsq(rows, wanted, rcond=None)[0].astype(np.float64)
    sigmas = np.sqrt(np.diagonal(np.linalg.inv(rows.T @ rows)))
    residual = wanted - rows @ line
    log_likelihood = -0.5 * float(residual @ residual + np.log(variance).sum())
    return line, sigmas, log_likelihood


def _are_in_order(angle: Array) -> bool:
    """Return true if angles (N,) [rad] of imprints rise from the first press to the last, by and large."""
    ranks = np.argsort(np.argsort(angle))
    return bool(np.corrcoef(np.arange(len(angle)), ranks)[0, 1] > _LIMITS.least_rank_correlation)


def imprint_angle(difference: Difference, sensor: SensorProfile) -> float:
    """Return the angle on the tip [rad] of the middle of an imprint, whatever its colours; NaN if there is none."""
    assert sensor.half_width
    strength = np.square(np.abs(difference).sum(axis=2)).sum(axis=0)
    if not strength.any():
        return math.nan
    column = (2.0 * np.arange(COLUMNS) + 1.0) / COLUMNS - 1.0
    return math.asin(float(strength @ column / strength.sum()) * sensor.shown * sensor.half_width / sensor.radius)
