"""Tracking a whole recording."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.checks import without_gradient
from palpate.config import ANYWHERE_SIGMA, NoiseSettings, TrackerSettings
from palpate.errors import FileError, FrameError, PalpateError, SettingError, kept_warnings, one_line
from palpate.geometry.shapes import Disc
from palpate.io.recording import Recording
from palpate.models.pushing.compiled import pushing_with
from palpate.models.pushing.layout import NAMES
from palpate.pipeline.check_hand import check_calibrations
from palpate.pipeline.check_motion import mismatches
from palpate.pipeline.first_release import release_after_start
from palpate.pipeline.learnt_outline import (
    in_frame_of_truth,
    is_anywhere,
    largest_shape,
    outline_scores,
    warn_of_flags_alone,
)
from palpate.pipeline.metrics import ambiguous_by_origin, flag_runs, innovation_scores, summarise
from palpate.pipeline.report import reasons_of
from palpate.touch.calibration import Calibration
from palpate.touch.touch_model import TouchModel, shipped_model
from palpate.tracker import Tracker, warm_up
from palpate.types.choices import TactileChoice
from palpate.types.estimate import Answers, Estimate, Trajectory
from palpate.types.outline import Outline, Sketch, Unknown

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Run:
    """A tracked recording of N frames."""

    recording: Recording
    settings: TrackerSettings
    """Settings of the tracker; `tactile` is the chosen source if auto was given."""
    model: TouchModel | None
    """Touch model, if touch was learnt."""
    calibration: Calibration | None
    """Calibration of the sensor unit: as given, or from the first release of a recording that began in contact."""
    first_pose: Array
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """Standard deviations of the first pose, (3,) [m, m, rad]."""
    online: Trajectory
    """Estimate at each frame from all frames up to it, with covariance, contact and status."""
    answers: Answers
    """All answers at each frame, the estimate first; empty at frames with one, which is the estimate."""
    step_ms: Array
    """Time of each `Tracker.update`, without reading and decoding the frame, (N,) [ms]."""
    summary: dict[str, Any]
    """Scores of the online estimates; see `metrics.summarise`."""
    calibrations: Mapping[str, Calibration] = field(default_factory=dict)
    """Calibrations of a hand's fingers that were given."""
    outlines: tuple[Outline, ...] = ()
    """The outline as it was known at each frame, (N,); none if it was known from the start."""


