"""Touch and graph together: one frame in, one estimate out."""

import logging
from collections import deque
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.graph import factors, make_smoother
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import DEPTH, Known, SmootherName
from palpate.recording.frame import Frame
from palpate.recording.measurements import Feeling
from palpate.recording.sensor import SensorProfile
from palpate.recording.trajectory import Trajectory
from palpate.touch.background import Background
from palpate.touch.detector import ContactDetector
from palpate.touch.model import TouchModel
from palpate.touch.modes import Tactile, make_touch
from palpate.touch.relative import Touch

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Status = Literal["resting", "tracking", "strained", "uncertain", "displaced", "indeterminate"]

STRAIN_FRAMES, STRAIN_EXPECTED, STRAIN_LIMIT = 30, 0.5, 4.0
"""Strain is the mean square, over so many frames, of the pushing row that is worst off, in variances. On simulated
pushes, which slide, it is 0.5 and less nine times in ten and 2 at most; a knock by hand makes it 70 and more. Beyond
the limit touch and pushing contradict each other, and the covariance that is reported from then on is larger by the
ratio to what is expected: nothing later measures what has shifted."""
_SURPRISE = 3.0  # standard deviations of a distance from which on an untouched object must have moved
_UNCERTAIN = np.array([0.02, 0.02, 0.2])  # [m, m, rad]; beyond it a linearised covariance is a guess itself
_PAUSE = 10  # intervals without a frame after which a contact is a new one


@dataclass(frozen=True)
class TrackerSettings:
    """How to track."""

    tactile: Tactile = "none"
    """What touch says; see `touch.modes.Tactile`."""
    smoother: SmootherName = "fixed-lag"
    """Sliding window with a bounded time a step, or iSAM2 over each whole contact."""
    noise: GraphNoise = GraphNoise()
    """Standard deviations of the factors."""
    pressure: str | float = "uniform"
    """How the object presses on the table, which gives c; or c itself [m]."""


@dataclass(frozen=True)
class Estimate:
    """The object's pose at one frame."""

    time: float
    """[s]"""
    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    contact: bool
    """Whether the sensor touches the object."""
    status: Status
    """What to make of it.

    - resting: untouched, so unmoved.
    - tracking: all is well.
    - strained: what touch says and how things are pushed contradict each other, or did before (a slip, a knock); the
      covariance is larger by as much.
    - uncertain: the covariance is so large that it is itself a guess.
    - displaced: the object was moved while nothing touched it, and its pose is known no better than the covariance
      says, in this contact and after it.
    - indeterminate: the graph could not be solved at this frame and starts anew from the last pose.
    """


