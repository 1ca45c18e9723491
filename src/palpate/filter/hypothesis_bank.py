"""All hypotheses about one object, as rows of arrays; the best is the first row.

While nothing is doubtful there is one. Others are added, and the one in which nothing happened is kept,

- if touch and pushing contradict each other: something else may have moved the object (`disturbance_alarms`);
- if a contact begins with a rough belief: the sensor may have met the object at several places (`contact_hypotheses`);
- until it is known how touch images lie: turned by half a turn or mirrored, touch measures the other side of the tip,
  so each hypothesis has a twin that takes all of touch with the opposite sign, and weights decide.
"""

import logging
import math
from collections.abc import Sequence

import numpy as np

from palpate.arrays import Array
from palpate.config import AHEAD, BACK, HAND, LIKELY, MOST_YOUNG, SLIDES, UNDECIDED, TrackerSettings
from palpate.errors import EstimationError
from palpate.estimation.rows import Indices
from palpate.estimation.window import LAG
from palpate.filter.consistency import ConsistencyMonitor, disturbance_alarms
from palpate.filter.contact_hypotheses import contact_hypotheses, is_rough, is_round, outline_places
from palpate.filter.hypotheses import costs_of_contact, single, worth_keeping
from palpate.filter.rest import measured_at_rest
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.layout import IN_OBJECT
from palpate.models.pushing.measurements import Step, step_of, timely
from palpate.models.pushing.own_measurements import OwnMeasurements
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import GRIP
from palpate.models.pushing.window import Window
from palpate.types.estimate import REASONS, Answer, Estimate
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose

logger = logging.getLogger(__name__)

_MIRRORED = "touch fits the push only with images upside down or mirrored; confirm by --orientation 180 or mirrored"
_OPEN = "not yet known if touch images are upside down or mirrored; --orientation upright says that they are not"


