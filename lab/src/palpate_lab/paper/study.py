"""The paper's experiments from nothing: recordings, models with Table II, tracking, figures (paper Sec. V)."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.errors import EstimationError, FileError
from palpate.files import read_json, whole_file, write_json
from palpate.geometry.shapes import Disc
from palpate.io import load_recording
from palpate.io.outlines import load_shape
from palpate.models.pushing.contact_geometry import contact_model
from palpate.pipeline.metrics import summarise
from palpate.pipeline.track import Run
from palpate.types.estimate import Trajectory
from palpate_lab.paper import figures
from palpate_lab.paper.features import KeypointNetwork, keypoints_of, learn_keypoints
from palpate_lab.paper.graph import CAPTURE, compared_frames, tactile_error, track_episodes
from palpate_lab.paper.images import Images, draw_pairs, episode_numbers, joined, read_images, turn_between
from palpate_lab.paper.transform_network import Pairs, expanded, fit_all, fit_linear, validation_loss
from palpate_lab.parallel import spread
from palpate_lab.simulate.recordings import fill_folder, plan
from palpate_lab.study.figures import write_figures
from palpate_lab.study.recordings import find_recordings
from palpate_lab.study.results import ALL, table
from palpate_lab.study.study import StudySettings, Trial, run_study, track_file
from palpate_lab.train.fit import FitSettings

Indices = NDArray[np.int_]
Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]

SHAPES = {"disc": "disc", "rect": "rectangle", "ellip": "ellipse"}
"""The paper's objects and palpate's names of their outlines."""
MODES = ("none", "const", "learnt", "oracle", "palpate")
TACTILE = MODES[1:4]


@dataclass(frozen=True)
class PaperSettings:
    """Size of the study."""

    train: int = 24
    """Sequences of each object to learn from, a quarter of them for validation."""
    test: int = 3
    """Sequences of each object to track; the paper has 50."""
    seconds: float = 10.0
    """Length of a training sequence [s]."""
    steps: int = 400
    """Steps of the auto-encoder's descent."""
    pairs: int = 20_000
    """Pairs that the transform networks are fitted to, and as many to validate."""
    seed: int = 0
    """Seed of recordings, the sensor, weights and pairs."""


FULL = PaperSettings(train=40, test=50, seconds=15.0, steps=2000, pairs=100_000)
"""As many sequences as the paper has."""
SMALL = PaperSettings(train=4, test=1, seconds=5.0, steps=100, pairs=2000)
"""Enough to see every part and figure."""


def run(out: Path, settings: PaperSettings, bar: Bar, workers: int = 1, dask: str | None = None) -> dict[str, Any]:
    """Run the study in a folder, keeping finished parts, and return `table2` and `tracking`.

    Raises FileError if the folder holds a study of another size.
    """
    _check_settings(out, settings)
    _simulate(out, settings, bar, workers, dask)
    if not (out / "models.json").exists():
        _learn(out, settings, bar, workers, dask)
    files = find_recordings(out / "test")
    track_by = partial(_tracked, out=out.resolve())
    with bar("tracking", len(files) * len(MODES)) as progress:
        study = run_study(files, out / "tracks", StudySettings(MODES), workers, dask, True, progress, track_by)
    for (name, mode), reason in study.failed.items():
        raise EstimationError(f"{out / 'test' / name}: cannot be tracked by {mode}: {reason}")
    models = read_json(out / "models.json")
    rows = table(study.trials, MODES)[ALL]
    results = {
        "table2": models["table2"],
        "tracking": {
            mode: {
                "final_translation_mm": row["final_mm"]["median"],
                "final_rotation_deg": row["final_deg"]["median"],
                "lost": row["lost"],
                "in_95_share": row["inside_95"],
            }
            for mode, row in rows.items()
        },
        "deviations": models["deviations"],
        "settings": asdict(settings),
        "sequences": len(files),
    }
    write_json(out / "results.json", results)
    with bar("figures", 1) as progress:
        write_figures(out, study.trials)
        _draw(out, files, study.trials)
        progress(1)
    return results


