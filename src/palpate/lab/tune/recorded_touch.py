"""Recordings with the measurements of their images, read once, so that they can be tracked again and again.

The measurements depend on no setting of the graph, and reading them takes half of the time of tracking.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from palpate.arrays import Array
from palpate.config import Tactile, TactileChoice, TrackerSettings
from palpate.errors import FileError, PalpateError, SettingError
from palpate.io import load_recording
from palpate.lab.parallel import spread
from palpate.pipeline.push_calibration import read_touch
from palpate.pipeline.track import first_pose_of, gathered, tracked_frames
from palpate.touch.calibration import UNCORRECTED, Calibration, DirectionCorrection
from palpate.touch.touch_model import TouchModel, shipped_model
from palpate.tracker import Tracker
from palpate.types.estimate import Trajectory
from palpate.types.measurements import Frame, Measurement
from palpate.types.recording import Recording

Measurements = tuple[Measurement, ...]


@dataclass(frozen=True, eq=False)
class RecordedTouch:
    """A recording of N frames with ground truth, and the measurements of its images."""

    recording: Recording
    """Without images; its contact is that seen in them."""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where unknown."""
    measurements: tuple[Measurements, ...] | None
    """Measurements of each frame, empty out of contact; None for a mode of touch without images."""
    tactile: Tactile | None = None
    """Mode of touch; None is that of the settings it is tracked with."""
    correction: DirectionCorrection = UNCORRECTED
    """Correction of contact directions, from the unit's calibration."""


def record_touch_of_files(
    files: Mapping[str, Path],
    tactile: TactileChoice,
    model: TouchModel | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    calibration: Calibration | None = None,
    orientation: str = "",
) -> tuple[dict[str, RecordedTouch], dict[str, str]]:
    """Record the touch of recordings by name; returns them, and the error of each that cannot be used.

    Raises FileError if none can be used.
    """
    results: dict[str, RecordedTouch | str] = {}
    do = partial(_record_file, touch=(tactile, model, calibration), orientation=orientation)
    for done, (name, result) in enumerate(spread(do, list(files.items()), workers), 1):
        results[name] = result
        if progress:
            progress(done)
    in_order = {name: results[name] for name in files}
    found = {name: result for name, result in in_order.items() if not isinstance(result, str)}
    left_out = {name: result for name, result in in_order.items() if isinstance(result, str)}
    if not found:
        raise FileError(f"no recording can be tuned on; the first: {next(iter(left_out.values()), 'there is none')}")
    return found, left_out


def record_touch(
    recording: Recording,
    tactile: TactileChoice,
    model: TouchModel | None = None,
    calibration: Calibration | None = None,
) -> RecordedTouch:
    """Record the measurements of all frames; `auto` is learnt where there are images, else oracle.

    Raises SettingError if ground truth, images, contact or a contact with known truth is missing, EstimationError and
    FileError on images that cannot be used.
    """
    name = recording.file or "the recording"
    known = recording.trusted_truth
    if tactile == "auto":
        tactile = "oracle" if recording.image is None else "learnt"
    is_learnt = tactile == "learnt"
    if recording.object_pose is None or not known.any():
        raise SettingError(f"{name}: has no ground truth, which noise is learnt from")
    if is_learnt and recording.image is None:
        raise SettingError(f"{name}: has no images, which tactile {tactile} needs")
    if recording.contact is None and recording.image is None:
        raise SettingError(f"{name}: has neither images nor contact flags, and tracking needs one of them")
    contact, measurements = recording.contact, None
    if recording.image is not None:
        used = (model or shipped_model(recording.sensor.name)) if is_learnt else None
        frames = list(read_touch(recording, tactile, used, calibration))
        contact = np.array([touching for touching, _ in frames])
        measurements = tuple(each for _, each in frames) if is_learnt else None
    assert contact is not None
    if not (contact & known).any():
        raise SettingError(f"{name}: is never in contact where ground truth is known, so there is nothing to score")
    truth = np.where(known[:, None], recording.object_pose, np.nan)
    blind = replace(recording, image=None, contact=contact)
    return RecordedTouch(
        blind, truth, measurements, tactile, correction=calibration.direction if calibration else UNCORRECTED
    )


class ReplayedTouch:
    """Measurements that were read from images before, by the times of their frames."""

    def __init__(
        self,
        time: Array,
        measurements: Sequence[Sequence[Measurement]],
        correction: DirectionCorrection = UNCORRECTED,
    ) -> None:
        """Take the times (N,) [s], the measurements of each, and the correction of directions that is in them."""
        self.correction = correction
        self._measurements = dict(zip(time.tolist(), measurements, strict=True))

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """Return the measurements recorded at the time of a frame."""
        return self._measurements[frame.time]

    def end_contact(self) -> None:
        """Do nothing: the measurements hold whatever a contact changes."""


def track_recorded(recorded: RecordedTouch, settings: TrackerSettings) -> Trajectory:
    """Return the online estimates, as `track` finds them.

    Raises EstimationError if the estimator cannot go on.
    """
    recording = recorded.recording
    first, sigma = first_pose_of(recording, settings.noise)
    touch = (
        None
        if recorded.measurements is None
        else ReplayedTouch(recording.time, recorded.measurements, recorded.correction)
    )
    tactile = recorded.tactile or settings.tactile
    settings = replace(settings, tactile=tactile)
    start = {"first_pose_sigma": sigma, "set_up_sigma": recording.set_up_sigma}
    tracker = Tracker(recording.shape, recording.sensor, first, settings, touch=touch, **start)
    return gathered([estimate for estimate, *_ in tracked_frames(tracker, recording)])[0]


def _record_file(
    item: tuple[str, Path], touch: tuple[TactileChoice, TouchModel | None, Calibration | None], orientation: str
) -> tuple[str, RecordedTouch | str]:
    name, path = item
    try:
        return name, record_touch(load_recording(path, orientation), *touch)
    except PalpateError as error:
        return name, f"{path}: {str(error).removeprefix(f'{path}: ')}"
