"""Input gate: refuses implausible frames and decides contact, before the estimator sees a frame."""

import logging
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.checks import FARTHEST
from palpate.config import LARGEST_ERROR, UNLIKELY
from palpate.errors import FileError, FrameError, PalpateError, SettingError
from palpate.models.pushing.own_measurements import check_own
from palpate.stream_monitor import PoseMonitor
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.cells import is_dark, is_grey
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.pipeline import GREY
from palpate.types.measurements import (
    Frame,
    Measurement,
    OwnMeasurement,
    TouchMeasurement,
    finite_number,
    finite_numbers,
)
from palpate.types.sensor import SensorProfile
from palpate.types.space import gel_pose

logger = logging.getLogger(__name__)


class InputGate:
    """Checks the frames of one sensor: `check` returns one as it can be used, `accept` makes it the last one."""

    def __init__(self, sensor: SensorProfile, calibration: Calibration | None) -> None:
        self._rate = sensor.rate
        self._detector = ContactDetector(sensor, calibration)
        self._begin()

    @property
    def needs_clearance(self) -> bool:
        """True if `check` needs the clearance, as images that may show a touch are to be taken as untouched."""
        return self._may_show_touch or self.background is None or self._detector.new_view is not None

    def reset(self) -> None:
        """Start again at any time; the untouched gel stays known unless its images may show a touch."""
        if self._may_show_touch:
            self._detector.forget()
        self._begin()

    def _begin(self) -> None:
        self._poses = PoseMonitor(self._rate)
        self._may_show_touch = self._detector.background is None  # of the first images, taken as untouched
        self._has_touched = False
        self.last: Frame | None = None
        """The last accepted frame."""
        self.paused = False
        """True if the sensor was not observed before the checked frame, so that a contact in it is a new one."""
        self.touches_since_start = False
        """True in a contact since before the untouched gel was known, so touch cannot measure."""
        self.hidden_motion = 0.0
        """Distance that the sensor may have moved in a contact while its pose was frozen [m]."""
        self.unobserved_push = 0.0
        """Distance by which the object may have been pushed while not observed [m], if a contact ends now."""
        self.doubt = self.weakness = ""
        """Reason to doubt the calibration's untouched gel, and a weakness of the stream; empty if all is well."""

    def check(
        self,
        frame: Frame,
        clearance: tuple[float, float] | None = None,
        reads_images: bool = False,
        needs_colours: bool = False,
    ) -> Frame:
        """Return a frame from `checked_frame` with its image in the profile's view, and contact as the image shows.

        `clearance` is the predicted distance between sensor and object and its standard deviation [m]. Raises
        FrameError if the frame cannot be used.
        """
        when, last = f"frame at {frame.time:.3f} s", self.last
        if last is not None and frame.time <= last.time:
            raise FrameError(f"{when} follows one at {last.time:.3f} s; times must increase")
        self._poses.check_time(frame.time)
        image, contact, touches_since_start = frame.image, bool(frame.contact), False
        if image is not None:
            image, contact = self._detector.read(image), False
            try:
                if reads_images and needs_colours and last is None and is_grey(image) and not is_dark(image):
                    raise SettingError(GREY)
                contact = self._detector.update(image)
            except SettingError as error:
                if not self._learns_anew(clearance):
                    raise FrameError(f"{when}: {error}") from error
            if clearance is not None and (self._may_show_touch or self.background is None):
                touches_since_start = self._touches_since_start(*clearance, contact)
            contact = contact or touches_since_start
        elif reads_images and contact:
            raise FrameError(f"{when} has no image, and learnt touch needs one")
        self.paused = self._poses.check_pose(frame.time, frame.sensor_pose, contact)
        has_drawn_back = self._poses.drawn_back > LARGEST_ERROR[0]  # which it could not in contact, as it cannot pull
        unseen = max(self.hidden_motion, LARGEST_ERROR[0] if has_drawn_back else 0.0)
        self.unobserved_push = self._poses.pushed if self.paused else unseen
        self.touches_since_start, self.hidden_motion = touches_since_start, self._poses.hidden
        if image is not None and has_drawn_back:
            self._detector.forget()  # the gel or the light has changed
            contact = self._may_show_touch = self.touches_since_start = False
        return frame if image is None else replace(frame, image=image, contact=contact)

    def _touches_since_start(self, distance: float, deviation: float, in_contact: bool) -> bool:
        if self.touches_since_start:
            return True
        came_later = in_contact if self.background is not None else distance >= UNLIKELY * deviation
        self._may_show_touch = not came_later
        # Mounting and outline may be wrong by some millimetres.
        return self._may_show_touch and distance < -max(deviation, LARGEST_ERROR[0])

    def _learns_anew(self, clearance: tuple[float, float] | None) -> bool:
        """Take a new steady view as the untouched gel, unless something may touch."""
        if clearance is None or self._detector.new_view is None:
            return False
        distance, deviation = clearance
        if self._has_touched and distance < UNLIKELY * deviation + LARGEST_ERROR[0]:
            return False
        logger.warning("the untouched gel is learnt anew, from images that are steady and unlike it")
        self._detector.take(self._detector.new_view)
        self._may_show_touch = distance < UNLIKELY * deviation
        return True

    def accept(self, frame: Frame) -> None:
        """Make a checked frame the last one."""
        self.last, self.doubt = frame, self._detector.doubt
        self._has_touched = self._has_touched or bool(frame.contact)
        self.weakness = self._poses.weakness(bool(frame.contact) and frame.image is not None and not self.paused)

    @property
    def background(self) -> Background | None:
        """The untouched gel as known now; None before the first images, and without images."""
        return self._detector.background


