"""The fault bench: recordings with one fault after the other, tracked, and what became of the estimate."""

import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from palpate.config import TrackerSettings
from palpate.errors import FrameError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.io import load_recording
from palpate.lab.study.faults.faults import FAULTS, is_of
from palpate.lab.study.faults.stream import Stream, check_faults, stream_of
from palpate.parallel import spread
from palpate.pipeline.metrics import CONTENT, inside_95, is_far, nees, rotation_errors, translation_errors
from palpate.pipeline.track import quiet
from palpate.touch.model import TouchModel
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate

SECOND = 1.0
"""[s] within which a fault has to be told, and which an estimate may be silently wrong."""


@dataclass(frozen=True)
class FaultRun:
    """One recording tracked with one fault."""

    fault: str
    """Its name; see `faults.FAULTS`."""
    recording: str
    """Its file."""
    final_mm: float
    """Error of the last estimate against where the object is at the end [mm]; NaN where there is no estimate."""
    final_deg: float
    """The same of yaw [deg]."""
    inside_share: float
    """Share of estimates since fault and first contact whose 95 % region holds the truth; NaN where there is none."""
    told_after: float
    """Time from where the fault can be seen to the first status that is not content, reason or refusal [s]; NaN
    where nothing is told."""
    silent_s: float
    """Time in which the estimate is far off, outside its own region and content [s], from fault and contact on."""
    refused: int
    """Frames that a FrameError refused."""
    first_refusal: str
    """What the first of them said."""
    exception: str
    """What else was raised; nothing where all is well."""
    frames: int
    """Frames that arrived."""
    wall_s: float
    """Time that tracking took [s]."""

    @property
    def silently_wrong(self) -> bool:
        """Whether it was silently wrong for longer than a second."""
        return self.silent_s > SECOND

    @property
    def told(self) -> bool:
        """Whether it was told within a second."""
        return self.told_after <= SECOND


def run_faults(
    files: Mapping[str, Path],
    names: Sequence[str] = tuple(FAULTS),
    seed: int = 0,
    model: TouchModel | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[FaultRun]:
    """Track recordings, by name, with each fault that `is_of` them; the order is that of faults, then of recordings.

    `progress` is called with the number of recordings that are done. Raises FileError, before the work, on a recording
    that `check_faults` refuses.
    """
    for path in files.values():
        check_faults(load_recording(path))
    runs: list[FaultRun] = []
    do = partial(run_recording, names=tuple(names), seed=seed, model=model)
    with closing(spread(do, files.items(), workers)) as results:
        for done, result in enumerate(results, 1):
            runs += result
            if progress:
                progress(done)
    faults, recordings = list(names), list(files)
    return sorted(runs, key=lambda run: (faults.index(run.fault), recordings.index(run.recording)))


def run_recording(
    named: tuple[str, Path], names: Sequence[str], seed: int = 0, model: TouchModel | None = None
) -> list[FaultRun]:
    """Track one recording, given its name and file, with each fault that `is_of` it."""
    name, path = named
    stream = stream_of(load_recording(path))
    settings = TrackerSettings("learnt")
    runs: list[FaultRun] = []
    for fault in (name for name in names if is_of(name, stream)):
        rng = np.random.default_rng([seed, zlib.crc32(f"{fault} {name}".encode())])
        with quiet():
            runs.append(run_stream(FAULTS[fault](stream, rng), settings, fault, name, model))
    return runs


def run_stream(
    stream: Stream, settings: TrackerSettings, fault: str = "", recording: str = "", model: TouchModel | None = None
) -> FaultRun:
    """Track a stream and score it."""
    start = time.perf_counter()
    kept: list[int] = []
    estimates: list[Estimate] = []
    refused: list[int] = []
    first_refusal = exception = ""
    try:
        tracker = Tracker(
            stream.shape, stream.sensor, stream.first_pose, settings, model, calibration=stream.calibration
        )
        for index, frame in enumerate(stream.frames):
            try:
                estimates.append(tracker.update(frame))
                kept.append(index)
            except FrameError as error:
                first_refusal = first_refusal or str(error)
                refused.append(index)
    except Exception as error:
        exception = f"{type(error).__name__}: {error}"
    wall_s = time.perf_counter() - start
    scores = _scores(stream, np.array(kept, dtype=np.int_), estimates, refused)
    return FaultRun(fault, recording, *scores, len(refused), first_refusal, exception, len(stream), round(wall_s, 3))


def _scores(
    stream: Stream, kept: np.ndarray, estimates: Sequence[Estimate], refused: Sequence[int]
) -> tuple[float, float, float, float, float]:
    """Final errors [mm], [deg], share inside, time until told [s], time silently wrong [s]; see FaultRun."""
    told = np.zeros(len(stream), np.bool_)
    told[list(refused)] = True
    if not estimates:
        after = stream.arrival[told & (stream.arrival >= stream.begin)]
        return np.nan, np.nan, np.nan, float(after[0] - stream.begin) if len(after) else np.nan, 0.0
    truth = np.array([frame.object_pose for frame in stream.frames])
    pose = np.array([estimate.pose for estimate in estimates])
    if isinstance(stream.shape, Disc):  # nothing can tell its yaw
        truth[kept, 2], truth[-1, 2] = pose[:, 2], pose[-1, 2]
    covariance = np.array([estimate.covariance for estimate in estimates])
    content = np.array([estimate.status in CONTENT and not estimate.reason for estimate in estimates])
    told[kept] = ~content
    after = stream.arrival[told & (stream.arrival >= stream.begin - 1e-9)]
    inside = inside_95(nees(pose, covariance, truth[kept]))
    far = is_far(1e3 * translation_errors(pose, truth[kept]), np.degrees(rotation_errors(pose, truth[kept])))
    touched = np.maximum.accumulate(stream.touching)[kept] & (stream.arrival[kept] >= stream.begin - 1e-9)
    interval = np.diff(stream.arrival, append=stream.arrival[-1])[kept]
    final = se2.between(truth[-1], pose[-1])
    return (
        float(1e3 * np.hypot(*final[:2])),
        float(np.degrees(abs(final[2]))),
        float(np.mean(inside[touched])) if touched.any() else np.nan,
        float(after[0] - stream.begin) if len(after) else np.nan,
        float(np.sum(interval[touched & far & ~inside & content])),
    )
