"""What a touch model says of real images of presses at known angles, and how well it knows how well.

    python benchmarks/real_gel.py --images DIR --untouched FILE --truth CSV [--model FOLDER] [--guise G]
        [--calibrate-on N] [--json]

The truth has columns file and angle_deg, as `digit_balls/truth.csv`. With --guise the images are given mirrored, turned
by 180 degrees (upturned) or with exchanged channels (swapped). With --calibrate-on, N of them, spread over the angles,
are given to `palpate calibrate`, and the others are judged in the view and with the correction that it finds.

`slope` and `offset_deg` are of the told angle over the true one; the RMS are of what is left after the offset and about
the line. `pairs_rms_deg` is of the change of angle between any two images; with `constant_pairs_rms_deg` it would be
told that nothing changes. `in_68_share` and `in_95_share` are the shares of told angles whose errors, as they are, lie
within what the model states for them; what it states, in the median, is `stated_deg`. A unit's offset is no error of an
image: `in_68_share_after_offset` and the one of 95 are without it, and `pairs_in_68_share` and the one of 95 are of the
changes between any two images.

A side that rolls over the gel moves its imprint as these presses do, and turns the sensor by as much as the angle
changes, the other way. `turns_rms_deg` is of such turns between any two images, by what the model tells of each image;
`network_pairs_rms_deg` by its network of pairs. Models that were learnt from presses tell neither.
"""

import argparse
import csv
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.lab.train.scores import coverage
from palpate.touch.background import Image, background_of
from palpate.touch.calibration import Calibration
from palpate.touch.difference import difference, reduced
from palpate.touch.model import SHIPPED, Look, TouchModel
from palpate.touch.press_files import read_image
from palpate.touch.presses import Presses, learn_from_presses
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]
GUISES = ("as it is", "mirrored", "upturned", "swapped")


def main() -> None:
    """Read the images, ask the model, print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, required=True)
    parser.add_argument("--untouched", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--model", type=Path, default=SHIPPED)
    parser.add_argument("--guise", choices=GUISES, default=GUISES[0])
    parser.add_argument("--calibrate-on", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with arguments.truth.open(newline="") as file:
        rows = list(csv.DictReader(file))
    true = np.radians([float(row["angle_deg"]) for row in rows])
    images = [in_guise(read_image(arguments.images / row["file"]), arguments.guise) for row in rows]
    untouched = in_guise(read_image(arguments.untouched), arguments.guise)
    model = TouchModel(arguments.model)
    calibration, chosen = Calibration(background_of([untouched] * 2)), np.zeros(len(true), np.bool_)
    if arguments.calibrate_on:
        chosen[np.argsort(true)[np.linspace(0, len(true) - 1, arguments.calibrate_on).astype(int)]] = True
        given = Presses(
            tuple(np.array(images)[chosen]), true[chosen], tuple(np.array([row["file"] for row in rows])[chosen])
        )
        calibration = learn_from_presses(given, [untouched], DIGIT, model).calibration
        print(f"images read {calibration.view}", file=sys.stderr)
    found = judged(
        model, calibration, [image for image, used in zip(images, chosen, strict=True) if not used], true[~chosen]
    )
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    for name, value in found.items():
        print(f"{name:26} {value:8.3f}")


def judged(model: TouchModel, calibration: Calibration, images: list[Image], true: Array) -> dict[str, float]:
    """Return the numbers of the module's docstring for images with true angles (N,) [rad]."""
    mean, view = reduced(calibration.background.mean), calibration.view
    looks = [model.look(difference(view.of(image), mean)) for image in images]
    told, variance = np.array([look.direction for look in looks]).T
    told = np.array([calibration.direction.true(angle) for angle in told])
    variance = variance * model.settings.spread["direction"].scale
    error = told - true
    slope, offset = np.polyfit(true, told, 1)
    within, without = coverage(error, variance), coverage(error - error.mean(), variance)
    first, second = pairs(len(true))
    of_pairs = coverage(changes(error), variance[first] + variance[second])
    return {
        "n": len(images),
        "correlation": float(np.corrcoef(true, told)[0, 1]),
        "slope": float(slope),
        "offset_deg": float(np.degrees(error.mean())),
        "rms_after_offset_deg": degrees_rms(error - error.mean()),
        "rms_about_line_deg": degrees_rms(told - slope * true - offset),
        "pairs_rms_deg": degrees_rms(changes(error)),
        "constant_pairs_rms_deg": degrees_rms(changes(true)),
        "in_68_share": within[0.68],
        "in_95_share": within[0.95],
        "in_68_share_after_offset": without[0.68],
        "in_95_share_after_offset": without[0.95],
        "pairs_in_68_share": of_pairs[0.68],
        "pairs_in_95_share": of_pairs[0.95],
        "stated_deg": float(np.degrees(np.median(np.sqrt(variance)))),
        **(turns(model, calibration, looks, true) if "turn" in model.settings.spread else {}),
    }


def turns(model: TouchModel, calibration: Calibration, looks: list[Look], true: Array) -> dict[str, float]:
    """Return the numbers of turns between any two looks at presses with true angles (N,) [rad]."""
    told, seen = (np.array([getattr(look, name) for look in looks]) for name in ("turn", "descriptor"))
    first, second = pairs(len(true))
    by_image = calibration.direction.turn(changes(told[:, 0]))
    by_pair = calibration.direction.turn(model.compare(seen[first], seen[second])[0])
    return {
        "turns_rms_deg": degrees_rms(by_image + changes(true)),
        "network_pairs_rms_deg": degrees_rms(by_pair + changes(true)),
    }


def changes(values: Array) -> Array:
    """Return the differences of any two of values (N,)."""
    first, second = pairs(len(values))
    return values[second] - values[first]


def pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of the first and the second of any two of so many."""
    return np.triu_indices(count, 1)


def degrees_rms(values: Array) -> float:
    """Return the root of the mean square [rad] in degrees."""
    return float(np.degrees(np.sqrt(np.mean(values**2))))


def in_guise(image: Image, guise: str) -> Image:
    """Return an image as another camera would give it; see GUISES."""
    views = {"mirrored": image[:, ::-1], "upturned": image[::-1, ::-1], "swapped": image[..., ::-1]}
    return np.ascontiguousarray(views.get(guise, image))


if __name__ == "__main__":
    main()
