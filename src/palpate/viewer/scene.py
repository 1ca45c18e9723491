"""A recording and, where it was tracked, its estimates, as views show them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import read_json
from palpate.io import load_recording
from palpate.io.trajectories import read_estimates_csv
from palpate.pipeline.run_folder import read_answers
from palpate.types.estimate import Answers, Status, Trajectory
from palpate.types.recording import Recording

# Okabe and Ito's palette, which people with any colour vision can tell apart.
COLOURS = {
    "truth": "#8C8C8C",
    "estimate": "#0E86CC",
    "sensor": "#D55E00",
    "contact": "#E69F00",
    "others": "#CC79A7",
}
STATUS_COLOURS: dict[Status, str] = {
    "tracking": "#009E73",
    "resting": "#A6B8C2",
    "ambiguous": "#E69F00",
    "strained": "#D55E00",
    "uncertain": "#F0E442",
    "displaced": "#CC79A7",
    "indeterminate": "#7F3FBF",
    "faulty": "#B00020",
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A recording of N frames and its estimates."""

    name: str
    """Name for people."""
    recording: Recording
    online: Trajectory | None = None
    """Estimate at each frame, with covariance, contact and status; None for a recording that was not tracked."""
    answers: Answers = ()
    """All answers at each frame with several."""


def load_scene(path: Path) -> Scene:
    """Read the folder of a run, or a recording of any known format; raises FileError."""
    if not path.is_dir():
        return Scene(path.name, load_recording(path))
    if not (path / "settings.json").exists():
        raise FileError(f"{path}: is no run of palpate track: there is no settings.json in it")
    if not isinstance(file := read_json(path / "settings.json").get("recording"), str):
        raise FileError(f"{path / 'settings.json'}: recording is {file!r}, expected the name of a file")
    recording = load_recording(path / file)
    online = read_estimates_csv(path / "estimates.csv")
    if online.covariance is None or online.contact is None or online.status is None:
        raise FileError(f"{path / 'estimates.csv'}: lacks covariance, contact or status, which palpate track writes")
    if not np.array_equal(online.time, recording.time):
        raise FileError(
            f"{path}: its {len(online)} estimates are not of the {len(recording)} frames of {recording.file}, "
            "which is another recording now; track it again"
        )
    return Scene(path.resolve().name, recording, online, read_answers(path / "answers.csv", online.time))
