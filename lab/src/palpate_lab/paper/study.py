"""The paper's experiments from nothing: recordings, models with Table II, tracking, figures (paper Sec. V)."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

import palpate
import palpate_lab
from palpate.arrays import Array
from palpate.errors import EstimationError, FileError
from palpate.files import read_json, whole_file, write_json
from palpate.geometry import se2
from palpate.io import load_recording
from palpate.io.outlines import load_shape
from palpate.types.sensor import DIGIT
from palpate_lab.paper import figures
from palpate_lab.paper.features import keypoints_of, learn_keypoints, learn_turns, load_features, started
from palpate_lab.paper.graph import physics_errors, physics_noise
from palpate_lab.paper.helps import Panel, level_of, panels_of, traits
from palpate_lab.paper.images import Images, draw_pairs, joined, read_images, turn_between
from palpate_lab.paper.published import TABLE2
from palpate_lab.paper.pushes import AS_IS, LEFT_OUT, PUSHES, SIDE, VARIED
from palpate_lab.paper.scores import order_scores, tracking_scores, turning
from palpate_lab.paper.touch import deviations_of, write_turns
from palpate_lab.paper.tracking import FRICTION_FACTORS, MODES, WAYS, physics_key, pushed, tracked
from palpate_lab.paper.transform_network import Pairs, fit_all, fit_linear, validation_loss
from palpate_lab.parallel import spread
from palpate_lab.simulate.push_settings import PushSettings
from palpate_lab.simulate.recordings import Simulation, fill_folder, plan
from palpate_lab.study.recordings import find_recordings
from palpate_lab.study.study import StudySettings, Trial, run_study
from palpate_lab.train.fit import FitSettings

Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]

SHAPES = {"disc": "disc", "rect": "rectangle", "ellip": "ellipse"}
"""The paper's objects and palpate's names of their outlines."""


@dataclass(frozen=True)
class PaperSettings:
    """Size of the study."""

    train: int = 10
    """Sequences of each object to learn from, half of them for validation."""
    rectangles: int = 30
    """Sequences of the rectangle to track; the paper has 50 of each object."""
    others: int = 5
    """Sequences of the disc, and of the ellipse, to track."""
    swept: int = 6
    """Sequences of the rectangle for each setting of "when touch helps"."""
    seconds: float = 15.0
    """Length of the sequences to learn from, and of those to track [s]."""
    swept_seconds: float = 8.0
    """Length of those of "when touch helps" [s]."""
    steps: int = 80
    """Steps of the auto-encoder's descent."""
    turn_steps: int = 240
    """Steps of the encoder's descent by the loss of the transform prediction."""
    pairs: int = 20_000
    """Pairs that the transform networks are fitted to, and as many to validate."""
    nonlinear_steps: int = 3000
    """Steps of the descent of each non-linear transform network."""
    limit_surface: float = 1.0
    """Factor on the authors' friction radii c (Eq. 7), `graph.FRICTION_RADIUS`."""
    features: str = ""
    """Network of features of one's own, "FILE:Class"; empty for the paper's."""
    seed: int = 0
    """Seed of recordings, the sensor, weights and pairs."""


FULL = PaperSettings(
    train=40, rectangles=50, others=50, swept=50, swept_seconds=15.0, steps=2000, turn_steps=2000, pairs=100_000
)
"""As many sequences as the paper has."""
SMALL = PaperSettings(
    train=4,
    rectangles=2,
    others=1,
    swept=1,
    seconds=5.0,
    swept_seconds=5.0,
    steps=20,
    turn_steps=60,
    pairs=2000,
    nonlinear_steps=200,
)
"""Enough to see every part and figure; of four pushes of the rectangle, edges and corners both train and validate."""