def track(
    recording: Recording,
    settings: TrackerSettings | None = None,
    first_pose: ArrayLike | None = None,
    *,
    first_pose_sigma: ArrayLike | None = None,
    model: TouchModel | None = None,
    calibration: Calibration | Mapping[str, Calibration] | None = None,
    outline: Unknown | Sketch | None = None,
    progress: Callable[[int], None] | None = None,
    keep: Callable[[Run], object] | None = None,
) -> Run:
    """Track the object of a recording.

    `first_pose` (3,) [m, m, rad] is world_T_object at the start, with standard deviations `first_pose_sigma` (3,); by
    default see `first_pose_of_recording`. Without a calibration, the untouched gel of a recording that begins in
    contact is taken from its first release. `outline` takes the place of the recording's, which is then used for scores
    alone; an unknown one without a first pose is where it is touched first, see `pipeline.learnt_outline`. `progress`
    is called with the number of frames done. A frame that cannot be used is skipped, see `tracked_frames`.

    Raises SettingError if the recording lacks something that the settings need, EstimationError if no estimate can be
    computed or the first frame cannot be used. If an error or Ctrl-C ends tracking early, it is raised after `keep` was
    called with the run up to there.
    """
    begin = time.perf_counter()
    if not isinstance(recording, Recording):
        kind = type(recording).__name__
        raise SettingError(
            f"found a {kind} to track, expected a Recording; load_recording reads one from a file, and read_bag has "
            "one as its .recording"
        )
    total = len(recording)
    settings = settings or TrackerSettings()
    first, sigma = start_of(recording, settings.noise, first_pose, first_pose_sigma, outline)
    _check_content(recording, settings.tactile, outline)
    check_calibrations(recording, calibration)
    warm_up(pushing_with(len(recording.hand.fingers) if recording.hand else 0))  # warns of no recording
    with kept_warnings() as warnings:
        of_fingers = calibration if isinstance(calibration, Mapping) else {}
        unit = None if isinstance(calibration, Mapping) else calibration
        if unit is None:
            unit = release_after_start(recording, first, sigma, settings.tactile, largest_shape(outline))
        start: Any = {name: getattr(recording, name) for name in ("set_up_sigma", "is_view_known")}
        start["first_pose_sigma"] = sigma
        sensor = recording.hand or recording.sensor
        warn_of_flags_alone(recording, settings.tactile, outline)
        tracker = Tracker(outline or recording.shape, sensor, first, settings, model, of_fingers or unit, **start)
        logger.info("first pose %s, sigma %s [m, m, rad]", first.tolist(), sigma.tolist())
        logger.info("touch is %s: %s", tracker.tactile, tracker.tactile_reason or "as asked")
        logger.info("tracking %d frames of %s", total, recording.sensor.name)
        estimates, step_ms, failure = _estimates_until_failure(tracker, recording, progress)
    if failure is not None:
        recording = _tracked_part(recording, estimates, failure, keep)
    settings = replace(settings, tactile=tracker.tactile)
    if outline is not None and is_anywhere(sigma):
        estimates = in_frame_of_truth(estimates, recording.truth)
        first = estimates[0].pose
    online, answers = gathered(estimates)
    for sentence in () if outline else mismatches(recording, online.contact, first, sigma):
        warnings.append(sentence)
        logger.warning("%s: %s", recording.file or "the recording", sentence)
    wall_s = time.perf_counter() - begin
    summary = _scores(recording, settings, online, step_ms, wall_s)
    summary |= _scores_of_estimates(recording, estimates, online, answers)
    summary |= {"warnings": [*recording.warnings, *warnings], "mirrored": tracker.mirrored}
    outlines = tuple(each.outline for each in estimates if each.outline is not None)
    summary |= outline_scores(outlines, recording)
    summary["ended"] = _end_of(failure, estimates, total)
    if tracker.tactile_reason:
        summary["tactile_reason"] = tracker.tactile_reason
    used_model = _used_model(recording, settings, model)
    more: Any = {"calibrations": of_fingers, "outlines": outlines}
    run = Run(recording, settings, used_model, unit, first, sigma, online, answers, step_ms, summary, **more)
    if failure is not None and keep:
        keep(run)
        raise failure
    return run


def start_of(
    recording: Recording,
    noise: NoiseSettings,
    given: ArrayLike | None,
    sigma: ArrayLike | None,
    outline: Unknown | Sketch | None,
) -> tuple[Array, Array]:
    """Return the first pose (3,) and its standard deviations (3,); an unknown outline may be anywhere.

    Raises SettingError if there is none, or if nothing says which outline the object has.
    """
    if not isinstance(outline, Unknown | Sketch | None):
        raise SettingError(f"outline is {outline!r}; allowed are a palpate.Unknown, a palpate.Sketch, and None")
    if outline is None and not recording.is_shape_known:
        raise SettingError(
            f"{recording.file or 'the recording'}: its outline is not known; allowed are --shape unknown, or --shape "
            "FILE with --outline-sigma, in Python outline"
        )
    if isinstance(outline, Unknown) and given is None and recording.first_pose is None:
        return np.zeros(3), np.array(ANYWHERE_SIGMA)
    return first_pose_of_recording(recording, noise, given, sigma)


def _factors(recording: Recording) -> tuple[str, ...]:
    """Return the names of the factors that a recording is tracked with."""
    return NAMES if recording.hand is None else pushing_with(len(recording.hand.fingers)).model.names


def _used_model(recording: Recording, settings: TrackerSettings, model: TouchModel | None) -> TouchModel | None:
    """Return the touch model that images were read with; of a hand, that of its first finger."""
    if settings.tactile != "learnt":
        return None
    sensor = recording.sensor if recording.hand is None else next(iter(recording.hand.fingers.values()))
    return model or shipped_model(sensor.name)


def _tracked_part(
    recording: Recording, estimates: Sequence[Estimate], failure: BaseException, keep: object | None
) -> Recording:
    """Return the part of a recording that was tracked before a failure; raises the failure if nobody keeps it."""
    if keep is None or not estimates:
        raise failure
    return recording.until(len(estimates))


