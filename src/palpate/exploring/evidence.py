"""Evidence for the status: how well pose and outline are known, and what contradicts the stated sizes or the sketch."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Integers
from palpate.status import FormEvidence, PoseEvidence
from palpate.types.outline import Outline, Sketch, Unknown


@dataclass(frozen=True)
class _Settings:
    """Settings of the evidence on an outline."""

    far: float = 4.0
    """Standard deviations from which a contact contradicts the sketch."""
    size: float = 1.2
    """Error of the mean radius that contradicts the sketch [standard deviations of the sketch]. It is smaller than that
    of a single contact, as errors all around an outline mostly cancel in the mean."""
    apart: float = 1.5
    """Standard deviations of each of two contacts by which these are farther apart than the stated size if they
    contradict it: less than for a sketch, as they have most of the error of their poses in common."""
    ways: int = 16
    """Number of directions along which the width of what was touched is measured."""
    often: float = 0.2
    """Share of contacts up to which something else may have moved the object, as it always may a single time."""


_SETTINGS = _Settings()


def pose_evidence(
    covariance: Array, in_contact: bool, tolerance: tuple[float, float], form: FormEvidence
) -> PoseEvidence:
    """Return the evidence of a pose with its covariance (3, 3), by a tolerance [m, rad], and of its outline."""
    x, y, yaw = np.sqrt(covariance.diagonal()).tolist()
    position = max(x, y)
    length, angle = tolerance
    return PoseEvidence(
        in_contact=in_contact,
        position_deviation=position,
        yaw_deviation=yaw,
        is_beyond_tolerance=2.0 * position > length or 2.0 * yaw > angle,
        form=form,
    )


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points where a tip has touched, by the pose at that time."""

    points: Array
    """(C, 2) [m], object frame."""
    deviation: Array
    """Standard deviation of each by that of the pose, (C,) [m]."""
    number: Integers
    """Number of the contact of each, (C,)."""
    count: int = 0
    """Number of contacts, each of which has one point or more."""
    shoved: float = 0.0
    """Number of those before which something else has moved the object, as it is expected."""


def form_evidence(
    outline: Outline, contacts: Contacts, given: Unknown | Sketch, tolerance: float, has_directions: bool
) -> FormEvidence:
    """Return the evidence on an outline, by its contacts, the stated sizes or the sketch, and a tolerance [m].

    `has_directions` says that touch measured directions or turns so far.
    """
    touched = outline.deviation[outline.touched]
    deviation = float(np.sqrt(np.mean(np.square(touched)))) if len(touched) else 0.0
    if isinstance(given, Sketch):
        return FormEvidence(
            untouched_share=0.0,
            deviation=deviation,
            is_beyond_tolerance=False,
            has_directions=True,
            from_sketch=_beyond_sketch(contacts, given),
            larger_than_sketch=_other_size(outline, given),
            shoved_share=_often_shoved(contacts),
        )
    return FormEvidence(
        untouched_share=outline.guessed_share,
        deviation=deviation,
        is_beyond_tolerance=2.0 * deviation > tolerance,
        has_directions=has_directions,
        exceeding_width=_beyond_size(contacts, given),
    )


def _often_shoved(contacts: Contacts) -> float:
    """Return the share of contacts in which something else seems to have moved the object, if it is large; else 0."""
    return contacts.shoved / contacts.count if _is_often(contacts.shoved, contacts) else 0.0


def _is_often(times: float, contacts: Contacts) -> bool:
    """Return True for more times than something else may have moved the object; never before a first contact."""
    return times > (max(_SETTINGS.often * contacts.count, 1.0) if contacts.count > 1 else 0.0)


def _beyond_size(contacts: Contacts, given: Unknown) -> float:
    """Return the width of what was touched [m] if it is larger than the stated size; else 0."""
    if len(contacts.points) < 2:
        return 0.0
    angle = np.arange(_SETTINGS.ways) * (np.pi / _SETTINGS.ways)
    along = contacts.points @ np.stack((np.cos(angle), np.sin(angle)))
    slack = _SETTINGS.apart * contacts.deviation[:, None]
    sure = (along - slack).max(axis=0) - (along + slack).min(axis=0)
    widest = int(np.argmax(sure))
    return float(np.ptp(along[:, widest])) if sure[widest] > given.size[1] else 0.0


def _other_size(outline: Outline, given: Sketch) -> float:
    """Return by how much the outline's mean radius is larger than the sketch's, as a share, if implausibly; else 0."""
    radius = float(np.sqrt(np.mean(np.square(outline.points - outline.origin).sum(axis=1))))  # of a disc of its area
    drawn = float(np.sqrt(given.shape.area / np.pi))
    return radius / drawn - 1.0 if abs(radius - drawn) > _SETTINGS.size * given.sigma else 0.0


def _beyond_sketch(contacts: Contacts, given: Sketch) -> float:
    """Return the largest distance of a contact from the sketch [m], if many are implausibly far; else 0.

    The first after the object was moved by something else are so, too.
    """
    if not len(contacts.points):
        return 0.0
    distance = np.abs(given.shape.signed_distance(contacts.points))
    allowed = _SETTINGS.far * np.hypot(given.sigma, contacts.deviation)
    far = distance > allowed
    is_often = _is_often(len(np.unique(contacts.number[far])), contacts)
    return float(distance[far].max()) if is_often else 0.0
