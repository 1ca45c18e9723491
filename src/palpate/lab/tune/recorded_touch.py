"""What the images of a recording say, read once, so that it can be tracked as often as one likes.

It depends on no setting of the graph, and half of the time of tracking goes into reading it from them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings, TrackerSettings
from palpate.errors import FileError, PalpateError, SettingError
from palpate.io import load_recording
from palpate.lab.study.recordings import group_of
from palpate.parallel import spread
from palpate.pipeline.first_release import release_after_start
from palpate.pipeline.track import first_pose_of, gathered, tracked_frames
from palpate.pipeline.truth import trusted_truth
from palpate.touch.background import Background
from palpate.touch.calibration import (
    UNCORRECTED,
    Calibration,
    DirectionCorrection,
    correction_of,
    detector_for,
    turned_as,
    view_of,
)
from palpate.touch.model import TouchModel, shipped_model
from palpate.touch.modes import Tactile, TactileChoice, make_touch
from palpate.tracker import Tracker
from palpate.tracker_arguments import with_correction
from palpate.types.frame import Frame
from palpate.types.measurements import Measurement, RelativePoses
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

Array = NDArray[np.float64]
Said = tuple[Measurement, ...]
_ANY = (1.0, 1.0, 1.0)  # noise of modes without images, which are not recorded beforehand


@dataclass(frozen=True, eq=False)
class RecordedTouch:
    """A recording with ground truth, and what its N images say."""

    recording: Recording
    """Without images; contact is what they tell."""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where it is not known or jumps away and back."""
    measurements: tuple[Said, ...] | None
    """What each frame says, nothing out of contact; None for a mode that needs no images."""
    tactile: Tactile | None = None
    """What touch says of it; None is what the settings say that it is tracked with."""
    kind: str = ""
    """Which kind of recording it is, all of which count the same in tuning."""
    correction: DirectionCorrection = UNCORRECTED
    """What was corrected of the directions that touch tells."""


def record_touch(
    recording: Recording,
    tactile: TactileChoice,
    model: TouchModel | None = None,
    calibration: Calibration | None = None,
) -> RecordedTouch:
    """Record what all frames say, by default with the model of its sensor.

    `calibration` is what is known of its unit, as the Tracker takes it. `auto` is learnt where there are
    images, and else the oracle's. Raises SettingError where ground truth, or what tells contact or the mode needs, is
    missing, or where nothing is touched while truth is known; EstimationError and FileError on images that cannot be
    used.
    """
    name = recording.file or "the recording"
    known = trusted_truth(recording)
    if tactile == "auto":
        tactile = "oracle" if recording.image is None else "learnt"
    learnt = tactile.startswith("learnt")
    if recording.object_pose is None or not known.any():
        raise SettingError(f"{name}: has no ground truth, which noise is learned from")
    if learnt and recording.image is None:
        raise SettingError(f"{name}: has no images, which tactile {tactile} needs")
    if recording.contact is None and recording.image is None:
        raise SettingError(f"{name}: has neither images nor contact flags, and tracking needs one of them")
    contact, measurements = recording.contact, None
    if recording.image is not None:
        felt_by = (model or shipped_model(recording.sensor.name)) if learnt else None
        frames = list(_frame_by_frame(recording, tactile, felt_by, calibration))
        contact = np.array([touched for touched, _ in frames])
        measurements = tuple(said for _, said in frames) if learnt else None
    assert contact is not None
    if not (contact & known).any():
        raise SettingError(f"{name}: is never in contact where ground truth is known, so there is nothing to score")
    truth = np.where(known[:, None], recording.object_pose, np.nan)
    blind = replace(recording, image=None, contact=contact)
    return RecordedTouch(blind, truth, measurements, tactile, correction=correction_of(calibration))


