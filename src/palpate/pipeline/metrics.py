"""Scores of a tracked trajectory: errors, coverage and consistency.

Frames without trusted ground truth have NaN errors and are not scored.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Flags
from palpate.geometry import se2
from palpate.models.pushing.layout import NAMES
from palpate.status import is_unknown
from palpate.types.estimate import Answers, Origin, Trajectory

CONTENT = ("tracking", "resting")
"""Statuses of an estimate that reports no doubt."""
PERCENTILES = {"p50": 50, "p95": 95, "p99": 99, "max": 100}
_CHI_SQUARE_OF_POSE = 7.814727903251178
"""95 % point of chi-square with 3 degrees of freedom."""
_CHI_SQUARE_OF_POSITION = 5.991464547107979
"""The same with 2."""


def flag_runs(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def translation_errors(pose: ArrayLike, truth: ArrayLike) -> Array:
    """Return the distances (N,) [m] between estimated and true poses (N, 3)."""
    difference = np.asarray(pose)[..., :2] - np.asarray(truth)[..., :2]
    return np.hypot(difference[..., 0], difference[..., 1])


def rotation_errors(pose: ArrayLike, truth: ArrayLike) -> Array:
    """Return the signed angles (N,) [rad] from true to estimated poses (N, 3), in (-pi, pi]."""
    return se2.wrap(np.asarray(pose, dtype=np.float64)[..., 2] - np.asarray(truth)[..., 2])


def deviations(covariance: ArrayLike) -> tuple[Array, Array]:
    """Return the RMS translation [m] and rotation [rad] errors that covariances (N, 3, 3) predict, (N,) each."""
    variance = np.diagonal(np.asarray(covariance, dtype=np.float64), axis1=1, axis2=2)
    return np.sqrt(variance[:, 0] + variance[:, 1]), np.sqrt(variance[:, 2])


def nees(pose: ArrayLike, covariance: ArrayLike, truth: ArrayLike) -> Array:
    """Return the normalised estimation error squared (N,): d^T covariance^-1 d with d = log(estimate^-1 truth).

    The mean over independent frames is 3 if the covariance (N, 3, 3) is right. NaN where it is singular.
    """
    return _squared(se2.log(se2.between(pose, truth)), np.asarray(covariance, dtype=np.float64))


def _squared(d: Array, covariance: Array) -> Array:
    """Return d^T covariance^-1 d (N,) of errors (N, D) with covariances (N, D, D); NaN where it is singular."""
    is_usable = np.isfinite(d).all(axis=-1) & (np.linalg.det(covariance) > 0.0)
    squared = np.full(len(d), np.nan)
    d = d[is_usable]
    weighted = np.linalg.solve(covariance[is_usable], d[..., None])[..., 0]
    squared[is_usable] = np.einsum("ni,ni->n", d, weighted)
    return squared


def inside_95(nees: ArrayLike) -> Flags:
    """Return flags (N,) of true poses in the 95 % region of their estimate, from the NEES (N,); false for NaN."""
    return np.asarray(nees) <= _CHI_SQUARE_OF_POSE


def log_likelihood(nees: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the log density [nats] of true poses under their estimates (N,), from the NEES (N,); NaN where it is.

    It is a proper score: neither too wide nor too narrow a covariance raises it. The density is per m^2 rad.
    """
    log_determinant = np.linalg.slogdet(np.asarray(covariance, dtype=np.float64))[1]
    return -0.5 * (np.asarray(nees) + log_determinant + 3.0 * np.log(2.0 * np.pi))


def gain_by_rescaling(nees: ArrayLike) -> float:
    """Return the gain of a mean log likelihood [nats] by the best common factor on covariances, mean NEES / 3."""
    mean = max(float(np.mean(np.asarray(nees))), 1e-12)  # estimates without any error would gain infinitely
    return 0.5 * (mean - 3.0 - 3.0 * float(np.log(mean / 3.0)))


def crps(error: ArrayLike, deviation: ArrayLike) -> Array:
    """Return the continuous ranked probability score of errors (...) under normals of deviations (...), in their unit.

    Smaller is better; for a deviation of 0 it is the size of the error.
    """
    sigma = np.asarray(deviation)
    z = np.asarray(error) / sigma
    inside = np.vectorize(math.erf, otypes=[float])(z / math.sqrt(2.0))
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return sigma * (z * inside + 2.0 * density - 1.0 / np.sqrt(np.pi))


