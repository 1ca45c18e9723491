"""A trial: one recording tracked by one method, with its scores, in memory and on disk."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from palpate.config import SmootherName, Tactile, TrackerSettings
from palpate.errors import FileError, PalpateError, SettingError, ShapeError
from palpate.files import read_arrays, whole_file
from palpate.geometry.shapes import shape_to_dict
from palpate.io import load_recording
from palpate.lab.study.recordings import group_of
from palpate.pipeline.metrics import nees, rotation_errors, translation_errors
from palpate.pipeline.track import Run, quiet, track
from palpate.touch.calibration import Calibration
from palpate.touch.touch_model import TouchModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Method:
    """A way to track."""

    tactile: str
    """Source of touch measurements, as in `TrackerSettings`."""
    smoother: str = "fixed-lag"
    """Solver of the graph, as in `TrackerSettings`."""

    def __str__(self) -> str:
        """`learnt`, or `learnt, batch` with another solver than the default."""
        return self.tactile if self.smoother == "fixed-lag" else f"{self.tactile}, {self.smoother}"


@dataclass(frozen=True)
class StudySettings:
    """Methods of a study, and the settings that all of them share."""

    methods: tuple[Method, ...]
    """Ways to track, in the order of tables."""
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    """All settings but `tactile` and `smoother`, which are the methods'."""
    first_pose: tuple[float, float, float] | None = None
    """world_T_object [m, m, rad] at the start of recordings without ground truth; None skips them."""
    first_pose_sigma: tuple[float, float, float] | None = None
    """Standard deviations of the first pose of all recordings [m, m, rad]; None takes those that they state."""
    first_pose_of_all: bool = False
    """Use `first_pose` for recordings with ground truth, too."""
    model: TouchModel | None = None
    """Touch model; None takes the one of each recording's sensor."""
    calibration: Calibration | None = None
    """Calibration of the sensor unit that made all recordings."""

    def of(self, method: Method) -> TrackerSettings:
        """Return the tracker's settings for a method."""
        tactile, smoother = cast(Tactile, method.tactile), cast(SmootherName, method.smoother)
        return replace(self.tracker, tactile=tactile, smoother=smoother)


@dataclass(frozen=True, eq=False)
class Trial:
    """A recording of N frames tracked by one method."""

    recording: str
    """Its file, relative to the folder of the study."""
    group: str
    """Kind of recording, such as "rectangle-edges"."""
    method: Method
    time: Array
    """(N,) [s]"""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where unknown."""
    pose: Array
    """Online estimate (N, 3) [m, m, rad]."""
    nees: Array
    """Squared error in units of the covariance (N,); NaN where the truth is unknown."""
    contact: NDArray[np.bool_]
    """(N,)"""
    sensor_pose: Array
    """world_T_sensor (N, 3) [m, m, rad]."""
    step_ms: Array
    """Duration of each `Tracker.update` (N,) [ms]."""
    summary: dict[str, Any]
    """Scores; see `metrics.summarise`."""

    @property
    def translation_error(self) -> Array:
        """(N,) [m], NaN where the truth is unknown."""
        return translation_errors(self.pose, self.truth)

    @property
    def rotation_error(self) -> Array:
        """Signed, (N,) [rad], NaN where the truth is unknown."""
        return rotation_errors(self.pose, self.truth)


@dataclass(frozen=True)
class Outcome:
    """A recording after all its methods were tried."""

    recording: str
    """Its file, relative to the folder of the study."""
    facts: dict[str, Any] | None = None
    """Group, shape, source, frames, seconds, images, truth; None if the recording cannot be read."""
    trials: tuple[Trial, ...] = ()
    skipped: dict[Method, str] = field(default_factory=dict)
    """Methods that do not apply to the recording, with the reason."""
    failed: dict[Method, str] = field(default_factory=dict)
    """Methods that ended in an error, with the error."""
    broken: str | None = None
    """Error of reading the recording."""


def track_recording(job: tuple[str, Path, Sequence[Method]], settings: StudySettings) -> Outcome:
    """Track a recording, given its name and file, by several methods; errors are kept and not raised."""
    name, path, methods = job
    trials: list[Trial] = []
    skipped: dict[Method, str] = {}
    failed: dict[Method, str] = {}

    def one_line(error: Exception) -> str:
        words = " ".join(str(error).split()).removeprefix(f"{path}: ")
        return words if isinstance(error, PalpateError) else f"{type(error).__name__}: {words}"

    try:
        recording = load_recording(path)
    except Exception as error:
        return Outcome(name, broken=one_line(error))
    has_truth = recording.object_pose is not None and bool(np.isfinite(recording.object_pose).all(axis=1).any())
    first = settings.first_pose if settings.first_pose_of_all or not has_truth else None
    known = {"model": settings.model, "calibration": settings.calibration}
    for method in methods:
        try:
            with quiet():
                run = track(recording, settings.of(method), first, first_pose_sigma=settings.first_pose_sigma, **known)
        except FileError as error:  # a damaged image
            return Outcome(name, broken=one_line(error))
        except (SettingError, ShapeError) as error:
            skipped[method] = one_line(error)
        except Exception as error:
            failed[method] = one_line(error)
        else:
            trials.append(trial_of(run, name, method))
    facts = {
        "group": group_of(name),
        "shape": shape_to_dict(recording.shape),
        "source": recording.source,
        "frames": len(recording),
        "seconds": float(recording.time[-1] - recording.time[0]),
        "images": recording.image is not None,
        "truth": has_truth,
    }
    return Outcome(name, facts, tuple(trials), skipped, failed)


def trial_of(run: Run, name: str, method: Method) -> Trial:
    """Return the parts of a run that a study keeps."""
    online = run.online
    truth = np.full_like(online.pose, np.nan) if run.truth is None else run.truth
    assert online.covariance is not None and online.contact is not None
    return Trial(
        recording=name,
        group=group_of(name),
        method=method,
        time=online.time,
        truth=truth,
        pose=online.pose,
        nees=nees(online.pose, online.covariance, truth),
        contact=online.contact,
        sensor_pose=run.recording.sensor_pose,
        step_ms=run.step_ms,
        summary=run.summary,
    )


_ARRAYS = {"time": (), "truth": (3,), "pose": (3,), "nees": (), "contact": (), "sensor_pose": (3,), "step_ms": ()}
"""Arrays of a trial's file, and their shapes after the frame."""


def write_trial(trial: Trial, path: Path) -> None:
    """Write a trial (.npz), whole or not at all."""
    about = {
        "recording": trial.recording,
        "group": trial.group,
        "method": asdict(trial.method),
        "summary": trial.summary,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, overwrite=True) as part, part.open("wb") as file:
        arrays = {name: getattr(trial, name) for name in _ARRAYS}
        np.savez_compressed(file, about=np.array(json.dumps(about, allow_nan=False)), **arrays)


def read_trial(path: Path) -> Trial:
    """Read a trial; FileError if it is damaged."""
    arrays: dict[str, Any] = read_arrays(path)
    try:
        about = json.loads(str(arrays.pop("about")))
        shapes = {name: (len(arrays["time"]), *shape) for name, shape in _ARRAYS.items()}
        if shapes != {name: array.shape for name, array in arrays.items()}:
            raise ValueError("its arrays have other shapes")
        return Trial(method=Method(**about.pop("method")), **about, **arrays)
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(f"{path}: is not a trial of a study ({error})") from error
