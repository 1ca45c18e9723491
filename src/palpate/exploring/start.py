"""Rows before the first contact, by the stated sizes or the sketch and by the first pose."""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Complex, Flags
from palpate.config import Priors
from palpate.exploring.curve import (
    COEFFICIENTS,
    UNIT_CIRCLE,
    BaseCurve,
    base_about,
    deviations_about,
    form_deviations,
)
from palpate.exploring.rows import CENTER, CENTER_IN_OBJECT, CURVE, Place, Rows
from palpate.types.outline import Sketch, Unknown


@dataclass(frozen=True)
class _Settings:
    """Settings of the rows before the first contact."""

    count: int = 100
    """Number of rows."""
    seed: int = 66
    """Seed by which they are drawn."""
    even: float = 0.68
    """Friction radius of an even pressure as a share of the mean radius: 2/3 for a disc, more for other forms."""
    roundness: float = 0.03
    """Deviation of the logarithm of the mean radius in a row; the rows differ in it."""
    middle: float = 0.2
    """Deviation of the centre of friction from the origin of a first pose, as a share of the mean radius."""
    behind: float = 0.25
    """Deviation of the logarithm of the distance at which the centre of friction lies behind the contact that makes the
    object frame, from the mean radius."""
    beside: float = 0.5
    """Deviation of the centre of friction to the side of that contact's direction, as a share of the mean radius."""
    in_row: float = 0.15
    """Deviation of the centre of friction in a row, as a share of the mean radius."""


_SETTINGS = _Settings()


@dataclass(frozen=True, eq=False)
class _Forms:
    """Forms of B rows."""

    base: BaseCurve
    """Curve that all are about."""
    curve: Array
    """Coefficients of the curves (B, COEFFICIENTS)."""
    deviation: Array
    """Their standard deviations (COEFFICIENTS,)."""
    friction_radius: Array
    """Friction radius of an even pressure (B,) [m]."""
    pole: Complex
    """Poles of the curves in the object frame (B,), complex [m]."""
    center: Complex
    """Centre of friction in the object frame (B,), complex [m]."""
    center_deviation: Array
    """Its standard deviation along each axis (B,) [m]."""
    is_straight: Flags
    """True for rows that expect straight sides, (B,)."""


def rows_about_origin(given: Unknown | Sketch, pose: Array, covariance: Array, priors: Priors, tip: float) -> Rows:
    """Return the rows of an object whose first pose (3,) is known by its covariance (3, 3), tangent space at the pose.

    The origin of the object frame is roughly the middle of an unknown outline. `tip` is the radius of the tip [m].
    """
    generator = np.random.default_rng(_SETTINGS.seed)
    if isinstance(given, Sketch):
        forms = _forms_of_sketch(given, priors, tip, generator)
    else:
        radius = _radii(given, generator)
        off = generator.normal(0.0, _SETTINGS.middle, (2, len(radius)))
        forms = _unknown_forms(radius, radius * (off[0] + 1j * off[1]), tip)
    return _rows(forms, pose, covariance, priors, generator)


def rows_behind_contact(given: Unknown, pose: Array, covariance: Array, priors: Priors, tip: float) -> Rows:
    """Return the rows of an object whose frame a contact has made, half the least width behind it along x."""
    generator = np.random.default_rng(_SETTINGS.seed)
    radius = _radii(given, generator)
    distance = radius * np.exp(generator.normal(0.0, _SETTINGS.behind, len(radius)))
    beside = radius * generator.normal(0.0, _SETTINGS.beside, len(radius))
    center = distance - 0.5 * given.size[0] + 1j * beside
    return _rows(_unknown_forms(radius, center, tip), pose, covariance, priors, generator)


def _radii(given: Unknown, generator: np.random.Generator) -> Array:
    """Return mean radii (B,) [m] of the stated sizes, evenly spaced in their logarithm, in any order."""
    least, largest = given.size
    share = (np.arange(_SETTINGS.count) + 0.5) / _SETTINGS.count
    generator.shuffle(share)
    return 0.5 * least * (largest / least) ** share


def _unknown_forms(radius: Array, center: Complex, tip: float) -> _Forms:
    """Return unknown forms of mean radii (B,) [m]; every other one expects straight sides."""
    count = len(radius)
    curve = np.zeros((count, COEFFICIENTS))
    curve[:, 0] = np.log(radius + tip)
    return _Forms(
        base=UNIT_CIRCLE,
        curve=curve,
        deviation=np.concatenate(((_SETTINGS.roundness,), form_deviations())),
        friction_radius=_SETTINGS.even * radius,
        pole=center,
        center=center,
        center_deviation=_SETTINGS.in_row * radius,
        is_straight=np.arange(count) % 2 == 0,
    )


