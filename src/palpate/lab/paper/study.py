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

from palpate.config import TrackerSettings
from palpate.errors import FileError
from palpate.files import read_json, whole_file
from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.shapes import Disc
from palpate.io import load_recording
from palpate.io.outlines import load_shape
from palpate.lab.paper import figures
from palpate.lab.paper.features import KeypointNetwork, keypoints_of, learn_keypoints
from palpate.lab.paper.graph import Model, compared_frames, track_episodes
from palpate.lab.paper.images import Images, draw_pairs, episodes_of, joined, read_images, turn_between
from palpate.lab.paper.transform_network import Pairs, expanded, fit_all, fit_linear, validation_loss
from palpate.lab.parallel import spread
from palpate.lab.simulate.recordings import plan, simulate_folder
from palpate.lab.train.fit import FitSettings
from palpate.pipeline.track import track as track_with_palpate

Array = NDArray[np.float64]
Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]

SHAPES = {"disc": "disc", "rect": "rectangle", "ellip": "ellipse"}
"""The paper's objects and palpate's names of their outlines."""
MODES = ("none", "const", "learnt", "oracle", "palpate")
PAIRS_A_STEP = 30
"""Pairs of images a step, which are not independent: the variance of one is as many times that of a prediction."""
LOST = 0.05, np.radians(30.0)
"""Final error [m], [rad] from which a sequence is lost."""


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
    """Of recordings, weights and pairs."""


FULL = StudySettings(train=40, test=50, seconds=15.0, steps=2000, pairs=100_000)
"""As many sequences as the paper has."""


def run(out: Path, settings: StudySettings, bar: Bar, workers: int = 1, dask: str | None = None) -> dict[str, Any]:
    """Run the study in a folder, keeping finished parts, and return `table2` and `tracking`.

    Raises FileError if the folder holds a study of another size.
    """
    _check_folder(out, settings)
    shapes = {name: load_shape(outline) for name, outline in SHAPES.items()}
    for name, count, seconds, seed in (
        ("train", settings.train, settings.seconds, 2 * settings.seed + 1),
        ("test", settings.test, 15.0, 2 * settings.seed + 2),
    ):
        wanted = plan(shapes, count, seed, seconds=seconds, ideal=True)
        with bar(f"simulating, {name}", len(wanted)) as progress:
            simulate_folder(out / name, wanted, workers=workers, dask=dask, resume=True, progress=progress)
    if not (out / "table2.json").exists():
        _learn(out, settings, bar, workers, dask)
    table2 = read_json(out / "table2.json")
    files = sorted((out / "test").glob("*.mcap"))
    (out / "tracks").mkdir(exist_ok=True)
    missing = [path for path in files if not (out / "tracks" / f"{path.stem}.npz").exists()]
    with bar("tracking", len(missing)) as progress:
        for done, _ in enumerate(spread(partial(_track, out=out), missing, workers, dask), 1):
            progress(done)
    tracks = {path.stem: dict(np.load(out / "tracks" / f"{path.stem}.npz")) for path in files}
    results = {"table2": table2["loss"], "tracking": {mode: _summary(tracks, mode) for mode in MODES}}
    results |= {"settings": asdict(settings), "sequences": len(tracks), "step_ms": _step_times(tracks)}
    results["not_solved"] = {mode: int(sum(each[f"{mode}_refused"] for each in tracks.values())) for mode in MODES[:4]}
    with whole_file(out / "results.json", overwrite=True) as part:
        part.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    with bar("figures", 1) as progress:
        figures.draw(out, tracks, results, _example_images(out, files))
        progress(1)
    return results


def _check_folder(out: Path, settings: StudySettings) -> None:
    out.mkdir(parents=True, exist_ok=True)
    known = out / "settings.json"
    if known.exists():
        if (found := read_json(known)) != asdict(settings):
            raise FileError(f"{out}: holds a study with settings {found}; take another folder")
        return
    with whole_file(known, overwrite=True) as part:
        part.write_text(json.dumps(asdict(settings), indent=2) + "\n", encoding="utf-8")


