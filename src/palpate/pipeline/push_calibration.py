"""Calibration of a robot by ordinary pushes without ground truth: one fit of the numbers that all pushes share.

Each push has a first pose, friction and path of its own. Its fit gives a Gaussian on the six shared numbers. All pushes
together give the product of these Gaussians, in which the prior, a part of each of them, counts only once.

Four of the numbers are variables of the graph. The other two are the sensor's offset along its y and the delay of the
images: each push is fitted at several values of both, and a quadratic through the costs, together with the changes of
the four variables, gives a Gaussian on all six. If a push finds another solution at one of these values, it tells
nothing about the two. A mounting error along x is part of the indentation, and one in yaw is part of the offset of
directions.
"""

import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Image
from palpate.config import NoiseSettings
from palpate.errors import EstimationError, FileError
from palpate.estimation.window import LAG
from palpate.files import in_file
from palpate.geometry import se2
from palpate.hypotheses.weigher import cost_of_contact
from palpate.io.recording import Recording
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import contact_model
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.layout import IN_OBJECT
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import DEPTH, DIRECTION_BIAS, DIRECTION_SCALE, OUTLINE_SCALE
from palpate.models.pushing.window import ContactWindow
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import first_pose_of_recording
from palpate.touch.background import first_frames
from palpate.touch.calibration import Calibration, DirectionCorrection, SetUp, mismatch
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.press_calibration import LEFT_OR_RIGHT
from palpate.touch.reader import TouchReader
from palpate.touch.touch_model import TouchModel
from palpate.tracker_arguments import Unit, noise_of_unit
from palpate.types.measurements import Measurement

logger = logging.getLogger(__name__)

FEWEST = 3
"""Least number of pushes that show if they belong together."""
NUMBERS = {
    "direction offset [deg]": 180.0 / math.pi,
    "direction scale [%]": 100.0,
    "depth [mm]": 1e3,
    "outline size [%]": 100.0,
    "sensor sideways [mm]": 1e3,
    "delay [ms]": 1e3,
}
"""The six numbers of the fit with their units for people; the first four are variables of the graph."""
_SHARED = (DIRECTION_BIAS, DIRECTION_SCALE, DEPTH, OUTLINE_SCALE)
_COLUMNS = [IN_OBJECT[variable].start for variable in _SHARED]
_MOUNTING_YAW_SIGMA = 0.0175  # [rad] standard deviation of the yaw of a mounting
_OUTLINE_SCALE_SIGMA = 0.015  # standard deviation of the size of outlines, as a share
_OUTSIDE = np.array([(0.0, 1e-3), (0.03, 0.05)])
"""Mean and standard deviation of the two numbers outside of the graph for a usual robot: sideways [m] and delay [s]."""
_GRID = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
"""Values of sideways and delay at which each push is fitted, from the means on, in steps."""
_LARGEST_MISFIT = 2.5  # more means that pushes are not of one robot
_ALL_STEPS = 2**62  # size of a window that keeps all steps of a contact


class _Fit(NamedTuple):
    """Fit of one push at one value of sideways and delay."""

    cost: float
    mean: Array
    """(4,) of the shared variables."""
    covariance: Array
    """(4, 4) of the shared variables."""


class _Expansion(NamedTuple):
    """Second-order expansion of the cost of one push in the six numbers."""

    at: Array
    """Numbers (6,) about which it is taken."""
    cost: float
    """Cost there."""
    slope: Array
    """(6,) of the cost."""
    curvature: Array
    """(6, 6) of the cost."""


class _Joint(NamedTuple):
    """Gaussian on the six numbers by all pushes and a prior."""

    mean: Array
    """(6,)"""
    covariance: Array
    """(6, 6)"""
    misfit: float
    """See `PushFit.misfit`."""
    weights: Array
    """(N,) weight of each push, at most 1."""


def first_images(recording: Recording, finger: str = "") -> Iterator[Image]:
    """Return the images of the first half second of a recording, of a hand those of one of its fingers.

    Those that its flags call touched are left out.
    """
    sensor = recording.sensor if recording.hand is None else recording.hand.fingers[finger]
    for index in range(min(first_frames(sensor.rate), len(recording))):
        frame = recording[index]
        image = frame.image if recording.hand is None else (frame.images or {}).get(finger)
        contact = frame.contact if recording.hand is None else (frame.contacts or {}).get(finger)
        if image is not None and not contact:
            yield image


class Push(NamedTuple):
    """A recording of N frames with the touch measurements from its images."""

    recording: Recording
    """The recording, with contact as its images show it."""
    measurements: Sequence[Sequence[Measurement]]
    """Touch measurements of each frame."""