def run(out: Path, settings: PaperSettings, bar: Bar, workers: int = 1, dask: str | None = None) -> dict[str, Any]:
    """Run the study in a folder, keeping finished parts, and return the content of its `results.json`.

    Raises FileError if the folder holds a study of another size, or one that other code made.
    """
    _check_settings(out, settings)
    _simulate(out, settings, bar, workers, dask)
    if not (out / "models.json").exists():
        _learn(out, settings, bar, workers, dask)
    files = find_recordings(out / "test")
    varied = {name: path for name, path in files.items() if level_of(name)}
    _feel(out, settings, list(files.values()), bar, workers, dask)
    tracked_trials = _track(out, "tracks", files, MODES, bar, workers, dask)
    trials = [trial for trial in tracked_trials if trial.recording not in varied]
    varied_trials = [trial for trial in tracked_trials if trial.recording in varied]
    others = tuple(name for name in WAYS if name not in MODES)
    as_is = {name: path for name, path in varied.items() if level_of(name) == AS_IS}
    in_other_ways = _track(out, "sweep", as_is, others, bar, workers, dask)
    models = read_json(out / "models.json")
    of_level = _traits_by_level(varied)
    panels = panels_of(varied_trials, in_other_ways, of_level)
    files = {name: path for name, path in files.items() if name not in varied}
    results = {
        "published_table2": TABLE2,
        "table2": models["table2"],
        "pushes": turning([*find_recordings(out / "train").values(), *files.values()]),
        "tracking": tracking_scores(trials, MODES),
        "order": order_scores(trials),
        "sweep": tracking_scores(in_other_ways, others)["rect"],
        "varied": {level: found | _scores_at(varied_trials, level) for level, found in of_level.items()},
        "when_touch_helps": panels,
        **{key: models[key] for key in ("deviations", "physics", "held_out_loss")},
        "settings": asdict(settings),
        "sequences": {name: sum(file.startswith(name) for file in files) for name in SHAPES},
    }
    write_json(out / "results.json", results)
    with bar("figures", 1) as progress:
        _draw(out, settings, files, trials, panels)
        progress(1)
    return results


def code_hash() -> str:
    """Return a hash of the code that a study depends on, all of palpate's and the lab's."""
    digest = sha256()
    for package in (palpate, palpate_lab):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.relative_to(folder).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _check_settings(out: Path, settings: PaperSettings) -> None:
    """Write the settings to the study's folder, or check that those in it are the same and of the same code."""
    now = asdict(settings) | {"code": code_hash()}
    if settings.features:
        file = settings.features.rpartition(":")[0]
        load_features(settings.features)
        now["features_hash"] = sha256(Path(file).read_bytes()).hexdigest()[:12]
    out.mkdir(parents=True, exist_ok=True)
    path = out / "settings.json"
    if path.exists():
        earlier = read_json(path)
        if {**earlier, "code": now["code"]} == now and earlier != now:
            made = f"made by other code ({earlier.get('code')}, now {now['code']})"
            raise FileError(f"{out}: holds a study {made}; take another folder")
        if earlier != now:
            raise FileError(f"{out}: holds a study with settings {earlier}; take another folder")
    write_json(path, now)


def _simulate(out: Path, settings: PaperSettings, bar: Bar, workers: int, dask: str | None) -> None:
    """Simulate the sequences to learn from and those to track, all with one sensor, as the paper has one DIGIT."""
    parts: dict[str, dict[str, Simulation]] = {"train": {}, "test": {}}
    counts = {"disc": settings.others, "rect": settings.rectangles, "ellip": settings.others}
    for name, pushes in PUSHES.items():
        parts["train"] |= _plan(name, pushes, settings.train, settings.seconds, settings, 1)
        parts["test"] |= _plan(name, pushes, counts[name], settings.seconds, settings, 2)
    for level, pushes in VARIED.items():
        planned = _plan("rect", pushes, settings.swept, settings.swept_seconds, settings, 3)
        parts["test"] |= {f"{file.removesuffix('.mcap')}@{level}.mcap": each for file, each in planned.items()}
    for part, simulations in parts.items():
        with bar(f"simulating, {part}", len(simulations)) as progress:
            fill_folder(out / part, simulations, workers=workers, dask=dask, resume=True, progress=progress)


def _plan(
    name: str, pushes: PushSettings, count: int, seconds: float, settings: PaperSettings, part: int
) -> dict[str, Simulation]:
    """Return sequences of one object, by file name; `part` is 1 to 3."""
    options = {"ideal": True, "unit": settings.seed, "pushes": pushes, "side": SIDE, "seconds": seconds}
    return plan({name: load_shape(SHAPES[name])}, count, 3 * settings.seed + part, LEFT_OUT, **options)


