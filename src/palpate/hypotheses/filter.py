"""Multi-hypothesis filter: the pose of one object from sensor poses and measurements, frame by frame.

While nothing is doubtful there is one hypothesis. At an event, a proposal adds others (`proposals/`), and the one in
which nothing happened is kept. One window solves them all, the weigher compares them, and the reducer merges and drops.
"""

import logging
import math
from collections.abc import Sequence

import numpy as np

from palpate.arrays import Array, changed
from palpate.config import Priors, TrackerSettings
from palpate.errors import EstimationError, SettingError
from palpate.estimation.compiled_model import CompiledModel
from palpate.estimation.window import LAG
from palpate.geometry import se2
from palpate.hypotheses.bank import Hypotheses, HypothesisBank, single_hypothesis
from palpate.hypotheses.consistency import ConsistencyMonitor, Tip
from palpate.hypotheses.outline_places import is_round, outline_places
from palpate.hypotheses.posterior import Circumstances, Posterior, Tolerance, Touching, posterior_of
from palpate.hypotheses.proposals.contact_places import is_rough, most_of_rough_start
from palpate.hypotheses.proposals.first_contact import propose_first_contact
from palpate.hypotheses.proposals.mirrored import decide_mirrored, propose_mirrored, takes_images_as
from palpate.hypotheses.proposals.rough_start import propose_rough_start
from palpate.hypotheses.proposals.shove import (
    SHOVE_SIGMA,
    STEPS_BEFORE_ALARM,
    disturbance_alarms,
    propose_shove,
    shoved,
)
from palpate.hypotheses.reducer import reduced
from palpate.hypotheses.rest import measured_at_rest
from palpate.hypotheses.weigher import Weigher, cost_of_contact
from palpate.models.pushing.belief import Belief, clearances
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.measurements import Fingers, OfFinger, Step, step_of, timely
from palpate.models.pushing.own_measurements import OwnMeasurements
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.window import ContactWindow
from palpate.status import EXCHANGED
from palpate.types.estimate import Clearance
from palpate.types.measurements import ContactDirection, Frame, Measurement, ObjectPose

logger = logging.getLogger(__name__)

_UNLIMITED_LAG = 2**62