def silently_wrong(online: Trajectory, truth: Array, center: ArrayLike, yaw_shows: bool) -> Flags:
    """Return flags (N,) of estimates that are far off, outside their 95 % region, and with a status in CONTENT.

    Far is 10 mm at the outline's centroid, `center` (2,) [m] in the object frame, or 5 degrees. If no yaw shows, as on
    a disc, it is neither far nor outside.
    """
    at_center = np.append(np.asarray(center, np.float64), 0.0)
    distance = translation_errors(se2.compose(online.pose, at_center), se2.compose(truth, at_center))
    angle = np.abs(rotation_errors(online.pose, truth)) if yaw_shows else np.zeros(len(online))
    is_far = (distance > 0.010) | (angle > math.radians(5.0))
    is_inside = inside_95(nees(online.pose, online.covariance, truth))
    if not yaw_shows:
        position = se2.log(se2.between(online.pose, truth))[:, :2]
        is_inside = _squared(position, online.covariance[:, :2, :2]) <= _CHI_SQUARE_OF_POSITION
    return is_far & ~is_inside & np.isin(online.status, CONTENT)


def rms(errors: ArrayLike) -> float | None:
    """Return the root mean square of errors (N,) without NaN; None if there are none."""
    mean = _mean(np.square(np.asarray(errors, np.float64)))
    return None if mean is None else float(np.sqrt(mean))


def percentiles(values: ArrayLike) -> dict[str, float]:
    """Return the 50th, 95th and 99th percentile and the maximum of values (N,)."""
    return {name: float(np.percentile(np.asarray(values), percent)) for name, percent in PERCENTILES.items()}


