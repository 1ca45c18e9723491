"""The tracker: one frame in, one estimate out."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.compiled import EVERY
from palpate.compiled.library import path_of
from palpate.config import TactileChoice, TrackerSettings
from palpate.errors import EstimationError
from palpate.estimation.compiled_model import CompiledModel
from palpate.geometry.shapes import Shape
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
from palpate.touch.calibration import Calibration
from palpate.touch.pipeline import Touch, TouchReader
from palpate.touch.touch_model import TouchModel
from palpate.tracker_arguments import check_arguments, first_pose_of, noise_of_unit
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame, Measurement
from palpate.types.sensor import SensorProfile
from palpate.types.sensor_file import known_sensor

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

        The first tracker of a process loads compiled code. Where palpate came without it, the very first takes 40 s to
        compile it.
        """
        check_arguments(shape, settings, model, calibration, touch)
        settings = settings or TrackerSettings()
        sensor = known_sensor(sensor)
        self._settings = settings
        self._tips = len(sensor.tips)
        self._first = first_pose_of(first_pose, first_pose_sigma, settings)
        warm_up()
        self._correction = SensorCorrection(calibration.set_up if calibration else None)
        self._gate = InputGate(sensor, calibration, settings.markers == "auto")
        self._is_touch_given = touch is not None
        is_view_known |= calibration is not None and calibration.is_view_known
        pitch_sigma = 0.0 if self._is_touch_given else sensor.pixel_pitch_sigma
        noise = noise_of_unit(settings.noise, calibration, pitch_sigma, set_up_sigma)
        self._filter = MultiHypothesisFilter(
            contact_model(shape, sensor),
            replace(settings, noise=noise),
            self._first.pose,
            self._first.covariance,
            may_be_mirrored=not (is_view_known or self._is_touch_given),
            compiled=graph,
        )
        self._touch = TouchReader(settings.tactile, sensor, model, calibration, own=touch)

    def reset(self, pose: ArrayLike | None = None, sigma: ArrayLike | None = None) -> None:
        """Begin anew with the same sensor, settings and untouched gel; the next frame may have any time.

        `pose` and `sigma` are a new first pose and its sigma, by default those it last began with.
        """
        if pose is not None or sigma is not None:
            self._first = first_pose_of(self._first.pose if pose is None else pose, sigma, self._settings)
        self._touch.end_contact()
        self._gate.reset()
        self._correction.reset()
        self._filter.begin(self._first.pose, self._first.covariance)

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
        posterior = self._filter.step(checked.frame, measured, checked.evidence.hidden_motion, self._touch.sunk)
        self._accept(checked, measured)
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

    def variable(self, name: str) -> tuple[Array, Array]:
        """Return a variable of the object as learnt so far, by the best answer: mean and standard deviation, (D,) each.

        Names are those of `palpate.models.pushing.variables`, and of an extended model. Raises SettingError for others.
        """
        return self._filter.variable(name)

    @property
    def frame(self) -> Frame:
        """The last frame as it was used, its image in the profile's view; EstimationError before the first one."""
        if self._gate.last is None:
            raise EstimationError("no frame has been taken so far; there is one after the first update")
        return self._gate.last

    @property
    def background(self) -> Background | None:
        """A copy of the untouched gel as it is known now; None before the first images, and without images."""
        background = self._gate.background
        return None if background is None else background.copy()

    def _check(self, frame: Frame, measurements: Sequence[Measurement]) -> CheckedFrame:
        """Refuse implausible input, correct the sensor's pose, and decide contact."""
        given = with_checked_values(frame, measurements, self._tips)
        corrected = self._correction.corrected(given)
        checked = self._gate.check(corrected, self._filter, self._touch.reads_images, self._touch.needs_colours)
        if checked.is_first:
            self._first.warn_if_far_from(checked.frame.sensor_pose)
        return checked

    def _measure(self, checked: CheckedFrame) -> Sequence[Measurement]:
        """Return the measurements by touch, of a frame in contact."""
        frame = checked.frame
        self._touch.choose(frame.image, checked.background)
        is_blind = checked.evidence.touches_since_start and self._touch.reads_images
        if not frame.contact or is_blind or not checked.shows_touch:
            return ()
        measured = self._touch.read(frame, checked.background, checked.light)
        return checked_measurements(frame.time, measured, self._tips) if self._is_touch_given else measured

    def _accept(self, checked: CheckedFrame, measured: Sequence[Measurement]) -> None:
        """Make a frame the last one, now that it was used."""
        self._gate.accept(checked, measured)
        self._correction.accept(checked.corrected)

    def _estimate(self, checked: CheckedFrame, posterior: Posterior) -> Estimate:
        """Return the estimate at the time of the frame, with its status and the reason for it."""
        stream = replace(checked.evidence, sunk=self._touch.sunk)
        verdict = decide(Evidence(posterior.evidence, stream))
        estimate = posterior.estimate(checked.frame.time, verdict)
        return self._correction.at_frame_time(estimate, checked.corrected)


@cache
def warm_up() -> None:
    """Load all machine code, or make it where there is none yet; once in a process."""
    if path_of(PUSHING.improve) is None:
        logger.warning("compiling the estimator: once for this version, some 40 s")
    for function in EVERY:
        function.load()