def _check_settings(out: Path, settings: PaperSettings) -> None:
    """Write the settings to the study's folder, or check that those in it are the same."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "settings.json"
    if path.exists():
        earlier = read_json(path)
        if earlier != asdict(settings):
            raise FileError(f"{out}: holds a study with settings {earlier}; take another folder")
    write_json(path, asdict(settings))


def _simulate(out: Path, settings: PaperSettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Simulate the sequences to learn from and those to track, all with one sensor, as the paper has one DIGIT."""
    shapes = {name: load_shape(outline) for name, outline in SHAPES.items()}
    for name, count, seconds, seed in (
        ("train", settings.train, settings.seconds, 2 * settings.seed + 1),
        ("test", settings.test, 15.0, 2 * settings.seed + 2),
    ):
        simulations = plan(shapes, count, seed, seconds=seconds, ideal=True, unit=settings.seed)
        with bar(f"simulating, {name}", len(simulations)) as progress:
            fill_folder(out / name, simulations, workers=workers, dask=dask, resume=True, progress=progress)


def _draw(out: Path, files: Mapping[str, Path], trials: Sequence[Trial]) -> None:
    """Draw some sequences of rectangles, and some of the others."""
    rectangles = [name for name in files if name.startswith("rect")]
    others = [name for name in files if not name.startswith("rect")]
    network, _ = _models(out)
    seen = []
    for name in (rectangles[0], others[0], others[-1]):
        images = read_images(load_recording(files[name]))
        shown = np.linspace(0, len(images.frame) - 1, 6).astype(int)
        seen.append((images.difference[shown], keypoints_of(network, images)[0][shown]))
    figures.draw(out, seen, _tracks(files, rectangles, trials), _tracks(files, others, trials))


