"""Whether a network reads touch better that sees the untouched gel beside the difference: docs/study/untouched.json.

    palpate simulate FOLDER --count 150 --seed 14001 --seconds 6 --ideal
    python scripts/measure_untouched.py FOLDER [--images DIR --untouched FILE --truth CSV] [--into FILE.json]

Every recording is of a sensor unit of its own, with lights in any order and from any side. Two networks of directions
learn from four fifths of the units, with the same draws, guises and steps: one takes the difference from the untouched
gel alone, as the shipped model does; the other takes the untouched gel beside it, which shows where light comes from,
in the same guise. Told are, on the units left out, the errors of directions, after each unit's own offset, and what is
stated [deg]; on real images of presses at known angles, as `benchmarks/real_gel.py` takes them, slope, offset and the
error about the line. Each has `SEEDS`, and half an hour on one core.
"""

import csv
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.cli.console import progress_bar
from palpate.io import load_recording
from palpate.lab.train.fit import FitSettings, fit
from palpate.lab.train.losses import gaussian_nll
from palpate.lab.train.networks import WIDTH, DirectionNetwork, Encoder, imprint
from palpate.lab.train.pairs import Seen, draw_guise, varied_batch
from palpate.lab.train.samples import UNTOUCHED, Samples, read_samples
from palpate.touch.background import background_of
from palpate.touch.difference import difference, reduced
from palpate.touch.press_files import read_image
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

OUT = Path(__file__).parents[1] / "docs/study/untouched.json"
SEEDS = (1, 2)
STEPS, BATCH = 1500, 96
FOLDS = 5
NAMES = ("difference alone", "untouched beside it")


class EncoderBeside(Encoder):
    """The encoder of a difference and, in three more channels, of the untouched gel."""

    def __init__(self) -> None:
        super().__init__(WIDTH)
        self.layers[0] = nn.Conv2d(6, WIDTH, 7, stride=2, padding=3, bias=False)

    def forward(self, difference: Tensor) -> Tensor:
        """Return the feature map of both, (B, 6, H, W)."""
        return self.layers(torch.cat([imprint(difference[:, :3]), difference[:, 3:]], dim=1))


@dataclass(frozen=True, eq=False)
class Gels:
    """Touched frames, and the untouched gel of each recording (ROWS, COLUMNS, 3), about -1 to 1, by its number."""

    samples: Samples
    untouched: dict[int, NDArray[np.float32]]
    sensor: SensorProfile


def main(
    folder: tyro.conf.Positional[Path],
    images: Path | None = None,
    untouched: Path | None = None,
    truth: Path | None = None,
    into: Path = OUT,
) -> None:
    """Read, train both, judge both."""
    files = sorted(folder.glob("*.h5"))
    with progress_bar("reading", 2 * len(files)) as progress:
        samples, sensor, failed = read_samples(files, progress=progress)
        gels: dict[int, NDArray[np.float32]] = {}
        for number, file in enumerate(files):
            gels[number] = untouched_of(file)
            progress(len(files) + number + 1)
    if failed:
        raise SystemExit(f"{len(failed)} files cannot be read: {failed}")
    held = samples.recording % FOLDS == 0
    learned, judged = (Gels(samples.of(chosen), gels, sensor) for chosen in (~held, held))
    real = None if images is None or untouched is None or truth is None else real_presses(images, untouched, truth)
    found: dict[str, Any] = {
        "units": len(np.unique(learned.samples.recording)),
        "units_judged_by": len(np.unique(judged.samples.recording)),
        "steps": STEPS,
    }
    for name in NAMES:
        runs = [scores(trained(name, learned, judged, seed), name, judged, real) for seed in SEEDS]
        found[name] = {key: [run[key] for run in runs] for key in runs[0]}
    into.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


def untouched_of(file: Path) -> NDArray[np.float32]:
    """The untouched gel of a recording, as a network may take it."""
    recording = load_recording(file)
    assert recording.contact is not None
    at_rest = np.flatnonzero(~recording.contact)
    chosen = at_rest[np.linspace(0, len(at_rest) - 1, min(UNTOUCHED, len(at_rest))).astype(int)]
    images = [image for index in chosen.tolist() if (image := recording[index].image) is not None]
    return scaled(reduced(background_of(images).mean))


