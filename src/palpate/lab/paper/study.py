"""The paper's experiments from nothing: recordings, models with Table II, tracking, figures (paper Sec. V)."""

import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.config import TrackerSettings
from palpate.errors import FileError
from palpate.files import read_json, whole_file
from palpate.geometry.shapes import Disc
from palpate.graph.contact_geometry import contact_model
from palpate.io import load_recording
from palpate.io.outlines import load_shape
from palpate.lab.paper import figures
from palpate.lab.paper.features import KeypointNetwork, keypoints_of, learn_keypoints
from palpate.lab.paper.graph import Deviations, Model, compared_frames, physical_errors, tactile_error, track_episodes
from palpate.lab.paper.images import Images, draw_pairs, episode_numbers, joined, read_images, turn_between
from palpate.lab.paper.transform_network import Pairs, expanded, fit_all, fit_linear, validation_loss
from palpate.lab.parallel import spread
from palpate.lab.simulate.recordings import plan, simulate_folder
from palpate.lab.train.fit import FitSettings
from palpate.pipeline.metrics import inside_95, nees
from palpate.pipeline.track import track as track_with_palpate

Indices = NDArray[np.int_]
Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]
Tracks = Mapping[str, Mapping[str, Any]]

SHAPES = {"disc": "disc", "rect": "rectangle", "ellip": "ellipse"}
"""The paper's objects and palpate's names of their outlines."""
MODES = ("none", "const", "learnt", "oracle", "palpate")
TACTILE = MODES[1:4]
LOST = 50.0, 30.0
"""Final error [mm], [degrees] from which a sequence is lost."""


@dataclass(frozen=True)
class StudySettings:
    """Size of the study."""

    train: int = 8
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


FULL = StudySettings(train=40, test=50, seconds=15.0, steps=2000, pairs=100_000)
"""As many sequences as the paper has."""


def run(out: Path, settings: StudySettings, bar: Bar, workers: int = 1, dask: str | None = None) -> dict[str, Any]:
    """Run the study in a folder, keeping finished parts, and return `table2` and `tracking`.

    Raises FileError if the folder holds a study of another size.
    """
    out.mkdir(parents=True, exist_ok=True)
    if (out / "settings.json").exists() and (found := read_json(out / "settings.json")) != asdict(settings):
        raise FileError(f"{out}: holds a study with settings {found}; take another folder")
    _write_json(out / "settings.json", asdict(settings))
    shapes = {name: load_shape(outline) for name, outline in SHAPES.items()}
    for name, count, seconds, seed in (
        ("train", settings.train, settings.seconds, 2 * settings.seed + 1),
        ("test", settings.test, 15.0, 2 * settings.seed + 2),
    ):
        # All with one sensor, as the paper has one DIGIT.
        wanted = plan(shapes, count, seed, seconds=seconds, ideal=True, unit=settings.seed)
        with bar(f"simulating, {name}", len(wanted)) as progress:
            simulate_folder(out / name, wanted, workers=workers, dask=dask, resume=True, progress=progress)
    if not (out / "models.json").exists():
        _learn(out, settings, bar, workers, dask)
    files = sorted((out / "test").glob("*.mcap"))
    (out / "tracks").mkdir(exist_ok=True)
    missing = [path for path in files if not (out / "tracks" / f"{path.stem}.npz").exists()]
    with bar("tracking", len(missing)) as progress:
        for done, _ in enumerate(spread(partial(_track, out=out), missing, workers, dask), 1):
            progress(done)
    tracks = {path.stem: dict(np.load(out / "tracks" / f"{path.stem}.npz")) for path in files}
    models = read_json(out / "models.json")
    results = {
        "table2": models["table2"],
        "tracking": {mode: _summary(tracks, mode) for mode in MODES},
        "deviations": models["deviations"],
        "settings": asdict(settings),
        "sequences": len(tracks),
    }
    _write_json(out / "results.json", results)
    with bar("figures", 1) as progress:
        figures.draw(out, tracks)
        progress(1)
    return results