def _tracks(files: Mapping[str, Path], names: Sequence[str], trials: Sequence[Trial]) -> figures.Tracks:
    """Return up to six of the sequences, evenly chosen, with their trials."""
    chosen = names[:: max(len(names) // 6, 1)][:6]
    tracks = {}
    for name in chosen:
        of_sequence = [trial for trial in trials if trial.recording == name]
        tracks[name] = (load_recording(files[name]), of_sequence)
    return tracks


def _learn(out: Path, settings: PaperSettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Train the auto-encoder and all transform networks, and measure touch; writes model.pt and models.json."""
    parts: dict[str, Images] = {}
    files = sorted((out / "train").glob("*.mcap"))
    with bar("reading images", len(files)) as progress:
        for name, images in spread(_read, files, workers, dask):
            parts[name] = images
            progress(len(parts))
    for_training: dict[str, Images] = {}
    validation: dict[str, Images] = {}
    for name in SHAPES:
        # Every fourth recording of an object validates; its kinds of contact take turns.
        of_object = [parts[recording] for recording in sorted(parts) if recording.startswith(name)]
        for_training[name] = joined([images for k, images in enumerate(of_object) if k % 4 != 3])
        validation[name] = joined(of_object[3::4])
    for split in (for_training, validation):
        split["combined"] = joined([split[name] for name in SHAPES])
    fit_settings = FitSettings(steps=settings.steps, check=max(settings.steps // 10, 1))
    with bar("key points", settings.steps) as progress:
        network = learn_keypoints(
            for_training["combined"], validation["combined"], fit_settings, settings.seed, out, progress
        )
    losses: dict[str, dict[str, float]] = {}
    with bar("transform networks", 4) as progress:
        weights = np.empty(0)
        for done, name in enumerate((*SHAPES, "combined"), 1):
            engineered, learnt, sine = _pairs(network, for_training[name], settings.pairs, settings.seed)
            models = fit_all(engineered, learnt, sine, settings.seed)
            weights = fit_linear(learnt, sine)  # the last are of all objects
            engineered, learnt, sine = _pairs(network, validation[name], settings.pairs, settings.seed + 1)
            for model, (features, predict) in models.items():
                pairs = engineered if features == "engineered" else learnt
                losses.setdefault(model, {})[name] = validation_loss(predict, pairs, sine)
            progress(done)
    deviations = _tactile_sigmas(network, weights, validation["combined"])
    with whole_file(out / "model.pt", overwrite=True) as part:
        torch.save({"network": network.state_dict(), "weights": torch.from_numpy(weights)}, part)
    write_json(out / "models.json", {"table2": losses, "deviations": deviations})


def _read(path: Path) -> tuple[str, Images]:
    """Return the name of a recording and its images."""
    return path.stem, read_images(load_recording(path))


def _pairs(network: KeypointNetwork, images: Images, count: int, seed: int) -> tuple[Pairs, Pairs, Array]:
    """Return pairs with engineered features, with learnt ones, and the sines of their true turns."""
    earlier, later = draw_pairs(images, count, np.random.default_rng(seed))
    points, classes = keypoints_of(network, images)
    class_vector = 0.5 * (classes[earlier] + classes[later])
    has_patch = ~np.isnan(images.ellipse)
    usual = np.mean(images.ellipse, axis=0, where=has_patch) if has_patch.any() else 0.0
    ellipse = np.where(has_patch, images.ellipse, usual)
    sine = np.sin(turn_between(images, earlier, later))
    return (ellipse[earlier], ellipse[later], class_vector), (points[earlier], points[later], class_vector), sine


def _turns(network: KeypointNetwork, weights: Array, images: Images) -> tuple[Indices, Indices, dict[str, Array]]:
    """Return the pairs of images that the graph compares, (P,) each, and their turns (P,) [rad] by kind of touch."""
    first = np.searchsorted(images.episode, images.episode).tolist()
    pairs = [(k - back, k) for k in range(len(images.frame)) for back in compared_frames(k - first[k])]
    earlier, later = np.array(pairs, int).reshape(-1, 2).T
    points, classes = keypoints_of(network, images)
    sine = expanded((points[earlier], points[later], 0.5 * (classes[earlier] + classes[later]))) @ weights
    turns = {
        "const": np.zeros(len(pairs)),
        "learnt": np.arcsin(np.clip(sine, -1.0, 1.0)),
        "oracle": turn_between(images, earlier, later),
    }
    return earlier, later, turns


def _tactile_sigmas(network: KeypointNetwork, weights: Array, images: Images) -> dict[str, float]:
    """Return the standard deviation of a tactile factor [rad] by kind of touch, from episodes not trained on.

    With it the turn over an episode, from these factors alone, is as uncertain as it is wrong.
    """
    earlier, later, turns = _turns(network, weights, images)
    first = np.searchsorted(images.episode, images.episode)[later]
    episode = images.episode[later]
    sigmas = {"oracle": 1e-3}
    for mode in ("const", "learnt"):
        error = turns[mode] - turns["oracle"]
        ratios = []
        for number in np.unique(episode):
            k = episode == number
            ratios.append(tactile_error((earlier - first)[k], (later - first)[k], error[k]))
        # The median of the absolute ratios of a Gaussian is 1 / 1.4826; most contacts stick, as in training.
        sigmas[mode] = float(1.4826 * np.median(np.abs(ratios)))
    return sigmas


def _models(out: Path) -> tuple[KeypointNetwork, Array]:
    """Return the trained auto-encoder, and the weights of the linear transform network."""
    saved = torch.load(out / "model.pt", weights_only=True)
    network = KeypointNetwork()
    network.load_state_dict(saved["network"])
    return network, saved["weights"].numpy()


@lru_cache(maxsize=1)
def _felt(path: Path, out: Path) -> dict[str, dict[int, list[tuple[int, float]]]]:
    """Return the tactile measurements of a sequence by mode and frame: turns [rad] since so many frames ago."""
    torch.set_num_threads(1)
    images = read_images(load_recording(path))
    earlier, later, turns = _turns(*_models(out), images)
    by_mode: dict[str, dict[int, list[tuple[int, float]]]] = {}
    for mode, turn in turns.items():
        by_frame: dict[int, list[tuple[int, float]]] = {}
        for i, k, angle in zip(earlier.tolist(), later.tolist(), turn.tolist(), strict=True):
            by_frame.setdefault(int(images.frame[k]), []).append((k - i, angle))
        by_mode[mode] = by_frame
    return by_mode


def _tracked(path: Path, mode: str, settings: StudySettings, out: Path) -> Run:
    """Track a sequence in a mode."""
    if mode == "palpate":
        return track_file(path, "learnt", settings)
    recording = load_recording(path)
    sigma = read_json(out / "models.json")["deviations"].get(mode, 0.0)
    truth = np.asarray(recording.object_pose)
    episode = episode_numbers(np.asarray(recording.contact))
    model = contact_model(recording.shape, recording.sensor)
    turns = {} if mode == "none" else _felt(path, out)[mode]
    pose, covariance, step_ms = track_episodes(model, recording.sensor_pose, episode, turns, truth[0], sigma)
    status = ("tracking",) * len(recording)
    reason = ("",) * len(recording)
    online = Trajectory(recording.time, pose, covariance, episode >= 0, status, reason)
    yaw_shows = not isinstance(recording.shape, Disc)
    summary = summarise(online, truth, step_ms, center=recording.shape.centroid, yaw_shows=yaw_shows)
    return Run(recording, settings.tracker, None, None, truth[0], np.array(CAPTURE), online, (), step_ms, summary)
