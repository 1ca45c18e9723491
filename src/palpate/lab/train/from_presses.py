"""A touch model of directions alone, from presses at known angles: for a round-tipped sensor without recordings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import held_folder
from palpate.lab.train.export import exported_direction
from palpate.lab.train.fit import FitSettings
from palpate.lab.train.learn import learn_direction
from palpate.lab.train.networks import DirectionNetwork
from palpate.lab.train.pairs import batch
from palpate.lab.train.samples import Samples
from palpate.lab.train.scores import spread_of
from palpate.lab.train.train import Bar, TrainSettings, free_folder
from palpate.touch.difference import difference, reduced
from palpate.touch.model import KINDS, ModelSettings, Spread, write_model
from palpate.touch.press_calibration import Presses, check_alike, check_spread
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

FEWEST = 50
"""Presses from which directions can be learnt."""
STEPS = 300
"""Of the descent, if nothing else is said."""
_HELD_OUT = 0.15  # share of presses that the model is judged by, and of others that end the descent
_LEARNED, _CHECKED, _JUDGED = range(3)
_TOGETHER = 19.0  # frames in a row that err together: as with the DIGIT's model, for presses do not tell


def train_on_presses(
    presses: Presses,
    untouched: Sequence[Image],
    sensor: str,
    out: Path,
    bar: Bar,
    settings: TrainSettings | None = None,
    resume: bool = False,
) -> dict[str, Any]:
    """Train a model on presses, write its folder and return how far it is off on presses that were left out.

    When to stop is told by as many others; how far the model is to be believed, by both together.

    untouched are images of the gel at rest, as large as the presses', and sensor is the name of the profile that the
    model is for. Raises FileError on too few presses, on ones too close together and on images of different sizes.
    """
    settings = settings or TrainSettings()
    count, seed = len(presses.images), settings.seed
    steps = STEPS if settings.steps is None else settings.steps
    apart = round(_HELD_OUT * count)
    if count < FEWEST:
        raise FileError(f"found {count} presses; at least {FEWEST} are needed to learn from")
    check_spread(presses.angle)
    check_alike(presses, untouched)
    height, width = untouched[0].shape[:2]
    with held_folder(out):
        work = free_folder(out, resume)
        work.mkdir(exist_ok=True)
        profile = SensorProfile(sensor, radius=0.0, image_height=height, image_width=width)
        samples = samples_of_presses(presses, untouched)
        part = np.full(count, _LEARNED)
        part[np.random.default_rng(seed).permutation(count)[: 2 * apart]] = np.repeat((_JUDGED, _CHECKED), apart)
        learned, checked, judged = (samples.of(part == each) for each in (_LEARNED, _CHECKED, _JUDGED))
        torch.manual_seed(seed)
        network, descent = DirectionNetwork(), FitSettings(steps=steps, check=25)
        with bar("direction", steps) as progress:
            learn_direction(network, learned, checked, profile, seed, work, descent, progress)
        held_out = samples.of(part != _LEARNED)
        scale = spread_of(*_off(network, held_out), held_out.episode).scale
        error, _ = _off(network, judged)
        nothing = tuple((0.0, 0.0) for _ in KINDS)
        training = {"seed": seed, "steps": steps, "presses": count}
        told_of = {"direction": Spread(scale, _TOGETHER)}
        model = ModelSettings(sensor, height, width, told_of, nothing, training)
        write_model(out, model, exported_direction(network))
    return {
        "presses": count,
        "held_out": apart,
        "rms_deg": float(np.degrees(np.sqrt(np.mean(error**2)))),
        "median_deg": float(np.degrees(np.median(np.abs(error)))),
    }


def _off(network: DirectionNetwork, samples: Samples) -> tuple[Array, Array]:
    """Return by how much what a network tells of presses is off, (N,) [rad], and its variances (N,) [rad^2]."""
    with torch.no_grad():
        told = network(batch(samples, np.arange(len(samples)))).numpy().astype(np.float64)
    return told[:, 0] - samples.direction, np.exp(told[:, 1])


def samples_of_presses(presses: Presses, untouched: Sequence[Image]) -> Samples:
    """Return what networks see of presses, each a contact of its own, of which nothing is known but its direction."""
    mean = np.asarray(np.mean([reduced(image) for image in untouched], axis=0), np.float32)
    seen = np.array([difference(image, mean) for image in presses.images], dtype=np.float16)
    count = len(seen)
    each, nothing = np.arange(count), np.zeros(count)
    kind = np.zeros(count, int)
    return Samples(seen, each, each, kind, nothing, presses.angle, nothing, kind, np.zeros((count, 6)))