def _forms_of_sketch(given: Sketch, priors: Priors, tip: float, generator: np.random.Generator) -> _Forms:
    """Return forms about a sketch; half of the variance of the centre of friction is between the rows."""
    count = _SETTINGS.count
    center = complex(*given.shape.centroid)
    pole = complex(*given.pole)
    base = base_about(given.shape, pole, tip)
    mean_radius = float(np.exp(base.table[0].mean()))
    friction_radius = given.shape.friction_radius()
    center_deviation = math.sqrt(0.5) * math.hypot(priors.friction_center[1] * friction_radius, given.sigma)
    between = generator.normal(0.0, center_deviation, (2, count))
    return _Forms(
        base=base,
        curve=np.zeros((count, COEFFICIENTS)),
        deviation=deviations_about(given.sigma / mean_radius),
        friction_radius=np.full(count, friction_radius),
        pole=np.full(count, pole),
        center=center + between[0] + 1j * between[1],
        center_deviation=np.full(count, center_deviation),
        is_straight=np.zeros(count, np.bool_),
    )


def _rows(forms: _Forms, pose: Array, covariance: Array, priors: Priors, generator: np.random.Generator) -> Rows:
    """Return rows of these forms at a first pose (3,); half of the variance of friction is between the rows."""
    count = len(forms.center)
    between = np.sqrt(0.5) * np.array((priors.friction_ratio[1], priors.grip[1]))
    friction = generator.normal(0.0, between[:, None], (2, count))
    rotation = np.exp(1j * pose[2])
    center_in_world = complex(pose[0], pose[1]) + rotation * forms.center
    mean = np.zeros((count, CURVE.stop))
    mean[:, CENTER] = np.column_stack((center_in_world.real, center_in_world.imag))
    mean[:, Place.YAW] = pose[2]
    mean[:, CENTER_IN_OBJECT] = np.column_stack((forms.center.real, forms.center.imag))
    mean[:, Place.FRICTION_RADIUS] = 2.0 * np.log(forms.friction_radius) + priors.friction_ratio[0] + friction[0]
    mean[:, Place.GRIP] = priors.grip[0] + friction[1]
    mean[:, CURVE] = forms.curve
    variance = np.zeros((count, CURVE.stop))
    variance[:, CENTER_IN_OBJECT] = np.square(forms.center_deviation)[:, None]
    variance[:, Place.FRICTION_RADIUS] = between[0] ** 2
    variance[:, Place.GRIP] = between[1] ** 2
    variance[:, CURVE] = np.square(forms.deviation)
    whole = variance[:, :, None] * np.eye(CURVE.stop)
    _follow_pose(whole, forms.center, rotation, covariance)
    return Rows(
        mean=mean,
        covariance=whole,
        base=forms.base,
        pole=forms.pole,
        is_straight=forms.is_straight,
        family=np.arange(count),
        shoves=np.zeros(count, np.int64),
        log_weight=np.zeros(count),
    )


def _follow_pose(whole: Array, center: Complex, rotation: complex, covariance: Array) -> None:
    """Let the centre of friction in the world follow from that in the object and a pose with its covariance (3, 3)."""
    count = len(whole)
    by_given = np.zeros((count, 3, 5))  # centre and yaw by x, y and yaw of the pose and by the centre in the object
    columns: tuple[tuple[int, Complex], ...] = (
        (0, np.full(count, rotation)),
        (1, np.full(count, 1j * rotation)),
        (2, 1j * rotation * center),
        (3, np.full(count, rotation)),
        (4, np.full(count, 1j * rotation)),
    )
    for column, moved in columns:
        by_given[:, 0, column] = np.real(moved)
        by_given[:, 1, column] = np.imag(moved)
    by_given[:, 2, 2] = 1.0
    given = np.zeros((count, 5, 5))
    given[:, :3, :3] = covariance
    given[:, 3:, 3:] = whole[:, CENTER_IN_OBJECT, CENTER_IN_OBJECT]
    whole[:, :3, :3] = by_given @ given @ by_given.transpose(0, 2, 1)
    whole[:, :3, CENTER_IN_OBJECT] = by_given @ given[:, :, 3:]
    whole[:, CENTER_IN_OBJECT, :3] = whole[:, :3, CENTER_IN_OBJECT].transpose(0, 2, 1)
