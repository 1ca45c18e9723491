"""A touch model from recordings: the whole way, from files to a model folder."""

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from palpate.errors import FileError, SettingError
from palpate.files import held_folder, whole_file
from palpate.lab.train import figures
from palpate.lab.train.export import exported, restore, width_of
from palpate.lab.train.features import features_of, fit_pair_models
from palpate.lab.train.fit import FitSettings
from palpate.lab.train.learn import KEYPOINT, TOUCH, Keypoints, Touch, learn_keypoints, learn_touch
from palpate.lab.train.networks import WIDTH
from palpate.lab.train.pairs import draw_pairs
from palpate.lab.train.results import judge, measure_spread
from palpate.lab.train.samples import Samples, read_samples
from palpate.touch.calibration import Calibration
from palpate.touch.model import ModelSettings, TouchModel, write_model
from palpate.types.sensor import SensorProfile

Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]

FINE = FitSettings(steps=300, rate=5e-4, check=25, patience=4)
"""The descent of a model that exists, for another sensor unit."""
WORK = "training"
"""Folder in a model's folder that keeps how it came about."""

_HELD_OUT, _TEST = 0.1, 0.15  # shares of the recordings
_FEWEST = 100  # samples: a contact of three seconds


@dataclass(frozen=True)
class TrainSettings:
    """How to train."""

    seed: int = 0
    """Of weights, batches and which recordings are held out."""
    keypoint: FitSettings = KEYPOINT
    """The auto-encoder's descent."""
    touch: FitSettings = TOUCH
    """The descent of what images and pairs of them say."""
    steps: int | None = None
    """Most steps of each descent; None is as many as each is made for."""
    workers: int = 1
    """Processes that read recordings."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise SettingError(f"seed is {self.seed}; allowed is 0 or more")
        if self.steps is not None and self.steps < 1:
            raise SettingError(f"steps is {self.steps}; allowed is 1 or more")


def train(
    files: Sequence[Path],
    out: Path,
    settings: TrainSettings,
    bar: Bar,
    start: Path | None = None,
    test: Sequence[Path] = (),
    resume: bool = False,
    calibration: Calibration | None = None,
) -> dict[str, Any]:
    """Train a touch model on recordings, write its folder and return what it is worth; see `results.judge`.

    Besides the model, `out` gets the folder `training`: logs, checkpoints, `results.json` and figures. The results are
    of the recordings `test`, or, where there are none, of a share of `files` that is left out. With `start`, a model
    folder, its touch network is trained on, and how far that is to be believed is measured anew; its key points stay.
    With `calibration`, of the unit that all recordings are of, images are seen as it says, and the model goes with it:
    tracking takes both. With `resume`, a run that was cut off goes on from its checkpoints. `bar` makes progress bars
    of a title and a total. Raises FileError on files and folders, SettingError where there is too little to learn from.
    """
    with held_folder(out):
        return _train(files, out, free_folder(out, resume), settings, bar, start, test, calibration)


def _train(
    files: Sequence[Path],
    out: Path,
    work: Path,
    settings: TrainSettings,
    bar: Bar,
    start: Path | None,
    test: Sequence[Path],
    calibration: Calibration | None,
) -> dict[str, Any]:
    base = None if start is None else TouchModel(start)
    with bar("reading recordings", len(files) + len(test)) as progress:
        read = partial(read_samples, workers=settings.workers, calibration=calibration)
        samples, sensor, failed = read(files, progress=progress)
        tested = read(test, progress=lambda done: progress(len(files) + done)) if test else None
    if tested is not None:
        _check_sensor("recordings to judge by", tested[1].name, (tested[1].image_height, tested[1].image_width), sensor)
        failed |= tested[2]
    if base is not None:
        made_for = base.settings
        _check_sensor(str(start), made_for.sensor, (made_for.image_height, made_for.image_width), sensor)
    rng = np.random.default_rng(settings.seed)
    rest, judged = split(samples, _TEST, rng) if tested is None else (samples, tested[0])
    learned, held_out = split(rest, _HELD_OUT, rng)
    del samples, rest  # they hold images, a gigabyte for every 40 000
    for part in (learned, held_out, judged):
        draw_pairs(part, 1, np.random.default_rng(0))  # raises now what it would after an hour of training
    work.mkdir(exist_ok=True)
    torch.manual_seed(settings.seed)
    width = WIDTH if base is None else width_of(base.networks["touch"])
    keypoints, touch = Keypoints(width), Touch(tells_place=sensor.flat_width > 0.0, width=width)
    settings = replace(settings, touch=settings.touch if base is None else FINE)
    if settings.steps is not None:
        settings = replace(
            settings,
            keypoint=replace(settings.keypoint, steps=settings.steps),
            touch=replace(settings.touch, steps=settings.steps),
        )
    if base is None:
        with bar("key points", settings.keypoint.steps) as progress:
            learn_keypoints(keypoints, learned, held_out, sensor, settings.seed, work, settings.keypoint, progress)
    else:
        networks = base.networks
        restore(keypoints.encoder, networks["keypoint"])
        restore(touch.image, networks["touch"])
        restore(touch.pair, networks["pair"])
    with bar("touch", settings.touch.steps) as progress:
        learn_touch(touch, learned, held_out, sensor, settings.seed, work, settings.touch, progress)
    with bar("scores", 3) as progress:
        models = fit_pair_models(learned, features_of(learned, keypoints, touch), touch, settings.seed)
        progress(1)
        seen = features_of(held_out, keypoints, touch)
        spread = measure_spread(held_out, seen, models, touch)
        if base is not None:
            spread["linear"] = base.settings.spread["linear"]  # of its key points, which stay
        progress(2)
        seen = features_of(judged, keypoints, touch)
        results = judge(judged, seen, models, touch, spread)
        progress(3)
    results["recordings"] = {
        "learned_from": len(np.unique(learned.recording)),
        "held_out": len(np.unique(held_out.recording)),
        "judged_by": len(np.unique(judged.recording)),
        "left_out": {str(file): why for file, why in failed.items()},
    }
    model = ModelSettings(
        sensor=sensor.name,
        image_height=sensor.image_height,
        image_width=sensor.image_width,
        spread=spread,
        linear=base.settings.linear if base else tuple((float(column), float(row)) for column, row in models.linear),
        training={
            **asdict(settings),
            "frames": len(learned),
            "from": str(start or ""),
            "calibration": str(calibration.file or "") if calibration else "",
        },
    )
    with whole_file(work / "results.json", overwrite=True) as part:
        part.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    figures.training_figures(judged, seen, models, touch, spread, work)
    write_model(out, model, exported(keypoints, touch))  # at last: where it is, nothing is left to go on with
    return results


def split(samples: Samples, share: float, rng: np.random.Generator) -> tuple[Samples, Samples]:
    """Return samples without and with a share of the recordings; of the contacts, where recordings are fewer than ten.

    Every recording is of a unit of its own when simulated, so that units are held out as well. Raises SettingError
    where there is too little to part.
    """
    by = samples.recording if len(np.unique(samples.recording)) >= 10 else samples.episode
    groups = np.unique(by)
    if len(samples) < _FEWEST or len(groups) < 2:
        raise SettingError(
            f"too few pairs to learn from: {len(samples)} frames of {len(np.unique(samples.episode))} contacts; "
            f"at least {_FEWEST} frames of 2 contacts are needed"
        )
    chosen = rng.permutation(groups)[: max(1, round(share * len(groups)))]
    held = np.isin(by, chosen)
    return samples.of(~held), samples.of(held)


def _check_sensor(what: str, name: str, size: tuple[int, int], sensor: SensorProfile) -> None:
    """FileError unless something is for the sensor of the recordings."""
    if (name, size) != (sensor.name, (sensor.image_height, sensor.image_width)):
        raise FileError(
            f"{what}: sensor {name!r} with images of {size[0]} x {size[1]} px is not that of the recordings to learn "
            f"from, {sensor.name!r} with {sensor.image_height} x {sensor.image_width} px"
        )


def free_folder(out: Path, resume: bool) -> Path:
    """Return the folder for the work in a model's folder; FileError unless a model may be made there."""
    work = out / WORK
    if (out / "model.json").exists():
        raise FileError(f"{out}: holds a model already; take another folder")
    if work.exists() and not resume:
        raise FileError(f"{out}: holds a training that was cut off; --resume goes on with it, or take another folder")
    return work
