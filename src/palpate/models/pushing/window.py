"""The window of one contact of a push: how it begins, what a step adds, and what else may have moved the object."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array, Flags
from palpate.estimation.compiled_model import CompiledModel, Given
from palpate.estimation.gauss_newton import RECENT
from palpate.estimation.rows import Indices
from palpate.estimation.variable import Variable
from palpate.estimation.window import LAG, Window
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.hand import variable_of
from palpate.models.pushing.measurements import Step, measurement_and_finger, terms_of
from palpate.models.pushing.priors import ObjectPrior
from palpate.models.pushing.variables import CORNER_BIAS, TURN_OFFSET
from palpate.types.measurements import ContactCorner, OwnMeasurement, Turn


class PushingWindow(Window):
    """A window whose rows are beliefs about an object that is pushed or rests."""

    def __init__(self, graph: Graph, steps: NDArray[np.void], rows: NDArray[np.void], lag: int, drift: Array) -> None:
        """Take the first step (1, B) and the rows (B,), and the variances `drift` of changes in each step.

        These are of the numbers of the last step and the shared variables.
        """
        room = np.zeros(1, graph.compiled.records.work)
        contact_model = graph.contact_model
        given = Given(graph.settings, drift, contact_model.surfaces, contact_model.corners, room)
        super().__init__(graph.compiled, given, steps, rows, lag, graph.own)

    def belief(self) -> Belief:
        """Return the beliefs about the object at the last step."""
        values = self.rows["shared"][:, self._compiled.model.contact_size :].copy()
        return Belief(self.rows["object"].copy(), values, self.rows["covariance"].copy())

    def object_path(self) -> Array:
        """Return the object poses of all steps in the window, (B, N, 3)."""
        steps = self._steps.swapaxes(0, 1)
        return se2.compose(steps["e"], se2.inverse(steps["g"]))


class ContactWindow(PushingWindow):
    """The graph of one contact over its last steps, in B hypotheses."""

    def __init__(
        self,
        graph: Graph,
        belief: Belief,
        step: Step,
        lag: int = LAG,
        prior: ObjectPrior | None = None,
        sign: Array | None = None,
    ) -> None:
        """Begin with the first step of a contact and B beliefs about the object.

        `sign` (B,) is -1 in hypotheses that take touch images as mirrored. The object's variables change from step to
        step as `prior` says, by default not at all.
        """
        sign = np.ones(len(belief)) if sign is None else sign
        steps, rows = first_step(graph.compiled, belief, step.sensor_pose, sign)
        _put_sunk_and_fingers(steps[0], rows, step)
        model = graph.compiled.model
        drift = np.zeros(model.last_size)
        if prior is not None:
            drift[model.last_size - model.object_size :] = prior.change_per_step
        super().__init__(graph, steps, rows, lag, drift)
        self._contact_model = graph.contact_model
        self._have_turns: set[int] = set()  # fingers, 0 of a single sensor
        self._have_touched: set[int] = set()  # fingers, in this contact of the object
        if step.fingers is not None:
            self._note_touching(step.fingers.touches)
        self._solve_with(step, *terms_of(graph.compiled, step, 0))

    def add(self, step: Step, spread: ArrayLike = 0.0) -> None:
        """Add the next step.

        `spread` (B,) [m] is the standard deviation of the slide over the sensor by which something else may move the
        object in this step. Raises EstimationError where no hypothesis has a solution.
        """
        arrived, own = terms_of(self._compiled, step, self._left + self._count)  # may raise
        if step.fingers is not None:
            self._begin_contacts_anew(step.fingers.touches)
        now = self._next_step()
        now["e"] = step.sensor_pose
        now["measured"] = step.sensor_pose
        now["spread"] = spread
        _put_sunk_and_fingers(now, self.rows, step)
        self._compiled.begin_step(self._steps)
        self._solve_with(step, arrived, own)

    def _solve_with(self, step: Step, arrived: Array, own: list[tuple[int, OwnMeasurement]]) -> None:
        """Take the terms and own measurements that arrive with the last step, and solve."""
        self._join(arrived, own, step.times[-1])
        self._begin_turns(step)
        self._solve(np.full(len(self.rows), RECENT))

    def _begin_turns(self, step: Step) -> None:
        """Let the first turn of a contact determine the offset of its turns."""
        for index, given in enumerate(step.measurements):
            measurement, finger = measurement_and_finger(given)
            if isinstance(measurement, Turn) and finger not in self._have_turns:
                self._have_turns.add(finger)
                self._begin_turn(measurement.angle, finger, index < step.from_touch)

    def _begin_turn(self, angle: float, finger: int, from_touch: bool) -> None:
        """Set the offset of turns with which a measured one fits the last step.

        Far from the true offset, the robust kernel would leave a turn hardly any weight.
        """
        model = self._compiled.model
        sign = self.rows["sign"] if from_touch else 1.0
        yaw = self._steps["g"][-1, :, 2]
        if model.fingers:
            yaw = yaw + self._steps["finger"][-1, :, finger, 2]
        offset = se2.wrap(yaw - angle * sign)
        self.rows["shared"][:, model.in_shared[variable_of(TURN_OFFSET, finger)]] = offset[:, None]

    def _note_touching(self, touches: Flags) -> None:
        """Remember the fingers that touch, by their flags (N,)."""
        self._have_touched.update(np.flatnonzero(touches).tolist())

    def _begin_contacts_anew(self, touches: Flags) -> None:
        """Let fingers that touch again, while others held on, begin a contact of their own.

        What the contact before has told of its variables is forgotten.
        """
        begin = touches & (self._steps["touches"][-1, 0] < 0.5)
        for finger in np.flatnonzero(begin).tolist():
            if finger in self._have_touched:
                self._forget_contact(finger)
        self._note_touching(touches)

    def _forget_contact(self, finger: int) -> None:
        """Drop the terms that hang on the variables of a finger's contact, and what older steps say of these."""
        model = self._compiled.model
        kinds = [model.factors_by_measurement[kind, finger] for kind in (Turn, ContactCorner)]
        self._terms = self._terms[~np.isin(self._terms[:, 1], kinds)]
        forgotten = [variable_of(variable, finger) for variable in (TURN_OFFSET, CORNER_BIAS)]
        for past in self.rows["past"]:
            for variable in forgotten:
                _forget(past, model.step_size, model.in_shared[variable].start, variable)
        self._have_turns.discard(finger)

    def disturb(self, rows: Indices, steps: int, slide: Array, spread: float) -> None:
        """Let something else have moved the object in the last steps, in some rows; rows without a solution are lost.

        `slide` (len(rows),) is the slide of the object over the sensor in all these steps, counter-clockwise along the
        outline, and `spread` its standard deviation, both [m].
        """
        last = self._count
        first = max(last - steps, 1)
        count = max(last - first, 1)
        slide_of_step = slide / count
        disturbed = self._steps[first:, rows]
        disturbed["slide"] = slide_of_step
        disturbed["spread"] = spread / math.sqrt(count)
        disturbed["cost"][..., 2] = 1.0
        # Seen from the object, the sensor moves the other way.
        back = -slide_of_step * np.arange(1.0, last - first + 1)[:, None]
        disturbed["g"] = self._moved_along(disturbed, back)
        self._steps[first:, rows] = disturbed
        recent = np.zeros(len(self.rows), np.int64)
        recent[rows] = self._count  # all, as costs from before these changes would not count rightly
        self._solve(recent)

    def _moved_along(self, steps: NDArray[np.void], lengths: Array) -> Array:
        """Return the sensor poses g (N, K, 3) of some steps moved along the outline by lengths (N, K) [m].

        A hand moves with its first finger that touches at the last of these steps.
        """
        model = self._contact_model
        g = steps["g"].reshape(-1, 3)
        if not model.fingers:
            return model.moved_along(g, lengths.ravel()).reshape(steps["g"].shape)
        finger = int(np.argmax(steps["touches"][-1, 0]))
        mount = steps["finger"][:, :, finger].reshape(-1, 3)
        moved = model.fingers[finger].moved_along(se2.compose(g, mount), lengths.ravel())
        return se2.compose(moved, se2.inverse(mount)).reshape(steps["g"].shape)


