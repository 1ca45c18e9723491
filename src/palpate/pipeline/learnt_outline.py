"""Scores of an outline that was learnt by touch, and of poses in an object frame that touch has made.

Without a drawing the object frame is what the first contact makes it. It is put where ground truth has the object at
the first frame of contact with truth, once for all frames: errors are those of the motion since.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate.types.estimate import Estimate
from palpate.types.outline import Outline


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
            outline = replace(outline, points=se2.transform(se2.inverse(other), outline.points))
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


def outline_scores(outline: Outline | None, recording: Recording) -> dict[str, float | None]:
    """Return scores of a learnt outline, if there is one: the share that was touched, and how far off a true one it is.

    The true one is that of a recording with ground truth: without, the object frames have nothing in common.

    `outline_rms_mm` is the root mean square of the distances of touched points from the true outline, of all points in
    `outline_all_rms_mm`; `outline_in_95` are the shares of all points that are within 1.96 standard deviations of it.
    """
    if outline is None:
        return {}
    scores: dict[str, float | None] = {
        "outline_touched_share": float(outline.touched.mean()),
        "outline_sigma_mm": 1e3 * outline.sigma,
    }
    if not np.isfinite(recording.truth).any():
        return scores
    off = np.abs(recording.shape.signed_distance(outline.points))
    touched = off[outline.touched]
    scores["outline_rms_mm"] = 1e3 * float(np.sqrt(np.mean(touched**2))) if len(touched) else None
    scores["outline_all_rms_mm"] = 1e3 * float(np.sqrt(np.mean(off**2)))
    scores["outline_in_95"] = float(np.mean(off <= 1.96 * outline.deviation))
    return scores