def _traits_by_level(varied: Mapping[str, Path]) -> dict[str, dict[str, float]]:
    """Return the medians of turning [deg] and slip [mm] over the pushes of each setting, and their number."""
    found: dict[str, dict[str, float]] = {}
    for level in VARIED:
        each = [traits(path) for name, path in varied.items() if level_of(name) == level]
        found[level] = {trait: float(np.nanmedian([of_push[trait] for of_push in each])) for trait in each[0]}
        found[level]["pushes"] = len(each)
    return found


def _scores_at(trials: Sequence[Trial], level: str) -> dict[str, Any]:
    """Return the scores of the pushes of one setting."""
    at_level = [trial for trial in trials if level_of(trial.recording) == level]
    return {"tracking": tracking_scores(at_level, MODES)["rect"], "order": order_scores(at_level)["rect"]}


def _track(
    out: Path,
    name: str,
    files: Mapping[str, Path],
    ways: tuple[str, ...],
    bar: Bar,
    workers: int,
    dask: str | None,
) -> list[Trial]:
    """Track sequences in ways, by their names, in a study of its own."""
    track_by = partial(tracked, out=out.resolve())
    with bar(f"tracking, {name}", len(files) * len(ways)) as progress:
        study = run_study(files, out / name, StudySettings(ways), workers, dask, True, progress, track_by)
    for (file, way), reason in study.failed.items():
        raise EstimationError(f"{out / 'test' / file}: cannot be tracked by {way}: {reason}")
    return study.trials


