"""Touch and estimation together: one frame in, one estimate out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import EstimationError, FrameError, SettingError
from palpate.estimate import Estimate
from palpate.estimation.belief import Prior
from palpate.estimation.contact_model import contact_model
from palpate.estimation.hypotheses import Hypotheses
from palpate.estimation.settings import NoiseSettings
from palpate.estimation.smoother import SmootherName
from palpate.estimation.unknowns import GRIP, IN_OBJECT
from palpate.estimation.warm_up import warm_up
from palpate.geometry.shapes import Shape
from palpate.recording.frame import Frame
from palpate.recording.measurements import Measurement
from palpate.recording.sensor import SensorProfile
from palpate.recording.trajectory import Trajectory
from palpate.touch.background import Background
from palpate.touch.calibration import AS_TOLD, Calibration, view_of
from palpate.touch.detector import detector_for
from palpate.touch.model import TouchModel
from palpate.touch.modes import Tactile, make_touch
from palpate.touch.relative import Touch

Array = NDArray[np.float64]

_ANYWHERE, _ANYWHERE_SIGMA = (0.0, 0.0, 0.0), (1.0, 1.0, 2.0)  # [m, m, rad]
_PAUSE = 10  # intervals without a frame after which a contact is a new one


@dataclass(frozen=True)
class TrackerSettings:
    """How to track; raises SettingError on a word that is not known."""

    tactile: Tactile = "none"
    """What touch says; see `touch.modes.Tactile`."""
    smoother: SmootherName = "fixed-lag"
    """How the graph of a contact is solved; see `estimation.smoother.SmootherName`."""
    noise: NoiseSettings = NoiseSettings()
    """How much each factor is believed."""
    pressure: str | float = "uniform"
    """How the object presses on the table, which gives c; or c itself [m]."""
    hypotheses: int = 9
    """How many answers are kept at most while touch cannot tell which is right; 1 keeps one whatever happens."""

    def __post_init__(self) -> None:
        for name, allowed in (("tactile", get_args(Tactile)), ("smoother", get_args(SmootherName))):
            if (found := getattr(self, name)) not in allowed:
                raise SettingError(f"{name} is {found!r}; allowed are {', '.join(allowed)}")
        if self.hypotheses < 1:
            raise SettingError(f"hypotheses is {self.hypotheses!r}; allowed is 1 or more")


class Tracker:
    """Tracks one object from the frames of one sensor. No input, output or drawing."""

    def __init__(
        self,
        shape: Shape,
        sensor: SensorProfile,
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
        anywhere within a metre of the world's origin, at any yaw.

        Learnt touch uses `model`, by default the one that comes with palpate. `calibration` is what is known of
        this unit, from `palpate calibrate`; without it the first half second of images is taken as untouched.
        `touch` says what is touched in place of what the settings' mode makes. The first tracker of a process takes
        half a second to load compiled code, and the very first of a machine some 20 s to compile it.
        """
        settings = settings or TrackerSettings()
        pose = _pose(_ANYWHERE if first_pose is None else first_pose)
        if pose is None:
            raise SettingError(
                f"first pose is {first_pose!r}; it must be three finite numbers x [m], y [m], theta [rad], or None"
            )
        if first_pose_sigma is None:
            first_pose_sigma = _ANYWHERE_SIGMA if first_pose is None else settings.noise.first_pose.deviation
        sigma = _pose(first_pose_sigma)
        if sigma is None or not (sigma > 0.0).all():
            raise SettingError(
                f"first pose sigma is {first_pose_sigma!r}; it must be three numbers above 0: x [m], y [m], theta [rad]"
            )
        warm_up(settings.smoother)
        self._sensor = sensor
        self._detector, self._view = detector_for(sensor, calibration), view_of(calibration)
        correction = calibration.direction if calibration else AS_TOLD
        without_images = settings.noise.relative_pose
        self._touch = touch or make_touch(
            settings.tactile,
            sensor,
            without_images.oracle,
            without_images.constant,
            model,
            self._known_background,
            correction,
        )
        contact = contact_model(shape, sensor, settings.pressure)
        noise = _with_offset(settings.noise, correction.offset_sigma)
        self._estimator = Hypotheses(contact, noise, settings.smoother, pose, sigma, settings.hypotheses)
        self._last: Frame | None = None
        self._interval = 1.0 / sensor.rate  # [s] between the last frames; sensors may be slower than they say
        self._touched_at = -math.inf  # [s] time of the last frame of contact
        self._times: list[float] = []
        self._contacts: list[bool] = []

    def update(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> Estimate:
        """Take the next frame and return the estimate at its time.

        `measurements` are what others than touch say, beside those of the frame itself: a camera's `ObjectPose`, or
        your own. Raises EstimationError where the frame cannot be used (no contact flag, time not after the last
        frame's, a sensor pose that is not finite) or the graph cannot be solved even anew. A frame with an image is in
        contact if the image says so, whatever its flag says.
        """
        frame, estimator = self._checked(frame), self._estimator
        others = (*frame.measurements, *measurements)
        if estimator.in_contact and (not frame.contact or self._paused(frame)):
            estimator.end_contact()
            self._touch.end_contact()
        if frame.contact:
            said = (*self._touch.measure(frame), *others)
            try:
                estimator.touch(frame.sensor_pose, said, frame.time)
            except EstimationError as error:
                self._touch.end_contact()
                said = (*self._touch.measure(frame), *others)
                estimator.begin_anew(frame.sensor_pose, said, frame.time, error)
        else:
            estimator.rest(frame.sensor_pose, others, frame.time)
        if self._last is not None:
            self._interval = max(1.0 / self._sensor.rate, frame.time - self._last.time)
        self._last = frame
        self._times.append(frame.time)
        self._contacts.append(estimator.in_contact)
        return self._estimate(frame.time)

    @property
    def frame(self) -> Frame:
        """The last frame as it was taken: its image as the profile's lie, contact as the image tells."""
        assert self._last is not None
        return self._last

    @property
    def background(self) -> Background | None:
        """The untouched gel as it is known now; None before the first images have told, and without images."""
        return self._detector.background

    def smoothed(self) -> Trajectory:
        """Return all poses so far, each as all later measurements in its contact leave it."""
        contact = np.array(self._contacts, dtype=bool)
        return Trajectory(np.array(self._times), self._estimator.path(), contact=contact)

    def _estimate(self, time: float) -> Estimate:
        """What is known at the last frame, of this time [s]."""
        estimator, touched = self._estimator, self._estimator.touched
        if touched:
            self._touched_at = time
        return Estimate(
            time,
            estimator.known.pose.copy(),
            estimator.covariance,
            estimator.in_contact,
            estimator.status,
            estimator.reason,
            estimator.answers,
            _friction(estimator.known),
            touched and touched.point,
            touched and touched.normal,
            touched.sliding if touched else math.nan,
            time - self._touched_at,
        )

    def _known_background(self) -> Background:
        """The untouched gel; it is known before the first contact that the detector finds."""
        assert self.background is not None
        return self.background

    def _paused(self, frame: Frame) -> bool:
        return self._last is not None and frame.time - self._last.time > _PAUSE * self._interval

    def _checked(self, frame: Frame) -> Frame:
        """The frame with contact as its image tells, and a pose of its own, so that a sensor may reuse its buffers."""
        last = -np.inf if self._last is None else self._last.time
        if not last < frame.time < np.inf:
            raise FrameError(f"frame at {frame.time:.3f} s follows one at {last:.3f} s; times must increase")
        if frame.contact is None and frame.image is None:
            raise FrameError(
                f"frame at {frame.time:.3f} s has neither an image nor a contact flag; the tracker needs one of them"
            )
        pose = _pose(frame.sensor_pose)
        if pose is None:
            raise FrameError(
                f"frame at {frame.time:.3f} s has sensor pose {frame.sensor_pose}; it must be three finite numbers"
            )
        image = None if frame.image is None else self._view.of(frame.image)
        contact = frame.contact if image is None else self._detector.update(image)
        return replace(frame, sensor_pose=pose, contact=contact, image=image)


def _with_offset(noise: NoiseSettings, sigma: float | None) -> NoiseSettings:
    """The settings with what is left unknown of a direction's offset after a calibration, [rad]."""
    if sigma is None:
        return noise
    return replace(noise, priors=replace(noise.priors, direction_bias=(0.0, sigma)))


def _friction(known: Prior) -> tuple[float, float]:
    place = IN_OBJECT[GRIP].start
    return float(known.values[place]), math.sqrt(known.covariance[3 + place, 3 + place])


def _pose(given: object) -> Array | None:
    """A copy of three finite numbers as an array (3,), or None if they are not that."""
    try:
        pose = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return pose if pose.shape == (3,) and np.isfinite(pose).all() else None
