"""Evidence for the status: how well pose and outline are known, and what contradicts what was given of the outline."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.status import FormEvidence, PoseEvidence
from palpate.types.outline import Outline, Sketch, Unknown


@dataclass(frozen=True)
class _Settings:
    """Settings of the evidence on an outline."""

    far: float = 4.0
    """Standard deviations from which what was touched contradicts what was given of the outline."""
    widest_gap: float = 0.3
    """Longest part of an outline, as a share of it, that may be a guess between contacts from all sides."""


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


def form_evidence(outline: Outline, given: Unknown | Sketch, tolerance: float, has_directions: bool) -> FormEvidence:
    """Return the evidence on an outline, by what was given of it and a tolerance [m].

    `has_directions` says that touch measured directions or turns so far.
    """
    touched = outline.points[outline.touched]
    deviation = float(np.sqrt(np.mean(np.square(outline.deviation[outline.touched])))) if len(touched) else 0.0
    if isinstance(given, Sketch):
        return FormEvidence(
            untouched_share=0.0,
            deviation=deviation,
            is_beyond_tolerance=False,
            has_directions=True,
            from_sketch=_beyond_sketch(touched, given),
        )
    return FormEvidence(
        untouched_share=_widest_gap(outline),
        deviation=deviation,
        is_beyond_tolerance=2.0 * deviation > tolerance,
        has_directions=has_directions,
        exceeding_width=_beyond_size(outline, given),
    )


def _widest_gap(outline: Outline) -> float:
    """Return the longest part of an outline that was not touched, as a share of it, if it is too long; else 0."""
    places = np.flatnonzero(outline.touched)
    if not len(places):
        return 1.0
    gaps = np.diff(np.append(places, places[0] + len(outline.touched)))
    widest = float(gaps.max()) / len(outline.touched)
    return widest if widest > _SETTINGS.widest_gap else 0.0


def _beyond_size(outline: Outline, given: Unknown) -> float:
    """Return the width of what was touched [m] if it is larger than the stated size; else 0."""
    touched = outline.points[outline.touched]
    if len(touched) < 2:
        return 0.0
    width = float(np.ptp(touched, axis=0).max())
    sure = width - _SETTINGS.far * float(outline.deviation[outline.touched].max())
    return width if sure > given.size[1] else 0.0


def _beyond_sketch(touched: Array, given: Sketch) -> float:
    """Return the largest distance of touched points from the sketch [m], if it is implausible; else 0."""
    if not len(touched):
        return 0.0
    farthest = float(np.abs(given.shape.signed_distance(touched)).max())
    return farthest if farthest > _SETTINGS.far * given.sigma else 0.0