def _put_sunk_and_fingers(now: NDArray[np.void], rows: NDArray[np.void], step: Step) -> None:
    """Write to a new step (B,) what the sensor or the fingers of a hand bring besides their pose."""
    if step.fingers is None:
        now["sunk"] = step.sunk
        return
    now["sunk"] = step.fingers.sunk
    now["touches"] = step.fingers.touches
    mounts = step.fingers.mounts_in(rows["sign"])
    now["finger"] = mounts
    now["turn_finger"] = np.exp(1j * mounts[..., 2])


def _forget(past: np.void, first: int, place: int, variable: Variable) -> None:
    """Marginalise the number at a place of a Gaussian on the past and give it the variable's prior.

    Shared variables begin at the column `first`.
    """
    information = past["information"]
    gradient = past["gradient"]
    mean, deviation = variable.prior
    at = first + place
    known = information[at, at]
    if known > 0.0:
        row = information[at].copy()
        gradient -= row * (gradient[at] / known)
        information -= np.outer(row, row) / known
    information[at] = 0.0
    information[:, at] = 0.0
    information[at, at] = deviation**-2.0
    gradient[at] = (mean - past["shared"][place]) / deviation**2


def first_step(
    compiled: CompiledModel, belief: Belief, sensor_pose: Array, sign: Array
) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the first step (1, B) of a window that begins with these beliefs, and its rows (B,).

    The sensor pose is (3,), or (B, 3).
    """
    model = compiled.model
    steps = np.zeros((1, len(belief)), compiled.records.step)
    rows = np.zeros(len(belief), compiled.records.row)
    steps["g"] = se2.between(belief.pose, sensor_pose)
    steps["e"] = sensor_pose
    steps["measured"] = sensor_pose
    steps["turn_measured"] = np.exp(1j * steps["measured"][..., 2])
    of_contact = model.of("contact")
    rows["shared"][:, : model.contact_size] = model.prior_mean(of_contact)
    rows["shared"][:, model.contact_size :] = belief.values
    rows["sign"] = sign
    past = rows["past"]
    for k, deviation in enumerate(model.prior_deviation(of_contact), start=model.step_size):
        past["information"][:, k, k] = deviation**-2.0
    past["g"] = steps["g"][0]
    past["e"] = steps["e"][0]
    past["shared"] = rows["shared"]
    rows["first_pose"] = belief.pose
    rows["first_turn"] = np.exp(1j * belief.pose[:, 2])
    rows["first_values"] = belief.values
    rows["first_root"] = _whitening(belief.covariance)
    return steps, rows


def _whitening(covariances: Array) -> Array:
    """Return inverse Cholesky roots (B, N, N); NaN, which leaves no solution, where there is none."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariances)), np.float64)
    except np.linalg.LinAlgError:
        if len(covariances) == 1:
            return np.full_like(covariances, np.nan)
        return np.concatenate([_whitening(covariance[None]) for covariance in covariances])
