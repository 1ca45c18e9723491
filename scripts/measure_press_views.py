"""What `palpate calibrate --presses` finds of simulated units that no network has seen: docs/study/press_views.json.

    python scripts/measure_press_views.py

Each unit's camera delivers images turned by 180 degrees, mirrored, both or neither, with its channels in any order. It
is given presses of a ball, at angles that are said to a degree or only in order, and judged on presses of another ball
and of an edge. `left_right_share`, `up_down_share` and `colours_share` are how often these are found as they are; by
chance they were 1/2, 1/2 and 1/6. `colours_usual_share` is of the units whose lights stand as on real DIGITs. The RMS
is of directions after the correction, over units. Three minutes on one core.
"""

import json
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from measure_colours import is_usual
from measure_direction_scale import ANGLES, presses
from numpy.typing import NDArray

from palpate.lab.simulate.gel import touch_image
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.background import Image
from palpate.touch.calibration import Calibration
from palpate.touch.difference import difference, reduced
from palpate.touch.model import shipped_model
from palpate.touch.presses import Presses, learn_from_presses
from palpate.touch.view import views
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]
OUT = Path(__file__).parents[1] / "docs/study/press_views.json"
UNITS, FIRST_SEED = 48, 13_700_000
"""No recording that a network has learnt from has so great a seed; the rule was chosen on units from 13,500,000 on."""
WAYS = {"5 presses": (5, True), "10 presses": (10, True), "5 presses in order": (5, False)}
"""How many presses, and whether their angles are said."""
GIVEN = np.radians(1.0)  # standard deviation of the angles that are said
MARKS = np.array([[(250, 30, 90), (60, 200, 10)], [(120, 0, 220), (20, 140, 170)]], np.uint8)
"""An image that no view leaves as it is."""


def main() -> None:
    """Press every unit, learn it from few presses, judge it on others."""
    cv2.setNumThreads(1)
    found: dict[str, list[tuple[float, ...]]] = {way: [] for way in WAYS}
    for seed in range(FIRST_SEED, FIRST_SEED + UNITS):
        unit, rng = draw_unit(DIGIT, seed), np.random.default_rng(seed)
        cameras = list(views(unit.no_contact, DIGIT.image_height, DIGIT.image_width))
        camera = cameras[rng.integers(len(cameras))]
        untouched = camera.of(touch_image(unit, None, rng=rng))
        pressed = list(presses("ball", unit, rng))
        others = [*presses("ball", unit, rng), *presses("edge", unit, rng)]
        judged = np.array([angle for angle, _ in others]), [camera.of(image) for _, image in others]
        said = np.array([angle for angle, _ in pressed]) + rng.normal(0.0, GIVEN, len(ANGLES))
        for way, (count, is_said) in WAYS.items():
            chosen = np.linspace(0, len(ANGLES) - 1, count).round().astype(int)
            images = tuple(camera.of(pressed[index][1]) for index in chosen)
            given = Presses(images, said[chosen] if is_said else np.full(count, np.nan), tuple(map(str, chosen)))
            calibration = learn_from_presses(given, [untouched], DIGIT, shipped_model()).calibration
            seen = calibration.view.of(camera.of(MARKS))
            found[way].append((is_usual(unit.light), *as_they_are(seen), off(calibration, *judged)))
    told = {way: summary(np.array(rows)) for way, rows in found.items()}
    about = {"units": UNITS, "said_to_deg": float(np.degrees(GIVEN))}
    OUT.write_text(json.dumps({**about, **told}, indent=2) + "\n", encoding="utf-8")


def as_they_are(seen: Image) -> tuple[bool, bool, bool]:
    """Return whether left and right, up and down, and the colours of MARKS are again where they belong."""
    for across, along in product((1, -1), (1, -1)):
        placed = MARKS[::along, ::across]
        if (np.sort(seen, axis=-1) == np.sort(placed, axis=-1)).all():
            return across == 1, along == 1, bool((seen == placed).all())
    raise AssertionError("a view turns, mirrors and exchanges colours, and no more")


def off(calibration: Calibration, true: Array, images: list[Image]) -> float:
    """Return the root of the mean square [deg] by which directions are off, which are (N,) [rad]."""
    mean, view, model = reduced(calibration.background.mean), calibration.view, shipped_model()
    told = [model.look(difference(view.of(image), mean)).direction[0] for image in images]
    error = np.array([calibration.direction.true(angle) for angle in told]) - true
    return float(np.degrees(np.sqrt(np.mean(error**2))))


def summary(rows: Array) -> dict[str, float]:
    """Return shares and errors over units (N, 5)."""
    usual, left_right, up_down, colours, rms = rows.T
    return {
        "left_right_share": float(left_right.mean()),
        "up_down_share": float(up_down.mean()),
        "colours_share": float(colours.mean()),
        "colours_usual_share": float(colours[usual > 0.0].mean()),
        "rms_median_deg": float(np.median(rms)),
        "rms_mean_deg": float(rms.mean()),
        "rms_worst_deg": float(rms.max()),
    }


if __name__ == "__main__":
    main()
