"""Tracking a whole recording."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.checks import without_gradient
from palpate.config import NoiseSettings, TrackerSettings
from palpate.errors import FileError, FrameError, PalpateError, SettingError, one_line
from palpate.geometry.shapes import Disc
from palpate.io.recording import Recording
from palpate.pipeline.first_release import release_after_start
from palpate.pipeline.metrics import ambiguous_by_origin, flag_runs, innovation_scores, summarise
from palpate.touch.calibration import Calibration
from palpate.touch.touch_model import TouchModel, shipped_model
from palpate.tracker import Tracker, warm_up
from palpate.types.estimate import Answers, Estimate, Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Run:
    """A tracked recording of N frames."""

    recording: Recording
    settings: TrackerSettings
    """Settings of the tracker; `tactile` is the chosen one where it was auto."""
    model: TouchModel | None
    """Touch model, where touch was learnt."""
    calibration: Calibration | None
    """Calibration of the sensor unit, given or found after a recording began in contact."""
    first_pose: Array
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """Its standard deviations, (3,) [m, m, rad]."""
    online: Trajectory
    """Estimate at each frame from all frames up to it, with covariance, contact and status."""
    answers: Answers
    """All answers at each frame, the estimate first; empty at frames with one, which is the estimate."""
    step_ms: Array
    """Time of each `Tracker.update`, without reading and decoding the frame, (N,) [ms]."""
    summary: dict[str, Any]
    """Scores of the online estimates; see `metrics.summarise`."""


def track(
    recording: Recording,
    settings: TrackerSettings | None = None,
    first_pose: ArrayLike | None = None,
    *,
    first_pose_sigma: ArrayLike | None = None,
    model: TouchModel | None = None,
    calibration: Calibration | None = None,
    progress: Callable[[int], None] | None = None,
    keep: Callable[[Run], object] | None = None,
) -> Run:
    """Track the object of a recording.

    `first_pose` (3,) [m, m, rad] is world_T_object at the start, with standard deviations `first_pose_sigma` (3,); by
    default see `first_pose_of`. Without a calibration, the untouched gel of a recording that begins in contact is taken
    from its first release. `progress` is called with the number of frames done. A frame that cannot be used is skipped,
    see `tracked_frames`. Raises SettingError if the recording lacks something that the settings need, EstimationError
    if no estimate can be computed or the first frame cannot be used. Whatever ends it early, Ctrl-C too, is raised
    after `keep` was called with the run up to there.
    """
    begin, total = time.perf_counter(), len(recording)
    settings = settings or TrackerSettings()
    first, sigma = first_pose_of(recording, settings.noise, first_pose, first_pose_sigma)
    tactile, has_images = settings.tactile, recording.image is not None
    for is_lacking, words in (
        (not has_images and recording.contact is None, "neither images nor contact flags, and tracking needs one"),
        (not has_images and tactile == "learnt", f"no images, which tactile {tactile} needs"),
        (tactile == "oracle" and np.isnan(recording.truth).all(), "no ground truth, which tactile oracle needs"),
    ):
        if is_lacking:
            raise SettingError(f"{recording.file or 'the recording'}: has {words}")
    estimates: list[Estimate] = []
    step_ms = np.zeros(len(recording))
    failure: BaseException | None = None
    warm_up()  # its notice is none of the recording's warnings
    with kept_warnings() as warnings:
        calibration = calibration or release_after_start(recording, first, sigma, settings.tactile)
        start: Any = {name: getattr(recording, name) for name in ("set_up_sigma", "is_view_known")}
        start["first_pose_sigma"] = sigma
        tracker = Tracker(recording.shape, recording.sensor, first, settings, model, calibration, **start)
        try:
            for index, (estimate, step_ms[index]) in enumerate(tracked_frames(tracker, recording)):
                estimates.append(estimate)
                if progress:
                    progress(index + 1)
        except BaseException as error:
            if keep is None or not estimates:
                raise
            failure, done = error, len(estimates)
            recording, step_ms = recording.until(done), step_ms[:done]
    settings = replace(settings, tactile=tracker.tactile)
    online, answers = gathered(estimates)
    summary = summarise(
        online,
        recording.truth,
        step_ms,
        yaw_shows=not isinstance(recording.shape, Disc),
        tactile=settings.tactile,
        smoother=settings.smoother,
        knocks=len(flag_runs(np.ravel(recording.extra.get("knocked", 0.0)) > 0.0)),  # as a simulation states them
        wall_s=time.perf_counter() - begin,
    )
    summary["ambiguous_by_origin"] = ambiguous_by_origin(online.status, answers)
    summary["innovations"] = innovation_scores([estimate.innovations for estimate in estimates])
    summary |= {"final_reason": estimates[-1].reason, "warnings": warnings, "mirrored": tracker.mirrored}
    summary["ended"] = None
    if failure is not None:
        place = f"after {len(estimates)} of {total} frames, at {estimates[-1].time:.3f} s"
        summary["ended"] = f"{place}: {type(failure).__name__}: {one_line(failure)}"
    if tracker.tactile_reason:
        summary["tactile_reason"] = tracker.tactile_reason
    if settings.tactile != "learnt":
        model = None
    elif model is None:
        model = shipped_model(recording.sensor.name)
    run = Run(recording, settings, model, calibration, first, sigma, online, answers, step_ms, summary)
    if failure is not None and keep:
        keep(run)
        raise failure
    return run


def tracked_frames(tracker: Tracker, recording: Recording) -> Iterator[tuple[Estimate, float]]:
    """Yield the estimate at each frame, and the time of the step [ms].

    Skipped are frames whose image is damaged and those that the tracker refuses; there the estimate before, or of the
    first frame that is used, is repeated with status "faulty". Raises FrameError if the tracker refuses the first
    frame, FileError if all images are damaged.
    """
    last: Estimate | None = None
    skipped: list[PalpateError] = []
    for index, when in enumerate(recording.time.tolist()):
        start = time.perf_counter()
        try:
            frame = recording[index]
            start = time.perf_counter()  # without the time to decode the image
            estimate = tracker.update(frame)
        except (FrameError, FileError) as error:
            if last is None and (isinstance(error, FrameError) or index + 1 == len(recording)):
                raise
            skipped.append(error)
            if len(skipped) <= 5:
                more = ", further ones without a word" if len(skipped) == 5 else ""
                logger.warning("%s; it is skipped%s", error, more)
            if last is not None:
                last = replace(last, time=when, status="faulty", reason=str(error), innovations=None)
                yield last, (time.perf_counter() - start) * 1e3
            continue
        if last is None:
            for early, error in zip(recording.time.tolist(), skipped, strict=False):
                yield replace(estimate, time=early, status="faulty", reason=str(error)), 0.0
        last = estimate
        yield last, (time.perf_counter() - start) * 1e3


def gathered(estimates: Sequence[Estimate]) -> tuple[Trajectory, Answers]:
    """Return the trajectory and the answers of N estimates, as in a Run."""
    rows = ((each.time, each.pose, each.covariance, each.contact, each.status, each.reason) for each in estimates)
    *arrays, status, reason = zip(*rows, strict=True)
    online = Trajectory(*map(np.array, arrays), status=status, reason=reason)
    return online, tuple(estimate.answers if len(estimate.answers) > 1 else () for estimate in estimates)


def first_pose_of(
    recording: Recording, noise: NoiseSettings, given: ArrayLike | None = None, sigma: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return the first pose (3,) [m, m, rad] and its standard deviations (3,): as given, or as the recording has them.

    Raises SettingError where there is none of them.
    """
    first = recording.first_pose if given is None else np.asarray(without_gradient(given), np.float64)
    if first is None:
        raise SettingError(
            f"{recording.file or 'the recording'}: has no ground truth to start from; give the object's first pose "
            "[m, m, rad]: --first-pose X Y THETA or --first-pose-unknown, in Python first_pose"
        )
    if sigma is None and given is None:
        sigma = recording.first_pose_sigma
    return first, np.array(noise.first_pose.deviation if sigma is None else without_gradient(sigma), np.float64)


@contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Yield a list that receives palpate's warnings while the block runs; they are shown as before."""
    kept: list[str] = []

    def keep(record: logging.LogRecord) -> None:
        kept.append(record.getMessage())
        if not logging.root.handlers and logging.lastResort:  # which a handler would replace
            logging.lastResort.handle(record)

    listener = logging.Handler(logging.WARNING)
    listener.emit = keep
    logging.getLogger("palpate").addHandler(listener)
    try:
        yield kept
    finally:
        logging.getLogger("palpate").removeHandler(listener)
