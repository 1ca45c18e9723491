"""Ground truth of a recording: frames at which it can be trusted, and knocks that it shows.

A knock is motion that something other than the sensor causes. Quasi-static pushing limits the motion that a push
explains: a touched object moves no point faster than twice the sensor. The rest is unexplained. A force at distance d
from the centre moves no point faster than (R d + c^2) / (d^2 + c^2) times the contact, with the largest radius R of the
outline and the friction radius c; over all d this is at most 1.4 for a disc, 1.6 for a square
or a thin bar, and 2 at R = 2.8 c.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def known_truth(recording: Recording) -> Array:
    """Return ground truth (N, 3) where it can be trusted, NaN elsewhere."""
    truth = np.nan if recording.object_pose is None else recording.object_pose
    return np.where(recording.trusted_truth[:, None], truth, np.full((1, 3), np.nan))


def flag_runs(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def knocked_frames(recording: Recording) -> Flags:
    """Return True at frames (N,) in which something other than the sensor moves the object.

    A simulation knows them, `extra["knocked"]` (N,). Otherwise they are those around which the object moves faster than
    the sensor and the noise of the capture explain. Without contact flags there are none.
    """
    simulated = recording.extra.get("knocked")
    if simulated is not None and simulated.shape == recording.time.shape:
        return simulated > 0
    knocked = np.zeros(len(recording), np.bool_)
    known = np.flatnonzero(recording.trusted_truth)
    if len(known) < 2 or recording.contact is None or recording.object_pose is None:
        return knocked
    # Speeds are means over 0.1 s, as long as a hand acts and three frames of noise at 30 Hz; where that holds too few
    # known frames, between the two neighbours, and 0 if these are too far apart.
    time, contact, frame = recording.time[known], recording.contact[known], np.arange(len(known))
    before = np.minimum(np.searchsorted(time, time - 0.05), np.maximum(frame - 1, 0))
    after = np.searchsorted(time, time + 0.05, side="right") - 1
    after = np.maximum(after, np.minimum(frame + 1, len(known) - 1))
    seconds = time[after] - time[before]
    outline = se2.transform(recording.object_pose[known][:, None], recording.shape.outline(40))
    tips = se2.transform(recording.sensor_pose[known][:, None], np.array(recording.sensor.tips))
    moved, pushed = (np.linalg.norm(one[after] - one[before], axis=-1).max(axis=-1) for one in (outline, tips))
    touched = contact[before] | contact | contact[after]
    unexplained = np.maximum(moved - np.where(touched, 2.0 * pushed, 0.0), 0.0)
    speed = np.where(seconds < 0.4, unexplained, 0.0) / seconds
    # The noise of the capture is the median distance of a pose from the middle between its neighbours, so that knocks
    # do not count; the difference of two poses is larger than four of it once in ten thousand steps.
    off = np.linalg.norm(outline[1:-1] - 0.5 * (outline[:-2] + outline[2:]), axis=-1).max(axis=-1)
    noise = 4.0 * (float(np.median(off)) if len(off) else 0.0) / seconds
    # Undisturbed real pushes have an unexplained speed of 0.043 m/s at most, hands of 0.12 and more.
    knocked[known] = speed > np.maximum(0.05, noise)
    for first, last in flag_runs(~knocked):
        inner = first > 0 and last + 1 < len(knocked)
        if inner and recording.time[last + 1] - recording.time[first - 1] < 0.3:  # [s] one knock
            knocked[first : last + 1] = True
    return knocked
