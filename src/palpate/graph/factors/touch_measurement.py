"""Base of the factors for touch measurements of one number with a variance: direction, place and turn."""

from typing import ClassVar

import numpy as np

from palpate.config import DirectionSettings, PlaceSettings, TurnSettings
from palpate.graph.factors.factor import Factor, Step, Terms, kernel_scale
from palpate.types.measurements import ContactDirection, ContactPlace, Turn

DATA = np.dtype([("value", np.float64), ("information", np.float64), ("from_touch", np.bool_)], align=True)


class TouchMeasurement(Factor):
    """One term of one row for each measurement of a kind.

    Values read from touch images are multiplied by the sign of each hypothesis, which is -1 for mirrored images.
    """

    measurement: ClassVar[type[ContactDirection | ContactPlace | Turn]]
    """Kind of measurement."""
    field: ClassVar[str] = "angle"
    """Field of the measured number."""
    rows = 1
    data = DATA

    def __init__(self, settings: DirectionSettings | PlaceSettings | TurnSettings) -> None:
        self.given = (kernel_scale(settings.kernel),)
        self._share = settings.share

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        found = [
            (getattr(one, self.field), 1.0 / (one.variance * self._share), index < step.from_touch)
            for index, one in enumerate(step.measurements)
            if isinstance(one, self.measurement)
        ]
        return Terms(np.zeros(len(found), np.int64), np.array(found, DATA)) if found else None
