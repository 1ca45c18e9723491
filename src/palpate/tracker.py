"""The tracker: one frame in, one estimate out."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.checks import SPAN, TURNS
from palpate.compiled import is_cached
from palpate.config import ANYWHERE_SIGMA, UNLIKELY, NoiseSettings, TactileChoice, TrackerSettings
from palpate.errors import EstimationError, SettingError
from palpate.estimation.compiled_model import CompiledModel
from palpate.geometry.shapes import Disc, Shape, check_outline
from palpate.hypotheses.filter import MultiHypothesisFilter
from palpate.hypotheses.posterior import Posterior
from palpate.input.checked_frame import CheckedFrame
from palpate.input.frame_values import checked_measurements, with_checked_values
from palpate.input.input_gate import InputGate
from palpate.input.sensor_correction import SensorCorrection
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.contact_geometry import contact_model
from palpate.status import Evidence, decide
from palpate.touch.background import Background
from palpate.touch.calibration import UNCORRECTED, Calibration
from palpate.touch.pipeline import Touch, TouchReader
from palpate.touch.touch_model import TouchModel
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame, Measurement, finite_numbers
from palpate.types.sensor import POINT, SensorProfile, known_sensor

logger = logging.getLogger(__name__)


class Tracker:
    """Tracks one object from the frames of one sensor. No input, output or drawing."""

    def __init__(
        self,
        shape: Shape,
        sensor: SensorProfile | str,
        first_pose: ArrayLike | None,
        settings: TrackerSettings | None = None,
        model: TouchModel | None = None,
        calibration: Calibration | None = None,
        touch: Touch | None = None,
        first_pose_sigma: ArrayLike | None = None,
        set_up_sigma: ArrayLike | None = None,
        is_view_known: bool = False,
        graph: CompiledModel = PUSHING,
    ) -> None:
        """Take the object's outline, the sensor or its name, and world_T_object (3,) [m, m, rad] at the first frame.

        A first pose of None is anywhere within a metre of the world's origin, at any yaw. `first_pose_sigma` are
        standard deviations (3,) [m, m, rad] along the object's axes, or a covariance (3, 3) as an `Estimate` has it; by
        default `noise.first_pose`. `set_up_sigma` are those of the constant offset between sensor, world and outline,
        by default `noise.sensor_pose.calibration`. Without a `calibration` of this sensor unit, the first half second
        of images is taken as untouched; one by pushes corrects the sensor's poses, too, and takes the place of
        `set_up_sigma`. `touch` is an object of your own that measures in place of the touch model. Unless the
        calibration or `is_view_known` says that images are upright, the tracker finds out if they are. `graph` are the
        variables and factors: those of pushing, or of a model that extends it.

        The first tracker of a process takes half a second to load compiled code, the very first 12 s to compile it.
        """
        check_arguments(shape, settings, model, calibration, touch)
        settings = settings or TrackerSettings()
        sensor = known_sensor(sensor)
        self._settings = settings
        self._tips = len(sensor.tips)
        self._first = first_pose_of(first_pose, first_pose_sigma, settings)
        warm_up()
        self._correction = SensorCorrection(calibration.set_up if calibration else None)
        self._gate = InputGate(sensor, calibration)
        self._is_touch_given = touch is not None
        is_view_known |= calibration is not None and calibration.is_view_known
        pitch_sigma = 0.0 if self._is_touch_given else sensor.pixel_pitch_sigma
        noise = noise_of_unit(settings.noise, calibration, pitch_sigma, set_up_sigma)
        self._filter = MultiHypothesisFilter(
            contact_model(shape, sensor),
            replace(settings, noise=noise),
            *self._first,
            may_be_mirrored=not (is_view_known or self._is_touch_given),
            compiled=graph,
        )
        self._touch = TouchReader(settings.tactile, sensor, model, calibration, own=touch)

    def reset(self, pose: ArrayLike | None = None, sigma: ArrayLike | None = None) -> None:
        """Begin anew with the same sensor, settings and untouched gel; the next frame may have any time.

        `pose` and `sigma` are a new first pose and its sigma, by default those it last began with.
        """
        if pose is not None or sigma is not None:
            self._first = first_pose_of(self._first[0] if pose is None else pose, sigma, self._settings)
        self._touch.end_contact()
        self._gate.reset()
        self._correction.reset()
        self._filter.begin(*self._first)

    def update(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> Estimate:
        """Take the next frame and return the estimate at its time.

        `measurements` of other sources, such as a camera's `ObjectPose`, are added to the frame's own. If a frame has
        an image, the image decides if it is in contact, whatever its flag is.

        Raises FrameError if the frame cannot be used and is left out, and EstimationError if no estimate can be
        computed, not even by beginning anew from the last pose: the next frame then begins another contact.
        """
        checked = self._check(frame, measurements)
        if checked.ends_contact:
            self._touch.end_contact()
            self._filter.end_contact(checked.unobserved_push)
        measured = self._measure(checked)
        posterior = self._filter.step(checked.frame, measured, checked.evidence.hidden_motion)
        self._accept(checked)
        return self._estimate(checked, posterior)

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements; auto until the first frame, and if `touch` was given."""
        return self._touch.tactile

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice, in words; empty if the settings named it."""
        return self._touch.reason

    @property
    def mirrored(self) -> bool:
        """True once touch images are taken as turned by half a turn or mirrored, as only so they fit the push."""
        return self._filter.is_mirrored

    @property
    def frame(self) -> Frame:
        """The last frame as it was used, its image in the profile's view; EstimationError before the first one."""
        if self._gate.last is None:
            raise EstimationError("no frame has been taken so far; there is one after the first update")
        return self._gate.last

    @property
    def background(self) -> Background | None:
        """The untouched gel as it is known now; None before the first images, and without images."""
        return self._gate.background

    def _check(self, frame: Frame, measurements: Sequence[Measurement]) -> CheckedFrame:
        """Refuse implausible input, correct the sensor's pose, and decide contact."""
        given = with_checked_values(frame, measurements, self._tips)
        corrected = self._correction.corrected(given)
        needs_clearance = self._gate.needs_clearance(given)
        clearance = self._filter.clearance(corrected.frame.sensor_pose) if needs_clearance else None
        checked = self._gate.check(corrected, clearance, self._touch.reads_images, self._touch.needs_colours)
        if checked.is_first:
            self._warn_of_far_poses(checked.frame)
        return checked

    def _measure(self, checked: CheckedFrame) -> Sequence[Measurement]:
        """Return the measurements by touch, of a frame in contact."""
        frame = checked.frame
        self._touch.choose(frame.image, checked.background)
        is_blind = checked.evidence.touches_since_start and self._touch.reads_images
        if not frame.contact or is_blind:
            return ()
        measured = self._touch.read(frame, checked.background)
        return checked_measurements(frame.time, measured, self._tips) if self._is_touch_given else measured

    def _accept(self, checked: CheckedFrame) -> None:
        """Make a frame the last one, now that it was used."""
        self._gate.accept(checked)
        self._correction.accept(checked.corrected)

    def _estimate(self, checked: CheckedFrame, posterior: Posterior) -> Estimate:
        """Return the estimate at the time of the frame, with its status and the reason for it."""
        verdict = decide(Evidence(posterior.evidence, checked.evidence))
        estimate = posterior.estimate(checked.frame.time, verdict)
        return self._correction.at_frame_time(estimate, checked.corrected)

    def _warn_of_far_poses(self, frame: Frame) -> None:
        """Warn of a first pose far from the sensor at the first frame, and of a sensor pose in degrees."""
        if abs(frame.sensor_pose[2]) > TURNS:
            logger.warning("sensor pose has theta %.4g rad: are these degrees?", frame.sensor_pose[2])
        pose, covariance = self._first
        distance = float(np.hypot(*(frame.sensor_pose - pose)[:2]))
        widest = float(np.sqrt(np.diagonal(covariance)[:2].max()))
        if distance > SPAN + UNLIKELY * widest:
            logger.warning("first pose is %.3g m from the sensor: is one of both in millimetres?", distance)


