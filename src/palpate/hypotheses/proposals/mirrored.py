"""Proposal until it is known how touch images lie: each hypothesis has a twin that takes them as mirrored.

Turned by half a turn or mirrored, touch measures the other side of the tip. The twin takes all of touch with the
opposite sign, and weights decide.
"""

from dataclasses import replace

import numpy as np

from palpate.arrays import Flags
from palpate.hypotheses.bank import Hypotheses

_UNDECIDED_WEIGHT = 1e-2
"""Weight of images that are mirrored, or are not, from which it is undecided."""


def propose_mirrored(rows: Hypotheses) -> Hypotheses:
    """Return the hypotheses, which take images as they come, followed by their twins, which take them as mirrored."""
    return rows.joined(replace(rows, touch_sign=-rows.touch_sign))


def decide_mirrored(rows: Hypotheses) -> bool | None:
    """Return True if images are mirrored, False if not, once hardly any weight is left for the other; else None."""
    mirrored_weight = float(rows.weight[rows.touch_sign < 0.0].sum())
    if _UNDECIDED_WEIGHT < mirrored_weight < 1.0 - _UNDECIDED_WEIGHT:
        return None
    return mirrored_weight > 0.5


def takes_images_as(rows: Hypotheses, is_mirrored: bool) -> Flags:
    """Return True (B,) for the hypotheses that take images as mirrored, or for those that do not."""
    return np.asarray((rows.touch_sign < 0.0) == is_mirrored)
