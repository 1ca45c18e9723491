"""Compare shipped touch models with real presses: docs/study/real_gel.json of a DIGIT, real_mini.json of a Mini.

    python scripts/measure_real_gel.py [../shared/data/digit_balls]

The folder holds the presses, `untouched.png` and `truth.csv`. True angles follow from the columns of the balls, the
middles of their halos, by the scale that the owner of this unit states. Images are read as they are or as others come,
without calibration or after `palpate calibrate` on five presses, which are left out of the scores then. `slope` and
`offset_deg` are of the measured angle over the true one, `flanks_slope` of where a ball's green flank meets the red
one, which needs no model; `pairs_rms_deg` is the error of the change between any two presses, and that of no
change. A side that rolls moves its imprint as presses do and turns the sensor the other way: `turns_rms_deg`.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import DATA, write
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from palpate import DIGIT, GELSIGHT_MINI, Calibration
from palpate.arrays import Image
from palpate.touch.background import background_of
from palpate.touch.calibration import calibrated
from palpate.touch.one_image import ImageReader
from palpate.touch.press_calibration import Presses, learn_from_presses
from palpate.touch.reader import angle_factor
from palpate.touch.touch_model import difference_in_light, reduced, shipped_model
from palpate.types.images import read_image
from palpate_lab.train.scores import coverage

Array = NDArray[np.float64]
OWN_PITCH = 1e-3 / 19.58  # [m] a pixel on the gel of this unit
CASES = {
    "as it is": ("as it is", 0),
    "as it is, its scale known": ("as it is", 1),
    "as it is, calibrated on 5": ("as it is", 5),
    "mirrored, calibrated on 5": ("mirrored", 5),
    "turned by 180 degrees, calibrated on 5": ("turned", 5),
    "red and blue exchanged": ("swapped", 0),
    "red and blue exchanged, calibrated on 5": ("swapped", 5),
}
"""The camera's images, and the number of presses to calibrate on; 1 is a ruler."""


def main(folder: Path) -> None:
    """Measure all cases and write."""
    write("real_gel", {name: measured(folder, *case) for name, case in CASES.items()})
    write("real_mini", places_on_pads(folder.parent))


def places_on_pads(data: Path) -> dict[str, Any]:
    """Return the scores of places on two flat pads, without a calibration; `measure_units.py` has those after one."""
    return {"balls": balls_on_mini(data), "edges": edges_on_mini(data), "dots": balls_on_dots(data)}


