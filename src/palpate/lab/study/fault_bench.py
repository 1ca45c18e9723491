"""The fault bench: recordings with one fault after the other, tracked and scored."""

import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.config import TrackerSettings
from palpate.errors import FrameError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.io import load_recording
from palpate.lab.parallel import spread
from palpate.lab.study.faults import CLEAN, FAULTS, Stream, applies, check_faults, stream_of, with_fault
from palpate.lab.study.results import write_rows
from palpate.pipeline.metrics import CONTENT, inside_95, is_far, nees, rotation_errors, translation_errors
from palpate.pipeline.track import quiet
from palpate.touch.touch_model import TouchModel
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate


@dataclass(frozen=True)
class FaultRun:
    """One recording tracked with one fault."""

    fault: str
    recording: str
    frames: int
    """Frames that arrived."""
    refused: int
    """Frames that a FrameError refused."""
    exception: str
    """Any other error; empty if all is well."""
    wall_s: float
    """Time that tracking took [s]."""
    noticed_after: float
    """Time from the fault to the first warning status, reason or refusal [s]; NaN if there is none."""
    final_mm: float = np.nan
    """Error of the last estimate against the object's last pose [mm]; NaN if there is no estimate."""
    final_deg: float = np.nan
    """The same of yaw [deg]."""
    inside_share: float = np.nan
    """Share of estimates since fault and first contact whose 95 % region holds the truth; NaN if there are none."""
    silent_s: float = 0.0
    """Time since fault and contact with the estimate far off, outside its region, and a good status [s]."""


