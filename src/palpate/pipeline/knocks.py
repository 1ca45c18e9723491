"""Knocks: frames in which something other than the sensor moves the object.

Quasi-static pushing limits the motion that a push explains. A touched object moves no point faster than `faster` times
the sensor. Where one tip touches, the outline moves with it along its normal, and along the outline by something
between the motion without friction and that of the tip. The rest is unexplained.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.graph.contact_geometry import contact_model
from palpate.pipeline.truth import flag_runs, trusted_truth
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Frames = NDArray[np.intp]


@dataclass(frozen=True)
class Limits:
    """Limits of motion that a push and the noise of the capture explain."""

    faster: float = 2.0
    """Largest speed of the object over the sensor's. A force at distance d from the centre moves no point faster than
    (R d + c^2) / (d^2 + c^2) times the contact, with the outline's largest radius R and the friction radius c. Its
    largest value over d is 1.4 for a disc, 1.6 for a square or a thin bar and reaches 2 at R = 2.8 c."""
    speed: float = 0.05
    """Unexplained speed of a knock [m/s]: undisturbed real pushes have 0.043 at most, hands 0.12 and more."""
    noises: float = 4.0
    """Noise, in median distances of a pose from the middle between its neighbours; the difference of two poses is
    larger once in ten thousand steps."""
    window: float = 0.1
    """Time over which speeds are averaged [s]: as long as a hand acts, and three frames of noise at 30 Hz."""
    short: float = 0.3
    """Knocks that are closer are one, and truth may be unknown for this time while the object jumps [s]."""


LIMITS = Limits()


def knocked_frames(recording: Recording) -> Flags:
    """Return True at frames (N,) in which something other than the sensor moves the object.

    They are those of `extra["knocked"]` (N,), as a simulation knows; without it, those around which the object moves
    faster than the sensor and the noise of the capture explain. Frames without truth count only within a knock; without
    contact flags there are none.
    """
    simulated = recording.extra.get("knocked")
    if simulated is not None and simulated.shape == recording.time.shape:
        return simulated > 0
    knocked = np.zeros(len(recording), np.bool_)
    known = np.flatnonzero(trusted_truth(recording))
    if len(known) < 2 or recording.contact is None:
        return knocked
    limit = np.maximum(LIMITS.speed, noise_speed(recording, known))
    knocked[known] = unexplained_speed(recording, known) > limit
    for first, last in flag_runs(~knocked):
        inner = first > 0 and last + 1 < len(knocked)
        if inner and recording.time[last + 1] - recording.time[first - 1] < LIMITS.short:
            knocked[first : last + 1] = True
    return knocked


def unexplained_speed(recording: Recording, known: Frames) -> Array:
    """Return the speed (M,) [m/s] of the object that the sensor does not explain, at M known frames, two or more.

    Speeds are means over `window` or, if it holds too few known frames, between the two neighbours; 0 where these are
    too far apart.
    """
    assert recording.object_pose is not None and recording.contact is not None
    contact, (before, after) = recording.contact[known], _windows(recording.time[known])
    objects, sensors = recording.object_pose[known], recording.sensor_pose[known]

    def farthest(pose: Array, points: Array) -> Array:
        """Return the largest motion (M,) [m] of points (P, 2) [m] on a body from before to after."""
        placed = se2.transform(pose[:, None], points)
        return np.linalg.norm(placed[after] - placed[before], axis=-1).max(axis=-1)

    moved = farthest(objects, recording.shape.outline(40))
    touched = contact[before] | contact | contact[after]
    unexplained = moved - np.where(touched, LIMITS.faster * farthest(sensors, np.array(recording.sensor.tips)), 0.0)
    if len(recording.sensor.tips) == 1:
        held = contact[before] & contact & contact[after]
        at_tip = _unexplained_at_tip(recording, objects, sensors, before, after)
        unexplained = np.where(held, np.maximum(unexplained, at_tip), unexplained)
    seconds = recording.time[known][after] - recording.time[known][before]
    return np.where(seconds < LIMITS.short + LIMITS.window, np.maximum(unexplained, 0.0), 0.0) / seconds


def noise_speed(recording: Recording, known: Frames) -> Array:
    """Return the speed (M,) [m/s] that the noise of the capture may look like, at M known frames.

    Noise is the median distance of a pose from the middle between its neighbours, so that knocks do not count.
    """
    assert recording.object_pose is not None
    points = se2.transform(recording.object_pose[known][:, None], recording.shape.outline(40))
    off = np.linalg.norm(points[1:-1] - 0.5 * (points[:-2] + points[2:]), axis=-1).max(axis=-1)
    time = recording.time[known]
    before, after = _windows(time)
    return LIMITS.noises * (float(np.median(off)) if len(off) else 0.0) / (time[after] - time[before])


def _windows(time: Array) -> tuple[Frames, Frames]:
    """Return the first and the last frame of the window around each of two or more frames at times (M,) [s]."""
    frame = np.arange(len(time))
    before = np.minimum(np.searchsorted(time, time - 0.5 * LIMITS.window), np.maximum(frame - 1, 0))
    after = np.searchsorted(time, time + 0.5 * LIMITS.window, side="right") - 1
    return before, np.maximum(after, np.minimum(frame + 1, frame[-1]))


def _unexplained_at_tip(recording: Recording, objects: Array, sensors: Array, before: Frames, after: Frames) -> Array:
    """Return the unexplained motion (M,) [m] of the object's point that is nearest to the one tip."""
    model = contact_model(recording.shape, recording.sensor)
    touch = model.touching(se2.between(objects, sensors)[None])[0]
    point, normal, c = touch["point"] - model.friction_center, touch["normal"], model.friction_radius

    def moved(pose: Array, point: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the motion of a point of a body, along the outline's normal and, times i, along the outline."""
        turn = np.exp(1j * pose[:, 2])
        shift = pose[after, 0] - pose[before, 0] + 1j * (pose[after, 1] - pose[before, 1])
        return (shift + (turn[after] - turn[before]) * point) * np.conj(normal * np.exp(1j * objects[:, 2]))

    motion, tip = moved(objects, touch["point"]), moved(sensors, touch["material"])
    # A force along the normal turns the object, so its point moves along the outline too; arm is (normal, along).
    arm = point * np.conj(normal)
    pushed = -arm.real * arm.imag / (c**2 + arm.imag**2) * motion.real
    explained = np.clip(motion.imag, np.minimum(pushed, tip.imag), np.maximum(pushed, tip.imag))
    return np.hypot(motion.real - tip.real, motion.imag - explained)