def world_sigma(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the standard deviations (3,) [m, m, rad] of a pose (3,) along the world's x and y, and of its yaw.

    The covariance (3, 3) is in the tangent space at the pose (right, body frame), order x, y, theta.
    """
    covariance = np.asarray(covariance, dtype=np.float64)
    rotation = se2.rotation(np.asarray(pose, dtype=np.float64)[2])
    position = rotation @ covariance[:2, :2] @ rotation.T
    return np.sqrt([position[0, 0], position[1, 1], covariance[2, 2]])


def pose_words(pose: ArrayLike, sigma: ArrayLike) -> str:
    """Return a pose (3,) [m, m, rad] with its standard deviations (3,) as text in mm and degrees."""
    units = np.array((1e3, 1e3, 180.0 / np.pi))
    x, y, yaw = np.asarray(pose) * units
    sigma_x, sigma_y, sigma_yaw = np.asarray(sigma) * units
    position = f"x {x:.1f} ± {sigma_x:.1f} mm, y {y:.1f} ± {sigma_y:.1f} mm"
    if is_unknown(float(np.asarray(sigma)[2])):
        return f"{position}, yaw unknown"
    return f"{position}, yaw {yaw:.1f} ± {sigma_yaw:.1f}°"


def summarise(
    online: Trajectory,
    truth: Array,
    step_ms: ArrayLike,
    *,
    center: ArrayLike = (0.0, 0.0),
    yaw_shows: bool = True,
    **about: Any,
) -> dict[str, Any]:
    """Return the content of `summary.json`, with `about` in it; scores that need truth are None without any.

    `truth` (N, 3) is NaN where it is not known and trusted; `center` (2,) [m] is the outline's centroid in the object
    frame, and `yaw_shows` is false for a disc. Final errors are of the last frame with truth. The shares `in_95` and
    `silently_wrong`, see that function, are of the frames since the first contact. `nats` and `sigma_mm` are of frames
    in contact.
    """
    translation = translation_errors(online.pose, truth) * 1e3
    rotation = np.degrees(rotation_errors(online.pose, truth))
    scored = np.flatnonzero(np.isfinite(translation))
    last = int(scored[-1]) if len(scored) else None
    squared = nees(online.pose, online.covariance, truth)
    inside = inside_95(squared)
    since = since_contact(online.contact, squared)
    silent = silently_wrong(online, truth, center, yaw_shows)
    return {
        "frames": len(online),
        "contact_frames": int(np.sum(online.contact)),
        "episodes": len(flag_runs(online.contact)),
        **about,
        "step_ms": percentiles(step_ms),
        "final_status": online.status[-1],
        "final_pose": online.pose[-1].tolist(),
        "final_sigma": world_sigma(online.pose[-1], online.covariance[-1]).tolist(),
        "translation_rmse_mm": rms(translation),
        "rotation_rmse_deg": rms(rotation),
        "final_translation_error_mm": None if last is None else float(translation[last]),
        "final_rotation_error_deg": None if last is None else abs(float(rotation[last])),
        "nees_mean": _mean(squared),
        **_contact_scores(online, truth, squared, since & online.contact),
        "statuses": dict(Counter(online.status)),
        "yaw_shows": yaw_shows,
        "scored_frames": len(scored),
        "final_scored_time_s": None if last is None else float(online.time[last]),
        "in_95_share": _mean(inside[since]),
        "in_95_contact_share": _mean(inside[since & online.contact]),
        "in_95_rest_share": _mean(inside[since & ~online.contact]),
        "in_95_final": bool(inside[since][-1]) if since.any() else None,
        "silently_wrong_share": _mean(silent[since]),
        "ambiguous_share": _mean((np.array(online.status) == "ambiguous")[online.contact]),
    }


def _contact_scores(online: Trajectory, truth: Array, squared: Array, frames: Flags) -> dict[str, float | None]:
    """Return scores of the covariance at flagged frames (N,) of contact, with the NEES (N,) of all frames."""
    nats = log_likelihood(squared, online.covariance)[frames]
    error = se2.log(se2.between(online.pose, truth))[frames, :2]
    sigma = np.sqrt(np.diagonal(online.covariance, axis1=1, axis2=2)[frames, :2])
    translation_sigma = deviations(online.covariance)[0][frames]
    return {
        "nats": _mean(nats),
        "nats_rescaled": _mean(nats + gain_by_rescaling(squared[frames])) if len(nats) else None,
        "crps_mm": _mean(1e3 * crps(error, sigma)),
        "sigma_mm": float(np.median(1e3 * translation_sigma)) if len(nats) else None,
    }


def ambiguous_by_origin(status: Sequence[str], answers: Answers) -> dict[Origin, float]:
    """Return the share of ambiguous frames that have an answer of an origin, for each origin but "as before".

    It says why a run is ambiguous. The shares may add up to more than 1, as a frame may have answers of several
    origins. Empty if none of the N frames is ambiguous.
    """
    ambiguous = [several for word, several in zip(status, answers, strict=True) if word == "ambiguous"]
    shares: dict[Origin, float] = {}
    for origin in get_args(Origin):
        count = sum(any(answer.origin == origin for answer in several) for several in ambiguous)
        if count and origin != "as before":
            shares[origin] = count / len(ambiguous)
    return shares


def innovation_scores(
    innovations: Sequence[Array | None], names: Sequence[str] = NAMES
) -> dict[str, dict[str, float | None]]:
    """Return scores of the `Estimate.innovations` of N frames for each factor that has some; 1, 1 and 0 are right.

    `names` are those of all factors.

    The mean square is that of innovations over their standard deviation, of prediction and measurement together. The
    variance ratio is that of their squares over the stated variance alone, where this is no less than a hundredth of
    the predicted one. The autocorrelation is from frame to frame.
    """
    empty = np.zeros((len(names), 6, 3))
    rows = np.array([empty if frame is None else frame for frame in innovations])
    scores = {}
    for factor, name in enumerate(names):
        value = rows[:, factor, :, 0]
        predicted = rows[:, factor, :, 1]
        stated = rows[:, factor, :, 2]
        is_measured = stated > 0.0
        if not is_measured.any():
            continue
        sigma = np.sqrt(predicted + stated)
        normalised = np.divide(value, sigma, where=is_measured, out=np.full_like(value, np.nan))
        mean_square = _mean(normalised**2) or 0.0
        product = _mean(normalised[1:] * normalised[:-1])
        is_tested = is_measured & (predicted < 100.0 * stated)
        scores[name] = {
            "count": int(is_measured.sum()),
            "mean_square": mean_square,
            "variance_ratio": _mean(value[is_tested] ** 2 / stated[is_tested]),
            "autocorrelation": product / mean_square if product is not None and mean_square else None,
        }
    return scores


def since_contact(contact: Flags, nees: Array) -> Flags:
    """Return flags of frames with a NEES from the first contact on; before it the pose is as good as the given one."""
    return np.maximum.accumulate(contact) & np.isfinite(nees)


def _mean(values: Array | Flags) -> float | None:
    """Return the mean of values (N,) without NaN; None if there are none."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else None