def read_push(recording: Recording, model: TouchModel, calibration: Calibration) -> Push:
    """Read contact and touch measurements from the images of a push.

    Raises FileError if there are no images, or if they do not show both contact and no contact.
    """
    name = recording.file or "the recording"
    if recording.image is None:
        raise FileError(f"{name}: has no images, and a calibration by pushes reads touch from them")
    detector = ContactDetector(recording.sensor, calibration)
    touch = TouchReader("learnt", recording.sensor, model, calibration)
    contact: list[bool] = []
    measurements: list[Sequence[Measurement]] = []
    was_touched = False
    for frame in recording:
        assert frame.image is not None
        with in_file(f"{name}: frame {len(measurements)}"):
            image = detector.read(frame.image)
            is_touched = detector.update(image)
        if was_touched and not is_touched:
            touch.end_contact()
        read: Sequence[Measurement] = ()
        if is_touched:
            read = touch.read(replace(frame, image=image), detector.background, detector.light)
        measurements.append(tuple(read))
        contact.append(is_touched)
        was_touched = is_touched
    if len(set(contact)) < 2:
        raise FileError(f"{name}: is touched in all frames or in none, and a calibration by pushes needs both")
    return Push(replace(recording, image=None, contact=np.array(contact)), measurements)


@dataclass(frozen=True, eq=False)
class PushFit:
    """Result of a calibration by N pushes; numbers are those of NUMBERS, in radians, metres and seconds."""

    calibration: Calibration
    """Calibration of the unit, for `Tracker`."""
    before: Array
    """Mean and standard deviation of each number for a usual robot, (6, 2)."""
    after: Array
    """Mean and standard deviation of each number for this robot, (6, 2)."""
    each: Array
    """Mean and standard deviation of the first four numbers by each push alone, (N, 4, 2)."""
    misfit: float
    """Weighted chi-square of the pushes about the common numbers, by degree of freedom; 1 if errors are as stated."""

    def about(self) -> dict[str, dict[str, float]]:
        """Return the numbers as plain data, in the units of their names."""
        units = np.array([*NUMBERS.values()])
        rows = np.column_stack([self.before, self.after]) * units[:, None]
        names = ("usual", "sigma_before", "found", "sigma")
        return {name: dict(zip(names, row, strict=True)) for name, row in zip(NUMBERS, rows.tolist(), strict=True)}


def learn_from_pushes(pushes: Sequence[Push], calibration: Calibration) -> PushFit:
    """Return the calibration with which the pushes were read, completed by what they show of the robot.

    Pushes are of one sensor. Those whose graphs have no solution are left out, with a warning. Raises FileError if
    fewer than FEWEST are left, or if they are of several robots.
    """
    sensor = pushes[0].recording.sensor
    noise = _noise_of_pushes(Unit(sensor, calibration=replace(calibration, set_up=None)))
    before = np.array([*(getattr(noise.priors, variable.name) for variable in _SHARED), *_OUTSIDE])
    # Whole frames, since poses interpolated between them have less noise, and that would show in the costs.
    step = np.array([1e-3, max(round(sensor.rate / 30.0), 1) / sensor.rate])  # [m], [s]
    solved = _solved(pushes, step, noise)
    joint = _joined([_expansion(fits, step) for _, fits in solved], before)
    upright = _log_odds_upright(solved, noise)
    _check_and_warn(solved, joint, upright)
    if (np.abs(joint.mean - before[:, 0])[4:] > 2.0 * step).any():
        logger.warning("sensor or images are off by 2 mm or two frames: correct sensor_T_gel or time_offset first")
    after = np.column_stack([joint.mean, np.minimum(np.sqrt(np.diagonal(joint.covariance)), before[:, 1])])
    after[5, 0] = max(after[5, 0], 0.0)  # images do not come before what they show
    offset, scale, depth, outline_scale, sideways, delay = map(tuple, after.tolist())
    learnt = replace(
        calibration,
        direction=_corrected(calibration.direction, offset, scale),
        set_up=SetUp(sideways, delay, depth, outline_scale),
        is_view_known=calibration.is_view_known or upright > LEFT_OR_RIGHT,
    )
    wrong = mismatch(learnt, sensor)
    if wrong:
        raise FileError(wrong)
    alone = [fits[0] for _, fits in solved]
    by_each = np.array([np.column_stack([fit.mean, np.sqrt(np.diagonal(fit.covariance))]) for fit in alone])
    return PushFit(learnt, before, after, by_each, joint.misfit)


