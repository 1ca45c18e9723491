"""All hypotheses about one object, as rows of arrays.

While nothing is doubtful there is one hypothesis. Others are added, and the one in which nothing happened is kept,

- if touch and pushing contradict each other: something else may have moved the object (`disturbance`);
- if a contact begins with a rough belief: the sensor may have met the object at several places (`contact_hypotheses`);
- until it is known how touch images lie: they may be mirrored (`mirrored_images`).

During a contact all hypotheses are rows of one `Window`. To branch, prune and reorder them is to take rows, of the
window and of all other arrays alike; the best hypothesis is the first row.
"""

import functools
import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings, SmootherName
from palpate.errors import EstimationError
from palpate.filter.answers import LIKELY, ambiguity_in_words, answers_of, is_ambiguous, joint_covariance
from palpate.filter.consistency import ConsistencyMonitor
from palpate.filter.contact_hypotheses import (
    LOG_UNLIKELY,
    MOST_YOUNG,
    FirstContact,
    contact_hypotheses,
    is_rough,
    is_round,
    outline_places,
)
from palpate.filter.disturbance import (
    AHEAD,
    BACK,
    SLIDES,
    SPREAD,
    STILL_GOING_ON,
    detects_disturbance,
    suspects_disturbance,
)
from palpate.filter.hypotheses import Hypotheses, costs_of_contact, worth_keeping
from palpate.filter.mirrored_images import MIRRORED, MirroredImages
from palpate.filter.paths import extended, no_paths, poses_of
from palpate.filter.rest import measured_at_rest
from palpate.graph.belief import Belief, Indices
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.factor import Step
from palpate.graph.variables import LAG
from palpate.graph.window import Window
from palpate.types.estimate import REASONS, Answer, Status
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

_OBSERVABLE_YAW = 0.05  # [rad] standard deviation of a round object's yaw that a graph may know of


class Report(NamedTuple):
    """Estimate of the object by all hypotheses."""

    pose: Array
    """Pose of the best hypothesis, (3,) [m, m, rad]."""
    covariance: Array
    """Covariance (3, 3) of all hypotheses about the best, tangent space at its pose (right, body frame)."""
    status: Status
    """Status of the estimate."""
    reason: str
    """Reason of the status in words; empty where all is well."""
    answers: tuple[Answer, ...]
    """All poses that may be the object's, the best first."""


