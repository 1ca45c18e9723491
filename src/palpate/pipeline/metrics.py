"""Figures of merit of a tracked trajectory. Frames without trusted truth are NaN and left out."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2
from palpate.pipeline.poses import world_sigma
from palpate.pipeline.recovery import is_far, recovery, unfelt
from palpate.types.trajectory import Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CONTENT = ("tracking", "resting")
"""Statuses of an estimate that calls itself right."""
PERCENTILES = {"p50": 50, "p95": 95, "p99": 99, "max": 100}


def translation_errors(pose: ArrayLike, truth: ArrayLike) -> Array:
    """Distances (N,) [m] between estimated and true poses (N, 3)."""
    difference = np.asarray(pose)[..., :2] - np.asarray(truth)[..., :2]
    return np.hypot(difference[..., 0], difference[..., 1])


def rotation_errors(pose: ArrayLike, truth: ArrayLike) -> Array:
    """Signed angles (N,) [rad] from true to estimated poses (N, 3), in (-pi, pi]."""
    return se2.wrap(np.asarray(pose, dtype=np.float64)[..., 2] - np.asarray(truth)[..., 2])


def deviations(covariance: ArrayLike) -> tuple[Array, Array]:
    """Return how long [m] and how large [rad] errors of covariances (N, 3, 3) are, root mean square, (N,) each."""
    variance = np.diagonal(np.asarray(covariance, dtype=np.float64), axis1=1, axis2=2)
    return np.sqrt(variance[:, 0] + variance[:, 1]), np.sqrt(variance[:, 2])


def nees(pose: ArrayLike, covariance: ArrayLike, truth: ArrayLike) -> Array:
    """Normalised estimation error squared (N,): d^T covariance^-1 d with d = log(estimate^-1 truth).

    The covariance (N, 3, 3) is that of the right tangent space at the estimate, as d is. The mean over
    independent frames is 3 if the covariance is right. NaN where the covariance is singular.
    """
    d = se2.log(se2.between(pose, truth))
    covariance = np.asarray(covariance, dtype=np.float64)
    usable = np.isfinite(d).all(axis=-1) & (np.linalg.det(covariance) > 0.0)
    found = np.full(len(d), np.nan)
    d = d[usable]
    found[usable] = np.einsum("ni,ni->n", d, np.linalg.solve(covariance[usable], d[..., None])[..., 0])
    return found


def inside_95(nees: ArrayLike) -> Flags:
    """Say whether each true pose is in the 95 % region of its estimate, (N,) from the NEES (N,); not so where NaN."""
    from scipy.special import chdtri  # as scipy.stats.chi2.isf, without the second that importing that takes

    return np.asarray(nees) <= chdtri(3, 0.05)


def rms(errors: ArrayLike) -> float | None:
    """Root mean square of errors (N,), NaN left out; None if there are none."""
    return None if (known := _known(errors)) is None else float(np.sqrt(np.mean(known**2)))


def percentiles(values: ArrayLike) -> dict[str, float]:
    """The 50th, 95th and 99th percentile and the largest of values (N,)."""
    values = np.asarray(values, dtype=np.float64)
    return {name: float(np.percentile(values, share)) for name, share in PERCENTILES.items()}


def summarise(
    trajectory: Trajectory,
    truth: Array | None,
    step_ms: ArrayLike,
    *,
    tactile: str,
    smoother: str,
    wall_s: float,
    episodes: int,
    knocked: Flags | None = None,
    yaw_shows: bool = True,
) -> dict[str, Any]:
    """Return the content of `summary.json`.

    `truth` (N, 3) is NaN where it is not known or not trusted. `final_pose` is world_T_object of the last frame [m, m,
    rad], and `final_sigma` its standard deviations along the world's axes. Final errors are those of the last frame
    with truth, whose time is `final_scored_time_s`; what needs truth or covariance that is not there is None.
    `coverage` says what the in_95_... are, `recovery` what is told of knocks, whose frames are `knocked` (N,); unless
    `yaw_shows`, as that of a disc does not, it is left out there.
    `silently_wrong_share` is of the frames since the first contact, as they are: those that `is_far` and that are
    outside the 95 % region while their status is one of CONTENT. `silently_wrong_unfelt_share` is the part of it that
    nothing could tell: the object was knocked and has not been touched since. It is None without knocks.
    `ambiguous_share` is of the frames in contact: those with that status.
    """
    if truth is None:
        truth = np.full((len(trajectory), 3), np.nan)
    translation = translation_errors(trajectory.pose, truth) * 1e3
    rotation = np.degrees(rotation_errors(trajectory.pose, truth))
    scored = np.flatnonzero(np.isfinite(translation))
    last = int(scored[-1]) if len(scored) else None
    squared, covariance = np.full(len(trajectory), np.nan), trajectory.covariance
    if covariance is not None:
        squared = nees(trajectory.pose, covariance, truth)
    consistency = _known(squared)
    contact = np.zeros(len(trajectory), np.bool_) if trajectory.contact is None else trajectory.contact
    wrong = is_far(translation, rotation) & ~inside_95(squared)
    silent = silent_unfelt = ambiguous = None
    if trajectory.status is not None:
        ambiguous = _share((np.asarray(trajectory.status) == "ambiguous")[contact])
        is_silent, since = wrong & np.isin(trajectory.status, CONTENT), since_contact(contact, squared)
        silent = _share(is_silent[since])
        if knocked is not None:
            silent_unfelt = _share((is_silent & unfelt(knocked, contact))[since])
    return {
        "frames": len(trajectory),
        "contact_frames": int(np.sum(contact)),
        "episodes": episodes,
        "tactile": tactile,
        "smoother": smoother,
        "wall_s": float(wall_s),
        "step_ms": percentiles(step_ms),
        "final_pose": trajectory.pose[-1].tolist(),
        "final_sigma": None if covariance is None else world_sigma(trajectory.pose[-1], covariance[-1]).tolist(),
        "translation_rmse_mm": rms(translation),
        "rotation_rmse_deg": rms(rotation),
        "final_translation_error_mm": None if last is None else float(translation[last]),
        "final_rotation_error_deg": None if last is None else abs(float(rotation[last])),
        "nees_mean": None if consistency is None else float(np.mean(consistency)),
        "statuses": dict(Counter(trajectory.status or ())),
        "yaw_shows": yaw_shows,
        "scored_frames": len(scored),
        "final_scored_time_s": None if last is None else float(trajectory.time[last]),
        **coverage(contact, squared),
        "silently_wrong_share": silent,
        "silently_wrong_unfelt_share": silent_unfelt,
        "ambiguous_share": ambiguous,
        **recovery(trajectory, translation, rotation if yaw_shows else 0.0 * rotation, knocked),
    }


def coverage(contact: Flags, nees: Array) -> dict[str, Any]:
    """Return how well the covariance covers the truth, from contact flags (N,) and the NEES (N,), NaN where not known.

    They are shares of frames in the 95 % region since the first contact: `in_95_share` of all, `in_95_contact_share` of
    those in contact, `in_95_rest_share` of the others; `in_95_final` tells whether the last one is in it. What has no
    frames is None.
    """
    inside, since = inside_95(nees), since_contact(contact, nees)
    return {
        "in_95_share": _share(inside[since]),
        "in_95_contact_share": _share(inside[since & contact]),
        "in_95_rest_share": _share(inside[since & ~contact]),
        "in_95_final": bool(inside[since][-1]) if since.any() else None,
    }


def since_contact(contact: Flags, nees: Array) -> Flags:
    """Return the frames (N,) with a NEES from the first contact on, before which the pose is as good as given."""
    return np.maximum.accumulate(contact) & np.isfinite(nees)


def _share(flags: Flags) -> float | None:
    return float(np.mean(flags)) if len(flags) else None


def _known(values: ArrayLike) -> Array | None:
    values = np.asarray(values, dtype=np.float64)
    known = values[np.isfinite(values)]
    return known if len(known) else None
