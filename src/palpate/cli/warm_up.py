"""`palpate warm-up`: compile what tracking needs."""

import time

from palpate.cli.console import report
from palpate.cli.options import Json
from palpate.errors import PalpateError


def warm_up(*, json: Json = False) -> int:
    """Compile what tracking needs and keep it, such as while a container image is built.

    Example: palpate warm-up
    """
    import numpy as np

    from palpate import DIGIT, Disc, Frame, Tracker
    from palpate.graph.compiled import folder_of
    from palpate.graph.gauss_newton import improve

    began = time.monotonic()
    folder = folder_of(improve)
    if folder is None:
        raise PalpateError("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder that only you can write to")
    tracker, random = Tracker(Disc(0.05), DIGIT, None), np.random.default_rng(0)
    for index in range(30):  # images of an untouched gel, then of one that is pressed
        image = random.integers(100, 120, (DIGIT.image_height, DIGIT.image_width, 3), np.uint8)
        image[80:200, 60:160] += np.uint8(0 if index < 25 else 100)
        tracker.update(Frame(index / DIGIT.rate, np.array([0.001 * min(index, 25) - 0.1, 0.0, 0.0]), image=image))
    report(json, "compiled code", {"folder": str(folder), "duration_s": time.monotonic() - began})
    return 0