class Tracker:
    """Tracks one object from the frames of one sensor. No input, output or drawing."""

    def __init__(
        self,
        shape: Shape,
        sensor: SensorProfile,
        first_pose: Array,
        settings: TrackerSettings | None = None,
        model: TouchModel | None = None,
        background: Background | None = None,
        touch: Touch | None = None,
    ) -> None:
        """Take the object, the sensor, world_T_object (3,) [m, m, rad] at the first frame, and how to track.

        Learnt touch uses `model`, by default the one that comes with palpate. `background` is the untouched gel of this
        unit, from `palpate calibrate`; without it the first half second of images is taken as untouched. `touch` feels
        in place of what the settings' mode makes.
        """
        settings = settings or TrackerSettings()
        pose = _pose(first_pose)
        if pose is None:
            raise SettingError(
                f"first pose is {first_pose!r}; it must be three finite numbers x [m], y [m], theta [rad]"
            )
        self._noise = settings.noise
        self._sensor = sensor
        self._tips = factors.contact_models(shape, sensor, settings.pressure)
        self._detector = ContactDetector(background)
        self._touch = touch or make_touch(
            settings.tactile, sensor, settings.noise.tactile, settings.noise.constant, model, self._background
        )
        self._smoother = make_smoother(settings.smoother, self._tips, self._noise)
        lasting, deviation = settings.noise.lasting
        variances = np.square(np.concatenate([settings.noise.first_pose, deviation]))
        self._known = Known(pose, lasting, np.diag(variances))
        self._status: Status = "resting"
        self._last: Frame | None = None
        self._interval = 1.0 / sensor.rate  # [s] between the last frames; sensors may be slower than they say
        self._touching = False
        self._errors: deque[Array] = deque(maxlen=STRAIN_FRAMES)
        self._strain = 1.0  # factor on the reported covariance
        self._displacement = 0.0  # [m] by which the object must have moved since it was last touched
        self._times: list[float] = []
        self._contacts: list[bool] = []
        self._smoothed: list[Array] = []  # object poses (n, 3) up to the current graph
        self._filtered: list[Array] = []  # object poses (3,) of the current graph

    def update(self, frame: Frame) -> Estimate:
        """Take the next frame and return the estimate at its time.

        Raises EstimationError where the frame cannot be used (no contact flag, time not after the last frame's, a
        sensor pose that is not finite) or the graph cannot be solved even anew. A frame with an image is in contact
        if the image says so, whatever its flag says.
        """
        frame = self._checked(frame)
        if self._touching and (not frame.contact or self._paused(frame)):
            self._lift()
        if frame.contact:
            self._feel(frame)
        else:
            self._rest(frame)
        self._touching = bool(frame.contact)
        if self._last is not None:
            self._interval = max(1.0 / self._sensor.rate, frame.time - self._last.time)
        self._last = frame
        self._times.append(frame.time)
        self._contacts.append(self._touching)
        covariance = self._strain * self._pose_covariance + (0.0 if self._touching else self._doubt())
        return Estimate(frame.time, self._pose.copy(), covariance, self._touching, self._status)

    def smoothed(self) -> Trajectory:
        """Return all poses so far, each as all later measurements in its contact leave it."""
        parts = [*self._smoothed, *([self._contact_path()] if self._touching else [])]
        poses = np.concatenate(parts) if parts else np.empty((0, 3))
        return Trajectory(np.array(self._times), poses, contact=np.array(self._contacts, dtype=bool))

    def _rest(self, frame: Frame) -> None:
        """The object stays where it is, unless the sensor now stands where it should be."""
        self._smoothed.append(self._pose[None])
        gap, sigma = self._gap(frame)
        if gap < -_SURPRISE * sigma:
            self._displacement = max(self._displacement, -gap)
        self._status = "displaced" if self._displacement else "resting"

    def _feel(self, frame: Frame) -> None:
        """Add a frame of contact to the graph."""
        feeling = self._touch.feel(frame)
        try:
            if self._touching:
                self._smoother.add(frame.sensor_pose, feeling)
            else:
                self._begin(frame, feeling)
        except EstimationError as error:
            self._begin_anew(frame, error)
        else:
            self._status = "displaced" if self._displacement else "tracking"
        self._take_belief()

    def _begin(self, frame: Frame, feeling: Feeling) -> None:
        """Start the graph of a contact from the last marginal."""
        gap, sigma = self._gap(frame)
        if abs(gap) > _SURPRISE * sigma:
            self._displacement = max(self._displacement, abs(gap))
        self._known = self._known.loosened(np.diag(np.square(self._noise.rest)) + self._doubt())
        self._smoother.begin(frame.sensor_pose, self._known, feeling)

    def _doubt(self) -> Array:
        """Covariance (3, 3) of what may have moved the untouched object: twice what the gap shows along one line."""
        return self._moved_by(2.0 * self._displacement)

    def _moved_by(self, length: float) -> Array:
        """Covariance (3, 3) of an unknown motion of this size [m]."""
        return np.diag(np.square([length, length, length / self._tips[0].friction_radius]))

    def _begin_anew(self, frame: Frame, error: EstimationError) -> None:
        """Go on with a new graph from the last pose, where the old one could not be solved."""
        reason = (
            f"frame at {frame.time:.3f} s: {error}; the likely reason is a motion that pushing, contact and touch "
            "together leave undetermined, or a sensor pose far from the object"
        )
        logger.warning("%s; starting a new graph from the last pose", reason)
        self._smoothed.extend(pose[None] for pose in self._filtered)
        self._filtered.clear()
        self._touch.lift()
        feeling = self._touch.feel(frame)
        pushed = 0.0 if self._last is None else float(np.hypot(*(frame.sensor_pose - self._last.sensor_pose)[:2]))
        self._known = self._known.loosened(self._moved_by(pushed))
        self._errors.clear()
        try:
            self._smoother.begin(frame.sensor_pose, self._known, feeling)
        except EstimationError:
            self._touching = False
            raise EstimationError(reason) from error
        self._status = "indeterminate"

    def _take_belief(self) -> None:
        """Turn the belief about g and e into what is known of the object."""
        self._known = self._smoother.belief().known
        self._errors.append(self._smoother.pushing_error() ** 2)
        strain = float(np.max(np.sum(self._errors, axis=0)[:3])) / STRAIN_FRAMES  # sticking and the balance
        if strain > STRAIN_LIMIT:
            self._strain = max(self._strain, strain / STRAIN_EXPECTED)
        if self._status == "tracking":
            if (np.diagonal(self._strain * self._pose_covariance) > _UNCERTAIN**2).any():
                self._status = "uncertain"
            elif self._strain > 1.0:
                self._status = "strained"
        self._filtered.append(self._pose)

    def _lift(self) -> None:
        self._smoothed.append(self._contact_path())
        self._filtered.clear()
        self._errors.clear()
        self._displacement = 0.0
        self._touch.lift()
        self._touching = False

    def _contact_path(self) -> Array:
        g, e = self._smoother.path()
        return se2.compose(e, se2.inverse(g))

    def _gap(self, frame: Frame) -> tuple[float, float]:
        """Estimated distance between sensor and object, and its standard deviation, both [m].

        The strain is left out: it puts pushing in doubt, not where the outline was last touched.
        """
        g = se2.between(self._pose, frame.sensor_pose)
        depth = self._known.lasting[DEPTH]
        nearest = min((factors.touching(g, tip) for tip in self._tips), key=lambda touch: float(touch.gap))
        by_object = -nearest.gap_by_g @ se2.adjoint(se2.inverse(g))
        variance = by_object @ self._pose_covariance @ by_object + self._noise.contact**2
        return float(nearest.gap) + depth, float(np.sqrt(variance))

    @property
    def _pose(self) -> Array:
        return self._known.pose

    @property
    def _pose_covariance(self) -> Array:
        return self._known.covariance[:3, :3]

    def _background(self) -> Background:
        """The untouched gel; it is known before the first contact that the detector finds."""
        background = self._detector.background
        assert background is not None
        return background

    def _paused(self, frame: Frame) -> bool:
        return self._last is not None and frame.time - self._last.time > _PAUSE * self._interval

    def _checked(self, frame: Frame) -> Frame:
        """The frame with contact as its image tells, and a pose of its own, so that a sensor may reuse its buffers."""
        last = -np.inf if self._last is None else self._last.time
        if not last < frame.time < np.inf:
            raise EstimationError(f"frame at {frame.time:.3f} s follows one at {last:.3f} s; times must increase")
        if frame.contact is None and frame.image is None:
            raise EstimationError(
                f"frame at {frame.time:.3f} s has neither an image nor a contact flag; the tracker needs one of them"
            )
        pose = _pose(frame.sensor_pose)
        if pose is None:
            raise EstimationError(
                f"frame at {frame.time:.3f} s has sensor pose {frame.sensor_pose}; it must be three finite numbers"
            )
        contact = frame.contact if frame.image is None else self._detector.update(frame.image)
        return replace(frame, sensor_pose=pose, contact=contact)


def _pose(given: object) -> Array | None:
    """A copy of three finite numbers as an array (3,), or None if they are not that."""
    try:
        pose = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return pose if pose.shape == (3,) and np.isfinite(pose).all() else None
