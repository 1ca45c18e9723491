"""Whether images lie as the untouched gel does, or are turned, mirrored or of exchanged channels against it."""

import numpy as np

from palpate.errors import SettingError
from palpate.touch.light import Levels
from palpate.touch.view import AS_IT_IS, views

_BETTER = 3.0
"""Times better that another view must fit. Images that lie as they should are at most 0.7 times as far off as in the
best other view, touched or not and in a light that has wandered to a side, and those of other units 3 times but for one
in 300; of those that lie otherwise 97 in 100 are farther off (simulated units, and real ones)."""
_ROUNDING = 1.0  # [grey levels] by which a flat or a symmetric gel may seem better in another view


def check_view(cells: Levels, untouched: Levels, name: str) -> None:
    """Raise SettingError if an image fits the untouched gel far better in another view, and name that.

    Both are cells (rows, columns, 3), see `touch.light`; `name` is what the message calls the untouched gel. Most of
    the gel looks as it did untouched, whatever touches it: so medians over the image tell.
    """
    off = {view: _off(view.of(cells), untouched) for view in views(cells, *untouched.shape[:2])}
    fits = min(off, key=off.__getitem__)
    if off[AS_IT_IS] > _BETTER * (off[fits] + _ROUNDING):
        raise SettingError(
            f"image: lies otherwise than {name}: it fits {fits}, {off[fits]:.1f} grey levels off in the median and not "
            f"{off[AS_IT_IS]:.1f}"
        )


def _off(cells: Levels, untouched: Levels) -> float:
    """How far an image is off the untouched gel with its channels as bright as they are in it [grey levels]."""
    light = np.median(cells / np.maximum(untouched, 1.0), axis=(0, 1))
    return float(np.median(np.abs(cells - light * untouched)))