@cache
def warm_up() -> None:
    """Compile the estimator by a short simulated push, or load what was compiled before; once in a process."""
    if not is_cached(PUSHING.improve):
        logger.warning("compiling the estimator: once for this version, some 12 s")
    model = contact_model(Disc(0.05), POINT)
    push = MultiHypothesisFilter(model, TrackerSettings(), np.zeros(3), 1e-4 * np.eye(3))
    for step in range(2):
        push.step(Frame(step / 30.0, np.array([1e-4 * step - 0.05, 0.0, 0.0]), contact=True))


def check_arguments(shape: Any, settings: Any, model: Any, calibration: Any, touch: Any) -> None:
    """Raise SettingError or ShapeError unless all are of the right kind and unit; all but the first may be None."""
    check_outline(shape)
    for name, found, kind, maker in (
        ("settings", settings, TrackerSettings, "palpate.TrackerSettings(...)"),
        ("model", model, TouchModel, "a palpate.TouchModel(folder)"),
        ("calibration", calibration, Calibration, "a Calibration, which palpate.load_calibration reads from a file"),
        ("touch", touch, Touch, "an object with methods measure(frame) and end_contact()"),
    ):
        # A class has the methods of its objects.
        if found is not None and (isinstance(found, type) or not isinstance(found, kind)):
            raise SettingError(f"{name} is {str(found) if isinstance(found, Path) else found!r}; it must be {maker}")


