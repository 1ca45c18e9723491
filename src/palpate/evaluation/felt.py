"""Feeling a recording once, and tracking it from what was felt as often as one likes.

What images say depends on no setting of the graph, and half of the time of tracking goes into reading it from them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, PalpateError, SettingError
from palpate.evaluation.findings import trusted_truth
from palpate.formats import load_recording
from palpate.measurement import Feeling, RelativePoses
from palpate.parallel import spread
from palpate.recording import Frame, Recording
from palpate.touch.background import Background
from palpate.touch.contact import ContactDetector
from palpate.touch.model import SHIPPED, TouchModel
from palpate.touch.modes import Tactile, make_touch
from palpate.tracker import Tracker, TrackerSettings
from palpate.trajectory import Trajectory

Array = NDArray[np.float64]
_ANY = (1.0, 1.0, 1.0)  # noise of modes without images, which are not felt beforehand


@dataclass(frozen=True, eq=False)
class Felt:
    """A recording with ground truth, and what its N images say."""

    recording: Recording
    """Without images; contact is what they tell."""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where it is not known or jumps away and back."""
    feelings: tuple[Feeling, ...] | None
    """What each frame says, nothing out of contact; None for a mode that needs no images."""


def feel(recording: Recording, tactile: Tactile, model: TouchModel | None = None) -> Felt:
    """Feel all frames, by default with the model that comes with palpate.

    Raises SettingError where ground truth, or what tells contact or the mode needs, is missing, or where nothing is
    touched while truth is known; EstimationError and FileError on images that cannot be used.
    """
    name = recording.file or "the recording"
    known = trusted_truth(recording)
    learnt = tactile.startswith("learnt")
    if recording.object_pose is None or not known.any():
        raise SettingError(f"{name}: has no ground truth, which noise is learned from")
    if learnt and recording.image is None:
        raise SettingError(f"{name}: has no images, which tactile {tactile} needs")
    if recording.contact is None and recording.image is None:
        raise SettingError(f"{name}: has neither images nor contact flags, and tracking needs one of them")
    contact, feelings = recording.contact, None
    if recording.image is not None:
        felt = list(_felt(recording, tactile, (model or TouchModel(SHIPPED)) if learnt else None))
        contact = np.array([touched for touched, _ in felt])
        feelings = tuple(feeling for _, feeling in felt) if learnt else None
    assert contact is not None
    if not (contact & known).any():
        raise SettingError(f"{name}: is never in contact where ground truth is known, so there is nothing to score")
    truth = np.where(known[:, None], recording.object_pose, np.nan)
    return Felt(replace(recording, image=None, contact=contact), truth, feelings)


def feel_files(
    files: Mapping[str, Path],
    tactile: Tactile,
    model: TouchModel | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> tuple[dict[str, Felt], dict[str, str]]:
    """Feel recordings by their names, and say of those that cannot be used why, both in the order given.

    `progress` is called with the number done. Raises FileError where none can be used.
    """
    found: dict[str, Felt] = {}
    left_out: dict[str, str] = {}
    work = partial(_feel_file, tactile=tactile, model=model)
    for done, (name, felt) in enumerate(spread(work, list(files.items()), workers), 1):
        if isinstance(felt, str):
            left_out[name] = felt
        else:
            found[name] = felt
        if progress:
            progress(done)
    if not found:
        raise FileError(f"no recording can be tuned on; the first: {next(iter(left_out.values()), 'there is none')}")
    in_order = [name for name in files if name in found]
    return {name: found[name] for name in in_order}, {name: left_out[name] for name in files if name in left_out}


def _feel_file(item: tuple[str, Path], tactile: Tactile, model: TouchModel | None) -> tuple[str, Felt | str]:
    name, path = item
    try:
        return name, feel(load_recording(path), tactile, model)
    except PalpateError as error:
        return name, f"{path}: {str(error).removeprefix(f'{path}: ')}"


def track_felt(felt: Felt, settings: TrackerSettings) -> Trajectory:
    """Track from the first known truth and return the online estimates, as `run.track` has them.

    Only where the tracker begins anew within a contact may they differ: pairs with its new first frame were not felt.
    Raises EstimationError where the estimator cannot go on.
    """
    recording = felt.recording
    first = felt.truth[int(np.argmax(np.isfinite(felt.truth[:, 0])))]
    touch = None if felt.feelings is None else _Remembered(recording.time, felt.feelings)
    tracker = Tracker(recording.shape, recording.sensor, first, settings, touch=touch)
    estimates = [tracker.update(frame) for frame in recording]
    return Trajectory(
        time=recording.time,
        pose=np.array([estimate.pose for estimate in estimates]),
        covariance=np.array([estimate.covariance for estimate in estimates]),
        contact=recording.contact,
        status=tuple(estimate.status for estimate in estimates),
    )


class _Remembered:
    """Says again what was felt."""

    def __init__(self, time: Array, feelings: tuple[Feeling, ...]) -> None:
        self._feelings = dict(zip(time.tolist(), feelings, strict=True))
        self._age = -1

    def feel(self, frame: Frame) -> Feeling:
        """See Touch."""
        self._age += 1
        feeling = self._feelings[frame.time]
        relative = feeling.relative
        if relative is None or (relative.back <= self._age).all():
            return feeling
        # The tracker began anew within a contact; what lies before is none of this one's.
        kept = relative.back <= self._age
        rest = RelativePoses(relative.back[kept], relative.pose[kept], relative.covariance[kept])
        return replace(feeling, relative=rest)

    def lift(self) -> None:
        """See Touch."""
        self._age = -1


def _felt(recording: Recording, tactile: Tactile, model: TouchModel | None) -> Iterator[tuple[bool, Feeling]]:
    """Whether each frame is in contact, and what it says if the mode reads images."""
    detector = ContactDetector()

    def background() -> Background:
        assert detector.background is not None  # known before any contact is
        return detector.background

    touch = make_touch(tactile, recording.sensor, _ANY, _ANY, model, background)
    touching = False
    for frame in recording:
        assert frame.image is not None
        was, touching = touching, detector.update(frame.image)
        if was and not touching:
            touch.lift()
        yield touching, touch.feel(frame) if touching and model is not None else Feeling()
