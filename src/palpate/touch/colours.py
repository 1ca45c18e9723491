"""Whether an untouched gel has its colours where other units of its kind have them.

Each light makes a side of the gel glow, and on one kind of sensor the lights stand alike. So channels that a driver has
exchanged, and images that lie turned or mirrored, show before anything is touched. A unit may be unlike the others,
which is why this says something and refuses nothing.
"""

import numpy as np

from palpate.touch.area import area_means
from palpate.touch.background import Image
from palpate.types.sensor import DIGIT, SensorProfile

_USUAL = {DIGIT.name: (0, 2, 1)}
"""Channels from left to right, by the name of the profile: as on 16 of 17 published DIGITs, docs/study/colours.json."""
_NAMES = np.array(("red", "green", "blue"))
_CELLS = (32, 24)
_DARK = 10.0  # [grey levels] added, for in the dark colours are noise
_FAINT = 0.1  # change of a colour's share from side to side below which a gel hardly has colours
_ALIKE = 0.1  # of the change, by which two channels differ too little to say which lies farther to a side


def unusual_colours(untouched: Image, sensor: SensorProfile) -> str:
    """Return what is unusual about the colours of a gel at rest, "" where nothing is or where nothing is known."""
    usual = _USUAL.get(sensor.name)
    if usual is None:
        return ""
    side = sides(untouched)
    order, span = np.argsort(side), float(np.ptp(side))
    ends = usual[0], usual[-1]
    if span < _FAINT or max(side[ends[0]] - side.min(), side.max() - side[ends[1]]) < _ALIKE * span:
        return ""
    found, wanted = (f"{_NAMES[which[0]]} at the left and {_NAMES[which[-1]]} at the right" for which in (order, usual))
    return (
        f"the gel is {found}, and most units are {wanted}: are channels exchanged, or do images lie turned or "
        "mirrored? `palpate calibrate --presses` tells"
    )


def sides(image: Image) -> np.ndarray:
    """Return how far to the right each channel lies, (3,): by how much its share grows from the middle to the side."""
    cells = area_means(image, *_CELLS).astype(np.float64) + _DARK
    share = cells / cells.sum(axis=2, keepdims=True)
    share /= share.mean(axis=(0, 1))
    x = (2.0 * np.arange(_CELLS[1])[:, None] + 1.0) / _CELLS[1] - 1.0
    return (share * x).mean(axis=(0, 1)) / (x**2).mean()