def _scores_of_estimates(
    recording: Recording, estimates: Sequence[Estimate], online: Trajectory, answers: Answers
) -> dict[str, Any]:
    """Return what a summary says of answers, innovations and reasons."""
    return {
        "ambiguous_by_origin": ambiguous_by_origin(online.status, answers),
        "innovations": innovation_scores([each.innovations for each in estimates], _factors(recording)),
        "reasons": reasons_of(online.status, online.reason),
        "final_reason": estimates[-1].reason,
    }


def _check_content(recording: Recording, tactile: TactileChoice, outline: Unknown | Sketch | None) -> None:
    """Raise SettingError if a recording lacks something that tracking with this source of touch and outline needs."""
    if outline is not None and recording.hand is not None:
        raise SettingError(
            f"{recording.file or 'the recording'}: is of a hand; an outline is learnt by one sensor alone"
        )
    has_images = recording.image is not None or bool(recording.images)
    lacking = ""
    if not has_images and recording.contact is None:
        lacking = "neither images nor contact flags, and tracking needs one"
    elif not has_images and tactile == "learnt":
        lacking = f"no images, which tactile {tactile} needs"
    elif tactile == "oracle" and np.isnan(recording.truth).all():
        lacking = "no ground truth, which tactile oracle needs"
    if lacking:
        raise SettingError(f"{recording.file or 'the recording'}: has {lacking}")


def _estimates_until_failure(
    tracker: Tracker, recording: Recording, progress: Callable[[int], None] | None
) -> tuple[list[Estimate], Array, BaseException | None]:
    """Return estimates and times of the steps [ms] of all frames, or of those before the failure that is returned."""
    estimates: list[Estimate] = []
    step_ms: list[float] = []
    failure: BaseException | None = None
    try:
        for estimate, milliseconds in tracked_frames(tracker, recording):
            step_ms.append(milliseconds)
            estimates.append(estimate)
            if progress:
                progress(len(estimates))
    except BaseException as error:  # Ctrl-C, too
        failure = error
    return estimates, np.array(step_ms[: len(estimates)]), failure


def _scores(
    recording: Recording, settings: TrackerSettings, online: Trajectory, step_ms: Array, wall_s: float
) -> dict[str, Any]:
    """Return the scores of a run, with its settings, and the knocks that a simulation states."""
    is_knocked = np.ravel(recording.extra.get("knocked", 0.0)) > 0.0
    return summarise(
        online,
        recording.truth,
        step_ms,
        center=recording.shape.centroid,
        yaw_shows=not isinstance(recording.shape, Disc),
        tactile=settings.tactile,
        smoother=settings.smoother,
        knocks=len(flag_runs(is_knocked)),
        wall_s=wall_s,
    )


def _end_of(failure: BaseException | None, estimates: Sequence[Estimate], total: int) -> str | None:
    """Return a sentence on the failure that ended a run early; None if there was none."""
    if failure is None:
        return None
    moment = f"after {len(estimates)} of {total} frames, at {estimates[-1].time:.3f} s"
    return f"{moment}: {type(failure).__name__}: {one_line(failure)}"


def tracked_frames(tracker: Tracker, recording: Recording) -> Iterator[tuple[Estimate, float]]:
    """Yield the estimate at each frame, and the time of the step [ms].

    Frames whose image is damaged and those that the tracker refuses are skipped: the estimate before, or that of the
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
    online = Trajectory(
        time=np.array([estimate.time for estimate in estimates]),
        pose=np.array([estimate.pose for estimate in estimates]),
        covariance=np.array([estimate.covariance for estimate in estimates]),
        contact=np.array([estimate.contact for estimate in estimates]),
        status=tuple(estimate.status for estimate in estimates),
        reason=tuple(estimate.reason for estimate in estimates),
    )
    return online, tuple(estimate.answers if len(estimate.answers) > 1 else () for estimate in estimates)


def first_pose_of_recording(
    recording: Recording, noise: NoiseSettings, given: ArrayLike | None = None, sigma: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return the first pose (3,) [m, m, rad] and its standard deviations (3,): as given, or as the recording has them.

    By default the standard deviations are those of the noise settings. Raises SettingError if there is no first pose.
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
