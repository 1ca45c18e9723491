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
    """Of recordings, the sensor, weights and pairs."""


FULL = PaperSettings(train=40, test=50, seconds=15.0, steps=2000, pairs=100_000)
"""As many sequences as the paper has."""
SMALL = PaperSettings(train=4, test=1, seconds=5.0, steps=100, pairs=2000)
"""Enough to see every part and figure."""


def run(out: Path, settings: PaperSettings, bar: Bar, workers: int = 1, dask: str | None = None) -> dict[str, Any]:
    """Run the study in a folder, keeping finished parts, and return `table2` and `tracking`.

    Raises FileError if the folder holds a study of another size.
    """
    out.mkdir(parents=True, exist_ok=True)
    if (out / "settings.json").exists() and (found := read_json(out / "settings.json")) != asdict(settings):
        raise FileError(f"{out}: holds a study with settings {found}; take another folder")
    write_json(out / "settings.json", asdict(settings))
    shapes = {name: load_shape(outline) for name, outline in SHAPES.items()}
    for name, count, seconds, seed in (
        ("train", settings.train, settings.seconds, 2 * settings.seed + 1),
        ("test", settings.test, 15.0, 2 * settings.seed + 2),
    ):
        # All with one sensor, as the paper has one DIGIT.
        wanted = plan(shapes, count, seed, seconds=seconds, ideal=True, unit=settings.seed)
        with bar(f"simulating, {name}", len(wanted)) as progress:
            fill_folder(out / name, wanted, workers=workers, dask=dask, resume=True, progress=progress)
    if not (out / "models.json").exists():
        _learn(out, settings, bar, workers, dask)
    files = find_recordings(out / "test")
    by = partial(_tracked, out=out.resolve())
    how = StudySettings(MODES)
    with bar("tracking", len(files) * len(MODES)) as progress:
        study = run_study(files, out / "tracks", how, workers, dask, True, progress, by)
    for (name, mode), why in study.failed.items():
        raise EstimationError(f"{out / 'test' / name}: cannot be tracked by {mode}: {why}")
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


def _draw(out: Path, files: Mapping[str, Path], trials: Sequence[Trial]) -> None:
    """Draw some sequences of rectangles, and some of the others."""
    names = [name for name in files if name.startswith("rect")], [name for name in files if not name.startswith("rect")]
    tracks = [
        {name: (load_recording(files[name]), [each for each in trials if each.recording == name]) for name in some}
        for some in (each[:: max(len(each) // 6, 1)][:6] for each in names)
    ]
    network, _ = _models(out)
    seen = []
    for name in (names[0][0], names[1][0], names[1][-1]):
        images = read_images(load_recording(files[name]))
        shown = np.linspace(0, len(images.frame) - 1, 6).astype(int)
        seen.append((images.difference[shown], keypoints_of(network, images)[0][shown]))
    figures.draw(out, seen, *tracks)


def _learn(out: Path, settings: PaperSettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Train the auto-encoder and all transform networks, and measure touch; writes model.pt and models.json."""
    parts: dict[str, Images] = {}
    files = sorted((out / "train").glob("*.mcap"))
    with bar("reading images", len(files)) as progress:
        for name, images in spread(_read, files, workers, dask):
            parts[name] = images
            progress(len(parts))
    # A quarter validates, of each object: every fourth recording, which takes turns with its kinds of contact.
    of_object = {name: [parts[each] for each in sorted(parts) if each.startswith(name)] for name in SHAPES}
    for_training = {name: joined([p for k, p in enumerate(each) if k % 4 != 3]) for name, each in of_object.items()}
    validation = {name: joined([p for k, p in enumerate(each) if k % 4 == 3]) for name, each in of_object.items()}
    for split in (for_training, validation):
        split["combined"] = joined([split[name] for name in SHAPES])
    fit_settings = FitSettings(steps=settings.steps, check=max(settings.steps // 10, 1))
    with bar("key points", settings.steps) as progress:
        everything = for_training["combined"], validation["combined"]
        network = learn_keypoints(*everything, fit_settings, settings.seed, out, progress)
    losses: dict[str, dict[str, float]] = {}
    with bar("transform networks", 4) as progress:
        weights = np.empty(0)
        for done, name in enumerate((*SHAPES, "combined"), 1):
            trained = _pairs(network, for_training[name], settings.pairs, settings.seed)
            checked = _pairs(network, validation[name], settings.pairs, settings.seed + 1)
            for model, (features, predict) in fit_all(trained[0], trained[1], trained[2], settings.seed).items():
                pairs = checked[0] if features == "engineered" else checked[1]
                losses.setdefault(model, {})[name] = validation_loss(predict, pairs, checked[2])
            weights = fit_linear(trained[1], trained[2])  # the last are of all objects
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
    found = ~np.isnan(images.ellipse)
    ellipse = np.where(found, images.ellipse, np.mean(images.ellipse, axis=0, where=found) if found.any() else 0.0)
    sine = np.sin(turn_between(images, earlier, later))
    return (ellipse[earlier], ellipse[later], class_vector), (points[earlier], points[later], class_vector), sine


def _turns(network: KeypointNetwork, weights: Array, images: Images) -> tuple[Indices, Indices, dict[str, Array]]:
    """Return the pairs of images that the graph compares, (P,) each, and their turns (P,) [rad] by kind of touch."""
    first = np.searchsorted(images.episode, images.episode).tolist()
    pairs = [(k - back, k) for k in range(len(images.frame)) for back in compared_frames(k - first[k])]
    earlier, later = np.array(pairs, int).reshape(-1, 2).T
    points, classes = keypoints_of(network, images)
    sine = expanded((points[earlier], points[later], 0.5 * (classes[earlier] + classes[later]))) @ weights
    turns = np.zeros(len(pairs)), np.arcsin(np.clip(sine, -1.0, 1.0)), turn_between(images, earlier, later)
    return earlier, later, dict(zip(TACTILE, turns, strict=True))


def _tactile_sigmas(network: KeypointNetwork, weights: Array, images: Images) -> dict[str, float]:
    """Return the standard deviation of a tactile factor [rad] by kind of touch, from episodes not trained on.

    With it the turn over an episode, from these factors alone, is as uncertain as it is wrong.
    """
    earlier, later, turns = _turns(network, weights, images)
    first = np.searchsorted(images.episode, images.episode)[later]
    episode = images.episode[later]
    found = {"oracle": 1e-3}
    for mode in ("const", "learnt"):
        error = turns[mode] - turns["oracle"]
        each = [
            tactile_error((earlier - first)[k], (later - first)[k], error[k])
            for k in (episode == number for number in np.unique(episode))
        ]
        found[mode] = float(1.4826 * np.median(np.abs(each)))  # of a Gaussian; most contacts stick, as in training
    return found


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
    earlier, later, found = _turns(*_models(out), images)
    turns: dict[str, dict[int, list[tuple[int, float]]]] = {mode: {} for mode in TACTILE}
    for mode, turn in found.items():
        for i, k, angle in zip(earlier.tolist(), later.tolist(), turn.tolist(), strict=True):
            turns[mode].setdefault(int(images.frame[k]), []).append((k - i, angle))
    return turns


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
    pose, covariance, took = track_episodes(model, recording.sensor_pose, episode, turns, truth[0], sigma)
    said = ("tracking",) * len(recording), ("",) * len(recording)
    online = Trajectory(recording.time, pose, covariance, episode >= 0, *said)
    summary = summarise(online, truth, took, yaw_shows=not isinstance(recording.shape, Disc))
    first = truth[0], np.array(CAPTURE)
    return Run(recording, settings.tracker, None, None, *first, online, (), took, summary)
