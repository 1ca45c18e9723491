"""Touch models from recordings or from presses: from files to a model folder."""

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from palpate.arrays import Flags, Image
from palpate.errors import FileError, SettingError
from palpate.files import whole_file, write_json
from palpate.touch import touch_model
from palpate.touch.calibration import Calibration
from palpate.touch.press_calibration import Presses, check_spread
from palpate.touch.reader import misfit
from palpate.touch.touch_model import NETWORK, OUTPUTS, ModelSettings, Spread, TouchModel, difference_in_light, reduced
from palpate.types.sensor import SensorProfile
from palpate_lab.parallel import held_folder
from palpate_lab.train.augment import ONE_UNIT, Augmentation, Batch, draw_groups, symmetry, varied_batch
from palpate_lab.train.fit import FitSettings, fit, with_pace
from palpate_lab.train.losses import OUTPUT_LOSSES
from palpate_lab.train.networks import Together, TouchNetwork, exported, restore
from palpate_lab.train.samples import Indices, Samples, read_samples
from palpate_lab.train.scores import errors_of, judge, measure_spread, spread_of

Bar = Callable[[str, int], AbstractContextManager[Callable[..., None]]]


@dataclass(frozen=True)
class TrainSettings:
    """Settings of a training."""

    seed: int = 0
    """Seed of weights, batches and the choice of held-out recordings."""
    touch: FitSettings = FitSettings(steps=8000, patience=80)
    """Descent of a new model, not stopped early: corners are learnt after all else."""
    fine: FitSettings = FitSettings(steps=300, rate=5e-4, check=25, patience=4)
    """Descent of an existing model, for another sensor unit."""
    presses: FitSettings = FitSettings(steps=600, check=600)
    """Descent of each network of a model from presses, kept as it ends: few presses do not show when to stop."""
    networks: int = 4
    """Networks of a model from presses, of which it takes the mean."""
    steps: int | None = None
    """Most steps of a descent; None keeps those above."""
    workers: int = 1
    """Processes that read recordings."""
    held_out: float = 0.1
    """Share of the recordings that ends the descent and calibrates variances."""
    test: float = 0.15
    """Share of the recordings that judges the model, unless others are given; with presses it also sets variances."""
    groups: tuple[int, int] = (24, 8)
    """Contacts in a batch and frames of each: the turn of a contact has an unknown offset, so frames come in groups."""
    fewest_frames: int = 100
    """Fewest frames of contact, three seconds."""
    fewest_presses: int = 50
    """Fewest presses that directions can be learnt from."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise SettingError(f"seed is {self.seed}; allowed is 0 or more")
        if self.steps is not None and self.steps < 1:
            raise SettingError(f"steps is {self.steps}; allowed is 1 or more")

    def descent(self, settings: FitSettings) -> FitSettings:
        """Return a descent with at most as many steps as are wanted."""
        return settings if self.steps is None else replace(settings, steps=self.steps)


def train(
    files: Sequence[Path],
    out: Path,
    settings: TrainSettings,
    bar: Bar,
    start: Path | None = None,
    test: Sequence[Path] = (),
    resume: bool = False,
    calibration: Calibration | None = None,
    orientation: str = "",
) -> dict[str, Any]:
    """Train a touch model on recordings, write its folder and return its scores; see `scores.judge`.

    Besides the model, `out` gets the folder `training`: checkpoint and `results.json`. Scores are of the recordings
    `test`, or else of a held-out share of `files`. The network of the model folder `start` is trained further. Images
    are seen through a `calibration` of the unit that all recordings are of. With `resume`, an interrupted run continues
    from its checkpoint. Raises FileError on files and folders, SettingError where there is too little to learn from.
    """
    with held_folder(out):
        work = work_folder(out, resume)
        base = None if start is None else TouchModel(start)
        with bar("reading recordings", len(files) + len(test)) as progress:
            how = settings.workers, progress, calibration, orientation
            samples, sensor, failed = read_samples([*files, *test], *how)
        wrong = None if base is None else misfit(sensor, base)
        if wrong:
            raise FileError(f"{start}: {wrong}")
        is_test = samples.recording >= len(files)
        if test and not is_test.any():
            raise FileError(f"no recording can be judged by; the first: {failed[test[0]]}")
        learned, held_out, judged = split_three(samples, is_test if test else None, settings)
        del samples  # it holds images, a gigabyte for every 40 000
        work.mkdir(exist_ok=True)
        torch.manual_seed(settings.seed)
        network = TouchNetwork(OUTPUTS[1] if sensor.flat_width > 0.0 else OUTPUTS[0])
        if base is not None:
            restore(network, base.network)
        descent = settings.descent(settings.touch if base is None else settings.fine)
        with bar("touch", descent.steps) as progress:
            paced = with_pace(progress, descent.steps)
            learn(network, learned, held_out, sensor, settings, descent, work, paced)
        with bar("judging", 1):
            spread = measure_spread(errors_of(network, held_out))
            scores = judge(errors_of(network, judged), spread)
        results = {
            "frames": len(judged),
            "scores": scores,
            "recordings": {
                "learned_from": recording_count(learned),
                "held_out": recording_count(held_out),
                "judged_by": recording_count(judged),
                "left_out": {str(file): why for file, why in failed.items()},
            },
        }
        write_json(work / "results.json", results)
        training = {
            "seed": settings.seed,
            "touch": asdict(descent),
            "frames": len(learned),
            "from": str(start or ""),
            "calibration": str(calibration.file or "") if calibration else "",
        }
        model = ModelSettings(sensor.name, sensor.image_height, sensor.image_width, spread, training)
        write_model(out, model, exported(network))  # last: a folder with a model has no work left
    return results


def train_on_presses(
    presses: Presses,
    untouched: Sequence[Image],
    sensor: str,
    out: Path,
    bar: Bar,
    settings: TrainSettings,
    resume: bool = False,
) -> dict[str, Any]:
    """Train a model of directions on presses, write its folder and return its errors on held-out presses.

    These calibrate its variances as well. untouched are images of the gel at rest, as large as the presses', and sensor
    is the name of the profile that the model is for. Raises FileError on too few presses, on ones too close together
    and on images of different sizes.
    """
    count = len(presses.images)
    descent = settings.descent(settings.presses)
    if count < settings.fewest_presses:
        raise FileError(f"found {count} presses; at least {settings.fewest_presses} are needed to learn from")
    check_spread(presses.angle)
    sizes = {image.shape[:2] for image in (*presses.images, *untouched)}
    if len(sizes) > 1:
        raise FileError(f"images have the sizes {sorted(sizes)}; allowed is one, of presses and of the untouched gel")
    height, width = untouched[0].shape[:2]
    with held_folder(out):
        work = work_folder(out, resume)
        work.mkdir(exist_ok=True)
        samples = samples_of_presses(presses, untouched)
        order = np.random.default_rng(settings.seed).permutation(count)
        apart = round(settings.test * count)
        held_out, learned = (samples.of(np.sort(part)) for part in np.split(order, [apart]))
        varied = replace(ONE_UNIT, signs=symmetry(samples.of(order[apart:][:400])))  # enough to tell, in seconds
        profile = SensorProfile(sensor, radius=0.0, image_height=height, image_width=width)
        torch.manual_seed(settings.seed)
        networks = [TouchNetwork(OUTPUTS[2]) for _ in range(settings.networks)]
        total = len(networks) * descent.steps
        with bar("direction", total) as progress:
            paced = with_pace(progress, total)
            for number, network in enumerate(networks):
                own = replace(settings, seed=len(networks) * settings.seed + number)
                folder = work / str(number)
                folder.mkdir(exist_ok=True)
                after = partial(_after, paced, number * descent.steps)
                learn(network, learned, held_out, profile, own, descent, folder, after, varied)
        together = Together(networks)
        errors = errors_of(together, held_out)
        scale = spread_of(*errors["direction"]).scale
        spread = {"direction": Spread(scale, together=19.0)}  # as of the DIGIT's model: presses cannot tell
        training = {"seed": settings.seed, "steps": descent.steps, "presses": count}
        write_model(out, ModelSettings(sensor, height, width, spread, training), exported(together))
        scores = judge(errors, spread)["direction"]
    return {"presses": count, "held_out": apart} | {name: scores[name] for name in ("rms_deg", "median_deg")}


def _after(progress: Callable[..., None], before: int, done: int, note: str = "") -> None:
    """Show the steps of one descent of several, after those before."""
    progress(before + done, note)


def samples_of_presses(presses: Presses, untouched: Sequence[Image]) -> Samples:
    """Return presses as samples; each is a contact of its own, of which only the direction is known."""
    count = len(presses.images)
    mean = np.asarray(np.mean([reduced(image) for image in untouched], axis=0), np.float32)
    difference = np.array([difference_in_light(image, mean) for image in presses.images], dtype=np.float16)
    number = np.arange(count)
    unknown = np.zeros(count)
    return Samples(
        difference=difference,
        recording=number,
        episode=number,
        yaw=unknown,
        direction=presses.angle,
        place=unknown,
        kind=np.zeros(count, int),
        corner=np.full(count, np.nan),
        cone=unknown,
    )


def learn(
    network: TouchNetwork,
    learned: Samples,
    held_out: Samples,
    sensor: SensorProfile,
    settings: TrainSettings,
    descent: FitSettings,
    folder: Path,
    progress: Callable[..., None] | None = None,
    varied: Augmentation | None = None,
) -> None:
    """Train a network by the likelihood of what it predicts, all outputs together; on a GPU where there is one."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    contacts, frames = settings.groups if "turn" in network.outputs else (2 * settings.groups[0], 1)

    def draw(samples: Samples, rng: np.random.Generator) -> tuple[Samples, Indices, Batch]:
        chosen = draw_groups(samples, contacts, frames, rng)
        return samples, chosen, varied_batch(samples, chosen, sensor, rng, varied)

    def losses(drawn: tuple[Samples, Indices, Batch]) -> dict[str, Tensor]:
        samples, chosen, seen = drawn
        outputs = network(seen.difference.to(device))
        by_name: dict[str, Tensor] = {}
        for name, output in zip(network.outputs, outputs, strict=True):
            by_name |= OUTPUT_LOSSES[name](output.cpu(), samples, chosen, seen)
        return by_name

    def judged() -> dict[str, Tensor]:
        rng = np.random.default_rng(0)  # the same batches at every evaluation
        evaluations = [losses(draw(held_out, rng)) for _ in range(4)]
        return {name: torch.stack([evaluation[name] for evaluation in evaluations]).mean() for name in evaluations[0]}

    network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    fit("touch", network, partial(draw, learned), losses, judged, descent, settings.seed, folder, progress)
    network.cpu()


