"""Tracking a whole recording."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import TrackerSettings
from palpate.errors import FrameError
from palpate.geometry.shapes import Disc
from palpate.pipeline.failed_step import write_failed_step
from palpate.pipeline.knocks import knocked_frames
from palpate.pipeline.metrics import summarise
from palpate.pipeline.prepared import Prepared, prepare
from palpate.pipeline.steps import Saving, Steps, load_steps
from palpate.pipeline.truth import known_truth
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.model import TouchModel, shipped_model
from palpate.types.answer import Answers
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

Array = NDArray[np.float64]
Watch = Callable[[Frame, Estimate, Background | None], None]
"""What looks on while tracking: it takes each frame, its estimate and the untouched gel as known then."""


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
    default they are those of `prepared.first_pose_of`. `model` and `calibration` are the Tracker's. Without a
    calibration, the untouched gel of a recording that begins in contact is taken from its first moment without; the
    summary's `untouched_from_s` says when.
    A frame that cannot be used is left out: the estimate before stands for it, with status "faulty".
    `state` is a file in which what is known is saved now and again; where it exists, tracking goes on from it and ends
    as if it had not been interrupted. `dump` is a file that is written where a step fails; see `failed_step`.
    Raises SettingError if the recording lacks what the settings need, EstimationError where the estimator
    cannot go on, or cannot use the first frame.
    """
    begin = time.perf_counter()
    settings = settings or TrackerSettings()
    prepared = prepare(recording, settings, first_pose, first_pose_sigma, model, calibration)
    steps = _tracked(prepared, progress, watch, state, dump)
    return _run_of(prepared, steps, begin)


def _tracked(
    prepared: Prepared,
    progress: Callable[[int], None] | None,
    watch: Watch | None,
    state: Path | None,
    dump: Path | None,
) -> Steps:
    """Take all frames, or those that are left where a state was saved."""
    recording, made_of = prepared.recording, prepared.made_of()

    def begun() -> Steps:
        if state is not None and state.exists():
            return load_steps(state, made_of)
        return Steps(prepared.tracker())

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
    return steps


def _run_of(prepared: Prepared, steps: Steps, begin: float) -> Run:
    """The run that all steps are, with its scores; tracking began at this time of the performance counter [s]."""
    recording, tracker = prepared.recording, steps.tracker
    settings = replace(prepared.settings, tactile=tracker.tactile)
    learnt = settings.tactile.startswith("learnt")
    online, answers, friction = gathered(steps.estimates)
    contact = np.asarray(online.contact, np.bool_)
    smoothed = _with_left_out(tracker.smoothed(), np.array(steps.taken), recording.time)
    step_ms, wall_s = np.array(steps.step_ms), steps.wall_s + time.perf_counter() - begin
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
    if prepared.untouched_from is not None:
        summary["untouched_from_s"] = prepared.untouched_from
    if tracker.tactile_reason:
        summary["tactile_reason"] = tracker.tactile_reason
    if tracker.unusual_colours and not recording.is_simulated:  # units are drawn with any light
        summary["unusual_colours"] = tracker.unusual_colours
    return Run(
        recording=recording,
        settings=settings,
        model=(prepared.model or shipped_model(recording.sensor.name)) if learnt else None,
        calibration=prepared.calibration,
        first_pose=prepared.first_pose,
        first_pose_sigma=prepared.first_pose_sigma,
        online=online,
        smoothed=smoothed,
        answers=answers,
        friction=friction,
        step_ms=step_ms,
        wall_s=wall_s,
        truth=truth,
        summary=summary,
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
