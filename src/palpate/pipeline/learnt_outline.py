"""Scores of an outline that was learnt by touch, and of poses in an object frame that touch has made.

Without a drawing the object frame is what the first contact makes it. It is put where ground truth has the object at
the first frame of contact with truth, once for all frames: errors are those of the motion since.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.arrays import Array
from palpate.config import ANYWHERE_SIGMA
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Shape
from palpate.io.recording import Recording
from palpate.status import LACKS_DIRECTIONS
from palpate.types.choices import TactileChoice
from palpate.types.estimate import Estimate
from palpate.types.outline import Outline, Sketch, Unknown

logger = logging.getLogger(__name__)


def is_anywhere(sigma: Array) -> bool:
    """Return True for standard deviations (3,) [m, m, rad] of a first pose that nobody knows."""
    return bool(sigma[:2].max() >= ANYWHERE_SIGMA[0])


def largest_shape(outline: Unknown | Sketch | None) -> Shape | None:
    """Return the largest outline that an object may have; None for one that is known."""
    if isinstance(outline, Unknown):
        return Disc(0.5 * outline.size[1])
    return None if outline is None else outline.shape


def warn_of_flags_alone(recording: Recording, tactile: TactileChoice, outline: Unknown | Sketch | None) -> None:
    """Warn if a recording has nothing but contact flags to tell of an unknown outline."""
    reads_images = recording.image is not None and tactile in ("auto", "learnt")  # an oracle tells turns alone
    tells_direction = reads_images or len(recording.sensor.tips) > 1
    if isinstance(outline, Unknown) and not tells_direction:
        logger.warning("%s: %s", recording.file or "the recording", LACKS_DIRECTIONS)


def in_frame_of_truth(estimates: Sequence[Estimate], truth: Array) -> list[Estimate]:
    """Return the estimates with the object frame of the truth (N, 3), as it was at the first contact."""
    estimates = _since_first_contact(estimates)
    both = [k for k, one in enumerate(estimates) if one.contact and np.isfinite(truth[k]).all()]
    if not both:
        return list(estimates)
    first = both[0]
    other = se2.between(estimates[first].pose, truth[first])  # the frame of the truth in that of the estimates
    motion = se2.adjoint(se2.inverse(other))
    moved: list[Estimate] = []
    for one in estimates:
        answers = tuple(
            replace(
                answer,
                pose=se2.compose(answer.pose, other),
                covariance=motion @ answer.covariance @ motion.T,
            )
            for answer in one.answers
        )
        outline = one.outline
        if outline is not None:
            points = se2.transform(se2.inverse(other), np.vstack((outline.points, outline.origin)))
            outline = replace(outline, points=points[:-1], origin=points[-1])
        pose = se2.compose(one.pose, other)
        covariance = motion @ one.covariance @ motion.T
        moved.append(replace(one, pose=pose, covariance=covariance, answers=answers, outline=outline))
    return moved


def _since_first_contact(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Return the estimates, those before the first contact with its pose: until then there is no object frame."""
    first = next((one for one in estimates if one.contact), estimates[0])
    before = True
    placed: list[Estimate] = []
    for one in estimates:
        before = before and not one.contact
        placed.append(replace(one, pose=first.pose) if before else one)
    return placed


def outline_scores(outlines: Sequence[Outline], recording: Recording) -> dict[str, float | None]:
    """Return scores of the last of the learnt outlines, if there are any: what was touched, and how far off it is.

    The true outline is that of a recording with ground truth: without, the object frames have nothing in common.

    `outline_rms_mm` is the root mean square of the distances of touched points from the true outline, of all points in
    `outline_all_rms_mm`; `outline_in_95` is the share of all points within 1.96 standard deviations of it, of touched
    ones in `outline_touched_in_95`.
    """
    if not outlines:
        return {}
    outline = outlines[-1]
    scores: dict[str, float | None] = {
        "outline_touched_share": float(outline.touched.mean()),
        "outline_sigma_mm": 1e3 * outline.sigma,
    }
    if not recording.is_shape_known or not np.isfinite(recording.truth).any():
        return scores
    off = np.abs(recording.shape.signed_distance(outline.points))
    is_within = off <= 1.96 * outline.deviation
    has_touched = bool(outline.touched.any())
    return scores | {
        "outline_rms_mm": 1e3 * _rms(off[outline.touched]) if has_touched else None,
        "outline_touched_in_95": float(is_within[outline.touched].mean()) if has_touched else None,
        "outline_all_rms_mm": 1e3 * _rms(off),
        "outline_in_95": float(is_within.mean()),
    }


def _rms(values: Array) -> float:
    """Return the root mean square of values (N,)."""
    return float(np.sqrt(np.mean(np.square(values))))