def run_faults(
    files: Mapping[str, Path],
    names: Sequence[str] = tuple(FAULTS),
    seed: int = 0,
    model: TouchModel | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[FaultRun]:
    """Track recordings, by name, with each fault that applies, in the order of faults and then of recordings.

    `progress` is called with the number of recordings that are done. Raises FileError, before any work, on a recording
    that lacks what faults need.
    """
    for path in files.values():
        check_faults(load_recording(path))
    runs: list[FaultRun] = []
    do = partial(_run_recording, names=tuple(names), seed=seed, model=model)
    with closing(spread(do, files.items(), workers)) as results:
        for done, result in enumerate(results, 1):
            runs += result
            if progress:
                progress(done)
    faults, recordings = list(names), list(files)
    return sorted(runs, key=lambda run: (faults.index(run.fault), recordings.index(run.recording)))


def run_stream(
    stream: Stream, settings: TrackerSettings, fault: str = "", recording: str = "", model: TouchModel | None = None
) -> FaultRun:
    """Track a stream and score it."""
    start = time.perf_counter()
    estimates: dict[int, Estimate] = {}
    refused: list[int] = []
    exception = ""
    try:
        tracker = Tracker(
            stream.shape, stream.sensor, stream.first_pose, settings, model, calibration=stream.calibration
        )
        for index, frame in enumerate(stream.frames()):
            try:
                estimates[index] = tracker.update(frame)
            except FrameError:
                refused.append(index)
    except Exception as error:
        exception = f"{type(error).__name__}: {error}"
    wall_s = round(time.perf_counter() - start, 3)
    since_fault = stream.arrival >= stream.begin - 1e-9
    noticed = np.zeros(len(stream), np.bool_)
    noticed[refused] = True
    noticed[[index for index, each in estimates.items() if each.status not in CONTENT or each.reason]] = True
    after = stream.arrival[noticed & since_fault]
    noticed_after = float(after[0] - stream.begin) if len(after) else np.nan
    scores = _scores(stream, estimates, since_fault, noticed) if estimates else {}
    return FaultRun(fault, recording, len(stream), len(refused), exception, wall_s, noticed_after, **scores)


def rows_of(runs: Sequence[FaultRun]) -> list[dict[str, Any]]:
    """Return a row for each fault, in the order of runs: medians of final errors, shares of frames and of runs."""
    by_fault: dict[str, list[FaultRun]] = {}
    for run in runs:
        by_fault.setdefault(run.fault, []).append(run)
    clean = _known(np.median, [run.final_mm for run in by_fault.get(CLEAN, [])])
    return [_row(fault, some, clean) for fault, some in by_fault.items()]


def write_table(folder: Path, runs: Sequence[FaultRun]) -> None:
    """Write `fault_runs.csv`, a row for each run, and then `faults.csv`, a row for each fault."""
    for name, rows in (("fault_runs.csv", [asdict(run) for run in runs]), ("faults.csv", rows_of(runs))):
        short = [{key: f"{x:.6g}" if isinstance(x, float) else x for key, x in row.items()} for row in rows]
        write_rows(folder / name, short)


def _run_recording(job: tuple[str, Path], names: Sequence[str], seed: int, model: TouchModel | None) -> list[FaultRun]:
    """Track one recording, given its name and file, with each fault that applies."""
    name, path = job
    stream = stream_of(load_recording(path))
    runs: list[FaultRun] = []
    for fault in (each for each in names if applies(each, stream)):
        rng = np.random.default_rng([seed, zlib.crc32(f"{fault} {name}".encode())])
        with quiet():
            runs.append(run_stream(with_fault(stream, fault, rng), TrackerSettings("learnt"), fault, name, model))
    return runs


def _scores(
    stream: Stream, estimates: Mapping[int, Estimate], since_fault: np.ndarray, noticed: np.ndarray
) -> dict[str, float]:
    """Return the scores of estimates, by frame, by their names in FaultRun."""
    kept, truth = np.array(list(estimates)), stream.truth.copy()
    pose = np.array([estimate.pose for estimate in estimates.values()])
    if isinstance(stream.shape, Disc):  # its yaw cannot be observed
        truth[kept, 2], truth[-1, 2] = pose[:, 2], pose[-1, 2]
    inside = inside_95(nees(pose, np.array([estimate.covariance for estimate in estimates.values()]), truth[kept]))
    far = is_far(1e3 * translation_errors(pose, truth[kept]), np.degrees(rotation_errors(pose, truth[kept])))
    touched = (np.maximum.accumulate(stream.contact) & since_fault)[kept]
    interval = np.diff(stream.arrival, append=stream.arrival[-1])[kept]
    final = se2.between(truth[-1], pose[-1])
    return {
        "final_mm": float(1e3 * np.hypot(*final[:2])),
        "final_deg": float(np.degrees(abs(final[2]))),
        "inside_share": float(np.mean(inside[touched])) if touched.any() else np.nan,
        "silent_s": float(np.sum(interval[touched & far & ~inside & ~noticed[kept]])),
    }


def _row(fault: str, runs: Sequence[FaultRun], clean: float) -> dict[str, Any]:
    """Return the scores of a fault: the share noticed within a second, and the share that stays silently wrong."""
    finals, frames = [run.final_mm for run in runs], sum(run.frames for run in runs)
    return {
        "fault": fault,
        "runs": len(runs),
        "final_mm": _known(np.median, finals),
        "worst_mm": _known(np.max, finals),
        "final_deg": _known(np.median, [run.final_deg for run in runs]),
        "times_clean": _known(np.median, finals) / clean,
        "inside_percent": 100.0 * _known(np.mean, [run.inside_share for run in runs]),
        "told_percent": 100.0 * float(np.mean([run.noticed_after <= 1.0 for run in runs])),
        "silent_percent": 100.0 * float(np.mean([run.silent_s > 1.0 for run in runs])),
        "refused_percent": 100.0 * sum(run.refused for run in runs) / frames,
        "exceptions": sum(bool(run.exception) for run in runs),
        "step_ms": 1e3 * sum(run.wall_s for run in runs) / frames,
    }


def _known(middle: Callable[[Sequence[float]], np.floating], values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(middle(known)) if known else np.nan
