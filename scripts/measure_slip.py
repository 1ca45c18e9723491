"""What touch images tell of sliding, on units left out: docs/study/slip.json.

    palpate simulate FOLDER --count 30 --seed 73601
    python scripts/measure_slip.py FOLDER

A frame slides where the contact moves along the outline by more than a tenth of the sensor's motion. Ridge regressions
on the recordings of four fifths of the units are judged on the others, three times:

- `known`: on what the graph has already, the kind of contact, its direction and how that has changed;
- `seen`: on the features that the shipped model makes of an image, and how these have changed;
- `both`: on all of it;
- `force`: on the true shear force, which is all of sliding that the renderer is told.

`auc` is that of sliding, `sign_auc` that of the way it slides where it does, `slip_r2` the explained share of the
signed speed along the outline and `shear_r2` that of the shear force. Ten minutes on one core.
"""

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.cli.console import progress_bar
from palpate.io import load_recording
from palpate.lab.train.samples import Samples, read_samples
from palpate.touch.model import KINDS, shipped_model

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OUT = Path(__file__).parents[1] / "docs/study/slip.json"
BACK = 5  # frames over which things change
SLIDES = 0.1  # of the sensor's motion
FOLDS = 5
PULL = 1e-2  # of the ridge, as a share of the number of samples


def main(folder: Path) -> None:
    """Read, ask the model, regress."""
    files = sorted(folder.glob("*.h5"))
    with progress_bar("reading", len(files)) as progress:
        samples, _, failed = read_samples(files, progress=progress)
    if failed:
        raise SystemExit(f"{len(failed)} files cannot be read: {failed}")
    slip, speed, shear = truth(files, samples)
    seen, direction = features(samples)
    earlier = np.maximum(np.arange(len(samples)) - BACK, 0)
    compared = (samples.episode[earlier] == samples.episode) & (samples.frame - samples.frame[earlier] == BACK)
    known = of_kinds(samples.kind, np.stack([direction, direction - direction[earlier]], axis=1))
    seen = np.concatenate([seen, seen - seen[earlier]], axis=1)
    inputs = {"known": known, "seen": squares(seen), "both": np.concatenate([known, squares(seen)], axis=1)}
    inputs["force"] = squares(shear[:, None])
    slides = np.abs(slip) > SLIDES * speed
    fold = samples.recording % FOLDS
    scores = {
        name: judged(given[compared], fold[compared], slides[compared], slip[compared], shear[compared])
        for name, given in inputs.items()
    }
    facts = {"recordings": len(files), "frames": int(compared.sum()), "slide_share": float(slides[compared].mean())}
    OUT.write_text(json.dumps({**facts, **scores}, indent=2) + "\n", encoding="utf-8")


def truth(files: list[Path], samples: Samples) -> tuple[Array, Array, Array]:
    """Return speed along the outline [m/s], the sensor's speed [m/s] and the shear force [N], (N,) each."""
    slip, speed, shear = np.zeros((3, len(samples)))
    for number, file in enumerate(files):
        recording, of_this = load_recording(file), samples.recording == number
        frame = samples.frame[of_this]
        velocity = np.gradient(recording.extra["sensor_pose_clean"][:, :2], recording.time, axis=0)
        slip[of_this], speed[of_this] = recording.extra["slip"][frame], np.hypot(*velocity[frame].T)
        shear[of_this] = recording.extra["tangential_force"][frame]
    return slip, speed, shear


def features(samples: Samples) -> tuple[Array, Array]:
    """Return what the shipped model makes of images: descriptors (N, D) and directions (N,) [rad]."""
    model = shipped_model()
    looks = [model.look(each.astype(np.float32)) for each in samples.difference]
    return np.array([look.descriptor for look in looks], np.float64), np.array([look.direction[0] for look in looks])


def squares(values: Array) -> Array:
    """Return values (N, D) and their squares, (N, 2 D)."""
    return np.concatenate([values, values**2], axis=1)


def of_kinds(kind: NDArray[np.int_], values: Array) -> Array:
    """Return one, values (N, D) and their squares for each kind of contact by itself."""
    is_kind = kind[:, None] == np.arange(len(KINDS))
    terms = np.concatenate([np.ones((len(kind), 1)), squares(values)], axis=1)
    return (is_kind[:, :, None] * terms[:, None, :]).reshape(len(kind), -1)


def judged(given: Array, fold: NDArray[np.int_], slides: Flags, slip: Array, shear: Array) -> dict[str, float]:
    """Return the scores of the module's docstring."""
    told = {name: regressed(given, wanted, fold) for name, wanted in (("slip", slip), ("shear", shear))}
    return {
        "auc": auc(slides, regressed(given, slides.astype(np.float64), fold)),
        "sign_auc": auc(slip[slides] > 0.0, told["slip"][slides]),
        "slip_r2": explained(slip, told["slip"]),
        "shear_r2": explained(shear, told["shear"]),
    }


def regressed(given: Array, wanted: Array, fold: NDArray[np.int_]) -> Array:
    """Return what ridge regressions on the other folds say of each sample (N,)."""
    told = np.zeros(len(wanted))
    for number in range(FOLDS):
        learned, asked = fold != number, fold == number
        mean, deviation = given[learned].mean(axis=0), given[learned].std(axis=0) + 1e-9
        x, middle = (given[learned] - mean) / deviation, wanted[learned].mean()
        square = x.T @ x + PULL * len(x) * np.eye(x.shape[1])
        told[asked] = (given[asked] - mean) / deviation @ np.linalg.solve(
            square, x.T @ (wanted[learned] - middle)
        ) + middle
    return told


def explained(true: Array, told: Array) -> float:
    """Return the share of a variance that is explained; below 0 where the mean would be nearer."""
    return float(1.0 - np.mean((true - told) ** 2) / np.var(true))


def auc(true: Flags, told: Array) -> float:
    """Return how often a true sample is told to be higher than one that is not."""
    rank = np.empty(len(told))
    rank[np.argsort(told)] = np.arange(1, len(told) + 1)
    positive = int(true.sum())
    return float((rank[true].sum() - positive * (positive + 1) / 2) / (positive * (len(true) - positive)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
