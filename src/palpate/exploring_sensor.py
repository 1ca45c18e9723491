"""One sensor that learns the outline of an object: its input and touch are those of any other."""

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.config import TrackerSettings
from palpate.exploring.exploration import Exploration
from palpate.exploring.explored import Explored
from palpate.input.checked_frame import CheckedFrame
from palpate.models.pushing.compiled import PUSHING
from palpate.sensors import OneSensor
from palpate.tracker_arguments import FirstPose, Unit
from palpate.types.measurements import Measurement
from palpate.types.outline import Sketch, Unknown


class OneSensorExploring(OneSensor):
    """One sensor, and an exploration in place of the filter of a known outline."""

    def __init__(
        self,
        outline: Unknown | Sketch,
        settings: TrackerSettings,
        unit: Unit,
        set_up_sigma: ArrayLike | None,
        is_view_known: bool,
    ) -> None:
        self._outline = outline
        no_shape = None  # only the methods below read it
        super().__init__(no_shape, settings, unit, set_up_sigma, is_view_known, PUSHING)  # pyright: ignore[reportArgumentType]

    def make_estimator(self, first: FirstPose) -> Exploration:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the exploration of the object."""
        exploration = Exploration(self._outline, self._sensor, self._settings)
        exploration.begin(first.pose, first.covariance)
        return exploration

    def begin(self, pose: Array, covariance: Array) -> None:
        """Take the object's first pose; without an outline, that the sensor's frame is turned does not show."""
        self._turn = None

    def step(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, estimator: Exploration, checked: CheckedFrame, measured: Sequence[Measurement]
    ) -> Explored:
        """Take the frame and its measurements to pose and outline; images are taken as they lie."""
        explored = estimator.step(checked.frame, (*measured, *checked.frame.measurements))
        may_be_mirrored = self._may_be_mirrored and self._touch.reads_images
        evidence = explored.evidence._replace(may_images_be_mirrored=may_be_mirrored)
        return replace(explored, evidence=evidence)
