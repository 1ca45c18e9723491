"""Tracking of a sequence in each mode, with the paper's limit surface and first pose or with others."""

import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.files import read_json
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Shape
from palpate.io import load_recording
from palpate.io.recording import Recording
from palpate.models.pushing.contact_geometry import ContactModel, contact_model
from palpate.pipeline.metrics import summarise
from palpate.pipeline.track import Run, track
from palpate.types.estimate import Trajectory
from palpate.types.sensor import SensorProfile
from palpate_lab.paper.graph import CAPTURE, FRICTION_RADIUS, PhysicsNoise, track_episodes
from palpate_lab.paper.images import episode_numbers
from palpate_lab.paper.touch import read_turns
from palpate_lab.parallel import quiet
from palpate_lab.study.study import StudySettings

MODES = ("none", "const", "learnt", "oracle", "palpate")
FRICTION_FACTORS = (0.5, 1.0, 2.0)
"""Friction radii c of the sweep, over that of uniform pressure."""
FIRST_ERRORS = (5.0, 15.0)
"""Errors of the first pose in the sweep [mm]; its yaw is off by 0.6 degrees for each millimetre."""


@dataclass(frozen=True)
class Way:
    """A mode, and what differs from the paper."""

    mode: str
    """One of MODES."""
    friction: float | None = None
    """Friction radius c over that of uniform pressure; None for the authors' c."""
    first_error: float = 0.0
    """Error of the first pose [mm], in a direction of its own in each sequence."""

    @property
    def name(self) -> str:
        """Return the name under which a study keeps its trials."""
        friction = "" if self.friction is None else f"+c{self.friction:g}"
        first = f"+first{self.first_error:g}" if self.first_error else ""
        return self.mode + friction + first


WAYS = {
    way.name: way
    for way in (
        *(Way(mode) for mode in MODES),
        *(Way(mode, friction=factor) for factor in FRICTION_FACTORS for mode in MODES[:4]),
        *(Way(mode, first_error=error) for error in FIRST_ERRORS for mode in MODES),
    )
}
"""All ways of tracking, by name. palpate has its own c."""


def pushed(shape: Shape, sensor: SensorProfile, object_name: str, friction: float | None, scale: float) -> ContactModel:
    """Return the contact model of one of the paper's objects, with the friction radius of a way.

    `scale` multiplies the authors' c.
    """
    model = contact_model(shape, sensor)
    if friction is None:
        return replace(model, friction_radius=scale * FRICTION_RADIUS[object_name])
    return replace(model, friction_radius=friction * model.friction_radius)


def tracked(path: Path, name: str, settings: StudySettings, out: Path) -> Run:
    """Track the sequence of a file in the way of this name; `out` is the folder of the paper's study."""
    way = WAYS[name]
    recording = load_recording(path)
    models = read_json(out / "models.json")
    truth = np.asarray(recording.object_pose)
    first_pose, first_sigma = _first_pose(path.stem, truth[0], way.first_error)
    if way.mode == "palpate":
        tracker = replace(settings.tracker, tactile="learnt")
        given: dict[str, Any] = {"first_pose": first_pose, "first_pose_sigma": first_sigma} if way.first_error else {}
        with quiet():
            return track(recording, tracker, **given)
    episode = episode_numbers(np.asarray(recording.contact))
    scale = models["limit_surface"]
    model = pushed(recording.shape, recording.sensor, path.stem.split("-")[0], way.friction, scale)
    noise = PhysicsNoise(**models["physics"][physics_key(way.friction)])
    turns = {} if way.mode == "none" else read_turns(out / "touch" / f"{path.stem}.npz", way.mode)
    sigma = models["deviations"][way.mode]
    estimate = track_episodes(model, noise, recording.sensor_pose, episode, turns, first_pose, sigma, first_sigma)
    return _run(recording, settings, estimate, first_pose, first_sigma, episode)


def physics_key(friction: float | None) -> str:
    """Return the name of the physics' noise for the friction radius of a way."""
    return "authors" if friction is None else f"{friction:g}"


def _first_pose(name: str, true: Array, error: float) -> tuple[Array, tuple[float, float, float]]:
    """Return the first pose as it is given and its deviations [m, m, rad], which are as large as its errors."""
    if not error:
        return true, CAPTURE
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    direction = rng.uniform(-np.pi, np.pi)
    shift = 1e-3 * error
    turn = float(np.radians(0.6 * error))
    off = shift * np.array([np.cos(direction), np.sin(direction), 0.0])
    off[2] = turn * rng.choice((-1.0, 1.0))
    side = shift / np.sqrt(2.0)
    given = true + off
    given[2] = se2.wrap(float(given[2]))
    return given, (side, side, turn)


def _run(
    recording: Recording,
    settings: StudySettings,
    estimate: tuple[Array, Array, Array],
    first_pose: Array,
    first_sigma: tuple[float, float, float],
    episode: NDArray[np.int_],
) -> Run:
    """Return the run of the paper's graph, as palpate's own tracker gives it."""
    pose, covariance, step_ms = estimate
    truth = np.asarray(recording.object_pose)
    words = ("tracking",) * len(recording)
    online = Trajectory(recording.time, pose, covariance, episode >= 0, words, ("",) * len(recording))
    yaw_shows = not isinstance(recording.shape, Disc)
    summary = summarise(online, truth, step_ms, center=recording.shape.centroid, yaw_shows=yaw_shows)
    sigma = np.array(first_sigma)
    return Run(recording, settings.tracker, None, None, first_pose, sigma, online, (), step_ms, summary)