def record_touch_of_files(
    files: Mapping[str, Path],
    tactile: TactileChoice,
    model: TouchModel | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    calibration: Calibration | None = None,
) -> tuple[dict[str, RecordedTouch], dict[str, str]]:
    """Record the touch of recordings by their names, and say of those that cannot be used why, both in the order given.

    Their kinds are those of `study.files.group_of`: the folders that they lie in. `progress` is called with the number
    done; `calibration` is of the unit that they are all of. Raises FileError where none can be used.
    """
    found: dict[str, RecordedTouch] = {}
    left_out: dict[str, str] = {}
    work = partial(_record_touch_of_file, tactile=tactile, model=model, calibration=calibration)
    for done, (name, result) in enumerate(spread(work, list(files.items()), workers), 1):
        if isinstance(result, str):
            left_out[name] = result
        else:
            found[name] = result
        if progress:
            progress(done)
    if not found:
        raise FileError(f"no recording can be tuned on; the first: {next(iter(left_out.values()), 'there is none')}")
    in_order = [name for name in files if name in found]
    return {name: found[name] for name in in_order}, {name: left_out[name] for name in files if name in left_out}


def _record_touch_of_file(
    item: tuple[str, Path], tactile: TactileChoice, model: TouchModel | None, calibration: Calibration | None
) -> tuple[str, RecordedTouch | str]:
    name, path = item
    try:
        recorded = record_touch(load_recording(path), tactile, model, calibration)
        return name, replace(recorded, kind=group_of(name))
    except PalpateError as error:
        return name, f"{path}: {str(error).removeprefix(f'{path}: ')}"


def track_recorded(recorded: RecordedTouch, settings: TrackerSettings) -> Trajectory:
    """Track from the first pose as `first_pose_of` finds it, and return the online estimates, as `run.track` has them.

    They may differ where the tracker begins anew or refuses a frame within a contact, for other pairs are recorded
    then, where a recording that begins in contact never lets go, and where images are found to lie turned.
    Raises EstimationError where the estimator cannot go on.
    """
    recording = recorded.recording
    first, sigma = first_pose_of(recording, settings.noise)
    touch = None if recorded.measurements is None else _Remembered(recording.time, recorded.measurements)
    tactile, noise = recorded.tactile or settings.tactile, with_correction(settings.noise, recorded.correction)
    settings = replace(settings, tactile=tactile, noise=noise)
    tracker = Tracker(recording.shape, recording.sensor, first, settings, touch=touch, first_pose_sigma=sigma)
    return gathered([estimate for estimate, *_ in tracked_frames(tracker, recording)])[0]


class _Remembered:
    """Says again what was recorded."""

    def __init__(self, time: Array, measurements: tuple[Said, ...]) -> None:
        self._said = dict(zip(time.tolist(), enumerate(measurements), strict=True))
        self._frames: list[int] = []  # of this contact that were taken, by their numbers in the recording

    def measure(self, frame: Frame) -> Said:
        """See Touch."""
        number, measurements = self._said[frame.time]
        self._frames.append(number)
        return tuple(self._of_this_contact(said) for said in measurements)

    def end_contact(self) -> None:
        """See Touch."""
        self._frames = []

    def _of_this_contact(self, said: Measurement) -> Measurement:
        """Without what is relative to frames that were refused, or before the contact as the tracker began it anew."""
        if not isinstance(said, RelativePoses):
            return said
        taken = np.array(self._frames)
        earlier = taken[-1] - said.back
        kept = np.isin(earlier, taken)
        back = len(taken) - 1 - np.searchsorted(taken, earlier[kept])
        return RelativePoses(back, said.pose[kept], said.covariance[kept])


def _frame_by_frame(
    recording: Recording, tactile: Tactile, model: TouchModel | None, calibration: Calibration | None
) -> Iterator[tuple[bool, Said]]:
    """Whether each frame is in contact, and what it says if the mode reads images."""
    if calibration is None:
        lift = release_after_start(recording, *first_pose_of(recording, NoiseSettings()), tactile)
        calibration = lift and lift.calibration
    sensor, view = turned_as(recording.sensor, calibration), view_of(calibration)
    detector = detector_for(sensor, calibration)

    def background() -> Background:
        assert detector.background is not None  # known before any contact is
        return detector.background

    touch = make_touch(tactile, sensor, _ANY, _ANY, model, background, correction_of(calibration))
    touching = False
    for frame in recording:
        assert frame.image is not None
        image = detector.read(view.of(frame.image))
        frame = replace(frame, image=image)
        was, touching = touching, detector.update(image)
        if was and not touching:
            touch.end_contact()
        yield touching, tuple(touch.measure(frame)) if touching and model is not None else ()