def _draw(
    out: Path,
    settings: PaperSettings,
    files: Mapping[str, Path],
    trials: Sequence[Trial],
    panels: Mapping[str, Mapping[str, Panel]],
) -> None:
    """Draw the figures."""
    rectangles = [name for name in files if name.startswith("rect")]
    others = [name for name in files if not name.startswith("rect")]
    network, _ = _models(out, settings)
    seen = {}
    for name in (rectangles[0], others[0], others[-1]):
        images = read_images(load_recording(files[name]))
        shown = np.linspace(0, len(images.frame) - 1, 6).astype(int)
        seen[name] = (images.difference[shown], keypoints_of(network, images)[0][shown], images.frame[shown])
    tracks = (_tracks(files, rectangles, trials), _tracks(files, others, trials))
    figures.draw(out, seen, *tracks, trials, panels)


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
    for_training, validation = _split(parts)
    network = _network(settings)
    combined = for_training["combined"], validation["combined"]
    held_out: dict[str, list[str]] = {}
    for name, learn, steps in (
        ("key points", learn_keypoints, settings.steps),
        ("turns", learn_turns, settings.turn_steps),
    ):
        noted: list[str] = []
        with bar(name, steps) as progress:
            note = partial(_note, noted, progress)
            fit_settings = FitSettings(steps=steps, rate=5e-4, check=max(steps // 10, 1))
            learn(network, *combined, fit_settings, settings.seed, out, note)
        held_out[name] = noted
    losses, weights = _fit_transforms(network, for_training, validation, settings, bar)
    with whole_file(out / "model.pt", overwrite=True) as part:
        torch.save({"network": network.state_dict(), "weights": torch.from_numpy(weights)}, part)
    learnt = {
        "table2": losses,
        "deviations": deviations_of(network, weights, validation["combined"]),
        "physics": _physics(for_training, settings.limit_surface),
        "limit_surface": settings.limit_surface,
        "held_out_loss": held_out,
    }
    write_json(out / "models.json", learnt)


def _note(noted: list[str], progress: Callable[..., None], step: int, losses: str) -> None:
    """Keep the held-out losses of a descent, and show them."""
    noted.append(f"{step}: {losses}")
    progress(step, losses)


def _split(parts: Mapping[str, Images]) -> tuple[dict[str, Images], dict[str, Images]]:
    """Return images for training and for validation by object, and of all objects as "combined"."""
    for_training: dict[str, Images] = {}
    validation: dict[str, Images] = {}
    for name in SHAPES:
        # Every second recording of an object validates; its kinds of contact follow each other by name.
        of_object = [parts[recording] for recording in sorted(parts) if recording.startswith(name)]
        for_training[name] = joined(of_object[0::2])
        validation[name] = joined(of_object[1::2])
    for split in (for_training, validation):
        split["combined"] = joined([split[name] for name in SHAPES])
    return for_training, validation


def _fit_transforms(
    network: nn.Module,
    for_training: Mapping[str, Images],
    validation: Mapping[str, Images],
    settings: PaperSettings,
    bar: Bar,
) -> tuple[dict[str, dict[str, float]], Array]:
    """Return the losses of Table II by model and data set, and the linear weights for all objects."""
    losses: dict[str, dict[str, float]] = {}
    weights = np.empty(0)
    with bar("transform networks", len(for_training)) as progress:
        for done, name in enumerate(for_training, 1):
            engineered, learnt, sine = _pairs(network, for_training[name], settings.pairs, settings.seed)
            models = fit_all(engineered, learnt, sine, settings.seed, settings.nonlinear_steps)
            weights = fit_linear(learnt, sine)  # the last are of all objects
            engineered, learnt, sine = _pairs(network, validation[name], settings.pairs, settings.seed + 1)
            for model, (features, predict) in models.items():
                pairs = engineered if features == "engineered" else learnt
                losses.setdefault(model, {})[name] = validation_loss(predict, pairs, sine)
            progress(done)
    return losses, weights


def _physics(for_training: Mapping[str, Images], scale: float) -> dict[str, Any]:
    """Return the noise of physics for each friction radius of the sweep and the authors', from true poses."""
    noise = {}
    for friction in (None, *FRICTION_FACTORS):
        errors = []
        for name, outline in SHAPES.items():
            model = pushed(load_shape(outline), DIGIT, name, friction, scale)
            images = for_training[name]
            truth = se2.compose(images.sensor_pose, se2.inverse(images.relative))
            for number in np.unique(images.episode):
                of_episode = images.episode == number
                errors.append(physics_errors(model, truth[of_episode], images.sensor_pose[of_episode]))
        noise[physics_key(friction)] = asdict(physics_noise(np.array(errors)))
    return noise


def _read(path: Path) -> tuple[str, Images]:
    """Return the name of a recording and its images."""
    return path.stem, read_images(load_recording(path))


def _pairs(network: nn.Module, images: Images, count: int, seed: int) -> tuple[Pairs, Pairs, Array]:
    """Return pairs with engineered features, with learnt ones, and the sines of their true turns."""
    earlier, later = draw_pairs(images, count, np.random.default_rng(seed))
    points, classes = keypoints_of(network, images)
    class_vector = 0.5 * (classes[earlier] + classes[later])
    has_patch = ~np.isnan(images.ellipse)
    usual = np.mean(images.ellipse, axis=0, where=has_patch) if has_patch.any() else 0.0
    ellipse = np.where(has_patch, images.ellipse, usual)
    sine = np.sin(turn_between(images, earlier, later))
    return (ellipse[earlier], ellipse[later], class_vector), (points[earlier], points[later], class_vector), sine


def _feel(out: Path, settings: PaperSettings, files: Sequence[Path], bar: Bar, workers: int, dask: str | None) -> None:
    """Write what touch measures in each sequence to track."""
    (out / "touch").mkdir(exist_ok=True)
    missing = [path for path in files if not (out / "touch" / f"{path.stem}.npz").exists()]
    with bar("touch", len(missing)) as progress:
        felt = spread(partial(_felt, out=out.resolve(), settings=settings), missing, workers, dask)
        for done, _ in enumerate(felt, 1):
            progress(done)


def _felt(path: Path, out: Path, settings: PaperSettings) -> None:
    torch.set_num_threads(1)
    write_turns(out / "touch" / f"{path.stem}.npz", *_models(out, settings), read_images(load_recording(path)))


def _network(settings: PaperSettings) -> nn.Module:
    """Return the network of features before it has learnt, with weights drawn from the seed."""
    torch.manual_seed(settings.seed)
    return load_features(settings.features) if settings.features else started()


def _models(out: Path, settings: PaperSettings) -> tuple[nn.Module, Array]:
    """Return the trained network of features, and the weights of the linear transform network."""
    saved = torch.load(out / "model.pt", weights_only=True)
    network = _network(settings)
    network.load_state_dict(saved["network"])
    return network, saved["weights"].numpy()