class MultiHypothesisFilter:
    """Estimates the pose of one object: `step` takes a frame and returns the posterior."""

    def __init__(
        self,
        model: ContactModel,
        settings: TrackerSettings,
        first_pose: Array,
        first_covariance: Array,
        may_be_mirrored: bool = False,
        compiled: CompiledModel = PUSHING,
        priors_of_fingers: tuple[Priors, ...] = (),
    ) -> None:
        """Take the first world_T_object (3,) and its covariance (3, 3).

        `compiled` are the variables and factors of pushing, or those of an extended model. `priors_of_fingers` are
        those of the fingers of a hand; then `may_be_mirrored` asks if two fingers may be exchanged.
        """
        self._contact_model = model
        self._settings = settings.noise
        self._most = settings.hypotheses
        self._disturbance_rate = settings.disturbance_rate  # [1/s]
        self._compiled = compiled
        self._prior = object_prior(settings.noise.priors, compiled.model, priors_of_fingers)
        self._settings_record = settings_record(settings.noise, model)
        self._lag = LAG if settings.smoother == "fixed-lag" else _UNLIMITED_LAG
        length, angle = settings.tolerance
        self._tolerance = Tolerance(length, math.inf if is_round(model) else angle)
        self._monitor = ConsistencyMonitor(model, settings.noise, self._prior)
        self._weigher = Weigher(self._prior)
        self._own = OwnMeasurements(model=compiled.model)
        self._graph = Graph(self._settings_record, model, self._own, compiled)
        # Places of a hand with its fingers as stated must not crowd out those with its fingers exchanged.
        self._most_unfound = most_of_rough_start(model) * (2 if model.fingers else 1)
        self._may_be_mirrored = may_be_mirrored and self._most > 1
        self.is_mirrored = False
        """True if touch images are taken as turned by half a turn or mirrored, of a hand as of exchanged fingers."""
        for tip in model.fingers or (model,):
            outline_places(tip)  # computed now, not when a contact begins
        self.begin(first_pose, first_covariance)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with nothing known but the object's pose (3,) and its covariance (3, 3)."""
        joint = np.diag(np.concatenate([np.zeros(3), np.square(self._prior.deviation)]))
        joint[:3, :3] = covariance
        belief = Belief(pose[None], self._prior.mean[None], joint[None])
        self._bank = HypothesisBank(single_hypothesis(belief, touch_sign=-1.0 if self.is_mirrored else 1.0))
        # The object is found once there was one hypothesis that is sure.
        self._is_found = not is_rough(belief, self._contact_model)[0]
        self._sensor_pose: Array | None = None  # at the last frame
        self._fingers: Fingers | None = None  # of a hand, at the last frame
        self._touched: tuple[Array, Fingers | None] | None = None  # pose and fingers at the last frame of contact
        self._has_begun_anew = False
        self._begin_rest()

    def _begin_rest(self) -> None:
        self._bank.window = None
        self._resting_since: float | None = None  # [s]
        self._times: Sequence[float] = []  # of the last frames of a contact [s]
        self._steps = 0  # of a contact

    def clearance(self, sensor_pose: Array, finger: int = 0) -> Clearance:
        """Return the predicted distance of a sensor, or a finger of a hand, at a pose (3,) from the object."""
        gap, deviation = self._monitor.clearance(self._bank.rows.belief, Tip(self._model_of(finger), sensor_pose))
        return Clearance(float(gap[0]), float(deviation[0]))

    def withdrawal(self, sensor_pose: Array, finger: int = 0) -> float:
        """Return the motion of a sensor or finger out of the object since the last frame, if the object rests [m]."""
        before = self._sensor_pose
        if before is None:
            return 0.0
        if self._fingers is not None:
            before = se2.compose(before, self._fingers.mounts[finger])
        gap, _ = clearances(self._bank.rows.belief, self._model_of(finger), np.stack([before, sensor_pose]))
        return float(gap[0, 1] - gap[0, 0])

    def _model_of(self, finger: int) -> ContactModel:
        """Return the contact model of the sensor, or of a finger of a hand."""
        return self._contact_model.fingers[finger] if self._contact_model.fingers else self._contact_model

    def _tips(self, rows: Hypotheses, sensor_pose: Array, fingers: Fingers | None) -> list[Tip]:
        """Return the sensor, or the fingers of a hand, at their poses in the hypotheses."""
        if fingers is None:
            return [Tip(self._contact_model, sensor_pose)]
        poses = se2.compose(sensor_pose, fingers.mounts_in(rows.touch_sign))
        return [Tip(model, poses[:, number]) for number, model in enumerate(self._contact_model.fingers)]

    def _touching_tips(self, rows: Hypotheses, step: Step) -> list[Tip]:
        """Return the sensor, or the fingers of a hand that touch, at their poses in the hypotheses."""
        tips = self._tips(rows, step.sensor_pose, step.fingers)
        return tips if step.fingers is None else [tips[k] for k in np.flatnonzero(step.fingers.touches)]

    def variable(self, name: str) -> tuple[Array, Array]:
        """Return mean and standard deviation, (D,) each, of a variable of the object in the best hypothesis.

        Raises SettingError if there is none of this name.
        """
        belief = self._bank.rows.belief
        places = {variable.name: place for variable, place in self._compiled.model.in_object.items()}
        if name not in places:
            raise SettingError(f"variable {name!r} is none of the object; known are {', '.join(places)}")
        variances = belief.covariance[0].diagonal()[3:]
        return belief.values[0, places[name]].copy(), np.sqrt(variances[places[name]])

    def step(
        self,
        frame: Frame,
        from_touch: Sequence[Measurement] = (),
        hidden_motion: float = 0.0,
        sunk: float = 0.0,
        fingers: Fingers | None = None,
        of_fingers: Sequence[OfFinger] = (),
    ) -> Posterior:
        """Take a frame, with measurements that were read from touch images, which may be mirrored.

        Since the last frame the sensor may have moved by `hidden_motion` [m]; its tip has `sunk` in by so much [m]
        more than usual. A frame of a hand comes with its `fingers`, and measurements `of_fingers` that their images
        show. Raises EstimationError if measurements at rest leave no solution, with nothing changed, or if a
        contact has none at its first frame: the next frame then begins another.
        """
        if frame.contact:
            every = [*from_touch, *of_fingers, *frame.measurements]
            self._contact_step(Step(frame.sensor_pose, every, len(from_touch), (frame.time,), sunk, fingers))
        else:
            self._rest_step(frame.sensor_pose, frame.measurements, frame.time, fingers)
        circumstances = Circumstances(hidden_motion, self._has_begun_anew, self.is_mirrored, fingers is not None)
        return posterior_of(self._bank.rows, self._touching(), self._monitor, self._tolerance, circumstances)

    def end_contact(self, moved: float = 0.0) -> None:
        """Take the object as released; something else may have moved it meanwhile by this much [m]."""
        window = self._bank.window
        if window is None:
            return
        rows = self._bank.rows
        moved_by = np.where(rows.disturbed_steps_left > 0, max(moved, SHOVE_SIGMA), moved)
        belief = rows.belief.at_next_contact(self._prior)
        self._bank.rows = changed(
            rows,
            belief=belief.inflated(self._monitor.covariance_of_motion(moved_by)),
            log_prior=rows.log_prior - cost_of_contact(window.costs()),
            displacement=np.zeros(len(rows)),
            disturbed_steps_left=np.zeros(len(rows), np.int64),
            next_alarm=np.zeros(len(rows), np.int64),
        )
        self._has_begun_anew = False
        self._begin_rest()

    def _touching(self) -> Touching | None:
        """Return the contact of the best hypothesis."""
        window = self._bank.window
        if window is None:
            return None
        touch = window.last(0)["touch"]
        return Touching(complex(touch["point"]), complex(touch["normal"]), window.rows["innovations"][0].copy())

    def _rest_step(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, fingers: Fingers | None
    ) -> None:
        """Take a frame in which nothing touches the object: it stays where it is, unless measurements say otherwise."""
        since = time if self._resting_since is None else self._resting_since
        rows = self._bank.rows
        if measurements:
            measured = measured_at_rest(rows, measurements, (since, time), self._monitor, self._graph)
            rows = measured.rows
            if measured.measures_pose:  # the object may be elsewhere, where the last contact tests nothing
                self._touched = None
        self._bank.rows = self._tested_at_rest(rows, sensor_pose, fingers)
        self._sensor_pose = sensor_pose
        self._fingers = fingers
        self._resting_since = since
        self._has_begun_anew = False

    def _tested_at_rest(self, rows: Hypotheses, sensor_pose: Array, fingers: Fingers | None) -> Hypotheses:
        """Return the hypotheses with the tests that what touches nothing is outside the object."""
        touched_pose, touched_by = (sensor_pose, fingers) if self._touched is None else self._touched
        tips = self._tips(rows, sensor_pose, fingers)
        before = self._tips(rows, touched_pose, touched_by)
        has_touched = [True] if touched_by is None else touched_by.touches.tolist()
        for tip, last, touched in zip(tips, before, has_touched, strict=True):
            rows = self._monitor.test_rest(rows, tip, last.pose) if touched else self._monitor.test_outside(rows, tip)
        return rows

    def _contact_step(self, given: Step) -> None:
        """Take a frame of contact, whose first `from_touch` measurements are read from touch images.

        If the graph has no solution, another one begins with this frame from the best last pose.
        """
        time = given.times[-1]
        times = [*self._times, time]
        step = changed(given, measurements=timely(given.measurements, times), times=times)
        window = self._bank.window
        try:
            measures_pose = self._begin_contact(step) if window is None else self._continue_contact(step, window)
        except EstimationError as error:
            reason = (
                f"frame at {time:.3f} s: {error}; the likely reason is a motion that pushing, contact and touch "
                "together leave undetermined, or a sensor pose far from the object"
            )
            self._bank.window = None
            if window is None:
                raise EstimationError(reason) from error
            logger.warning("%s; starting a new graph from the last pose", reason)
            self._abandon_contact(step.sensor_pose)
            self._contact_step(given)
            return
        assert self._bank.window is not None
        self._after_solution(step, self._bank.window, measures_pose)

    def _begin_contact(self, step: Step) -> bool:
        """Take the first frame of a contact in all hypotheses with which it may begin, and test poses of the object.

        Returns True if any was measured.
        """
        bank = self._bank
        measures_pose = any(isinstance(one, ObjectPose) for one in step.measurements)
        if self._may_be_mirrored and _is_read_from_touch(step) and (bank.rows.touch_sign > 0.0).all():
            bank.rows = propose_mirrored(bank.rows)
        for tip in self._touching_tips(bank.rows, step):
            bank.rows = self._monitor.test_first_contact(bank.rows, tip)
        bank.rows = self._with_places(bank.rows, step)
        bank.rows = bank.rows.with_yaw_held_out(is_observable=measures_pose or not is_round(self._contact_model))
        self._begin_window(step)
        bank.drop_lost()
        if measures_pose:
            self._test_object_poses(step, bank.rows.belief.pose[:, None])
        return measures_pose

    def _begin_window(self, step: Step) -> None:
        """Begin the graph of a contact in all hypotheses."""
        rows = self._bank.rows
        self._bank.window = ContactWindow(self._graph, rows.belief, step, self._lag, self._prior, rows.touch_sign)

    def _with_places(self, rows: Hypotheses, step: Step) -> Hypotheses:
        """Return the hypotheses with the places of the outline at which this contact may have begun."""
        rest_covariance = np.diag(np.square(self._settings.first_pose.rest))
        rest = rows.belief.inflated(rest_covariance)
        doubt = self._monitor.displacement_covariance(rows) + self._monitor.contradiction_covariance(rows)
        displaced = rest.inflated(doubt)
        if self._most == 1:
            return changed(rows, belief=displaced)
        propose = propose_first_contact if self._is_found else propose_rough_start
        return propose(rows, rest, displaced, self._contact_model, step)

    def _continue_contact(self, step: Step, window: ContactWindow) -> bool:
        """Take the next frame of a contact in all hypotheses; see `_begin_contact`."""
        measures_pose = any(isinstance(one, ObjectPose) for one in step.measurements)
        if measures_pose:
            self._test_object_poses(step, window.object_path())
        disturbed_steps = self._bank.rows.disturbed_steps_left
        if np.count_nonzero(disturbed_steps):
            window.add(step, np.where(disturbed_steps > 0, SHOVE_SIGMA / math.sqrt(STEPS_BEFORE_ALARM), 0.0))
        else:
            window.add(step)
        self._bank.drop_lost()
        self._has_begun_anew = False
        return measures_pose

    def _after_solution(self, step: Step, window: ContactWindow, measures_pose: bool) -> None:
        """Take the solution of a step into the hypotheses, and propose, weigh and reduce them."""
        bank = self._bank
        bank.rows = changed(bank.rows, belief=window.belief())
        disturbed_steps = bank.rows.disturbed_steps_left
        if np.count_nonzero(disturbed_steps):
            bank.rows = changed(bank.rows, disturbed_steps_left=np.maximum(disturbed_steps - 1, 0))
        if measures_pose or np.count_nonzero(bank.rows.contradictions):
            touching = self._touching_tips(bank.rows, step)
            bank.rows = self._monitor.test_outline(bank.rows, touching, measures_pose)
        bank.rows = self._monitor.test_variables(bank.rows)
        self._times = step.times[-LAG:]
        self._steps += 1
        self._sensor_pose = step.sensor_pose
        self._fingers = step.fingers
        self._touched = (step.sensor_pose, step.fingers)
        if self._most > 1:
            self._branch_at_alarms(window)
            self._weigh_and_reduce(window)

    def _abandon_contact(self, sensor_pose: Array) -> None:
        """Keep the best hypothesis of a graph that has no solution any more."""
        self._bank.take([0])
        before = sensor_pose if self._sensor_pose is None else self._sensor_pose
        moved = float(np.hypot(*(sensor_pose - before)[:2]))
        rows = self._bank.rows
        self._bank.rows = changed(
            rows,
            belief=rows.belief.inflated(self._monitor.covariance_of_motion(moved)),
            weight=np.ones(1),
            disturbed_steps_left=np.zeros(1, np.int64),
            next_alarm=np.zeros(1, np.int64),
        )
        self._begin_rest()
        self._has_begun_anew = True

    def _test_object_poses(self, step: Step, path: Array) -> None:
        """Test measured poses of the object against the poses (B, N, 3) before this step."""
        measured = [one for one in step.measurements if isinstance(one, ObjectPose)]
        expected = [path[:, min(step_of(one, step.times), -1)] for one in measured]
        before = step.sensor_pose if self._sensor_pose is None else self._sensor_pose
        moved = math.hypot(*(step.sensor_pose - before)[:2])
        self._bank.rows = self._monitor.test_object_poses(self._bank.rows, expected, measured, moved)

    def _branch_at_alarms(self, window: ContactWindow) -> None:
        """Add hypotheses that something else moved the object, where touch and pushing contradict each other."""
        bank = self._bank
        shove = propose_shove(bank.rows, disturbance_alarms(window), self._steps)
        if shove is None:
            return
        count = len(bank)
        bank.take(shove.taken(count))
        disturbed_steps = self._steps - max(self._steps - STEPS_BEFORE_ALARM, 1)
        window.disturb(shove.added(count), disturbed_steps, shove.slides, SHOVE_SIGMA)
        duration = self._times[-1] - self._times[-1 - disturbed_steps]  # [s]
        expected_shoves = self._disturbance_rate * duration
        bank.rows = shoved(bank.rows, shove, window.belief(), self._steps, expected_shoves)
        bank.drop_lost()

    def _weigh_and_reduce(self, window: ContactWindow) -> None:
        """Weigh all hypotheses, sort them and drop those not worth keeping."""
        bank = self._bank
        has_mirrors = bank.rows.has_mirrors
        if len(bank) > 1:
            most = self._most if self._is_found else max(self._most, self._most_unfound)
            log_weights = self._weigher.log_weights(bank.rows, window.costs())
            kept, weights = reduced(bank.rows, log_weights, most, self._contact_model)
            bank.take(kept)
            bank.rows = changed(bank.rows, weight=weights)
        is_single = len(bank) == 1
        if is_single and not bank.rows.is_only_one:
            bank.rows = bank.rows.as_only_one()
        if is_single:
            window.count_all_costs()
        if has_mirrors:
            self._decide_mirrored()
        if is_single and not self._is_found:
            self._is_found = not is_rough(bank.rows.belief, self._contact_model)[0]

    def _decide_mirrored(self) -> None:
        """Decide if touch images are mirrored once hardly any weight is left for the other way to take them."""
        bank = self._bank
        is_mirrored = decide_mirrored(bank.rows)
        if is_mirrored is None:
            return
        self._may_be_mirrored = False
        self.is_mirrored = is_mirrored
        bank.take(takes_images_as(bank.rows, is_mirrored))
        bank.rows = changed(bank.rows, weight=bank.rows.weight / bank.rows.weight.sum())
        if is_mirrored and self._contact_model.fingers:
            logger.warning("frame at %.3f s: %s", self._times[-1], EXCHANGED)


def _is_read_from_touch(step: Step) -> bool:
    """Return True if a contact direction was read from touch images, of a hand any of its fingers' directions."""
    of_fingers = [one.measurement for one in step.measurements if isinstance(one, OfFinger)]
    return any(isinstance(one, ContactDirection) for one in (*step.measurements[: step.from_touch], *of_fingers))
