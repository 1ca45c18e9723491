"""The window of an object that rests: one step, in which the object stands in the sensor's place.

Then g is the identity and e the object's pose, so that measurements of the object's pose, and of one's own, are the
same factors as in a contact. What belongs to a contact keeps its prior.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.estimation.compiled_model import CompiledModel
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.measurements import Step, terms_of
from palpate.models.pushing.own_measurements import OwnMeasurements
from palpate.models.pushing.variables import SENSOR, SENSOR_IN_OBJECT
from palpate.models.pushing.window import PushingWindow, first_step

_PINNED = 1e18
"""[1/m^2], [1/rad^2] Information that keeps the object in the sensor's place: its variance adds nothing to others."""


class RestWindow(PushingWindow):
    """The graph of one instant at which nothing touches the object, in B hypotheses."""

    def __init__(
        self,
        graph: Graph,
        belief: Belief,
        step: Step,
    ) -> None:
        """Take B beliefs about the object and the measurements of a frame; those of an earlier time count as of now.

        Raises EstimationError if they leave the object indeterminate in a hypothesis.
        """
        steps, rows = _step_at_rest(graph.compiled, belief)
        model = graph.compiled.model
        rows["past"]["g"] = 0.0
        pinned = model.in_step[SENSOR_IN_OBJECT]
        for k in range(pinned.start, pinned.stop):
            rows["past"]["information"][:, k, k] = _PINNED
        super().__init__(graph, steps, rows, lag=1, drift=np.zeros(model.last_size))
        self._join(*terms_of(graph.compiled, step, 0), step.times[-1])
        self._solve(np.ones(len(rows), np.int64))
        if self.rows["is_lost"].any():
            raise EstimationError("measurements of the resting object leave it indeterminate")


def _step_at_rest(compiled: CompiledModel, belief: Belief) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the only step (1, B), and the rows (B,) of the window."""
    steps, rows = first_step(compiled, belief, belief.pose, np.ones(len(belief)))
    steps["is_resting"] = 1.0
    steps["g"] = 0.0
    return steps, rows


def own_measure_pose(belief: Belief, step: Step, own: OwnMeasurements, compiled: CompiledModel = PUSHING) -> bool:
    """Return True if any measurement of one's own depends on the object's pose at these beliefs."""
    steps, rows = _step_at_rest(compiled, belief)
    own.given = terms_of(compiled, step, 0)[1]
    own.time = step.times[-1]
    by_sensor = own.evaluated(0, steps, rows["shared"])[..., 1:][..., compiled.model.in_step[SENSOR]]
    return bool(by_sensor.any())