class HypothesisBank:
    """Estimates the pose of one object from sensor poses and measurements, frame by frame."""

    def __init__(
        self,
        model: ContactModel,
        settings: TrackerSettings,
        first_pose: Array,
        first_covariance: Array,
        may_be_mirrored: bool = False,
    ) -> None:
        """Take the first world_T_object (3,) and its covariance (3, 3)."""
        self._model, self._settings, self._most = model, settings.noise, settings.hypotheses
        self._rate = settings.disturbance_rate
        self._factors = settings_record(settings.noise, model)
        self._lag = LAG if settings.smoother == "fixed-lag" else 2**62
        length, angle = settings.tolerance
        tolerance = (length, math.inf if is_round(model) else angle)  # a round object looks alike at every yaw
        self._monitor = ConsistencyMonitor(model, settings.noise, tolerance)
        self._own = OwnMeasurements()
        self._may_be_mirrored = may_be_mirrored and self._most > 1
        self.is_mirrored = False
        """True if touch images are taken as turned by half a turn or mirrored."""
        outline_places(model)  # computed now, not when a contact begins
        self.begin(first_pose, first_covariance)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with nothing known but the object's pose (3,) and its covariance (3, 3)."""
        priors = self._settings.priors
        joint = np.diag(np.concatenate([np.zeros(3), np.square(object_prior(priors).deviation)]))
        joint[:3, :3] = covariance
        belief = Belief(pose[None], object_prior(priors).mean[None], joint[None])
        self._rows = single(belief, sign=-1.0 if self.is_mirrored else 1.0)
        self._is_found = not is_rough(belief, self._model)[0]  # once there was one hypothesis that is sure
        self._sensor_pose: Array | None = None  # at the last frame
        self._touched: Array | None = None  # sensor pose at the last frame of contact
        self._is_indeterminate = False
        self._begin_rest()

    def _begin_rest(self) -> None:
        self._window: Window | None = None
        self._resting_since: float | None = None  # [s]
        self._times: Sequence[float] = []  # of the last frames of a contact [s]
        self._steps = 0  # of a contact

    @property
    def in_contact(self) -> bool:
        """True if the object is being touched."""
        return self._window is not None

    def clearance(self, sensor_pose: Array) -> tuple[float, float]:
        """Return the distance of a sensor pose (3,) from the object and its standard deviation [m]."""
        gap, deviation = self._monitor.clearance(self._rows.belief, sensor_pose)
        return float(gap[0]), float(deviation[0])

    def report(self, time: float, hidden_motion: float = 0.0) -> Estimate:
        """Return the estimate at a time [s]; since the last frame the sensor may have moved by `hidden_motion` [m]."""
        window, rows, grip = self._window, self._rows, IN_OBJECT[GRIP].start
        belief = rows.belief
        covariance, covariances, status, reason = self._monitor.assessed(rows, window is not None)
        if self._is_indeterminate and status != "ambiguous":
            status = "indeterminate"
        if hidden_motion:
            covariance = covariance + self._monitor.covariance_of_motion(hidden_motion)
        is_open = bool((rows.sign != rows.sign[0]).any())
        every = zip(belief.pose.copy(), covariances.copy(), rows.weight.tolist(), strict=True)
        friction, spread = math.exp(belief.values[0, grip]), math.sqrt(belief.covariance[0, 3 + grip, 3 + grip])
        point = normal = None
        if window is not None:
            touch, (x, y, theta) = window.last(0)["touch"], belief.pose[0].tolist()
            turn = complex(math.cos(theta), math.sin(theta))
            both = complex(x, y) + turn * touch["point"], turn * touch["normal"] / abs(touch["normal"])
            point, normal = np.array(both).view(np.float64).reshape(2, 2)
        return Estimate(
            time=time,
            pose=belief.pose[0].copy(),
            covariance=covariance,
            contact=window is not None,
            status=status,
            reason=reason or REASONS[status] or (_MIRRORED if self.is_mirrored else _OPEN if is_open else ""),
            answers=tuple(Answer(*each) for each in every if each[2]),
            friction=(friction, friction * spread),
            contact_point=point,
            contact_normal=normal,
            innovations=None if window is None else window.rows["innovations"][0].copy(),
        )

    def rest_step(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame in which nothing touches the object: it stays where it is, unless measurements say otherwise.

        Raises EstimationError, with nothing changed, if measurements leave no solution.
        """
        since = time if self._resting_since is None else self._resting_since
        if measurements:
            times = since, time
            self._rows, is_found = measured_at_rest(
                self._rows, measurements, times, self._monitor, self._own, self._factors, self._model
            )
            self._touched = None if is_found else self._touched
        touched = sensor_pose if self._touched is None else self._touched
        self._monitor.test_rest(self._rows, sensor_pose, touched)
        self._sensor_pose, self._resting_since, self._is_indeterminate = sensor_pose, since, False

    def contact_step(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, from_touch: int = 0
    ) -> None:
        """Take a frame of contact, whose first `from_touch` measurements are read from touch images.

        If the graph has no solution, another one begins with this frame from the best last pose. Raises EstimationError
        if a graph has none at its first frame; the next frame then begins another.
        """
        times = [*self._times, time]
        step = Step(sensor_pose, timely(measurements, times), from_touch, times)
        before = self._window
        try:
            window, is_measured = self._begin_contact(step) if before is None else self._continue_contact(step, before)
        except EstimationError as error:
            reason = (
                f"frame at {time:.3f} s: {error}; the likely reason is a motion that pushing, contact and touch "
                "together leave undetermined, or a sensor pose far from the object"
            )
            self._window = None
            if before is None:
                raise EstimationError(reason) from error
            logger.warning("%s; starting a new graph from the last pose", reason)
            self._abandon_contact(sensor_pose)
            self.contact_step(sensor_pose, measurements, time, from_touch)
            return
        rows = self._rows
        rows.belief = window.belief()
        rows.disturbed_steps_left = np.maximum(rows.disturbed_steps_left - 1, 0)
        if is_measured or rows.apart.any():
            self._monitor.test_outline(rows, sensor_pose, is_measured)
        self._times, self._steps = step.times[-LAG:], self._steps + 1
        self._sensor_pose = self._touched = sensor_pose
        if self._most > 1:
            self._branch_at_alarms(window)
            self._reweight_and_prune(window)

    def end_contact(self, moved: float = 0.0) -> None:
        """The sensor released the object, which something else may have moved meanwhile by this much [m]."""
        if self._window is None:
            return
        rows, self._is_indeterminate = self._rows, False
        moved_by = np.where(rows.disturbed_steps_left > 0, max(moved, HAND), moved)
        belief = rows.belief.at_next_contact(object_prior(self._settings.priors))
        rows.log_prior = rows.log_prior - costs_of_contact(self._window.costs())
        rows.belief = belief.inflated(self._monitor.covariance_of_motion(moved_by))
        rows.displacement = np.zeros_like(rows.displacement)
        rows.disturbed_steps_left = rows.next_alarm = np.zeros_like(rows.next_alarm)
        self._begin_rest()

    def _abandon_contact(self, sensor_pose: Array) -> None:
        """Keep the best hypothesis of a graph that has no solution any more."""
        self._take([0])
        rows, before = self._rows, sensor_pose if self._sensor_pose is None else self._sensor_pose
        pushed = self._monitor.covariance_of_motion(float(np.hypot(*(sensor_pose - before)[:2])))
        rows.belief, rows.weight = rows.belief.inflated(pushed), np.ones(1)
        rows.disturbed_steps_left = rows.next_alarm = np.zeros_like(rows.next_alarm)
        self._begin_rest()
        self._is_indeterminate = True

    def _begin_contact(self, step: Step) -> tuple[Window, bool]:
        """Take the first frame of a contact in all hypotheses with which it may begin.

        Returns the window, and True if poses of the object were measured, and tests them, as `_continue_contact` does.
        """
        touch = step.measurements[: step.from_touch]
        is_measured = any(isinstance(one, ContactDirection) for one in touch)
        if self._may_be_mirrored and is_measured and (self._rows.sign > 0.0).all():
            count = len(self._rows.weight)
            self._take(np.tile(np.arange(count), 2))
            self._rows.sign = np.repeat([1.0, -1.0], count)
        rows = self._rows
        self._monitor.test_first_contact(rows, step.sensor_pose)
        rest = rows.belief.inflated(np.diag(np.square(self._settings.first_pose.rest)))
        doubt = self._monitor.displacement_covariance(rows) + self._monitor.contradiction_covariance(rows)
        if self._most == 1:
            rows.belief = rest.inflated(doubt)
        else:
            displaced = rest.inflated(doubt)
            rows, origins = contact_hypotheses(rows, rest, displaced, self._is_found, self._model, step)
            self._take(origins)
            self._rows = rows
        is_measured = any(isinstance(one, ObjectPose) for one in step.measurements)
        rows.hold_out_yaw(is_observable=is_measured or not is_round(self._model))
        known = self._factors, self._model, rows.belief
        self._window = window = Window(*known, step, self._lag, self._settings.priors, rows.sign, self._own)
        self._take(~window.rows["is_lost"])
        return window, self._test_object_poses(step, self._rows.belief.pose[:, None])

    def _continue_contact(self, step: Step, window: Window) -> tuple[Window, bool]:
        """Take the next frame of a contact in all hypotheses; see `_begin_contact`."""
        is_measured = self._test_object_poses(step, window.object_path())
        spread = np.where(self._rows.disturbed_steps_left > 0, HAND / math.sqrt(BACK), 0.0)
        window.add(step, spread)
        self._take(~window.rows["is_lost"])
        self._is_indeterminate = False
        return window, is_measured

    def _test_object_poses(self, step: Step, path: Array) -> bool:
        """Test measured poses of the object against the poses (B, N, 3) before this step; True if there are any."""
        measured = [one for one in step.measurements if isinstance(one, ObjectPose)]
        if measured:
            expected = [path[:, min(step_of(one, step.times), -1)] for one in measured]
            moved = np.zeros(2) if self._sensor_pose is None else (step.sensor_pose - self._sensor_pose)[:2]
            self._monitor.test_object_poses(self._rows, expected, measured, math.hypot(*moved))
        return bool(measured)

    def _branch_at_alarms(self, window: Window) -> None:
        """Add hypotheses that something else moved the object, sliding it by several lengths.

        They are added to the likeliest one that has a new alarm, and to the likeliest that takes images the other way.
        """
        rows, count = self._rows, len(self._rows.weight)
        # A contradiction of the less likely way to read images speaks against it, not for a disturbance.
        is_watched = (rows.weight > LIKELY) & (rows.sign == rows.sign[0])
        is_watched &= (rows.disturbed_steps_left == 0) & (self._steps >= rows.next_alarm)
        alarmed = np.flatnonzero(is_watched & disturbance_alarms(window)).tolist()
        if not alarmed:
            return
        twin = np.flatnonzero((rows.weight > LIKELY) & (rows.sign != rows.sign[0])).tolist()[:1]
        moved_rows, slides = [alarmed[0], *twin], np.tile(SLIDES, 1 + len(twin))
        new, steps = np.arange(count, count + len(slides)), self._steps - max(self._steps - BACK, 1)
        self._take([*range(count), *np.repeat(moved_rows, len(SLIDES))])
        window.disturb(new, steps, slides, HAND)
        rows, is_new = self._rows, np.arange(count + len(new)) >= count
        rows.belief = rows.belief.take(~is_new).joined(window.belief().take(new))
        meanwhile = self._times[-1] - self._times[-1 - steps]  # [s]
        rows.log_prior = rows.log_prior + is_new * math.log(self._rate * meanwhile / len(SLIDES))
        rows.weight = np.where(is_new, 1.0, rows.weight)
        rows.disturbed_steps_left[count:] = AHEAD
        rows.next_alarm[[*moved_rows, *new]] = self._steps + BACK + AHEAD
        self._take(~window.rows["is_lost"])

    def _reweight_and_prune(self, window: Window) -> None:
        """Weigh all hypotheses, sort them and drop those not worth keeping."""
        kept, weights, sign = np.zeros(1, np.int64), np.ones(1), self._rows.sign
        if len(self._rows.weight) > 1:
            most = self._most if self._is_found else max(self._most, MOST_YOUNG)
            kept, weights = worth_keeping(self._rows, window.costs(), self._settings.priors, most)
            self._take(kept)
        rows, is_single = self._rows, len(kept) == 1
        rows.weight, rows.log_prior = weights, np.zeros(1) if is_single else rows.log_prior
        window.count_all_costs(np.full(len(kept), is_single))
        if (sign != sign[0]).any():
            self._decide_mirrored()
        if is_single and not self._is_found:
            self._is_found = not is_rough(rows.belief, self._model)[0]

    def _decide_mirrored(self) -> None:
        """Decide if touch images are mirrored once hardly any weight is left of one of both answers."""
        rows, is_mirrored = self._rows, self._rows.sign < 0.0
        share = float(rows.weight[is_mirrored].sum())
        if UNDECIDED < share < 1.0 - UNDECIDED:
            return
        self._may_be_mirrored, self.is_mirrored = False, share > 0.5
        self._take(is_mirrored == self.is_mirrored)
        self._rows.weight = self._rows.weight / self._rows.weight.sum()
        if self.is_mirrored:
            logger.warning("frame at %.3f s: %s", self._times[-1], _MIRRORED)

    def _take(self, rows: Indices) -> None:
        """Keep these hypotheses, in this order; one may be taken several times."""
        places = np.arange(len(self._rows.weight))[rows]
        if np.array_equal(places, np.arange(len(self._rows.weight))):
            return
        self._rows = self._rows.take(places)
        if self._window is not None:
            self._window.take(places)