class HypothesisBank:
    """Estimates the pose of one object from sensor poses and measurements, frame by frame."""

    def __init__(
        self,
        model: ContactModel,
        settings: NoiseSettings,
        smoother: SmootherName,
        first_pose: Array,
        first_covariance: Array,
        most: int = 9,
        may_be_mirrored: bool = False,
    ) -> None:
        """Take the first world_T_object (3,) and its covariance (3, 3), and the largest number of hypotheses."""
        self._model, self._settings, self._most = model, settings, most
        self._factors = make_factors(settings, model)
        self._lag = LAG if smoother == "fixed-lag" else 2**62
        self._monitor = ConsistencyMonitor(model, settings)
        self._images = MirroredImages(may_be_mirrored)
        outline_places(model)  # computed now, not when a contact begins
        self.begin(first_pose, first_covariance)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with nothing known but the object's pose (3,) and its covariance (3, 3)."""
        priors = self._settings.priors
        joint = np.diag(np.concatenate([np.zeros(3), np.square(priors.deviation)]))
        joint[:3, :3] = covariance
        belief = Belief(pose[None], priors.mean[None], joint[None])
        self._rows = Hypotheses.one(belief, sign=-1.0 if self._images.is_mirrored else 1.0)
        self._is_found = not is_rough(belief, self._model)  # once there was one hypothesis that is sure
        self._window: Window | None = None
        self._steps = 0  # of this contact
        self._times: list[float] = []  # of this contact's last frames [s]
        self._sensor_pose: Array | None = None  # at the last frame
        self._touched: tuple[Array, float] | None = None  # sensor pose and time [s] of the last frame of contact
        self._resting_since: float | None = None  # [s]
        self._is_indeterminate = False
        self._images.end_contact()

    @property
    def in_contact(self) -> bool:
        """True if the object is being touched."""
        return self._window is not None

    @property
    def belief(self) -> Belief:
        """Belief of the best hypothesis, one row."""
        return self._rows.belief.take([0])

    def report(self) -> Report:
        """Return the estimate at the last frame."""
        rows, monitor = self._rows, self._monitor
        rows = rows.take(~rows.is_mirror) if rows.is_mirror.any() else rows
        poses, weights, whole = rows.belief.pose, rows.weight, rows.whole_belief
        covariances = monitor.covariance(rows.consistency, whole)
        status: Status = monitor.status(rows.consistency, whole, covariances[0], self.in_contact)
        if not self.in_contact:
            covariances = covariances + monitor.displacement_covariance(rows.consistency)
        reason = rows.consistency.contradiction_in_words(0)
        if is_ambiguous(poses, covariances, weights):
            status = "ambiguous"
            reason = reason or ambiguity_in_words(poses, weights)
        elif self._is_indeterminate:
            status = "indeterminate"
        return Report(
            poses[0].copy(),
            joint_covariance(poses, covariances, weights),
            status,
            reason or REASONS[status],
            answers_of(poses, covariances, weights),
        )

    @property
    def mirrored_reason(self) -> str:
        """Sentence for users whose touch images are mirrored, else empty."""
        return MIRRORED if self._images.is_mirrored else ""

    @property
    def force_angle(self) -> float:
        """Angle of the pushing force from the outline's inward normal [rad], by the best hypothesis; NaN if unknown."""
        return self._window.force_angle(0) if self._window else math.nan

    @property
    def sensor_in_object(self) -> Array:
        """Sensor pose in the object frame (3,) in contact, by the best hypothesis."""
        assert self._window is not None
        return self._window.sensor_in_object[0]

    def clearance(self, sensor_pose: Array) -> tuple[float, float]:
        """Return the distance of a sensor pose (3,) from the object and its standard deviation [m]."""
        gap, deviation = self._monitor.clearance(self.belief, sensor_pose)
        return float(gap[0]), float(deviation[0])

    def covariance_of_motion(self, length: float) -> Array:
        """Return the covariance (3, 3) of an unknown motion of the object of this size [m]."""
        return self._monitor.covariance_of_motion(length)

    def path(self) -> Array:
        """Return the object poses at all frames so far (N, 3), by the best hypothesis."""
        settled = poses_of(self._rows.path[0])
        return np.concatenate([settled, self._window.object_path()[0]]) if self._window else settled

    def rest_step(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame in which nothing touches the object: it stays where it is, unless measurements say otherwise.

        Raises EstimationError, with nothing changed, if measurements leave no solution.
        """
        rows = self._measured_at_rest(measurements, time) if measurements else self._rows
        consistency = self._monitor.test_clearance(rows.consistency, rows.belief, sensor_pose)
        if self._touched is not None:
            touched_from, at = self._touched
            consistency = self._monitor.test_release(consistency, rows.belief, touched_from, sensor_pose, time - at)
        path = extended(rows.path, rows.belief.pose[:, None])
        self._rows = replace(rows, consistency=consistency, path=path)
        self._resting_since = time if self._resting_since is None else self._resting_since
        self._sensor_pose, self._is_indeterminate = sensor_pose, False

    def contact_step(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, from_touch: int = 0
    ) -> None:
        """Take a frame of contact, the first one or the next. Raises EstimationError if no hypothesis has a solution.

        The first `from_touch` measurements are read from touch images.
        """
        if self._window is None:
            self._begin_contact(FirstContact(sensor_pose, measurements, from_touch), time)
        else:
            self._decide_mirrored(time)
            self._continue_contact(sensor_pose, measurements, time, from_touch)
        self._is_indeterminate = False
        self._rows = replace(self._rows, age=self._rows.age + 1)
        self._steps += 1
        if self._most > 1:
            self._branch_at_alarms()
            self._reweight_and_prune()
        mirror = np.flatnonzero(self._rows.is_mirror)
        if len(mirror) and self._rows.consistency.is_displaced[mirror[0]]:
            self._take(~self._rows.is_mirror)

    def begin_anew(
        self,
        sensor_pose: Array,
        measurements: Sequence[Measurement],
        time: float,
        from_touch: int,
        error: EstimationError,
    ) -> None:
        """Go on with a new graph from the best last pose, if the old one had no solution.

        Raises EstimationError if this fails, too; the contact is then over.
        """
        reason = (
            f"frame at {time:.3f} s: {error}; the likely reason is a motion that pushing, contact and touch "
            "together leave undetermined, or a sensor pose far from the object"
        )
        logger.warning("%s; starting a new graph from the last pose", reason)
        left = poses_of(self._rows.online[0], min(self._steps, self._lag))
        self._window, self._steps, self._resting_since = None, 1, None
        rows = self._rows.take([0])
        before = sensor_pose if self._sensor_pose is None else self._sensor_pose
        pushed = float(np.hypot(*(sensor_pose - before)[:2]))
        anew = Hypotheses.one(rows.belief.inflated(self.covariance_of_motion(pushed)), float(rows.sign[0]))
        self._rows = replace(
            rows,
            belief=anew.belief,
            consistency=rows.consistency.without_errors(),
            log_prior=anew.log_prior,
            weight=anew.weight,
            age=anew.age,
            disturbed_steps_left=anew.disturbed_steps_left,
            next_alarm=anew.next_alarm,
            ignored_motion=np.zeros((1, 1), np.bool_),
            path=extended(rows.path, left[None]),
            online=anew.online,
        )
        try:
            self._window = self._new_window(self._rows, FirstContact(sensor_pose, measurements, from_touch), time)
        except EstimationError:
            raise EstimationError(reason) from error
        self._times = []
        self._update_belief(sensor_pose, time)
        self._is_indeterminate = True

    def end_contact(self, moved: float = 0.0) -> None:
        """The sensor released the object, which something else may have moved meanwhile by this much [m]."""
        if self._window is None:
            return
        self._take(~self._rows.is_mirror)
        if not (lost := self._rows.is_lost).all():
            self._take(~lost)
        rows = self._rows
        moved_by = np.where(rows.disturbed_steps_left > 0, max(moved, SPREAD), moved)
        belief = rows.belief.at_next_contact(self._settings.priors)
        self._rows = replace(
            rows,
            belief=belief.inflated(self._monitor.covariance_of_motion(moved_by)),
            consistency=rows.consistency.without_errors().found(),
            log_prior=rows.log_prior - costs_of_contact(rows, self._window.costs()),
            disturbed_steps_left=np.zeros_like(rows.age),
            next_alarm=np.zeros_like(rows.age),
            ignored_motion=np.zeros((len(rows), 0), np.bool_),
            path=extended(rows.path, self._window.object_path()),
            online=no_paths(len(rows)),
        )
        self._window = self._resting_since = None
        self._images.end_contact()

    # Steps of a contact

    def _begin_contact(self, contact: FirstContact, time: float) -> None:
        """Take the first frame of a contact in all hypotheses with which it may begin."""
        self._steps, self._times = 0, []
        rows = self._rows
        touch = contact.measurements[: contact.from_touch]
        is_sure = self._is_found and len(rows) == 1
        if self._images.is_open and is_sure and any(isinstance(one, ContactDirection) for one in touch):
            rows = rows.joined(replace(rows, sign=-rows.sign, is_mirror=~rows.is_mirror))
        consistency = self._monitor.test_first_contact(
            rows.consistency, rows.belief, contact.sensor_pose, contact.measurements, rows.sign, contact.from_touch
        )
        rows = replace(rows, consistency=consistency)
        rest = rows.belief.inflated(np.diag(np.square(self._settings.first_pose.rest)))
        displaced = rest.inflated(
            self._monitor.displacement_covariance(consistency) + self._monitor.contradiction_covariance(consistency)
        )
        if self._most == 1:
            rows = replace(rows, belief=displaced, ignored_motion=np.zeros((len(rows), 1), np.bool_))
        else:
            groups = [rows.is_mirror == mirror for mirror in (False, True)]
            begun = [_begun(rows, rest, displaced, each, self._is_found, self._model, contact) for each in groups]
            rows = begun[0] if not groups[1].any() else begun[0].joined(begun[1])
        self._rows = rows = self._without_unobservable_yaw(rows, contact.measurements)
        self._window = self._new_window(rows, contact, time)
        self._check_solved()
        self._drop_lost()
        self._test_and_update(contact.sensor_pose, contact.measurements, time)

    def _new_window(self, rows: Hypotheses, contact: FirstContact, time: float) -> Window:
        return Window(
            self._factors,
            self._model,
            rows.belief,
            contact.sensor_pose,
            contact.measurements,
            time,
            self._lag,
            self._settings.priors,
            rows.sign,
            contact.from_touch,
        )

    def _continue_contact(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, from_touch: int
    ) -> None:
        """Take the next frame of a contact in all hypotheses."""
        assert self._window is not None
        is_disturbed = self._rows.disturbed_steps_left > 0
        disturbance = np.where(is_disturbed[:, None], STILL_GOING_ON, 0.0)
        leaving = self._window.add(sensor_pose, measurements, time, disturbance, from_touch)
        self._check_solved()
        ignored = np.concatenate([self._rows.ignored_motion, is_disturbed[:, None]], axis=1)
        self._rows = replace(
            self._rows,
            disturbed_steps_left=self._rows.disturbed_steps_left - is_disturbed,
            ignored_motion=ignored[:, -self._window.steps_with_costs :],
            path=self._rows.path if leaving is None else extended(self._rows.path, leaving[:, None]),
        )
        tested = ~is_disturbed[~self._window.is_lost]
        self._drop_lost()
        self._test_and_update(sensor_pose, measurements, time, tested)

    def _test_and_update(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, tested: Flags | None = None
    ) -> None:
        """Run the consistency tests of a frame of contact, and take the window's beliefs."""
        rows, measured = self._rows, [one for one in measurements if isinstance(one, ObjectPose)]
        if measured:
            step = Step(sensor_pose, self._sensor_pose, measurements, [*self._times, time])
            measured = [one for one in measured if step.is_in_window(one)]
            recent = [poses_of(path, len(self._times)) for path in rows.online]
            expected = np.concatenate([np.stack(recent), rows.belief.pose[:, None]], axis=1)
            places = step.nearest(measured) - 1
            consistency = self._monitor.test_object_poses(
                rows.consistency, rows.belief, [expected[:, place] for place in places], measured, step.moved
            )
            self._rows = replace(rows, consistency=consistency)
        self._update_belief(sensor_pose, time, tested)
        rows = self._rows
        consistency = self._monitor.test_outline(rows.consistency, rows.belief, sensor_pose, bool(measured))
        self._rows, self._touched = replace(rows, consistency=consistency), (sensor_pose, time)

    def _update_belief(self, sensor_pose: Array, time: float, tested: Flags | None = None) -> None:
        """Take the window's beliefs, and test its errors in some rows, by default in all."""
        assert self._window is not None
        rows, belief, errors = self._rows, self._window.belief(), self._window.last_errors()
        consistency = rows.consistency
        if errors is not None:
            tested = np.ones(len(rows), np.bool_) if tested is None else tested
            consistency = self._monitor.test_innovations(consistency, errors, tested)
        online = extended(rows.online, belief.pose[:, None])
        self._rows = replace(rows, belief=belief, consistency=consistency, online=online)
        self._sensor_pose, self._times = sensor_pose, [*self._times, time][-LAG:]

    def _branch_at_alarms(self) -> None:
        """Add hypotheses in which something else moved the object, to the likeliest one that has a new alarm."""
        assert self._window is not None
        rows = self._rows
        is_watched = (rows.weight > LIKELY) & (rows.disturbed_steps_left == 0) & (self._steps >= rows.next_alarm)
        alarms = is_watched & suspects_disturbance(self._window, self._steps)
        for is_mirror in (True, False):
            group = np.flatnonzero(alarms & (self._rows.is_mirror[: len(alarms)] == is_mirror))
            if len(group):
                self._branch(int(group[0]))

    def _branch(self, row: int) -> None:
        """Add the hypotheses that something else moved the object, sliding it by several lengths, to one row."""
        assert self._window is not None
        before = len(self._rows)
        first = max(self._steps - BACK, 1)
        new = np.arange(before, before + len(SLIDES))
        self._take(np.concatenate([np.arange(before), np.full(len(SLIDES), row)]))
        self._window.disturb(new, self._steps - first, SLIDES, SPREAD)
        rows, belief = self._rows, self._window.belief()
        is_new = np.arange(len(rows)) >= before
        ignored = rows.ignored_motion.copy()
        ignored[before:, ignored.shape[1] - (self._steps - first) :] = True
        next_alarm = np.where(is_new, self._steps + BACK + AHEAD, rows.next_alarm)
        next_alarm[row] = self._steps + BACK + AHEAD
        self._rows = replace(
            rows,
            belief=rows.belief.take(~is_new).joined(belief.take(is_new)),
            consistency=replace(
                rows.consistency, squares=np.where(is_new[:, None, None], 0.0, rows.consistency.squares)
            ),
            log_prior=np.where(is_new, rows.log_prior - LOG_UNLIKELY, rows.log_prior),
            weight=np.where(is_new, 1.0, rows.weight),
            age=np.where(is_new, 0, rows.age),
            disturbed_steps_left=np.where(is_new, AHEAD, rows.disturbed_steps_left),
            next_alarm=next_alarm,
            ignored_motion=ignored,
        )
        self._drop_lost()
        mirror_last = np.argsort(self._rows.is_mirror, kind="stable")
        self._take(mirror_last)

    def _reweight_and_prune(self) -> None:
        """Weigh all hypotheses, sort them and drop those not worth keeping, in each group."""
        assert self._window is not None
        groups = [np.flatnonzero(self._rows.is_mirror == mirror) for mirror in (False, True)]
        order, weights = [], []
        for group in groups:
            if not len(group):
                continue
            is_sure = self._is_found or self._rows.is_mirror[group[0]]
            most = self._most if is_sure else max(self._most, MOST_YOUNG)
            costs = self._window.costs()[group]
            kept, weight = worth_keeping(self._rows.take(group), costs, self._settings.priors, most)
            order.append(group[kept])
            weights.append(weight)
        order = np.concatenate(order)
        if not np.array_equal(order, np.arange(len(self._rows))):
            self._take(order)
        is_single = np.array([len(group) == 1 for group in groups])[self._rows.is_mirror.astype(np.int64)]
        self._rows = replace(
            self._rows,
            weight=np.concatenate(weights),
            log_prior=np.where(is_single, 0.0, self._rows.log_prior),
            ignored_motion=self._rows.ignored_motion & ~is_single[:, None],
        )
        if is_single[0] and not self._is_found:
            self._is_found = not is_rough(self.belief, self._model)

    def _decide_mirrored(self, time: float) -> None:
        """Decide from the frames so far whether touch images are mirrored, and keep the right hypotheses."""
        rows, window = self._rows, self._window
        if not rows.is_mirror.any() or window is None:
            return
        detected, undisturbed = detects_disturbance(window, self._steps), rows.ignored_motion.sum(axis=1) == 0
        contradicted = []
        for mirror in (False, True):
            group = np.flatnonzero(rows.is_mirror == mirror)
            best = group[undisturbed[group]][:1]
            contradicted.append(bool(detected[best[0] if len(best) else group[0]]))
        is_sure = np.count_nonzero(rows.is_mirror) == 1
        self._images.decide((contradicted[0], contradicted[1]), is_sure, time)
        if self._images.is_open:
            return
        self._take(rows.is_mirror == self._images.is_mirrored)
        self._rows = replace(self._rows, is_mirror=np.zeros(len(self._rows), np.bool_))
        if self._images.is_mirrored:
            logger.warning("frame at %.3f s: %s", time, MIRRORED)

    # Rest

    def _measured_at_rest(self, measurements: Sequence[Measurement], time: float) -> Hypotheses:
        """Return the hypotheses that have a solution with measurements of the resting object."""
        monitor, since = self._monitor, time if self._resting_since is None else self._resting_since
        solved: list[Hypotheses] = []
        for row in range(len(self._rows)):
            rows = self._rows.take([row])
            whole, state = rows.whole_belief, rows.consistency
            prior = whole.inflated(monitor.displacement_covariance(state))
            doubted = prior.inflated(monitor.contradiction_covariance(state))
            given = measurements, self._factors, self._model, since, time
            try:
                belief, is_of_pose = measured_at_rest(whole, doubted, *given)
            except EstimationError:
                if row == len(self._rows) - 1 and not solved:
                    raise
                continue
            step = Step(prior.pose[0], None, measurements, [since, time], at_rest=True)
            measured = [one for one in measurements if isinstance(one, ObjectPose) and step.is_in_window(one)]
            state = monitor.test_object_poses(state, prior, [prior.pose] * len(measured), measured, moved=0.0)
            if is_of_pose:  # the object may have been found elsewhere
                state, self._touched = state.found(), None
            solved.append(replace(rows, belief=belief, unobservable_yaw=np.zeros(1), consistency=state))
        return functools.reduce(Hypotheses.joined, solved)

    def _without_unobservable_yaw(self, rows: Hypotheses, measurements: Sequence[Measurement]) -> Hypotheses:
        """Return hypotheses for the graph of a contact, with the large variance of a round object's yaw held out.

        The graph would otherwise learn yaw from its own linearisation errors.
        """
        whole = rows.whole_belief
        variance = whole.covariance[:, 2, 2]
        held_out = np.maximum(variance - _OBSERVABLE_YAW**2, 0.0)
        if any(isinstance(one, ObjectPose) for one in measurements) or not held_out.any() or not is_round(self._model):
            return replace(rows, belief=whole, unobservable_yaw=np.zeros(len(rows)))
        less = np.ones(whole.covariance.shape[:2])
        less[:, 2] = np.where(held_out > 0.0, _OBSERVABLE_YAW / np.sqrt(variance), 1.0)
        belief = replace(whole, covariance=whole.covariance * (less[:, :, None] * less[:, None, :]))
        return replace(rows, belief=belief, unobservable_yaw=held_out)

    # Rows

    def _take(self, rows: Indices) -> None:
        """Keep these hypotheses, in this order; one may be taken several times."""
        self._rows = self._rows.take(rows)
        if self._window is not None:
            self._window.take(rows)

    def _check_solved(self) -> None:
        """Raise EstimationError if no hypothesis with images as they are has a solution."""
        assert self._window is not None
        if self._window.is_lost[~self._rows.is_mirror].all():
            raise EstimationError("the linear system of the window is indeterminate")

    def _drop_lost(self) -> None:
        """Drop hypotheses without a solution."""
        assert self._window is not None
        if (lost := self._window.is_lost).any():
            self._take(~lost)


def _begun(
    rows: Hypotheses,
    rest: Belief,
    displaced: Belief,
    group: Flags,
    was_found: bool,
    model: ContactModel,
    contact: FirstContact,
) -> Hypotheses:
    """Return the hypotheses with which a contact begins, from those of a group (B,) before it."""
    rows, rest, displaced = rows.take(group), rest.take(group), displaced.take(group)
    if not len(rows):
        return rows
    is_displaced = rows.consistency.is_displaced
    begun = contact_hypotheses(rest, displaced, rows.log_prior, rows.sign, is_displaced, was_found, model, contact)
    taken = rows.take([one.row for one in begun])
    belief = begun[0].belief
    for one in begun[1:]:
        belief = belief.joined(one.belief)
    is_place, goes_on = (np.array([getattr(one, name) for one in begun]) for name in ("is_place", "goes_on"))
    return replace(
        taken,
        belief=belief,
        log_prior=np.array([one.log_prior for one in begun]),
        weight=np.where(goes_on, taken.weight, 1.0),
        age=np.where(goes_on, taken.age, 0),
        disturbed_steps_left=np.where(is_place, AHEAD, 0),
        next_alarm=np.zeros(len(begun), np.int64),
        ignored_motion=is_place[:, None],
    )