def checked_frame(frame: Frame, measurements: Any, tips: int) -> Frame:
    """Return a copy of a frame, so that a driver may reuse its arrays, with further measurements added.

    `tips` is the sensor's number of tips. Raises FrameError on a value that is not allowed.
    """
    if not isinstance(frame, Frame):
        raise FrameError(f"found {type(frame).__name__} in place of a frame; allowed is palpate.Frame(time, ...)")
    time = None if isinstance(frame.time, bool) else finite_number(frame.time)
    if time is None:
        raise FrameError(f"frame has time {frame.time!r}; it must be a finite number [s]")
    when, image = f"frame at {time:.3f} s", frame.image
    pose, object_pose = _planar(when, frame.sensor_pose), frame.object_pose
    if frame.contact is None and image is None:
        raise FrameError(f"{when} has neither an image nor a contact flag; the tracker needs one of them")
    if not isinstance(frame.contact, bool | np.bool_ | None):
        raise FrameError(f"{when} has contact {frame.contact!r}; it must be True, False or None")
    if pose is None or (np.abs(pose) > FARTHEST).any():
        allowed = f"three finite numbers x [m], y [m], theta [rad], up to {FARTHEST:g}"
        raise FrameError(f"{when} has sensor pose {frame.sensor_pose}; it must be {allowed}")
    is_array = isinstance(image, np.ndarray)
    if image is not None and not (is_array and image.dtype == np.uint8 and image.ndim == 3):
        found = f"{image.dtype} {image.shape}" if is_array else f"type {type(image).__name__}"
        allowed = "an array of uint8 (height, width, 3): rows, columns, red green blue; decode encoded images first"
        raise FrameError(f"{when} has an image of {found}; it must be {allowed}")
    added = (checked_measurements(time, each, tips) for each in (frame.measurements, measurements))
    return replace(
        frame,
        time=time,
        sensor_pose=pose,
        contact=None if frame.contact is None else bool(frame.contact),
        object_pose=None if object_pose is None else _planar(when, object_pose),  # NaN where a camera loses the object
        measurements=tuple(chain.from_iterable(added)),
    )


def _planar(when: str, pose: Any) -> Array | None:
    """Return a pose in the plane, or one in space (7,) or (4, 4) as one; None if it is neither."""
    found = finite_numbers(pose, (3,))
    if found is not None or all(finite_numbers(pose, shape) is None for shape in ((7,), (4, 4))):
        return found
    try:
        return gel_pose(pose)
    except FileError as error:
        raise FrameError(f"{when}: {error}") from error


def checked_measurements(time: float, measurements: Any, tips: int) -> tuple[Measurement, ...]:
    """Return the measurements of a frame as a tuple; raises FrameError on one that is not allowed."""
    when = f"frame at {time:.3f} s"
    try:
        several = (measurements,) if isinstance(measurements, Measurement) else tuple(measurements)
    except TypeError:
        found = type(measurements).__name__
        raise FrameError(f"{when} has measurements of type {found}; they must be a list of measurements") from None
    for one in several:
        kind = type(one).__name__
        if not isinstance(one, Measurement):
            raise FrameError(f"{when} has a measurement of type {kind}; allowed are palpate's, as ObjectPose")
        if tips > 1 and isinstance(one, TouchMeasurement):
            raise FrameError(f"{when} has a measurement {kind}, which is of one tip, and the sensor has {tips}")
        try:
            if isinstance(one, OwnMeasurement):
                check_own(one)
        except PalpateError as error:
            raise FrameError(f"{when}: {error}") from error
    return several
