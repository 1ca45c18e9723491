"""Checks of a hand's recording against what its fingers are said to be."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.errors import FileError, SettingError
from palpate.io.recording import Recording
from palpate.touch.calibration import Calibration
from palpate.touch.cells import cells_of


def check_calibrations(recording: Recording, calibrations: Any) -> None:
    """Raise SettingError if the calibrations of two fingers of a hand are exchanged, as their first images show.

    An image of a unit fits the untouched gel of its own calibration, whatever touches it, as most of it is untouched.
    """
    if recording.hand is None or recording.images is None or not isinstance(calibrations, Mapping):
        return
    there = [name for name in recording.hand.fingers if name in calibrations and name in recording.images]
    misfits = {(name, of): _misfit(recording, name, calibrations[of]) for name in there for of in there}
    for index, name in enumerate(there):
        for other in there[:index]:
            own = min(misfits[name, name], misfits[other, other])
            exchanged = max(misfits[name, other], misfits[other, name])
            if own > 3.0 * (exchanged + 1.0):
                raise SettingError(
                    f"calibration: images of finger {other!r} show the gel of {_name(calibrations[name], name)}, those "
                    f"of {name!r} that of {_name(calibrations[other], other)}; are the two exchanged?"
                )


def _name(calibration: Calibration, finger: str) -> str:
    """Return words that name a calibration."""
    return str(calibration.file) if calibration.file else f"the calibration of {finger!r}"


def _misfit(recording: Recording, finger: str, calibration: Calibration) -> float:
    """Return the median difference of a finger's first image from an untouched gel in its light [grey levels].

    It is infinite if there is no image, or if it has another size.
    """
    for index in range(min(len(recording), 30)):
        try:
            images = recording[index].images or {}
        except FileError:  # a damaged image
            continue
        if finger not in images:
            continue
        untouched = calibration.background.mean
        if images[finger].shape != untouched.shape:
            return float("inf")
        seen = cells_of(images[finger])
        gel = cells_of(untouched)
        light = np.median(seen / np.maximum(gel, 1.0), axis=(0, 1))
        return float(np.median(np.abs(seen - light * gel)))
    return float("inf")