def scaled(levels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Grey levels from -1 to 1."""
    return (levels / np.float32(127.5) - np.float32(1.0)).astype(np.float32)


def trained(name: str, learned: Gels, judged: Gels, seed: int) -> DirectionNetwork:
    """Train one of NAMES."""
    torch.manual_seed(seed)
    network = DirectionNetwork()
    if name == NAMES[1]:
        network.image.encoder = EncoderBeside()
    few = np.random.default_rng(0).integers(len(judged.samples), size=(512, 1))

    def draw(of: Gels, chosen: Indices, rng: np.random.Generator) -> tuple[Indices, Seen]:
        # The guises are the first that a varied batch draws.
        start = int(rng.integers(2**31))
        seen = varied_batch(of.samples, chosen, of.sensor, np.random.default_rng(start))
        if name == NAMES[0]:
            return chosen, seen
        same = np.random.default_rng(start)
        guises = [draw_guise(same) for _ in chosen]
        gels = [of.untouched[number] for number in of.samples.recording[chosen[:, 0]].tolist()]
        beside = [
            gel[:: -1 if guise.upturned else 1, :: -1 if guise.mirrored else 1][..., guise.channels]
            for gel, guise in zip(gels, guises, strict=True)
        ]
        both = torch.cat([seen.difference, torch.from_numpy(np.array(beside)).permute(0, 3, 1, 2)], dim=1)
        return chosen, Seen(both, seen.sign, seen.moved)

    def losses(of: Gels, batch: tuple[Indices, Seen]) -> dict[str, Tensor]:
        chosen, seen = batch
        said = network(seen.difference)
        angle = seen.direction(of.samples.direction[chosen]).ravel()
        return {"direction": gaussian_nll(said[:, 0] - angle, said[:, 1])}

    with tempfile.TemporaryDirectory() as folder, progress_bar(f"{name}, {seed}", STEPS) as progress:
        fit(
            "direction",
            network,
            lambda rng: draw(learned, rng.integers(len(learned.samples), size=(BATCH, 1)), rng),
            lambda batch: losses(learned, batch),
            lambda: losses(judged, draw(judged, few, np.random.default_rng(1))),
            FitSettings(STEPS),
            seed,
            Path(folder),
            progress,
        )
    return network.eval()


@torch.no_grad()
def told(network: DirectionNetwork, name: str, seen: NDArray[Any], gel: NDArray[Any]) -> tuple[Array, Array]:
    """Directions and their standard deviations (N,) [rad] of differences and untouched gels (N, ROWS, COLUMNS, 3)."""
    given = seen if name == NAMES[0] else np.concatenate([seen, gel], axis=3)
    said = network(torch.from_numpy(given.astype(np.float32)).permute(0, 3, 1, 2)).numpy()
    return said[:, 0], np.exp(0.5 * said[:, 1])


def scores(network: DirectionNetwork, name: str, judged: Gels, real: Any) -> dict[str, float]:
    """What the module's docstring says is told [deg]."""
    samples, errors, stated = judged.samples, [], []
    for number in np.unique(samples.recording).tolist():
        of = samples.of(samples.recording == number)
        gel = np.broadcast_to(judged.untouched[number], of.difference.shape)
        angle, deviation = told(network, name, of.difference, gel)
        errors.append(angle - of.direction)
        stated.append(deviation)
    error = np.concatenate(errors)
    about = np.concatenate([each - np.median(each) for each in errors])
    found = {
        "median_deg": float(np.degrees(np.median(np.abs(error)))),
        "rms_deg": float(np.degrees(np.sqrt(np.mean(error**2)))),
        "median_after_offset_deg": float(np.degrees(np.median(np.abs(about)))),
        "stated_deg": float(np.degrees(np.median(np.concatenate(stated)))),
    }
    if real is None:
        return found
    seen, gel, angle = real
    said, _ = told(network, name, seen, gel)
    slope, offset = np.polyfit(angle, said, 1)
    about_line = said - slope * angle - offset
    return found | {
        "real_slope": float(slope),
        "real_offset_deg": float(np.degrees(np.mean(said - angle))),
        "real_rms_about_line_deg": float(np.degrees(np.sqrt(np.mean(about_line**2)))),
    }


def real_presses(images: Path, untouched: Path, truth: Path) -> tuple[NDArray[Any], NDArray[Any], Array]:
    """Differences, untouched gels and true angles [rad] of real presses."""
    with truth.open(newline="") as file:
        rows = list(csv.DictReader(file))
    mean = reduced(background_of([read_image(untouched)] * 2).mean)
    seen = np.array([difference(read_image(images / row["file"]), mean) for row in rows])
    return seen, np.broadcast_to(scaled(mean), seen.shape), np.radians([float(row["angle_deg"]) for row in rows])


if __name__ == "__main__":
    tyro.cli(main)
