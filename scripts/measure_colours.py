"""How often exchanged channels show in untouched gels: docs/study/colours.json.

    python scripts/measure_colours.py ../shared/data

Of the published DIGITs (`digit_backgrounds`, of different units), of two more (`digit_balls`, `digit_gripped`), and of
simulated units whose lights stand as usual: in how many something is said of the colours, as the images are, with
channels in each other order, and mirrored. What counts as usual was chosen with the 17 backgrounds before one's eyes.
"""

import json
import sys
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path

import numpy as np

from palpate.lab.simulate.unit import draw_unit
from palpate.touch.background import Image
from palpate.touch.colours import unusual_colours
from palpate.touch.press_files import read_image
from palpate.types.sensor import DIGIT

OUT = Path(__file__).parents[1] / "docs/study/colours.json"
UNITS, FIRST_SEED = 200, 16_100_000
AS_DRAWN = np.deg2rad((30.0, 150.0, 270.0))
"""From where red, green and blue light usually come in a simulated unit."""
WITHIN = np.deg2rad(40.0)


def main(data: Path) -> None:
    """Count and write."""
    others = [data / "digit_balls/untouched.png", sorted((data / "digit_gripped").glob("*untouched.png"))[0]]
    published = [read_image(file) for file in sorted((data / "digit_backgrounds").glob("*.jpg"))]
    units = [draw_unit(DIGIT, seed) for seed in range(FIRST_SEED, FIRST_SEED + UNITS)]
    usual = [unit.no_contact for unit in units if is_usual(unit.light)]
    found = {
        "published": counted(published),
        "two more": counted([read_image(file) for file in others]),
        "simulated, usual": counted(usual),
    }
    OUT.write_text(json.dumps(found, indent=2) + "\n", "utf-8")


def counted(images: Sequence[Image]) -> dict[str, int]:
    """Return how many images there are, and of how many something is said in each guise."""
    said = {"n": len(images), "as they are": many(images), "mirrored": many([image[:, ::-1] for image in images])}
    for order in list(permutations(range(3)))[1:]:
        said["".join("RGB"[channel] for channel in order)] = many([image[..., order] for image in images])
    return said


def many(images: Sequence[Image]) -> int:
    """Return of how many images something is said."""
    return sum(bool(unusual_colours(np.ascontiguousarray(image), DIGIT)) for image in images)


def is_usual(light: np.ndarray) -> bool:
    """Return whether the three lights (3, 3) come from where they usually do."""
    off = np.arctan2(light[:, 1], light[:, 0]) - AS_DRAWN
    return bool(np.abs(np.angle(np.exp(1j * off))).max() < WITHIN)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