def first_pose_of(pose: ArrayLike | None, sigma: ArrayLike | None, settings: TrackerSettings) -> tuple[Array, Array]:
    """Return the first pose (3,) and its covariance (3, 3), and warn of degrees and millimetres.

    `sigma` are standard deviations (3,) or a covariance (3, 3). Raises SettingError on what is none.
    """
    first = finite_numbers(np.zeros(3) if pose is None else pose, (3,))
    if first is None:
        allowed = "three finite numbers x [m], y [m], theta [rad], or None"
        raise SettingError(f"first pose is {pose!r}; it must be {allowed}")
    if abs(first[2]) > TURNS:
        turns = abs(first[2]) / (2.0 * np.pi)
        logger.warning("first pose has theta %.4g rad, %.1f turns: are these degrees?", first[2], turns)
    if sigma is None:
        sigma = ANYWHERE_SIGMA if pose is None else settings.noise.first_pose.deviation
    deviation = finite_numbers(sigma, (3,))
    covariance = finite_numbers(sigma, (3, 3)) if deviation is None else np.diag(deviation * np.abs(deviation))
    is_symmetric = covariance is not None and np.allclose(covariance, covariance.T)
    if covariance is None or not is_symmetric or np.linalg.eigvalsh(covariance).min() <= 0.0:
        allowed = "three numbers above 0: x [m], y [m], theta [rad], or a covariance (3, 3)"
        raise SettingError(f"first pose sigma is {np.asarray(sigma).tolist()}; it must be {allowed}")
    deviation = np.sqrt(np.diagonal(covariance))
    if (deviation[:2] > ANYWHERE_SIGMA[:2]).any():
        logger.warning("first pose sigma has %.4g and %.4g m: are these millimetres?", *deviation[:2])
    if deviation[2] > np.pi:
        logger.warning("first pose sigma has theta %.4g rad, any yaw at all: are these degrees?", deviation[2])
    return first, covariance


def noise_of_unit(
    noise: NoiseSettings, calibration: Calibration | None, pitch_sigma: float, set_up_sigma: ArrayLike | None = None
) -> NoiseSettings:
    """Return the noise settings of a sensor unit: its calibration and the accuracy of its set-up replace the defaults.

    `pitch_sigma` is the deviation of the pixel pitch of units without a calibration, as a share of it.
    """
    priors, pose = noise.priors, noise.sensor_pose
    correction, set_up = (calibration.direction, calibration.set_up) if calibration else (UNCORRECTED, None)
    mean, sigma = priors.direction_scale
    priors = replace(priors, direction_scale=(mean, math.hypot(sigma, pitch_sigma)))
    if correction.offset_sigma is not None:
        priors = replace(priors, direction_bias=(0.0, correction.offset_sigma))
    if correction.scale_sigma is not None:
        priors = replace(priors, direction_scale=(0.0, correction.scale_sigma / correction.scale))
    if set_up is not None:
        priors = replace(priors, depth=set_up.depth, outline_scale=set_up.outline_scale)
        # The rest of the mounting is in the depth and in the errors of directions.
        set_up_sigma = set_up.sideways[1], set_up.sideways[1], 0.0
    if set_up_sigma is not None:
        pose = replace(pose, calibration=set_up_sigma)  # pyright: ignore[reportArgumentType]  checked by the settings
    return replace(noise, priors=priors, sensor_pose=pose)