def _noise_of_pushes(unit: Unit) -> NoiseSettings:
    """Return noise settings with priors as wide as mountings and outlines of any robot."""
    noise = noise_of_unit(NoiseSettings(), unit)
    bias_sigma = math.hypot(noise.priors.direction_bias[1], _MOUNTING_YAW_SIGMA)
    priors = replace(noise.priors, direction_bias=(0.0, bias_sigma), outline_scale=(0.0, _OUTLINE_SCALE_SIGMA))
    return replace(noise, priors=priors)


def _solved(pushes: Sequence[Push], step: Array, noise: NoiseSettings) -> list[tuple[Push, list[_Fit]]]:
    """Return the pushes that have a solution, each with its fits on _GRID; one that is given twice counts once."""
    different = {push.recording.sensor_pose.tobytes(): push for push in pushes}
    solved: list[tuple[Push, list[_Fit]]] = []
    for push in different.values():
        try:
            fits = [_fitted(push, _OUTSIDE[:, 0] + steps * step, noise) for steps in _GRID]
        except EstimationError as error:
            logger.warning("%s: is left out (%s)", push.recording.file, error)
        else:
            solved.append((push, fits))
    if len(solved) < FEWEST:
        raise FileError(f"found {len(solved)} pushes; at least {FEWEST} different ones that fit are needed")
    return solved


def _log_odds_upright(solved: Sequence[tuple[Push, list[_Fit]]], noise: NoiseSettings) -> float:
    """Return the log odds that images are not mirrored.

    A single push counts by LEFT_OR_RIGHT at most, since its solution may be a wrong one.
    """
    log_odds = 0.0
    for push, fits in solved:
        with suppress(EstimationError):
            mirrored = _fitted(push, _OUTSIDE[:, 0], noise, sign=-1.0)
            log_odds += float(np.clip(mirrored.cost - fits[0].cost, -LEFT_OR_RIGHT, LEFT_OR_RIGHT))
    return log_odds


def _check_and_warn(solved: Sequence[tuple[Push, list[_Fit]]], joint: _Joint, upright: float) -> None:
    """Raise FileError if pushes are mirrored or not of one robot; warn of each that contradicts the others."""
    if upright < -LEFT_OR_RIGHT:
        raise FileError("the images fit these pushes only with left and right exchanged: --orientation mirrored or 180")
    if joint.misfit > _LARGEST_MISFIT:
        raise FileError(
            f"the pushes do not belong together: they differ by {joint.misfit:.1f} times what their errors allow, and "
            f"those of one robot by {_LARGEST_MISFIT:g} at most; are outlines and first poses right, and is it one "
            "mounting?"
        )
    for (push, _), weight in zip(solved, joint.weights.tolist(), strict=True):
        if weight < 0.1:
            logger.warning("%s: contradicts the others and hardly counts: wrong pose or outline?", push.recording.file)


def _corrected(
    direction: DirectionCorrection, offset: tuple[float, float], scale: tuple[float, float]
) -> DirectionCorrection:
    """Return a correction of directions after which offset and scale error, with their sigmas, were still found."""
    return DirectionCorrection(
        offset=direction.offset + direction.scale * offset[0],
        scale=direction.scale * (1.0 + scale[0]),
        offset_sigma=offset[1],
        scale_sigma=direction.scale * scale[1],
    )


def _fitted(push: Push, outside: Array, noise: NoiseSettings, sign: float = 1.0) -> _Fit:
    """Return the fit of a push alone.

    `outside` are the sensor's offset along its y [m] and the delay of the images [s]; `sign` is -1 for mirrored images.
    Raises EstimationError if a graph has no solution.
    """
    recording = push.recording
    assert recording.contact is not None
    sideways, delay = outside
    poses = _true_sensor_poses(recording, sideways, delay)
    model = contact_model(recording.shape, recording.sensor)
    factors = settings_record(noise, model)
    first, sigma = first_pose_of_recording(recording, noise)
    of_object = object_prior(noise.priors)
    covariance = np.diag(np.square([*sigma, *of_object.deviation]))
    belief = Belief(first[None], of_object.mean[None], covariance[None])
    last = belief
    cost = 0.0
    for begin, end in flag_runs(recording.contact):
        belief = belief.inflated(np.diag(np.square(noise.first_pose.rest)))
        window = None
        for index in range(begin, end + 1):
            measured = push.measurements[index]
            times = recording.time[max(index - LAG + 1, begin) : index + 1].tolist()
            step = Step(poses[index], measured, len(measured), times)
            if window is None:
                window = ContactWindow(Graph(factors, model), belief, step, _ALL_STEPS, of_object, np.array([sign]))
            else:
                window.add(step)
        assert window is not None
        cost += float(cost_of_contact(window.costs())[0] + window.cost_of_belief()[0])
        last = window.belief()
        belief = window.belief().at_next_contact(of_object)
    covariance_of_shared = last.covariance[0, 3:, 3:][np.ix_(_COLUMNS, _COLUMNS)]
    return _Fit(cost, last.values[0, _COLUMNS], covariance_of_shared)


