"""The tracker: one frame in, one estimate out."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import TactileChoice, TrackerSettings
from palpate.errors import EstimationError
from palpate.filter.contact_point import contact_point
from palpate.filter.hypothesis_bank import HypothesisBank
from palpate.filter.warm_up import warm_up
from palpate.geometry.shapes import Shape
from palpate.graph.contact_geometry import contact_model
from palpate.graph.variables import GRIP, IN_OBJECT
from palpate.input_gate import InputGate, checked_frame, checked_measurements
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, correction_of
from palpate.touch.pipeline import Touch, TouchReader
from palpate.touch.touch_model import TouchModel
from palpate.tracker_arguments import check_arguments, check_distance, first_pose_of, with_correction
from palpate.types.estimate import Estimate, Trajectory
from palpate.types.measurements import Frame, Measurement
from palpate.types.sensor import SensorProfile, known_sensor

Array = NDArray[np.float64]
_NO_FRAME = "no frame has been taken so far; there is one after the first update"


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
    ) -> None:
        """Take the object's outline, the sensor, and world_T_object (3,) [m, m, rad] at the first frame.

        `first_pose_sigma` are standard deviations (3,) [m, m, rad] along the object's axes, or a covariance (3, 3) as
        an `Estimate` has it; by default `noise.first_pose`. A rough first pose is improved by touch. A first pose of
        None is anywhere within a metre of the world's origin, at any yaw. `sensor` is a profile or a known name.

        `model` is a touch model, by default the one that comes with palpate. `calibration` is that of this sensor unit,
        from `palpate calibrate`; without one, the first half second of images is taken as untouched. `touch` is an
        object of your own that measures in place of the touch model. The first tracker of a process takes half a second
        to load compiled code, and the very first of a machine some 20 s to compile it.
        """
        check_arguments(shape, settings, model, calibration, touch)
        settings, sensor = settings or TrackerSettings(), known_sensor(sensor)
        self._first = first_pose_of(first_pose, first_pose_sigma, settings)
        warm_up()
        self._sensor, self._settings = sensor, settings
        self._gate = InputGate(sensor, calibration, settings.noise.sensor_pose.deviation)
        self._contact_model = contact_model(shape, sensor, settings.pressure)
        self._is_touch_given = touch is not None
        is_view_known = calibration is not None and calibration.is_view_known
        self._bank = HypothesisBank(
            self._contact_model,
            with_correction(settings.noise, correction_of(calibration)),
            settings.smoother,
            *self._first,
            settings.hypotheses,
            may_be_mirrored=not (is_view_known or self._is_touch_given),
        )
        self._touch = TouchReader(settings.tactile, sensor, model, calibration, own=touch)
        self._begin()

    def reset(self, pose: ArrayLike | None = None, sigma: ArrayLike | None = None) -> None:
        """Begin anew with the same sensor, settings and untouched gel; the next frame may have any time.

        `pose` and `sigma` are as `first_pose` and `first_pose_sigma` of a new tracker; by default they are those that
        it last began with. Images that were found to be mirrored stay so.
        """
        if pose is not None or sigma is not None:
            self._first = first_pose_of(self._first[0] if pose is None else pose, sigma, self._settings)
        self._touch.end_contact()
        self._gate.reset()
        self._bank.begin(*self._first)
        self._begin()

    def _begin(self) -> None:
        self._touched_at = -math.inf  # [s] time of the last frame of contact
        self._times: list[float] = []
        self._contacts: list[bool] = []

    def update(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> Estimate:
        """Take the next frame and return the estimate at its time.

        `measurements` are those of other sources, added to the frame's own: a camera's `ObjectPose`, or your own. If a
        frame has an image, the image decides whether it is in contact, whatever its flag is.

        Raises FrameError if the frame cannot be used: a time not after the last frame's, a pose that is not finite,
        neither image nor contact flag, an image of another size, a measurement of a wrong kind. The frame is left out,
        and later estimates are the same to the last digit as without it. One exception: if a pose is refused because it
        jumps in a contact, what that frame's image showed of the gel is kept.

        Raises EstimationError, of which FrameError is a kind, if no estimate can be computed, not even by beginning
        anew from the last pose: the contact is over, and the next frame begins another.
        """
        gate, bank = self._gate, self._bank

        # 1. Refuse implausible input, and decide contact.
        frame = checked_frame(frame, measurements, len(self._sensor.tips))
        clearance = bank.clearance(frame.sensor_pose) if gate.needs_clearance(frame) else None
        frame = gate.check(frame, clearance, self._touch.reads_images, self._touch.needs_colours)
        if gate.last is None:
            check_distance(self._first, frame.sensor_pose)
            self._touch.begin(frame.image)

        # 2. End a contact that is over.
        if bank.in_contact and (gate.paused or not frame.contact):
            bank.end_contact(gate.unobserved_push)
            self._touch.end_contact()

        # 3. Read touch, and correct all hypotheses.
        if frame.contact:
            self._contact_step(frame)
        else:
            bank.rest_step(frame.sensor_pose, frame.measurements, frame.time)

        # 4. Report.
        gate.accept(frame)
        self._times.append(frame.time)
        self._contacts.append(bank.in_contact)
        return self._estimate(frame)

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements; auto until the first frame, and if `touch` was given."""
        return self._touch.tactile

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice, in words; empty if the settings named it."""
        return self._touch.reason

    @property
    def unusual_colours(self) -> str:
        """Question about the first image if its colours are in unusual places; empty if all is well.

        Channels may be exchanged, or images turned or mirrored. Nothing is asked of a calibrated view or with a touch
        model of your own.
        """
        return self._touch.question

    @property
    def frame(self) -> Frame:
        """The last frame as it was used: its image in the profile's view, contact as the image shows.

        Raises EstimationError before the first one.
        """
        if self._gate.last is None:
            raise EstimationError(_NO_FRAME)
        return self._gate.last

    @property
    def background(self) -> Background | None:
        """The untouched gel as it is known now; None before the first images, and without images."""
        return self._gate.background

    def smoothed(self) -> Trajectory:
        """Return the object's poses at all frames so far, each corrected by later measurements in its contact.

        Raises EstimationError before the first frame.
        """
        if not self._times:
            raise EstimationError(_NO_FRAME)
        return Trajectory(np.array(self._times), self._bank.path(), contact=np.array(self._contacts, dtype=bool))

    def _contact_step(self, frame: Frame) -> None:
        """Take a frame of contact; if its graph has no solution, begin a new one with it."""
        touch = self._measure(frame)
        try:
            self._bank.contact_step(frame.sensor_pose, (*touch, *frame.measurements), frame.time, len(touch))
        except EstimationError as error:
            self._touch.end_contact()
            touch = self._measure(frame)
            measurements = *touch, *frame.measurements
            try:
                self._bank.begin_anew(frame.sensor_pose, measurements, frame.time, len(touch), error)
            except EstimationError:
                self._touch.end_contact()
                raise

    def _measure(self, frame: Frame) -> Sequence[Measurement]:
        """Return what touch measures at a frame of contact."""
        if self._gate.touches_since_start and self._touch.reads_images:
            return ()
        measured = self._touch.read(frame, self._gate.background)
        return checked_measurements(frame.time, measured, len(self._sensor.tips)) if self._is_touch_given else measured

    def _estimate(self, frame: Frame) -> Estimate:
        """Return the estimate at the last frame."""
        gate, bank, now = self._gate, self._bank, self._bank.report()
        belief = bank.belief
        touch = None
        if bank.in_contact:
            self._touched_at = frame.time
            touch = contact_point(self._contact_model, bank.sensor_in_object, belief, bank.force_angle)
        reasons = gate.doubt, now.reason, gate.weakness, bank.mirrored_reason, self._unread_images(frame)
        status, reason = gate.alarm or (now.status, next(filter(None, reasons), ""))
        grip = 3 + IN_OBJECT[GRIP].start
        return Estimate(
            time=frame.time,
            pose=now.pose,
            covariance=now.covariance + bank.covariance_of_motion(gate.hidden_motion),
            contact=bank.in_contact,
            status=status,
            reason=reason,
            answers=now.answers,
            friction=(float(belief[GRIP][0, 0]), math.sqrt(belief.covariance[0, grip, grip])),
            contact_point=touch and touch.point,
            contact_normal=touch and touch.normal,
            sliding=touch.sliding if touch else math.nan,
            touch_age=frame.time - self._touched_at,
        )

    def _unread_images(self, frame: Frame) -> str:
        """Return the reason why images of a contact are not read, if nobody asked for that; else empty."""
        is_asked = self._touch.tactile != "none" or not self._touch.reason
        if is_asked or not self._bank.in_contact or frame.image is None:
            return ""
        return f"touch says nothing, by the first frame: {self._touch.reason}"
