"""One recording of a study, tracked in every way that is asked for."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings, SmootherName, TrackerSettings
from palpate.errors import FileError, PalpateError, SettingError, ShapeError
from palpate.geometry.shapes import shape_to_dict
from palpate.io import load_recording
from palpate.lab.study.files import group_of
from palpate.lab.study.trial import Method, Trial
from palpate.pipeline.track import Run, quiet, track
from palpate.pipeline.truth import trusted_truth
from palpate.touch.calibration import Calibration
from palpate.touch.model import TouchModel
from palpate.touch.modes import Tactile
from palpate.types.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StudySettings:
    """How to track the recordings of a study."""

    methods: tuple[Method, ...]
    """Ways to track, in the order of tables."""
    noise: NoiseSettings = NoiseSettings()
    """Standard deviations of the factors."""
    pressure: str | float = "uniform"
    """How the objects press on the table, or c [m]."""
    first_pose: tuple[float, float, float] | None = None
    """world_T_object [m, m, rad] at the start of recordings without ground truth; None leaves them out."""
    first_pose_sigma: tuple[float, float, float] | None = None
    """How well the pose at the start of all recordings is known, standard deviations [m, m, rad]; by default as they or
    the noise settings say."""
    first_pose_of_all: bool = False
    """Whether `first_pose` is also where recordings with ground truth begin, as where nothing is known of it."""
    hypotheses: int = TrackerSettings.hypotheses
    """How many answers are kept at most."""
    calibration: Calibration | None = None
    """What is known of the one sensor unit that all recordings are of."""

    def tracker(self, method: Method) -> TrackerSettings:
        """Return how to track in one of the ways; SettingError where that cannot be."""
        return TrackerSettings(
            tactile=cast(Tactile, method.tactile),
            smoother=cast(SmootherName, method.smoother),
            noise=self.noise,
            pressure=self.pressure,
            hypotheses=self.hypotheses,
        )


@dataclass(frozen=True)
class Job:
    """A recording to track."""

    name: str
    """Its file, as seen from the folder of the study."""
    path: Path
    """Its file."""
    methods: tuple[Method, ...]
    """Ways in which to track it."""


@dataclass(frozen=True)
class Outcome:
    """What became of a job."""

    job: Job
    """What was to be done."""
    facts: dict[str, Any] | None = None
    """Of the recording: group, shape, source, frames, seconds, images, truth; None where it cannot be read."""
    trials: tuple[Trial, ...] = ()
    """Those that went to the end."""
    skipped: dict[Method, str] = field(default_factory=dict)
    """Why the recording cannot be tracked in this way."""
    failed: dict[Method, str] = field(default_factory=dict)
    """Why tracking did not go to the end."""
    broken: str | None = None
    """Why the recording cannot be read."""


def do_job(job: Job, settings: StudySettings, model: TouchModel | None) -> Outcome:
    """Track one recording in its ways; what goes wrong is told and not raised, so that the study goes on."""
    try:
        recording = load_recording(job.path)
    except Exception as error:
        return Outcome(job, broken=_said(error, job))
    known = bool(trusted_truth(recording).any())
    trials: list[Trial] = []
    skipped: dict[Method, str] = {}
    failed: dict[Method, str] = {}
    for method in job.methods:
        try:
            with quiet():
                run = track(
                    recording,
                    settings.tracker(method),
                    settings.first_pose if settings.first_pose_of_all or not known else None,
                    model=model,
                    calibration=settings.calibration,
                    first_pose_sigma=settings.first_pose_sigma,
                )
        except FileError as error:  # an image in the middle of it
            return Outcome(job, broken=_said(error, job))
        except (SettingError, ShapeError) as error:
            skipped[method] = _said(error, job)
        except Exception as error:
            failed[method] = _said(error, job)
        else:
            trials.append(trial_of(run, job.name, method))
    facts = {
        "group": group_of(job.name),
        "shape": shape_to_dict(recording.shape),
        "source": recording.source,
        "frames": len(recording),
        "seconds": float(recording.time[-1] - recording.time[0]),
        "images": recording.image is not None,
        "truth": known,
    }
    return Outcome(job, facts, tuple(trials), skipped, failed)


def trial_of(run: Run, name: str, method: Method) -> Trial:
    """Return what a study keeps of a run.

    Its summary is the run's and `slid_mm`: way that contacts slid in all, None where it is not known.
    """
    recording, truth = run.recording, run.truth
    way = slid(recording)
    assert run.online.covariance is not None and run.online.contact is not None
    return Trial(
        recording=name,
        group=group_of(name),
        method=method,
        time=run.online.time,
        truth=np.full((len(recording), 3), np.nan) if truth is None else truth,
        pose=run.online.pose,
        covariance=run.online.covariance,
        contact=run.online.contact,
        sensor_pose=recording.sensor_pose,
        slid=way,
        step_ms=run.step_ms,
        summary={**run.summary, "slid_mm": float(way[-1]) * 1e3 if np.isfinite(way[-1]) else None},
    )


def slid(recording: Recording) -> Array:
    """Return the way (N,) [m] that contacts have slid along the sensor up to each frame, back and forth both counted.

    It comes from the simulation's slip [m/s]; NaN where that is not known.
    """
    slip = recording.extra.get("slip")
    if slip is None or slip.shape != recording.time.shape or recording.contact is None:
        return np.full(len(recording), np.nan)
    interval = np.diff(recording.time, prepend=recording.time[0])
    return np.cumsum(np.where(recording.contact, np.abs(slip) * interval, 0.0))


def _said(error: Exception, job: Job) -> str:
    """What an error says, on one line, without the name of the file."""
    words = " ".join(str(error).split()).removeprefix(f"{job.path}: ")
    return words if isinstance(error, PalpateError) else f"{type(error).__name__}: {words}"