def _true_sensor_poses(recording: Recording, sideways: float, delay: float) -> Array:
    """Return the sensor poses (N, 3) at the times that the images show, without an offset along the sensor's y [m]."""
    poses = se2.compose(recording.sensor_pose, (0.0, -sideways, 0.0))
    touch_delay = 0.05  # [s] by which images without delay show a touch late
    return se2.interpolated(recording.time - delay - touch_delay, recording.time, poses)


def _expansion(fits: Sequence[_Fit], step: Array) -> _Expansion:
    """Return the expansion of a push's cost from its fits on _GRID, at steps (2,) of sideways [m] and delay [s].

    A push that finds another solution at one of the values tells nothing about sideways and delay.
    """
    costs = np.array([fit.cost for fit in fits])
    means = np.array([fit.mean for fit in fits])
    best = 0
    # Central differences: one row for sideways, one for delay.
    slope = (costs[1::2] - costs[2::2]) / (2.0 * step)
    cost_bend = costs[1::2] + costs[2::2] - 2.0 * costs[0]
    mean_slope = (means[1::2] - means[2::2]) / (2.0 * step[:, None])
    mean_bend = means[1::2] + means[2::2] - 2.0 * means[0]
    squared_bend = np.einsum("ki,ij,kj->k", mean_bend, np.linalg.inv(fits[0].covariance), mean_bend)
    if squared_bend.max() > 1.0 or cost_bend.min() < -1.0:  # no Gaussian has such costs: there are several solutions
        best = int(np.argmin(costs))
        slope = np.zeros(2)
        cost_bend = np.zeros(2)
        mean_slope = np.zeros((2, 4))
    off_mean = np.column_stack([np.eye(4), -mean_slope.T])  # change of the four variables off their mean, by all six
    curvature = off_mean.T @ np.linalg.inv(fits[best].covariance) @ off_mean
    curvature[4:, 4:] += np.diag(np.maximum(cost_bend, 0.0) / np.square(step))
    return _Expansion(
        at=np.append(means[best], _OUTSIDE[:, 0]),
        cost=costs[best],
        slope=np.append(np.zeros(4), slope),
        curvature=curvature,
    )


def _joined(expansions: Sequence[_Expansion], prior: Array) -> _Joint:
    """Return the Gaussian by N pushes and a prior (6, 2) of means and standard deviations.

    The cost of each push includes the prior of the four shared variables, which counts once in all. A push that fits
    the common numbers worse than half of them counts by so much less.
    """
    at = np.array([expansion.at for expansion in expansions])
    costs = np.array([expansion.cost for expansion in expansions])
    slopes = np.array([expansion.slope for expansion in expansions])
    curvatures = np.array([expansion.curvature for expansion in expansions])
    prior_mean = prior[:, 0]
    prior_information = np.diag(prior[:, 1] ** -2.0)
    information_in_each = prior_information.copy()  # of the prior, in the cost of each push
    information_in_each[4:] = 0.0
    mean = prior_mean
    covariance = prior_information
    weights = np.ones_like(costs)
    squared_distance = np.zeros_like(costs)
    rise = np.zeros_like(costs)  # of the cost of each push, from its own numbers to the common ones
    for _ in range(20):
        total = np.maximum(costs + rise, 1.0)
        weights = np.minimum(np.median(total) / total, 1.0)
        information = prior_information + np.tensordot(weights, curvatures - information_in_each, 1)
        covariance = np.asarray(np.linalg.inv(information), np.float64)
        pulls = np.einsum("nij,nj->ni", curvatures, at) - slopes - information_in_each @ prior_mean
        mean = covariance @ (prior_information @ prior_mean + weights @ pulls)
        off = mean - at
        squared_distance = np.einsum("ni,nij,nj->n", off, curvatures, off)
        rise = np.sum(slopes * off, axis=1) + 0.5 * squared_distance
    misfit = float(weights @ squared_distance / (4.0 * (weights.sum() - 1.0)))
    return _Joint(mean, covariance, misfit, weights)