def balls_on_dots(data: Path) -> dict[str, float]:
    """Return the scores of places of balls on a gel with dots, whose circles are marked by hand; one of 51 wrongly."""
    with (data / "mini_dots_balls/truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    folder = data / "mini_dots_balls"
    images = [read_image(folder / row["file"]) for row in rows]
    return of_places(folder / "untouched.png", images, [float(row["column_px"]) for row in rows])


def balls_on_mini(data: Path) -> dict[str, float]:
    """Return the scores of places of balls, whose columns are those of the best sphere in gradients of the image."""
    with (data / "mini_balls/centres.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    images = [read_image(data / "mini_balls" / row["press"] / "gelsight.png") for row in rows]
    columns = [float(row["centre_col_px"]) for row in rows]
    return of_places(data / "mini_balls/background.png", images, columns)


def edges_on_mini(data: Path) -> dict[str, float]:
    """Return the scores of places of upright edges that are labelled by hand."""
    folders = [data / "edges_mini/10.000x10.000mm" / number for number in ("13", "16")]
    columns = [float(np.load(folder / "label.npz")["line_center"][0]) for folder in folders]
    return of_places(
        data / "edges_mini/background.png", [read_image(folder / "gelsight.png") for folder in folders], columns
    )


def of_places(still: Path, images: list[Image], columns: list[float]) -> dict[str, float]:
    """Return the scores of places of imprints at columns (N,) [px]."""
    true = (np.array(columns) - 0.5 * (GELSIGHT_MINI.image_width - 1)) * (GELSIGHT_MINI.pixel_pitch or 0.0)
    calibration = Calibration(background_of([read_image(still)]))
    reader = ImageReader(GELSIGHT_MINI, calibration, shipped_model(GELSIGHT_MINI.name))
    readings = [reader.read(image).place for image in images]
    place, sigma = np.array([reading for reading in readings if reading]).T
    error = place - true
    inside = coverage(error, sigma**2)
    return {
        "n": len(images),
        "median_mm": float(1e3 * np.median(np.abs(error))),
        "second_worst_mm": float(1e3 * np.sort(np.abs(error))[-2]),
        "worst_mm": float(1e3 * np.max(np.abs(error))),
        "slope": float(np.polyfit(true, place, 1)[0]),
        "in_68_share": inside[0.68],
        "in_95_share": inside[0.95],
    }


def measured(folder: Path, camera: str, calibrate_on: int) -> dict[str, float]:
    """Return the scores of one case."""
    with (folder / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    column = np.array([float(row["column_px"]) for row in rows])
    true = np.arcsin((column - 0.5 * (DIGIT.image_width - 1)) * OWN_PITCH / DIGIT.radius)
    images = [as_delivered(read_image(folder / row["file"]), camera) for row in rows]
    untouched = as_delivered(read_image(folder / "untouched.png"), camera)
    calibration = Calibration(background_of([untouched] * 2))
    chosen = np.array([], np.int_)
    if calibrate_on == 1:
        calibration = replace(calibration, pixel_pitch=OWN_PITCH, pixel_pitch_sigma=0.04)
    elif calibrate_on:
        chosen = np.argsort(true)[np.linspace(0, len(true) - 1, calibrate_on).astype(int)]
        presses = Presses(tuple(images[k] for k in chosen), true[chosen], tuple(rows[k]["file"] for k in chosen))
        calibration, _ = learn_from_presses(presses, calibration, DIGIT, shipped_model(DIGIT.name))
    left = np.setdiff1d(np.arange(len(true)), chosen)
    scores = scored(calibration, [images[k] for k in left], true[left])
    if calibrate_on == 1:
        change = zip(np.array(images, np.float64) - untouched, [float(row["row_px"]) for row in rows], strict=True)
        scores["flanks_slope"] = float(np.polyfit(column, [meeting(*each) for each in change], 1)[0])
    return scores


def meeting(change: Array, row: float) -> float:
    """Return the column where the green flank of a ball at a row meets the red one, by the rows that show both."""
    flanks = gaussian_filter(change[..., 1] - change[..., 0], 3.0)[max(round(row) - 50, 0) : round(row) + 50]
    left = flanks.argmax(axis=1)
    both = np.minimum(flanks.max(axis=1), -flanks.min(axis=1))
    falls = (np.arange(flanks.shape[1]) > left[:, None]) & (flanks <= 0.0)
    shows_both = left < flanks.argmin(axis=1)
    weights = np.where(shows_both, np.maximum(both - 8.0, 0.0), 0.0)
    return float(np.average(falls.argmax(axis=1), weights=weights))


def scored(calibration: Calibration, images: list[Image], true: Array) -> dict[str, float]:
    """Return the scores of images with true angles (N,) [rad]."""
    model = shipped_model(DIGIT.name)
    mean = reduced(calibration.background.mean)
    looks = [model.read(difference_in_light(calibration.view.of(image), mean)) for image in images]
    factor = angle_factor(model, calibrated(DIGIT, calibration))
    direction, variance = np.array([look["direction"] for look in looks]).T
    direction = (factor * direction - calibration.direction.offset) / calibration.direction.scale
    error = direction - true
    slope, intercept = np.polyfit(true, direction, 1)
    inside = coverage(
        error, (factor / calibration.direction.scale) ** 2 * variance * model.settings.spread["direction"].scale
    )
    turns = (
        changes(np.array([look["turn"][0] for look in looks if "turn" in look])) * factor / calibration.direction.scale
    )
    return {
        "n": len(images),
        "correlation": float(np.corrcoef(true, direction)[0, 1]),
        "slope": float(slope),
        "offset_deg": float(np.degrees(error.mean())),
        "rms_after_offset_deg": rms_deg(error - error.mean()),
        "rms_about_line_deg": rms_deg(direction - slope * true - intercept),
        "pairs_rms_deg": rms_deg(changes(error)),
        "constant_pairs_rms_deg": rms_deg(changes(true)),
        "in_68_share": inside[0.68],
        "in_95_share": inside[0.95],
        "turns_rms_deg": rms_deg(turns + changes(true)),
    }


def changes(values: Array) -> Array:
    """Return the differences between any two of values (N,)."""
    first, second = np.triu_indices(len(values), 1)
    return values[second] - values[first]


def rms_deg(values: Array) -> float:
    """Return the root mean square of angles [rad] in degrees."""
    return float(np.degrees(np.sqrt(np.mean(values**2))))


def as_delivered(image: Image, camera: str) -> Image:
    """Return an image as another camera would deliver it."""
    views = {"mirrored": image[:, ::-1], "turned": image[::-1, ::-1], "swapped": image[..., ::-1]}
    return np.ascontiguousarray(views.get(camera, image))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA / "digit_balls")
