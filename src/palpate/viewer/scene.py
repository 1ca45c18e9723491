"""What a view shows: frames of a recording and, where it was tracked, what came of it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate import io as formats
from palpate.errors import FileError
from palpate.files import read_json
from palpate.io import estimates_csv
from palpate.pipeline import details
from palpate.pipeline.truth import known_truth
from palpate.touch.calibration import Calibration, load_calibration
from palpate.touch.lift import lift_of
from palpate.types.answer import Answers
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene:
    """A recording of N frames and what tracking made of it."""

    name: str
    """What to call it."""
    recording: Recording
    """What was tracked, or is only to be seen."""
    truth: Array | None
    """Ground truth (N, 3), NaN where it is not known or not trusted."""
    estimate: Trajectory | None = None
    """The estimate at each frame, with covariance, contact and status; None for a recording that was not tracked."""
    answers: Answers = ()
    """All answers at each of N frames, the best first; none at frames with one."""
    friction: Array | None = None
    """Friction as learnt up to each frame, and its standard deviation, (N, 2)."""
    calibration: Calibration | None = None
    """What was known of the sensor unit."""

    @property
    def contact(self) -> NDArray[np.bool_] | None:
        """Whether the sensor touches at each frame, (N,): as tracking found, or as the recording says."""
        return self.recording.contact if self.estimate is None else self.estimate.contact


def load_scene(path: Path) -> Scene:
    """Return what there is to see of a run folder, or of a recording in any known format. Raises FileError."""
    if path.is_dir():
        return _load_run(path)
    recording = formats.load_recording(path)
    return Scene(path.name, recording, known_truth(recording))


def _load_run(folder: Path) -> Scene:
    if not (folder / "settings.json").exists():
        raise FileError(f"{folder}: is no run of palpate track: there is no settings.json in it")
    settings = read_json(folder / "settings.json")
    recording = formats.load_recording(folder / _said(settings, "recording", folder))
    estimate = estimates_csv.read(folder / "estimates.csv")
    if not np.array_equal(estimate.time, recording.time):
        raise FileError(
            f"{folder}: its {len(estimate)} estimates are not of the {len(recording)} frames of {recording.file}, "
            "which is another recording now; track it again"
        )
    return Scene(
        folder.resolve().name,
        recording,
        known_truth(recording),
        estimate,
        details.read_answers(folder / "answers.csv", estimate.time),
        details.read_friction(folder / "friction.csv", estimate.time),
        _calibration(folder, settings, recording),
    )


def _calibration(folder: Path, settings: dict[str, Any], recording: Recording) -> Calibration | None:
    """What a run was tracked with: a file or, where it began in contact, the gel after that."""
    if settings.get("calibration") is not None:
        return load_calibration(_said(settings, "calibration", folder))
    began_in_contact = "untouched_from_s" in read_json(folder / "summary.json")
    lift = lift_of(recording) if began_in_contact else None
    return lift and lift.calibration


def _said(settings: dict[str, Any], name: str, folder: Path) -> str:
    value = settings.get(name)
    if not isinstance(value, str):
        raise FileError(f"{folder / 'settings.json'}: {name} is {json.dumps(value)}, expected the name of a file")
    return value
