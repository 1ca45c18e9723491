"""Knocks: when something else than the sensor moves the object, as simulation tells or ground truth shows.

What a push explains follows from quasi-static pushing. A touched object moves no point faster than `FASTER` times the
sensor. Where one tip touches, the outline moves with it along its normal; along the outline it moves between what the
push alone makes of it, as if there were no friction, and what the tip does, as if it stuck. The rest is unexplained:
a hand that slides the object along the tip shows in the second, one that turns it about the tip in the first.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.graph.contact_geometry import contact_model
from palpate.pipeline.truth import flag_runs, trusted_truth
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FASTER = 2.0
"""Times the sensor's motion from which on a push does not explain the object's. A quasi-static push by a
force at distance d from the centre moves no point faster than (R d + c^2) / (d^2 + c^2) times the contact,
where R is the farthest point of the outline and c the friction radius. Its largest value over d, (1 + sqrt(1
+ (R/c)^2)) / 2, is 1.4 for a disc, 1.6 for a square or a thin bar and reaches 2 at R = 2.8 c."""
SPEED = 0.05
"""[m/s] Unexplained speed that is a knock. In undisturbed real pushes noise and what is not known of friction make
0.022 m/s at most, and a contact flag that comes late 0.043; hands made 0.12 m/s and more."""
NOISES = 4.0
"""Median distances of a pose from the middle between its neighbours that noise of the capture moves an object by.
Of normal noise, one step in ten thousand is longer: sqrt(4 / 3) for the difference of two poses, times sqrt(ln 10^4 /
ln 2) for the tail."""
WINDOW = 0.1
"""[s] over which speeds are averaged: as long as a hand acts, and three frames of noise at 30 Hz."""
SHORT = 0.3
"""[s] Knocks that are closer are one, and so long the truth may be unknown where the object jumps meanwhile."""


def knocked_frames(recording: Recording) -> Flags:
    """Return the frames (N,) in which something else than the sensor moves the object.

    They are those that `extra["knocked"]` (N,) tells or, without it, those around which the object moves faster than
    the sensor and the noise of the capture explain. Where truth is not known nothing is a knock but what lies within
    one; without contact flags nothing is.
    """
    told = recording.extra.get("knocked")
    if told is not None and told.shape == recording.time.shape:
        return told > 0
    knocked = np.zeros(len(recording), np.bool_)
    known = np.flatnonzero(trusted_truth(recording))
    if len(known) < 2 or recording.contact is None:
        return knocked
    limit = np.maximum(SPEED, noise_speed(recording, known))
    knocked[known] = unexplained_speed(recording, known) > limit
    for first, last in flag_runs(~knocked):
        inner = first > 0 and last + 1 < len(knocked)
        if inner and recording.time[last + 1] - recording.time[first - 1] < SHORT:
            knocked[first : last + 1] = True
    return knocked


def unexplained_speed(recording: Recording, known: NDArray[np.intp]) -> Array:
    """Return how fast (M,) [m/s] the object moves beyond what the sensor explains, around each of M known frames.

    The recording has contact flags, and ground truth at the frames `known` (M,), two or more. Speeds are means over
    `WINDOW` or, where that holds too few known frames, from the one before to the one after; 0 where that is too long.
    """
    assert recording.object_pose is not None and recording.contact is not None
    contact, (before, after) = recording.contact[known], _windows(recording.time[known])
    objects, sensors = recording.object_pose[known], recording.sensor_pose[known]

    def farthest(pose: Array, points: Array) -> Array:
        """The farthest (M,) [m] that any of points (P, 2) [m] on the body moves from before to after."""
        placed = se2.transform(pose[:, None], points)
        return np.linalg.norm(placed[after] - placed[before], axis=-1).max(axis=-1)

    moved = farthest(objects, recording.shape.outline(40))
    touched = contact[before] | contact | contact[after]
    unexplained = moved - np.where(touched, FASTER * farthest(sensors, np.array(recording.sensor.tips)), 0.0)
    if len(recording.sensor.tips) == 1:
        held = contact[before] & contact & contact[after]
        at_tip = _unexplained_at_tip(recording, objects, sensors, before, after)
        unexplained = np.where(held, np.maximum(unexplained, at_tip), unexplained)
    seconds = recording.time[known][after] - recording.time[known][before]
    return np.where(seconds < SHORT + WINDOW, np.maximum(unexplained, 0.0), 0.0) / seconds


def noise_speed(recording: Recording, known: NDArray[np.intp]) -> Array:
    """Return how fast (M,) [m/s] noise of the capture may make an object seem, around each of M known frames.

    Noise is what a pose is off the middle between its neighbours, in the median, so that knocks do not count.
    """
    assert recording.object_pose is not None
    points = se2.transform(recording.object_pose[known][:, None], recording.shape.outline(40))
    off = np.linalg.norm(points[1:-1] - 0.5 * (points[:-2] + points[2:]), axis=-1).max(axis=-1)
    time = recording.time[known]
    before, after = _windows(time)
    return NOISES * (float(np.median(off)) if len(off) else 0.0) / (time[after] - time[before])


def _windows(time: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first and the last frame of the window around each of two or more frames at times (M,) [s]."""
    frame = np.arange(len(time))
    before = np.minimum(np.searchsorted(time, time - 0.5 * WINDOW), np.maximum(frame - 1, 0))
    after = np.searchsorted(time, time + 0.5 * WINDOW, side="right") - 1
    return before, np.maximum(after, np.minimum(frame + 1, frame[-1]))


def _unexplained_at_tip(
    recording: Recording, objects: Array, sensors: Array, before: NDArray[np.intp], after: NDArray[np.intp]
) -> Array:
    """The unexplained way (M,) [m] of the object's point that is nearest to the one tip."""
    model = contact_model(recording.shape, recording.sensor)
    touch = model.touching(se2.between(objects, sensors)[None])[0]
    point, normal, c = touch["point"] - model.friction_center, touch["normal"], model.friction_radius

    def moved(pose: Array, point: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """How a point of the body moves: along the outline's normal, and i times along the outline."""
        turn = np.exp(1j * pose[:, 2])
        way = pose[after, 0] - pose[before, 0] + 1j * (pose[after, 1] - pose[before, 1])
        return (way + (turn[after] - turn[before]) * point) * np.conj(normal * np.exp(1j * objects[:, 2]))

    way, tip = moved(objects, touch["point"]), moved(sensors, touch["material"])
    # A force along the normal at the arm (along the normal, along the outline) turns the object, so that its point
    # moves along the outline, too.
    arm = point * np.conj(normal)
    pushed = -arm.real * arm.imag / (c**2 + arm.imag**2) * way.real
    explained = np.clip(way.imag, np.minimum(pushed, tip.imag), np.maximum(pushed, tip.imag))
    return np.hypot(way.real - tip.real, way.imag - explained)