def split_three(samples: Samples, is_test: Flags | None, settings: TrainSettings) -> tuple[Samples, Samples, Samples]:
    """Return the samples to learn from, those held out to stop and to calibrate by, and those to judge by.

    is_test (N,) marks the last; None takes a share. Raises SettingError where there is too little to split.
    """
    rng = np.random.default_rng(settings.seed)
    if is_test is None:
        rest, judged = split(samples, settings.test, rng, settings)
    else:
        rest = samples.of(~is_test)
        judged = samples.of(is_test)
    learned, held_out = split(rest, settings.held_out, rng, settings)
    return learned, held_out, judged


def recording_count(samples: Samples) -> int:
    """Return the number of recordings that samples are of."""
    return len(np.unique(samples.recording))


def split(samples: Samples, share: float, rng: np.random.Generator, settings: TrainSettings) -> tuple[Samples, Samples]:
    """Return samples without and with a share of the recordings; of the contacts, where recordings are fewer than ten.

    Every simulated recording is of a unit of its own, so that units are held out as well. Raises SettingError where
    there is too little to split.
    """
    by = samples.recording if len(np.unique(samples.recording)) >= 10 else samples.episode
    groups = np.unique(by)
    if len(samples) < settings.fewest_frames or len(groups) < 2:
        raise SettingError(
            f"too little to learn from: {len(samples)} frames of {len(np.unique(samples.episode))} contacts; "
            f"at least {settings.fewest_frames} frames of 2 contacts are needed"
        )
    chosen = rng.permutation(groups)[: max(1, round(share * len(groups)))]
    held = np.isin(by, chosen)
    return samples.of(~held), samples.of(held)


def work_folder(out: Path, resume: bool) -> Path:
    """Return the folder for the work in a model's folder; FileError unless a model may be made there."""
    work = out / "training"
    if (out / "model.json").exists() or ((out / NETWORK).exists() and not work.exists()):
        raise FileError(f"{out}: holds a model already; take another folder")
    if work.exists() and not resume:
        raise FileError(f"{out}: holds an interrupted training; --resume continues it, or take another folder")
    return work


def write_model(folder: Path, settings: ModelSettings, network: bytes) -> None:
    """Write a model into an existing folder; `model.json` comes last, so a folder with one is complete."""
    plain = json.loads(json.dumps(asdict(settings)))
    with whole_file(folder / NETWORK, overwrite=True) as part:
        part.write_bytes(network)
    written = {"format": touch_model.FORMAT, "version": touch_model.VERSION, "settings": plain}
    written["hash"] = touch_model.fingerprint(plain, network)
    write_json(folder / "model.json", written)