def _learn(out: Path, settings: StudySettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Train the auto-encoder and all transform networks; writes model.pt and table2.json."""
    parts: dict[str, Images] = {}
    files = sorted((out / "train").glob("*.mcap"))
    with bar("reading images", len(files)) as progress:
        for done, (name, images) in enumerate(spread(_read, files, workers, dask), 1):
            parts[name] = images
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
    saved: dict[str, Any] = {"network": network.state_dict()}
    with bar("transform networks", 4) as progress:
        for done, name in enumerate((*SHAPES, "combined"), 1):
            trained = _pairs(network, for_training[name], settings.pairs, settings.seed)
            checked = _pairs(network, validation[name], settings.pairs, settings.seed + 1)
            for model, (features, predict) in fit_all(trained[0], trained[1], trained[2], settings.seed).items():
                pairs = checked[0] if features == "engineered" else checked[1]
                losses.setdefault(model, {})[name] = validation_loss(predict, pairs, checked[2])
            if name == "combined":
                saved["weights"] = torch.from_numpy(fit_linear(trained[1], trained[2]))
            progress(done)
    for mode, model in (("const", "const"), ("learnt", "linear learnt-feat")):
        saved[f"{mode}_sigma"] = float(np.sqrt(2.0 * losses[model]["combined"] * PAIRS_A_STEP))
    with whole_file(out / "model.pt", overwrite=True) as part:
        torch.save(saved, part)
    with whole_file(out / "table2.json", overwrite=True) as part:
        part.write_text(json.dumps({"loss": losses}, indent=2) + "\n", encoding="utf-8")


def _read(path: Path) -> tuple[str, Images]:
    return path.stem, read_images(path)


def _pairs(network: KeypointNetwork, images: Images, count: int, seed: int) -> tuple[Pairs, Pairs, Array]:
    """Return pairs with engineered features, with learnt ones, and the sines of their true turns."""
    earlier, later = draw_pairs(images, count, np.random.default_rng(seed))
    points, classes = keypoints_of(network, images)
    class_vector = 0.5 * (classes[earlier] + classes[later])
    found = ~np.isnan(images.ellipse)
    ellipse = np.where(found, images.ellipse, np.mean(images.ellipse, axis=0, where=found) if found.any() else 0.0)
    sine = np.sin(turn_between(images, earlier, later))
    return (ellipse[earlier], ellipse[later], class_vector), (points[earlier], points[later], class_vector), sine


def _track(path: Path, out: Path) -> None:
    """Track a sequence in all modes and write tracks/NAME.npz."""
    torch.set_num_threads(1)
    saved = torch.load(out / "model.pt", weights_only=True)
    network = KeypointNetwork()
    network.load_state_dict(saved["network"])
    weights = saved["weights"].numpy()
    recording, images = load_recording(path), read_images(path)
    assert recording.object_pose is not None
    points, classes = keypoints_of(network, images)
    episode, truth = episodes_of(recording), recording.object_pose
    first = np.searchsorted(images.episode, images.episode)
    turns: dict[str, dict[int, list[tuple[int, float]]]] = {"none": {}, "const": {}, "learnt": {}, "oracle": {}}
    for k, frame in enumerate(images.frame.tolist()):
        back = compared_frames(k - int(first[k]))
        if not back:
            continue
        earlier, later = k - np.array(back), np.full(len(back), k)
        class_vector = 0.5 * (classes[earlier] + classes[later])
        sine = np.clip(expanded((points[earlier], points[later], class_vector)) @ weights, -1.0, 1.0)
        found = {
            "const": np.zeros(len(back)),
            "learnt": np.arcsin(sine),
            "oracle": turn_between(images, earlier, later),
        }
        for mode, turn in found.items():
            turns[mode][frame] = list(zip(back, turn.tolist(), strict=True))
    model = Model(DistanceField.of(recording.shape), recording.shape.friction_radius(), recording.sensor.radius)
    arrays: dict[str, Any] = {
        "truth": truth,
        "sensor": recording.sensor_pose,
        "time": recording.time,
        "episode": episode,
    }
    arrays["is_disc"] = isinstance(recording.shape, Disc)
    arrays["outline"] = recording.shape.outline()
    for mode in MODES[:4]:
        sigma = saved.get(f"{mode}_sigma", 1e-3)
        pose, covariance, took, refused = track_episodes(
            model, recording.sensor_pose, episode, turns[mode], truth[0], sigma
        )
        arrays |= {
            f"{mode}_pose": pose,
            f"{mode}_covariance": covariance,
            f"{mode}_ms": took,
            f"{mode}_refused": refused,
        }
    online = track_with_palpate(recording, TrackerSettings("learnt")).online
    arrays |= {"palpate_pose": online.pose, "palpate_covariance": online.covariance}
    with whole_file(out / "tracks" / f"{path.stem}.npz", overwrite=True) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def errors_of(track: Mapping[str, Any], mode: str) -> tuple[Array, Array]:
    """Return errors of translation (N,) [m] and rotation (N,) [rad] of a tracked sequence."""
    off = se2.between(track["truth"], track[f"{mode}_pose"])
    return np.hypot(off[:, 0], off[:, 1]), np.abs(se2.wrap(off[:, 2]))


def _summary(tracks: Mapping[str, Mapping[str, Any]], mode: str) -> dict[str, float]:
    """Return medians of final errors, the number of lost sequences, and the share of true poses in the 95 % region."""
    last = {name: [errors[-1] for errors in errors_of(track, mode)] for name, track in tracks.items()}
    lost = [
        metres > LOST[0] or (radians > LOST[1] and not tracks[name]["is_disc"])
        for name, (metres, radians) in last.items()
    ]
    inside = []
    for track in tracks.values():
        off = se2.log(se2.between(track[f"{mode}_pose"], track["truth"]))
        weighed = np.linalg.solve(track[f"{mode}_covariance"], off[..., None])[..., 0]
        since = np.arange(len(off)) >= np.argmax(track["episode"] >= 0)
        inside.append(np.mean((np.sum(off * weighed, axis=1) < 7.815)[since]))  # chi-square, 3 degrees, 95 %
    final = np.array(list(last.values()))
    return {
        "final_translation_mm": float(1e3 * np.median(final[:, 0])),
        "final_rotation_deg": float(np.degrees(np.median(final[:, 1]))),
        "lost": int(np.sum(lost)),
        "in_95_share": float(np.mean(inside)),
    }


def _step_times(tracks: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    found = {}
    for mode in MODES[:4]:
        took = np.concatenate([track[f"{mode}_ms"][track["episode"] >= 0] for track in tracks.values()])
        found[mode] = {"median": float(np.median(took)), "p95": float(np.percentile(took, 95))}
    return found


def _example_images(out: Path, files: list[Path]) -> dict[str, tuple[Images, Array, Array]]:
    """Return images of one test sequence of each object, with key points and class probabilities."""
    network = KeypointNetwork()
    network.load_state_dict(torch.load(out / "model.pt", weights_only=True)["network"])
    found = {}
    for name in SHAPES:
        images = read_images(next(path for path in files if path.stem.startswith(name)))
        found[name] = (images, *keypoints_of(network, images))
    return found
