"""One recording tracked in one way, as the study keeps it on disk."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FLAGS, NUMBERS, checked_array
from palpate.errors import FileError
from palpate.files import json_object, read_arrays, whole_file
from palpate.pipeline.metrics import nees, rotation_errors, translation_errors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Method:
    """A way to track."""

    tactile: str
    """See `touch.modes.Tactile`."""
    smoother: str
    """See `estimation.smoother.SmootherName`."""

    def __str__(self) -> str:
        """`learnt`, and with another smoother than the usual one `learnt, isam2`."""
        return self.tactile if self.smoother == "fixed-lag" else f"{self.tactile}, {self.smoother}"


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of one recording, tracked in one way; N frames."""

    recording: str
    """Its file, as seen from the folder of the study."""
    group: str
    """What it is one of, such as "rectangle-edges": its name without the number."""
    method: Method
    """How it was tracked."""
    time: Array
    """(N,) [s]"""
    truth: Array
    """world_T_object (N, 3) [m, m, rad]; NaN where it is not known."""
    pose: Array
    """Online estimate (N, 3) [m, m, rad]."""
    covariance: Array
    """(N, 3, 3), right tangent space at the pose."""
    contact: NDArray[np.bool_]
    """(N,)"""
    sensor_pose: Array
    """world_T_sensor (N, 3) [m, m, rad]."""
    slid: Array
    """Way that the contact has slid along the sensor up to here (N,) [m]; NaN where it is not known."""
    step_ms: Array
    """Time of each `Tracker.update` (N,) [ms]."""
    summary: dict[str, Any]
    """See `metrics.summarise`, and `job.trial_of` for what the study adds; None where truth is not known."""

    @property
    def translation_error(self) -> Array:
        """(N,) [m], NaN where truth is not known."""
        return translation_errors(self.pose, self.truth)

    @property
    def rotation_error(self) -> Array:
        """Signed, (N,) [rad], NaN where truth is not known."""
        return rotation_errors(self.pose, self.truth)

    @property
    def nees(self) -> Array:
        """(N,), NaN where truth is not known."""
        return nees(self.pose, self.covariance, self.truth)


_ARRAYS: dict[str, tuple[int, ...]] = {
    "time": (),
    "truth": (3,),
    "pose": (3,),
    "covariance": (3, 3),
    "contact": (),
    "sensor_pose": (3,),
    "slid": (),
    "step_ms": (),
}
"""What is kept of each frame, and its shape."""


def write_trial(trial: Trial, path: Path) -> None:
    """Write a trial (.npz), whole or not at all; FileError where that is not possible."""
    about = {
        "recording": trial.recording,
        "group": trial.group,
        "method": asdict(trial.method),
        "summary": trial.summary,
    }
    arrays = {name: getattr(trial, name) for name in _ARRAYS}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path, overwrite=True) as part, part.open("wb") as file:
            np.savez_compressed(file, about=np.array(json.dumps(about, allow_nan=False)), **arrays)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror})") from error


def read_trial(path: Path) -> Trial:
    """Read a trial; FileError where it is none."""
    arrays = read_arrays(path)
    if missing := [name for name in ("about", *_ARRAYS) if name not in arrays]:
        raise FileError(f"{path}: is not a trial of a study: lacks {', '.join(missing)}")
    about = json_object(str(arrays.pop("about")), f"{path}: about")
    n = len(np.atleast_1d(arrays["time"]))
    try:
        found: dict[str, Any] = {
            name: checked_array(name, arrays[name], FLAGS if name == "contact" else NUMBERS, (n, *shape))
            for name, shape in _ARRAYS.items()
        }
        method = Method(**about.pop("method"))
        return Trial(method=method, **about, **found)
    except (FileError, TypeError, KeyError) as error:
        raise FileError(f"{path}: is not a trial of a study ({error})") from error
