"""Tracking a whole recording."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import FrameError, SettingError
from palpate.estimate import Estimate
from palpate.estimation.settings import NoiseSettings
from palpate.geometry.shapes import Disc, shape_to_dict
from palpate.recording.derived import gaps
from palpate.recording.frame import Frame
from palpate.recording.recording import Recording
from palpate.recording.sensor import sensor_to_dict
from palpate.recording.trajectory import Trajectory
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, turned_as
from palpate.touch.lift import Lift, lift_of
from palpate.touch.model import TouchModel, shipped_model
from palpate.touch.modes import TactileChoice
from palpate.touch.steady import first_frames
from palpate.tracker import Tracker
from palpate.tracker_settings import TrackerSettings
from palpate.tracking.details import Answers
from palpate.tracking.failed_step import write_failed_step
from palpate.tracking.knocks import knocked_frames
from palpate.tracking.metrics import summarise
from palpate.tracking.steps import Saving, Steps, load_steps
from palpate.tracking.truth import known_truth, trusted_truth

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Watch = Callable[[Frame, Estimate, Background | None], None]
"""What looks on while tracking: it takes each frame, its estimate and the untouched gel as known then."""

_REACH, _SURE = 5e-3, 3.0
"""[m] between sensor and object beyond which nothing is touched, and besides so many sigmas of the first pose."""


@dataclass(frozen=True, eq=False)
class Run:
    """A tracked recording."""

    recording: Recording
    """What was tracked."""
    settings: TrackerSettings
    """How; tactile is what was chosen, where it was left open."""
    model: TouchModel | None
    """What felt, where touch was learnt."""
    calibration: Calibration | None
    """What the untouched sensor looks like, where it was given or found after a recording began in contact."""
    first_pose: Array
    """world_T_object that tracking began with, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """How well it was known, (3,) [m, m, rad]."""
    online: Trajectory
    """The estimate at each frame from all frames up to it, with covariance, contact and status."""
    smoothed: Trajectory
    """The poses as all frames of their contact leave them."""
    answers: Answers
    """All answers at each of N frames, the best first; none at frames with one, which is the estimate."""
    friction: Array
    """Friction between sensor and object as learnt up to each frame, and its standard deviation, (N, 2)."""
    step_ms: Array
    """Time of each `Tracker.update` (N,) [ms], the reading and decoding of the frame left out."""
    wall_s: float
    """Time of it all [s]."""
    truth: Array | None
    """Ground truth that the run is scored by, (N, 3); NaN where it is not known or jumps away and back."""
    summary: dict[str, Any]
    """See `metrics.summarise`; of the online estimates."""


def track(
    recording: Recording,
    settings: TrackerSettings | None = None,
    first_pose: ArrayLike | None = None,
    progress: Callable[[int], None] | None = None,
    model: TouchModel | None = None,
    calibration: Calibration | None = None,
    first_pose_sigma: ArrayLike | None = None,
    watch: Watch | None = None,
    state: Path | None = None,
    dump: Path | None = None,
) -> Run:
    """Track the object of a recording; `progress` is called after each frame with the number done, and `watch`.

    `first_pose` (3,) [m, m, rad] is world_T_object at the start, and `first_pose_sigma` (3,) how well that is known; by
    default they are those of `first_pose_of`. `model` and `calibration` are the Tracker's. Without a calibration, the
    untouched gel of a recording that begins in contact is taken from its first moment without; the summary's
    `untouched_from_s` says when.
    A frame that cannot be used is left out: the estimate before stands for it, with status "faulty".
    `state` is a file in which what is known is saved now and again; where it exists, tracking goes on from it and ends
    as if it had not been interrupted. `dump` is a file that is written where a step fails; see `failed_step`.
    Raises SettingError if the recording lacks what the settings need, EstimationError where the estimator
    cannot go on, or cannot use the first frame.
    """
    begin = time.perf_counter()
    settings = settings or TrackerSettings()
    first, sigma = first_pose_of(recording, settings.noise, first_pose, first_pose_sigma)
    _check(recording, settings)
    lift = None if calibration else lift_of_beginning(recording, first, sigma, settings.tactile)
    if lift:
        calibration = Calibration(lift.background)
    sensor = turned_as(recording.sensor, calibration)
    made_of = {
        "recording": (recording.source, recording.time, recording.sensor_pose),
        "object": shape_to_dict(recording.shape),
        "sensor": sensor_to_dict(sensor),
        "first pose": first,
        "first pose sigma": sigma,
        "setting": settings,
        "touch model": None if model is None else model.hash,
        "calibration": calibration and (calibration.background.mean, calibration.view, calibration.direction),
    }

    def begun() -> Steps:
        if state is not None and state.exists():
            return load_steps(state, made_of)
        given = recording.shape, sensor, first, settings, model, calibration
        return Steps(Tracker(*given, first_pose_sigma=sigma))

    steps, saving = begun(), None if state is None else Saving(state, made_of)
    for index in range(len(steps.taken), len(recording)):
        frame = recording[index]
        try:
            steps.take(frame)
        except FrameError:
            raise
        except Exception as error:
            if dump is None:
                raise
            before = begun()
            for earlier in range(len(before.taken), index):
                before.take(recording[earlier])
            raise write_failed_step(dump, before.tracker, frame, error) from error
        if watch:
            watch(steps.tracker.frame, steps.estimates[-1], steps.tracker.background)
        if progress:
            progress(index + 1)
        if saving:
            saving.see(steps)
    tracker, estimates, step_ms = steps.tracker, steps.estimates, np.array(steps.step_ms)
    settings = replace(settings, tactile=tracker.tactile)
    model = (model or shipped_model(recording.sensor.name)) if settings.tactile.startswith("learnt") else None
    online, answers, friction = gathered(estimates)
    contact = np.asarray(online.contact, np.bool_)
    smoothed = _with_left_out(tracker.smoothed(), np.array(steps.taken), recording.time)
    wall_s = steps.wall_s + time.perf_counter() - begin
    truth = known_truth(recording)
    summary = summarise(
        online,
        truth,
        step_ms,
        tactile=settings.tactile,
        smoother=settings.smoother,
        wall_s=wall_s,
        episodes=int(np.count_nonzero(np.diff(contact, prepend=False) & contact)),
        knocked=knocked_frames(recording),
        yaw_shows=not isinstance(recording.shape, Disc),
    )
    if lift:
        summary["untouched_from_s"] = lift.time
    if tracker.tactile_reason:
        summary["tactile_reason"] = tracker.tactile_reason
    return Run(
        recording,
        settings,
        model,
        calibration,
        first,
        sigma,
        online,
        smoothed,
        answers,
        friction,
        step_ms,
        wall_s,
        truth,
        summary,
    )