def _learn(out: Path, settings: StudySettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Train the auto-encoder and all transform networks, and measure the factors; writes model.pt and models.json."""
    parts: dict[str, Images] = {}
    physical: list[Array] = []
    files = sorted((out / "train").glob("*.mcap"))
    with bar("reading images", len(files)) as progress:
        for done, (name, images, errors) in enumerate(spread(_read, files, workers, dask), 1):
            parts[name] = images
            physical.append(errors)
            progress(done)
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
    sigmas = _tactile_sigmas(network, weights, validation["combined"])
    *quasi_static, contact = _scale(np.concatenate(physical))
    deviations = {"quasi_static": quasi_static, "contact": contact, **sigmas}
    with whole_file(out / "model.pt", overwrite=True) as part:
        torch.save({"network": network.state_dict(), "weights": torch.from_numpy(weights)}, part)
    _write_json(out / "models.json", {"table2": losses, "deviations": deviations})


def _read(path: Path) -> tuple[str, Images, Array]:
    """Return the name of a recording, its images, and the errors of the physical factors in it."""
    recording = load_recording(path)
    assert recording.object_pose is not None and recording.contact is not None
    model = Model(contact_model(recording.shape, recording.sensor))
    episode = episode_numbers(recording.contact)
    errors = physical_errors(model, recording.object_pose, recording.sensor_pose, episode)
    return path.stem, read_images(recording), errors


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
    first, episode = np.searchsorted(images.episode, images.episode)[later], images.episode[later]
    found = {"oracle": 1e-3}
    for mode in ("const", "learnt"):
        error = turns[mode] - turns["oracle"]
        each = [
            tactile_error((earlier - first)[k], (later - first)[k], error[k])
            for k in (episode == number for number in np.unique(episode))
        ]
        found[mode] = float(_scale(np.array(each)))
    return found


def _track(path: Path, out: Path) -> None:
    """Track a sequence in all modes and write tracks/NAME.npz."""
    torch.set_num_threads(1)
    saved, network = torch.load(out / "model.pt", weights_only=True), KeypointNetwork()
    network.load_state_dict(saved["network"])
    deviations = read_json(out / "models.json")["deviations"]
    recording = load_recording(path)
    model = Model(contact_model(recording.shape, recording.sensor))
    images, truth = read_images(recording), recording.object_pose
    assert truth is not None and recording.contact is not None
    episode = episode_numbers(recording.contact)
    earlier, later, found = _turns(network, saved["weights"].numpy(), images)
    turns: dict[str, dict[int, list[tuple[int, float]]]] = {mode: {} for mode in MODES[:4]}
    for mode, turn in found.items():
        for i, k, angle in zip(earlier.tolist(), later.tolist(), turn.tolist(), strict=True):
            turns[mode].setdefault(int(images.frame[k]), []).append((k - i, angle))
    shown = np.linspace(0, len(images.frame) - 1, 6).astype(int)
    arrays: dict[str, Any] = {
        "images": images.difference[shown],
        "keypoints": keypoints_of(network, images)[0][shown],
        "truth": truth,
        "sensor": recording.sensor_pose,
        "time": recording.time,
        "episode": episode,
        "is_disc": isinstance(recording.shape, Disc),
        "outline": recording.shape.outline(),
    }
    physical = Deviations(tuple(deviations["quasi_static"]), deviations["contact"])
    for mode in MODES[:4]:
        sigma = deviations.get(mode, 0.0)
        pose, covariance, took = track_episodes(
            model, recording.sensor_pose, episode, turns[mode], truth[0], sigma, physical
        )
        arrays |= {f"{mode}_pose": pose, f"{mode}_covariance": covariance, f"{mode}_ms": took}
    online = track_with_palpate(recording, TrackerSettings("learnt")).online
    arrays |= {"palpate_pose": online.pose, "palpate_covariance": online.covariance}
    with whole_file(out / "tracks" / f"{path.stem}.npz", overwrite=True) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _summary(tracks: Tracks, mode: str) -> dict[str, float]:
    """Return medians of final errors, the number of lost sequences, and the share of true poses in the 95 % region."""
    final, lost, inside = [], 0, []
    for track in tracks.values():
        translation, rotation = (float(each[-1]) for each in figures.errors(track, mode))
        final.append((translation, rotation))
        lost += translation > LOST[0] or (rotation > LOST[1] and not track["is_disc"])
        squared = nees(track[f"{mode}_pose"], track[f"{mode}_covariance"], track["truth"])
        inside.append(np.mean(inside_95(squared)[np.argmax(track["episode"] >= 0) :]))
    translation, rotation = np.median(final, axis=0).tolist()
    return {
        "final_translation_mm": translation,
        "final_rotation_deg": rotation,
        "lost": int(lost),
        "in_95_share": float(np.mean(inside)),
    }


def _scale(errors: Array) -> Any:
    """Return the standard deviation of a typical episode: one in which the contact sticks, as the factors suppose."""
    return (1.4826 * np.median(np.abs(errors), axis=0)).tolist()  # the median of a Gaussian's absolute values


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    with whole_file(path, overwrite=True) as part:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
