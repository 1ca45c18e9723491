"""Calibration of a robot by ordinary pushes without truth: one fit over what is common to all of them.

With its own first pose, friction and path, each push gives a Gaussian on the numbers that all share; their product,
less the prior that each one counts again, is that of all. Four of the numbers are variables of the graph. The place of
the sensor along its y and the delay of images are not: each push is fitted at several of both, and a quadratic through
its costs, with the motion of the four, gives a Gaussian on all six. A push that finds another solution there says
nothing of these two. A mounting error along x is in the indentation, and one in yaw in the offset of directions.
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
from palpate.models.pushing.layout import IN_OBJECT
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import DEPTH, DIRECTION_BIAS, DIRECTION_SCALE, OUTLINE_SCALE
from palpate.models.pushing.window import Window
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import first_pose_of
from palpate.touch.background import first_frames
from palpate.touch.calibration import Calibration, DirectionCorrection, SetUp, calibrated, mismatch
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.pipeline import TouchReader
from palpate.touch.press_calibration import LEFT_OR_RIGHT
from palpate.touch.touch_model import TouchModel
from palpate.tracker_arguments import noise_of_unit
from palpate.types.measurements import Measurement

logger = logging.getLogger(__name__)

FEWEST = 3
"""Pushes that show if they belong together."""
NUMBERS = {
    "direction offset [deg]": 180.0 / math.pi,
    "direction scale [%]": 100.0,
    "depth [mm]": 1e3,
    "outline size [%]": 100.0,
    "sensor sideways [mm]": 1e3,
    "delay [ms]": 1e3,
}
"""Numbers of the fit with their units for people; the first four are variables of the graph."""
_SHARED = (DIRECTION_BIAS, DIRECTION_SCALE, DEPTH, OUTLINE_SCALE)
_COLUMNS = [IN_OBJECT[one].start for one in _SHARED]
_MOUNTED, _OUTLINES = 0.0175, 0.015  # [rad], share: deviations of a mounting's yaw and of outlines' size
_OUTSIDE = np.array([(0.0, 1e-3), (0.03, 0.05)])  # [m], [s]: sideways and delay of a usual robot
_CROSS = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])  # steps of both between the fits
_Fit = tuple[float, Array, Array]
"""Cost, mean (4,) and covariance (4, 4) of the shared variables."""
_Expansion = tuple[Array, float, Array, Array]
"""Numbers (6,) at which a push was fitted, its cost there, and slope (6,) and curvature (6, 6) of the cost."""
_APART = 2.5  # misfit from which pushes are not of one robot


def first_images(recording: Recording) -> Iterator[Image]:
    """Yield the images of the first half second of a recording, taken as untouched unless flags say otherwise."""
    frames = (recording[index] for index in range(min(first_frames(recording.sensor.rate), len(recording))))
    return (frame.image for frame in frames if frame.image is not None and not frame.contact)


class Push(NamedTuple):
    """A recording of N frames with what touch reads from its images."""

    recording: Recording
    """Its contact is that in the images."""
    measurements: Sequence[Sequence[Measurement]]
    """Those of each frame."""


def read_push(recording: Recording, model: TouchModel, calibration: Calibration) -> Push:
    """Return a push as touch reads it; raises FileError if it has no images or shows no contact."""
    name = recording.file or "the recording"
    if recording.image is None:
        raise FileError(f"{name}: has no images, and a calibration by pushes reads touch from them")
    detector = ContactDetector(recording.sensor, calibration)
    touch = TouchReader("learnt", recording.sensor, model, calibration)
    contact, measurements = [False], []
    for frame in recording:
        assert frame.image is not None
        with in_file(f"{name}: frame {len(measurements)}"):
            image = detector.read(frame.image)
            contact.append(detector.update(image))
        if contact[-2] and not contact[-1]:
            touch.end_contact()
        frame = replace(frame, image=image)
        measurements.append(tuple(touch.read(frame, detector.background)) if contact[-1] else ())
    if len(set(contact[1:])) < 2:
        raise FileError(f"{name}: is touched in all frames or in none, and a calibration by pushes needs both")
    return Push(replace(recording, image=None, contact=np.array(contact[1:])), measurements)


@dataclass(frozen=True, eq=False)
class PushFit:
    """Result of a calibration by N pushes; numbers are those of NUMBERS, in radians, metres and seconds."""

    calibration: Calibration
    """For `Tracker`."""
    before: Array
    """Mean and standard deviation of each number of a usual robot, (6, 2)."""
    after: Array
    """The same of this one, (6, 2)."""
    each: Array
    """The same of the first four by each push alone, (N, 4, 2)."""
    misfit: float
    """Chi-square of the pushes, as far as they count, about their fit by degree of freedom; 1 with errors as stated."""

    def about(self) -> dict[str, dict[str, float]]:
        """Return the numbers as plain data, in the units of their names."""
        rows = np.column_stack([self.before, self.after]) * np.array([*NUMBERS.values()])[:, None]
        names = ("usual", "sigma_before", "found", "sigma")
        return {name: dict(zip(names, row, strict=True)) for name, row in zip(NUMBERS, rows.tolist(), strict=True)}


def learn_from_pushes(pushes: Sequence[Push], calibration: Calibration) -> PushFit:
    """Return the calibration that the pushes were read with, with what they show of the robot besides.

    Pushes, of one sensor, whose graphs have no solution are left out, with a warning. Raises FileError if fewer than
    FEWEST are left, or if they are of several robots.
    """
    sensor, direction = pushes[0].recording.sensor, calibration.direction
    unit = calibrated(sensor, calibration)
    noise = noise_of_unit(NoiseSettings(), replace(calibration, set_up=None), unit.pixel_pitch_sigma)
    bias = math.hypot(noise.priors.direction_bias[1], _MOUNTED)
    noise = replace(noise, priors=replace(noise.priors, direction_bias=(0.0, bias), outline_scale=(0.0, _OUTLINES)))
    before = np.array([*(getattr(noise.priors, one.name) for one in _SHARED), *_OUTSIDE])
    # Whole frames, since poses interpolated between them have less noise, and that would show in the costs.
    size = np.array([1e-3, max(round(sensor.rate / 30.0), 1) / sensor.rate])  # [m], [s]
    solved: list[tuple[Push, list[_Fit]]] = []
    for push in {each.recording.sensor_pose.tobytes(): each for each in pushes}.values():  # one given twice counts once
        try:
            solved.append((push, [_fitted(push, _OUTSIDE[:, 0] + step * size, noise) for step in _CROSS]))
        except EstimationError as error:
            logger.warning("%s: is left out (%s)", push.recording.file, error)
    if len(solved) < FEWEST:
        raise FileError(f"found {len(solved)} pushes; at least {FEWEST} different ones that fit are needed")
    mean, covariance, misfit, weights = _joined([_expansion(fits, size) for _, fits in solved], before)
    upright = 0.0  # log likelihood; a push alone makes nothing known, since its solution may be a wrong one
    for push, fits in solved:
        with suppress(EstimationError):
            mirrored = _fitted(push, _OUTSIDE[:, 0], noise, sign=-1.0)[0]
            upright += float(np.clip(mirrored - fits[0][0], -LEFT_OR_RIGHT, LEFT_OR_RIGHT))
    if upright < -LEFT_OR_RIGHT:
        raise FileError("the images fit these pushes only with left and right exchanged: --orientation mirrored or 180")
    if misfit > _APART:
        raise FileError(
            f"the pushes do not belong together: they differ by {misfit:.1f} times what their errors allow, and "
            f"those of one robot by {_APART:g} at most; are outlines and first poses right, and is it one mounting?"
        )
    for (push, _), weight in zip(solved, weights.tolist(), strict=True):
        if weight < 0.1:
            logger.warning("%s: contradicts the others and hardly counts: wrong pose or outline?", push.recording.file)
    if (np.abs(mean - before[:, 0])[4:] > 2.0 * size).any():
        logger.warning("sensor or images are off by 2 mm or two frames: correct sensor_T_gel or time_offset first")
    after = np.column_stack([mean, np.minimum(np.sqrt(np.diagonal(covariance)), before[:, 1])])
    after[5, 0] = max(after[5, 0], 0.0)
    offset, scale, depth, outline, sideways, delay = map(tuple, after.tolist())
    by = direction.scale
    corrected = DirectionCorrection(direction.offset + by * offset[0], by * (1.0 + scale[0]), offset[1], by * scale[1])
    learnt = replace(
        calibration,
        direction=corrected,
        set_up=SetUp(sideways, delay, depth, outline),
        is_view_known=calibration.is_view_known or upright > LEFT_OR_RIGHT,
    )
    if wrong := mismatch(learnt, sensor):
        raise FileError(wrong)
    by_each = np.array([np.column_stack([mean, np.sqrt(np.diagonal(spread))]) for _, ((_, mean, spread), *_) in solved])
    return PushFit(learnt, before, after, by_each, misfit)


def _fitted(push: Push, outside: Array, noise: NoiseSettings, sign: float = 1.0) -> _Fit:
    """Return the fit of a push alone.

    `outside` are the sensor's place [m] and the delay [s]. Raises EstimationError where a graph has no solution.
    """
    recording = push.recording
    poses = se2.compose(recording.sensor_pose, (0.0, -outside[0], 0.0))
    shows_late = 0.05  # [s] by which a touch does in images that are not late
    poses = se2.interpolated(recording.time - outside[1] - shows_late, recording.time, poses)
    model, priors = contact_model(recording.shape, recording.sensor), noise.priors
    factors, (first, sigma) = settings_record(noise, model), first_pose_of(recording, noise)
    joint = np.diag(np.square([*sigma, *object_prior(priors).deviation]))
    belief, cost = Belief(first[None], object_prior(priors).mean[None], joint[None]), 0.0
    last = belief
    assert recording.contact is not None
    for begin, end in flag_runs(recording.contact):
        belief, window = belief.inflated(np.diag(np.square(noise.first_pose.rest))), None
        for index in range(begin, end + 1):
            measured = push.measurements[index]
            times = recording.time[max(index - LAG + 1, begin) : index + 1].tolist()
            step = Step(poses[index], measured, len(measured), times)
            if window is None:
                window = Window(factors, model, belief, step, 2**62, priors, np.array([sign]))
            else:
                window.add(step)
        assert window is not None
        cost += float(cost_of_contact(window.costs())[0] + window.cost_of_belief()[0])
        last, belief = window.belief(), window.belief().at_next_contact(object_prior(priors))
    return cost, last.values[0, _COLUMNS], last.covariance[0, 3:, 3:][np.ix_(_COLUMNS, _COLUMNS)]


def _expansion(fits: Sequence[_Fit], step: Array) -> _Expansion:
    """Return the second-order expansion of a push's cost from its fits at the places of _CROSS, `step` (2,) apart.

    A push with another solution at one of them says nothing of sideways and delay.
    """
    costs, means, covariances = (np.array(each) for each in zip(*fits, strict=True))
    slope, curve = (costs[1::2] - costs[2::2]) / (2.0 * step), costs[1::2] + costs[2::2] - 2.0 * costs[0]
    motion, bend = (means[1::2] - means[2::2]) / (2.0 * step[:, None]), means[1::2] + means[2::2] - 2.0 * means[0]
    best, bends = 0, np.einsum("ki,ij,kj->k", bend, np.linalg.inv(covariances[0]), bend)
    if bends.max() > 1.0 or curve.min() < -1.0:  # which no Gaussian has
        best, slope, curve, motion = int(np.argmin(costs)), np.zeros(2), np.zeros(2), np.zeros((2, 4))
    off_mean = np.column_stack([np.eye(4), -motion.T])  # of the four, by all six
    curvature = off_mean.T @ np.linalg.inv(covariances[best]) @ off_mean
    curvature[4:, 4:] += np.diag(np.maximum(curve, 0.0) / np.square(step))
    return np.append(means[best], _OUTSIDE[:, 0]), costs[best], np.append(np.zeros(4), slope), curvature


def _joined(expansions: Sequence[_Expansion], prior: Array) -> tuple[Array, Array, float, Array]:
    """Return mean (6,) and covariance (6, 6) of the numbers by N pushes and a prior (6, 2), misfit and weights (N,).

    The cost of each push includes the prior of the four shared variables, which counts once. A push that fits the
    common numbers worse than half of them counts by so much less.
    """
    at, costs, slopes, curvatures = (np.array(each) for each in zip(*expansions, strict=True))
    once = np.diag(prior[:, 1] ** -2.0)
    again, mean, covariance, rise = once * (np.arange(6) < 4), prior[:, 0], once, 0.0 * costs
    weights, apart = 0.0 * costs + 1.0, 0.0 * costs
    for _ in range(20):
        together = np.maximum(costs + rise, 1.0)
        weights = np.minimum(np.median(together) / together, 1.0)
        covariance = np.asarray(np.linalg.inv(once + np.tensordot(weights, curvatures - again, 1)), np.float64)
        pulls = np.einsum("nij,nj->ni", curvatures, at) - slopes - again @ prior[:, 0]
        mean = covariance @ (once @ prior[:, 0] + weights @ pulls)
        off = mean - at
        apart = np.einsum("ni,nij,nj->n", off, curvatures, off)
        rise = np.sum(slopes * off, axis=1) + 0.5 * apart
    return mean, covariance, float(weights @ apart / (4.0 * (weights.sum() - 1.0))), weights