def gathered(estimates: Sequence[Estimate]) -> tuple[Trajectory, Answers, Array]:
    """Return what estimates of N frames say: poses with all about them, answers and friction, as a Run has them."""
    online = Trajectory(
        time=np.array([estimate.time for estimate in estimates]),
        pose=np.array([estimate.pose for estimate in estimates]),
        covariance=np.array([estimate.covariance for estimate in estimates]),
        contact=np.array([estimate.contact for estimate in estimates]),
        status=tuple(estimate.status for estimate in estimates),
    )
    answers = tuple(estimate.answers if len(estimate.answers) > 1 else () for estimate in estimates)
    return online, answers, np.array([estimate.friction for estimate in estimates])


def _with_left_out(smoothed: Trajectory, taken: NDArray[np.bool_], time: Array) -> Trajectory:
    """The trajectory at all N times, of which those not taken have the pose before."""
    if taken.all():
        return smoothed
    last = np.cumsum(taken) - 1
    return Trajectory(time, smoothed.pose[last], contact=None if smoothed.contact is None else smoothed.contact[last])


def lift_of_beginning(
    recording: Recording, first_pose: Array, first_pose_sigma: Array, tactile: TactileChoice
) -> Lift | None:
    """Return the first moment without contact where the sensor touches the object in the first images; else None.

    It may do so where it is at the first pose (3,), which is known as well as its sigma (3,) says.
    """
    if recording.image is None or not tactile.startswith(("auto", "learnt")):
        return None
    count = min(first_frames(recording.sensor.rate), len(recording))
    gap = gaps(recording.sensor_pose[:count], np.tile(first_pose, (count, 1)), recording.shape, recording.sensor)
    if gap.min() > _REACH + _SURE * np.hypot(*first_pose_sigma[:2]):
        return None
    lift = lift_of(recording)
    if lift:
        logger.warning(
            "%s: begins in contact; how the gel looks untouched is taken from %.2f s on",
            recording.file or "the recording",
            lift.time,
        )
    return lift


def _check(recording: Recording, settings: TrackerSettings) -> None:
    name = recording.file or "the recording"
    if recording.contact is None and recording.image is None:
        raise SettingError(f"{name}: has neither images nor contact flags, and tracking needs one of them")
    if settings.tactile.startswith("learnt") and recording.image is None:
        raise SettingError(f"{name}: has no images, which tactile {settings.tactile} needs")
    known = recording.object_pose is not None and not np.isnan(recording.object_pose).all()
    if settings.tactile == "oracle" and not known:
        raise SettingError(f"{name}: has no ground truth, which tactile oracle takes its measurements from")


def first_pose_of(
    recording: Recording,
    noise: NoiseSettings,
    given: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the first pose (3,) [m, m, rad] and how well it is known (3,).

    It is what is given; else what the recording says; else the first ground truth. Raises SettingError where there is
    none of them.
    """
    deviation = np.array(noise.first_pose.deviation)
    if given is not None:
        first = np.asarray(given, np.float64)
    elif recording.first_pose is not None:
        first = recording.first_pose
        deviation = deviation if recording.first_pose_sigma is None else recording.first_pose_sigma
    else:
        first, deviation = _first_truth(recording), np.array(noise.first_pose.truth)
    return first, deviation if sigma is None else np.asarray(sigma, np.float64)


def _first_truth(recording: Recording) -> Array:
    name = recording.file or "the recording"
    known = trusted_truth(recording)
    if recording.object_pose is None or not known.any():
        raise SettingError(
            f"{name}: has no ground truth to start from; give the object's first pose [m, m, rad]: "
            "--first-pose X Y THETA or --first-pose-unknown, in Python first_pose"
        )
    first = int(np.argmax(known))
    if recording.contact is not None and recording.contact[:first].any():
        logger.warning("%s: the first pose is ground truth of frame %d, after contact began", name, first)
    return recording.object_pose[first]
