"""Recovery: how an estimate finds back after knocks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.pipeline.truth import flag_runs
from palpate.types.trajectory import Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FAR_MM, FAR_DEG = 10.0, 5.0
"""An estimate that is farther off than either is wrong."""
SEEN = 0.3
"""[s] of scored frames for which an estimate has to be near at least: one that is near at the very end may not stay."""
AFTER = (0.5, 1.0, 1.5, 2.0, 3.0)
"""[s] after a knock at which errors are told."""
BESIDE = 0.1
"""[s] by which a frame may lie beside such a time, for truth drops out."""
_ROUNDING = 1e-9  # [s]
_KEYS = ("knocks", "knock_recovery_s", "knock_recovery_contact_s", "knock_contact_s", "knock_error_mm")


def recovery(trajectory: Trajectory, translation: Array, rotation: Array, knocked: Flags | None) -> dict[str, Any]:
    """Return the part of `summary.json` that is about knocks.

    `translation` (N,) [mm] and `rotation` (N,) [deg], of any sign, are errors, NaN where truth is not known; `knocked`
    (N,) tells the frames of knocks, and without it all values are None.

    - knocks: how many there are.
    - knock_recovery_s: for each the time [s] from its last frame until the estimate is near the truth, by FAR_MM and
      FAR_DEG, and stays so in every scored frame before the next knock or the end. None where the last of them is far
      off, or where less than SEEN are left: how long it would have taken is not known.
    - knock_recovery_contact_s: the same, time in contact only.
    - knock_contact_s: for each the time in contact [s] until the last scored frame before the next knock or the end.
    - knock_error_mm: by the seconds after a knock ("0.5") the error then for each; None where it is not known before
      the next one.
    """
    if knocked is None:
        return dict.fromkeys(_KEYS)
    time, interval = trajectory.time, np.diff(trajectory.time, prepend=trajectory.time[0])
    contact = np.zeros(len(time), np.bool_) if trajectory.contact is None else trajectory.contact
    scored, far = np.isfinite(translation), is_far(translation, rotation)
    in_contact, in_score = np.cumsum(interval * contact), np.cumsum(interval * scored)
    runs = flag_runs(knocked)
    seconds: list[float | None] = []
    contact_seconds: list[float | None] = []
    contact_after: list[float] = []
    errors: list[list[float | None]] = []
    ends = [*(first for first, _ in runs), len(time)][1:]
    for (_, last), following in zip(runs, ends, strict=True):
        frames = last + np.flatnonzero(scored[last:following])
        lasting = frames[np.cumsum(far[frames][::-1])[::-1] == 0]  # those that no far one follows
        is_seen = len(lasting) > 0 and in_score[lasting[-1]] - in_score[lasting[0]] > SEEN - _ROUNDING
        found, until = lasting[0] if is_seen else None, frames[-1] if len(frames) else last
        seconds.append(None if found is None else float(time[found] - time[last]))
        contact_seconds.append(None if found is None else float(in_contact[found] - in_contact[last]))
        contact_after.append(float(in_contact[until] - in_contact[last]))
        errors.append([_nearest(time[frames] - time[last], translation[frames], after) for after in AFTER])
    by_time = {f"{after:g}": [each[k] for each in errors] for k, after in enumerate(AFTER)}
    return dict(zip(_KEYS, (len(runs), seconds, contact_seconds, contact_after, by_time), strict=True))


def is_far(translation: Array, rotation: Array) -> Flags:
    """Return the frames (N,) whose errors, (N,) [mm] and (N,) [deg], are beyond FAR_MM or FAR_DEG."""
    return (translation > FAR_MM) | (np.abs(rotation) > FAR_DEG)


def unfelt(knocked: Flags, contact: Flags) -> Flags:
    """Return the frames (N,) in which the object has been knocked and not touched since."""
    frames = np.arange(len(knocked))
    last_knocked, last_touched = (np.maximum.accumulate(np.where(flags, frames, -1)) for flags in (knocked, contact))
    return last_knocked > last_touched


def _nearest(time: Array, error: Array, wanted: float) -> float | None:
    """The error at the frame nearest to a time; None where there is none beside it."""
    off = np.abs(time - wanted)
    return float(error[np.argmin(off)]) if len(off) and off.min() < BESIDE + _ROUNDING else None
