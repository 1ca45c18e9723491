"""Stream, touch and estimation together: one frame in, one estimate out."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import TrackerSettings
from palpate.errors import EstimationError
from palpate.filter.belief import Prior
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.filter.mirrored_images import MirroredImages
from palpate.geometry.shapes import Shape
from palpate.graph.contact_geometry import contact_model
from palpate.graph.smoother import IN_A_WINDOW
from palpate.graph.variables import GRIP, IN_OBJECT
from palpate.graph.warm_up import warm_up
from palpate.input_gate import InputGate, checked_frame, checked_measurements
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, correction_of
from palpate.touch.camera_view import unusual_colours
from palpate.touch.model import TouchModel
from palpate.touch.modes import Tactile, TactileChoice, chosen, expected, make_touch
from palpate.touch.relative import Touch
from palpate.tracker_arguments import ask_how_far, check_arguments, first_pose_of, with_correction
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame
from palpate.types.measurements import Measurement
from palpate.types.sensor import SensorProfile, known_sensor
from palpate.types.trajectory import Trajectory

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
        """Take the object, the sensor, world_T_object (3,) [m, m, rad] at the first frame, and how to track.

        `first_pose_sigma` (3,) [m, m, rad] is how well the first pose is known, standard deviations in the object's
        frame; by default as well as `noise.first_pose` says. A rough one is found by touch. A first pose of None is
        anywhere within a metre of the world's origin, at any yaw. `sensor` is a profile or a known name.

        Learnt touch uses `model`, by default the one that comes with palpate. `calibration` is what is known of
        this unit, from `palpate calibrate`; without it the first half second of images is taken as untouched.
        `touch` is an object of your own that measures in place of what `settings.tactile` names. The first tracker of a
        process takes half a second to load compiled code, and the very first of a machine some 20 s to compile it.
        """
        check_arguments(shape, settings, model, calibration, touch)
        settings, sensor = settings or TrackerSettings(), known_sensor(sensor)
        self._first = first_pose_of(first_pose, first_pose_sigma, settings)
        warm_up(settings.smoother)
        self._shape, self._sensor, self._settings, self._model = shape, sensor, settings, model
        self._gate = InputGate(sensor, calibration, settings.noise.sensor_pose.deviation)
        self._correction = correction_of(calibration)
        self._contact_model = contact_model(shape, sensor, settings.pressure)
        self._tactile: TactileChoice = settings.tactile
        self._tactile_reason = self._unusual_colours = ""
        self._is_touch_given = touch is not None
        self._is_view_known = calibration is not None and calibration.is_view_known
        is_open = not (self._is_view_known or self._is_touch_given)
        self._mirrored_images = MirroredImages(looks=is_open and settings.smoother in IN_A_WINDOW)
        # Networks are opened now and not in a robot's loop, where images may come to them.
        self._touch = touch or self._make_touch(expected(settings.tactile, sensor, model))
        self._begin()

    def reset(self, pose: ArrayLike | None = None, sigma: ArrayLike | None = None) -> None:
        """Begin anew with the same sensor, settings and untouched gel, at whatever time the next frame has.

        Images that were found to lie turned still do.
        `pose` (3,) is world_T_object [m, m, rad] then, with standard deviations `sigma` (3,); by default the pose and
        sigma that it last began with. A `pose` without `sigma` is known as well as `noise.first_pose` says.
        """
        if pose is not None or sigma is not None:
            self._first = first_pose_of(self._first[0] if pose is None else pose, sigma, self._settings)
        self._forget_contact()
        self._gate.reset()
        self._begin()

    def _begin(self) -> None:
        """Begin with nothing known of the object but the first pose."""
        settings = self._settings
        noise = with_correction(settings.noise, self._correction)
        self._estimator = Hypotheses(self._contact_model, noise, settings.smoother, *self._first, settings.hypotheses)
        self._touched_at = -math.inf  # [s] time of the last frame of contact
        self._times: list[float] = []
        self._contacts: list[bool] = []

    def update(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> Estimate:
        """Take the next frame and return the estimate at its time.

        `measurements` are what others than touch say, beside those of the frame itself: a camera's `ObjectPose`, or
        your own. A frame with an image is in contact if the image says so, whatever its flag says.

        Raises FrameError where the frame cannot be used: a time not after the last frame's, a pose that is not finite,
        neither image nor contact flag, an image of another size, a measurement of a wrong kind. The frame is left out,
        and later estimates are the same to the last digit as if it had not come. One exception: if a pose is refused
        because it leaps in a contact, what that frame's image showed of the gel is kept.

        Raises EstimationError, of which FrameError is a kind, where no estimate can be computed, not even by beginning
        anew from the last pose: the contact is over, and the next frame begins another.
        """
        gate = self._gate
        frame = checked_frame(frame, measurements, len(self._sensor.tips))
        clearance = self._estimator.gap(frame.sensor_pose) if gate.needs_clearance(frame) else None
        frame = gate.check(frame, clearance, reads_images=self._feels, needs_colours=self._model is None)
        if gate.last is None:
            ask_how_far(self._first, frame.sensor_pose)
        self._choose_touch(frame)
        if self._estimator.in_contact and (gate.paused or not frame.contact):
            self._estimator.end_contact(gate.unobserved_push)
            self._forget_contact()
        if frame.contact:
            self._touch_object(frame)
        else:
            self._estimator.rest(frame.sensor_pose, frame.measurements, frame.time)
        gate.accept(frame)
        self._times.append(frame.time)
        self._contacts.append(self._estimator.in_contact)
        return self._estimate(frame.time)

    def save(self, path: Path | str) -> None:
        """Write all that is known, so that a process that restarts goes on with the same estimates to the last digit.

        The file is written whole or not at all, replaces an earlier one and holds no code. Raises SettingError, in one
        sentence, where something cannot be saved: the particle filter, a contact solved by iSAM2 or with measurements
        of your own in it, touch of your own.
        """
        from palpate.tracker_state import save_tracker

        save_tracker(self, path)

    @staticmethod
    def load(path: Path | str) -> "Tracker":
        """Return the tracker that `save` wrote; raises FileError on anything else, or of another version of palpate."""
        from palpate.tracker_state import load_tracker

        return load_tracker(path)

    @property
    def tactile(self) -> TactileChoice:
        """What touch says; of settings that say auto, what was chosen at the first frame.

        It is auto before that, and where touch was given in place of what settings make.
        """
        return self._tactile

    @property
    def tactile_reason(self) -> str:
        """Why that was chosen, in words; empty where the settings named it."""
        return self._tactile_reason

    @property
    def unusual_colours(self) -> str:
        """What is unusual about where the first image has its colours, as a question; empty where nothing is.

        Channels may be exchanged, or images lie turned or mirrored. Nothing is asked of a unit that presses have shown
        how its images lie, nor with a touch model of one's own.
        """
        return self._unusual_colours

    @property
    def frame(self) -> Frame:
        """The last frame as it was taken: its image as the profile's lie, contact as the image tells.

        Raises EstimationError before the first one.
        """
        if self._gate.last is None:
            raise EstimationError(_NO_FRAME)
        return self._gate.last

    @property
    def background(self) -> Background | None:
        """The untouched gel as it is known now; None before the first images have told, and without images."""
        return self._gate.background

    def smoothed(self) -> Trajectory:
        """Return the object's poses at all frames so far, each corrected by what was measured later in its contact.

        Raises EstimationError before the first one.
        """
        if not self._times:
            raise EstimationError(_NO_FRAME)
        contact = np.array(self._contacts, dtype=bool)
        return Trajectory(np.array(self._times), self._estimator.path(), contact=contact)

    def _touch_object(self, frame: Frame) -> None:
        """Take a frame of contact, the first of one or the next; in a graph without a solution, as the first."""
        told = self._told(frame)
        estimator = self._estimator = self._mirrored_images.see(self._estimator, frame, told)
        try:
            estimator.touch(frame.sensor_pose, self._measured(frame, told), frame.time)
        except EstimationError as error:
            self._touch.end_contact()
            said = self._measured(frame, self._told(frame))
            try:
                estimator.begin_anew(frame.sensor_pose, said, frame.time, error)
            except EstimationError:
                self._forget_contact()
                raise

    def _estimate(self, time: float) -> Estimate:
        """What is known at the last frame, of this time [s]."""
        estimator, gate, touched = self._estimator, self._gate, self._estimator.touched
        if touched:
            self._touched_at = time
        weaknesses = gate.weakness, self._mirrored_images.reason, self._unread
        reasons = gate.doubt, estimator.reason, *weaknesses
        status, reason = gate.alarm or (estimator.status, next(filter(None, reasons), ""))
        return Estimate(
            time=time,
            pose=estimator.known.pose.copy(),
            covariance=estimator.covariance + estimator.covariance_of_motion(gate.hidden_motion),
            contact=estimator.in_contact,
            status=status,
            reason=reason,
            answers=estimator.answers,
            friction=_friction(estimator.known),
            contact_point=touched and touched.point,
            contact_normal=touched and touched.normal,
            sliding=touched.sliding if touched else math.nan,
            touch_age=time - self._touched_at,
        )

    def _forget_contact(self) -> None:
        """Forget what touch told in a contact that is over."""
        self._touch.end_contact()
        self._mirrored_images.end_contact()

    @property
    def _unread(self) -> str:
        """Why touch says nothing of the images of a contact, where nobody asked for that; nothing where all is well."""
        is_seen = self._estimator.in_contact and self.frame.image is not None
        if self._tactile != "none" or not self._tactile_reason or not is_seen:
            return ""
        return f"touch says nothing, by the first frame: {self._tactile_reason}"

    @property
    def _feels(self) -> bool:
        """Whether a model reads images."""
        return self._tactile.startswith("learnt") and not self._is_touch_given

    def _told(self, frame: Frame) -> Sequence[Measurement]:
        """What touch tells of a frame of contact; nothing where it has not felt it begin."""
        if self._gate.touches_since_start and self._feels:
            return ()
        told = self._touch.measure(frame)
        return checked_measurements(frame.time, told, len(self._sensor.tips)) if self._is_touch_given else told

    def _measured(self, frame: Frame, told: Sequence[Measurement]) -> Sequence[Measurement]:
        """All that is measured at a frame of which touch tells this."""
        return (*self._mirrored_images.believed(told), *frame.measurements)

    def _choose_touch(self, frame: Frame) -> None:
        """Settle what the settings leave open, at the first frame, and note what is unusual about its colours."""
        if self._gate.last is not None:
            return
        if self._tactile == "auto" and not self._is_touch_given:
            self._settle_touch(*chosen(frame.image, self._sensor, self._model))
        if self._feels and frame.image is not None and self._model is None and not self._is_view_known:
            self._unusual_colours = unusual_colours(frame.image, self._sensor)

    def _settle_touch(self, tactile: Tactile, reason: str) -> None:
        self._tactile, self._tactile_reason = tactile, reason
        if tactile == "none":
            self._touch = self._make_touch("none")

    def _known_background(self) -> Background:
        assert self._gate.background is not None  # it is known before the first contact that an image shows
        return self._gate.background

    def _make_touch(self, tactile: Tactile) -> Touch:
        given = self._settings.noise.relative_pose
        known = self._sensor, given.oracle, given.constant, self._model, self._known_background, self._correction
        return make_touch(tactile, *known, given.linear)


def _friction(known: Prior) -> tuple[float, float]:
    place = IN_OBJECT[GRIP].start
    return float(known.values[place]), math.sqrt(known.covariance[3 + place, 3 + place])
