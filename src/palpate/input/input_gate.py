"""Input gate: refuses implausible frames and decides contact, before the estimator sees a frame."""

import logging
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from palpate.arrays import Array, Image, changed
from palpate.config import LARGEST_ERROR, UNLIKELY
from palpate.errors import FrameError, SettingError
from palpate.input.checked_frame import CheckedFrame, CorrectedFrame
from palpate.input.pose_monitor import PoseMonitor, SensorMotion
from palpate.input.push_direction import PushDirection
from palpate.input.touch_changes import TouchChanges
from palpate.input.unseen_contact import UnseenContact
from palpate.status import InputEvidence
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.cells import is_dark, is_grey
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.reader import GREY
from palpate.types.estimate import Clearance
from palpate.types.measurements import Frame, Measurement
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)

_NOTICEABLE = LARGEST_ERROR[0]
"""[m] Motion that is more than errors of mounting and outline."""
_WELL_INSIDE = 2.0
"""Standard deviations by which a sensor is inside the outline if it touched since before the gel was known. With one, 3
of 100 pushes from a first pose that was some millimetres off were taken for such."""


class Predicted(Protocol):
    """Prediction of where the sensor is to the object."""

    def clearance(self, sensor_pose: Array) -> Clearance:
        """Return the predicted distance of a sensor pose (3,) from the object."""
        ...

    def withdrawal(self, sensor_pose: Array) -> float:
        """Return the motion of the sensor out of the object since the last frame, if the object rests [m]."""
        ...


class _Seen(NamedTuple):
    """Contact in a frame, by its image if it has one."""

    image: Image | None
    """The image in the profile's view."""
    contact: bool
    touches_since_start: bool
    """True if the contact lasts since before the untouched gel was known, so that touch cannot measure."""


class InputGate:
    """Checks the frames of one sensor: `check` returns one as it can be used, `accept` makes it the last one."""

    def __init__(
        self,
        sensor: SensorProfile,
        calibration: Calibration | None,
        seek_markers: bool = True,
        only_pushes: bool = True,
    ) -> None:
        """Take the sensor; one that does not only push may move any way in contact, as it holds the object."""
        self._rate = sensor.rate
        self._only_pushes = only_pushes
        self._detector = ContactDetector(sensor, calibration, seek_markers)
        self._begin()

    @property
    def background(self) -> Background | None:
        """The untouched gel as known now; None before the first images, and without images."""
        return self._detector.background

    def reset(self) -> None:
        """Start again at any time; the untouched gel stays known unless its images may show a touch."""
        if self._may_show_touch:
            self._detector.forget()
        self._begin()

    def _begin(self) -> None:
        self._poses = PoseMonitor(self._rate, self._only_pushes)
        self._push = PushDirection()
        self._changes = TouchChanges(self._rate)
        # The first images, taken as untouched, may show a touch.
        self._may_show_touch = self._detector.background is None
        self._has_touched = False
        self._touches_since_start = False
        self._hidden_motion = 0.0
        self._unseen = UnseenContact()
        self.last: Frame | None = None
        """The last accepted frame."""

    def check(
        self,
        corrected: CorrectedFrame,
        predicted: Predicted,
        reads_images: bool = False,
        needs_colours: bool = False,
        closed: float = 0.0,
    ) -> CheckedFrame:
        """Return a frame with its image in the profile's view, contact as the image shows it, and what was found.

        `predicted` says where the sensor is to the object, as known so far. `reads_images` says that touch is measured
        in images, and `needs_colours` that grey ones will not do. A finger that holds the object with another has
        `closed` in the hand by so much [m] since the frame before. Raises FrameError if the frame cannot be used.
        """
        frame = corrected.frame
        self._check_time(frame)
        seen = self._seen(frame, predicted, reads_images, needs_colours)
        goes_on_unseen = self._goes_on_unseen(seen, frame.sensor_pose, predicted)
        self._remember_touch(seen)
        may_be_in_contact = seen.contact or goes_on_unseen
        motion = self._poses.check_pose(frame.time, frame.sensor_pose, may_be_in_contact, self._changes, closed)
        has_drawn_back = motion.drawn_back > _NOTICEABLE  # out of contact, as a sensor that pushes cannot pull
        if has_drawn_back and seen.image is not None:
            self._detector.forget()  # the gel or the light has changed
            self._may_show_touch = False
            seen = _Seen(seen.image, False, False)
            goes_on_unseen = False
        in_contact = seen.contact or (goes_on_unseen and not motion.was_unobserved)
        unseen_push = max(self._hidden_motion, _NOTICEABLE if has_drawn_back else 0.0)
        sees_touch = seen.contact and seen.image is not None and not motion.was_unobserved
        self._push.see(frame.sensor_pose, sees_touch and self._only_pushes)
        self._touches_since_start = seen.touches_since_start
        self._hidden_motion = motion.hidden
        was_in_contact = self.last is not None and bool(self.last.contact)
        return CheckedFrame(
            corrected=corrected,
            frame=frame if seen.image is None else changed(frame, image=seen.image, contact=in_contact),
            is_first=self.last is None,
            ends_contact=was_in_contact and (motion.was_unobserved or not in_contact),
            unobserved_push=motion.possible_push if motion.was_unobserved else unseen_push,
            background=self.background,
            light=self._detector.light,
            shows_touch=seen.contact,
            evidence=self._evidence(seen, motion),
        )

    def _evidence(self, seen: _Seen, motion: SensorMotion) -> InputEvidence:
        """Return the signs that the stream is faulty or weak."""
        return InputEvidence(
            hidden_motion=motion.hidden,
            touches_since_start=seen.touches_since_start,
            doubt=self._detector.doubt,
            weakness=self._poses.weakness or self._push.weakness,
            push_angle=self._push.angle,
        )

    def accept(self, checked: CheckedFrame, measured: Sequence[Measurement]) -> None:
        """Make a checked frame the last one, with what touch measured in it."""
        self.last = checked.frame
        if checked.ends_contact:
            self._unseen = UnseenContact()
        if checked.shows_touch:
            self._unseen.see(measured, self._detector.share)
        self._has_touched = self._has_touched or bool(checked.frame.contact)

    def _needs_clearance(self) -> bool:
        """Return True if an image may show a touch and is to be taken as untouched."""
        return self._may_show_touch or self.background is None or self._detector.new_view is not None

    def _goes_on_unseen(self, seen: _Seen, sensor_pose: Array, predicted: Predicted) -> bool:
        """Return True if a contact goes on that the image does not show."""
        was_in_contact = self.last is not None and bool(self.last.contact)
        if seen.image is None or seen.contact or not was_in_contact:
            return False
        return self._unseen.goes_on(predicted.withdrawal(sensor_pose))

    def _check_time(self, frame: Frame) -> None:
        """Raise FrameError on a time that does not follow the last one, or is far ahead."""
        last = self.last
        if last is not None and frame.time <= last.time:
            raise FrameError(f"frame at {frame.time:.3f} s follows one at {last.time:.3f} s; times must increase")
        self._poses.check_time(frame.time)

    def _seen(self, frame: Frame, predicted: Predicted, reads_images: bool, needs_colours: bool) -> _Seen:
        """Return the contact that a frame's image shows, or its flag; raises FrameError if it cannot be used."""
        if frame.image is None:
            if reads_images and frame.contact:
                raise FrameError(f"frame at {frame.time:.3f} s has no image, and learnt touch needs one")
            return _Seen(None, bool(frame.contact), False)
        refuses_grey = reads_images and needs_colours and self.last is None
        clearance = predicted.clearance(frame.sensor_pose) if self._needs_clearance() else None
        image = self._detector.read(frame.image)
        shows_touch = self._shows_touch(frame.time, image, clearance, refuses_grey)
        touches_since_start = self._touches_before_gel_is_known(clearance, shows_touch)
        return _Seen(image, shows_touch or touches_since_start, touches_since_start)

    def _remember_touch(self, seen: _Seen) -> None:
        """Remember the cells of an image that shows a touch, or forget the touch that is over."""
        cells = self._detector.cells
        if seen.contact and seen.image is not None and cells is not None and self.background is not None:
            self._changes.add(cells, self.background)
        else:
            self._changes.clear()

    def _shows_touch(self, time: float, image: Image, clearance: Clearance | None, refuses_grey: bool) -> bool:
        """Return True if an image shows a touch; raises FrameError if it cannot be used."""
        try:
            if refuses_grey and is_grey(image) and not is_dark(image):
                raise SettingError(GREY)
            return self._detector.update(image)
        except SettingError as error:
            if self._takes_new_view(clearance):
                return False
            raise FrameError(f"frame at {time:.3f} s: {error}") from error

    def _touches_before_gel_is_known(self, clearance: Clearance | None, shows_touch: bool) -> bool:
        """Return True in a contact since before the untouched gel was known, in which touch cannot measure.

        A frame that is clear of the object, or a touch that comes later, tells that the gel was untouched.
        """
        if clearance is None or not (self._may_show_touch or self.background is None):
            return False
        if self._touches_since_start:
            return True
        is_clear = clearance.distance >= UNLIKELY * clearance.deviation
        touch_came_later = shows_touch if self.background is not None else is_clear
        self._may_show_touch = not touch_came_later
        # Mounting and outline may be wrong by some millimetres.
        return self._may_show_touch and clearance.distance < -max(_WELL_INSIDE * clearance.deviation, LARGEST_ERROR[0])

    def _takes_new_view(self, clearance: Clearance | None) -> bool:
        """Take a new steady view as the untouched gel, unless something may touch it; return True if it was taken."""
        if clearance is None or self._detector.new_view is None:
            return False
        may_reach = UNLIKELY * clearance.deviation
        if self._has_touched and clearance.distance < may_reach + LARGEST_ERROR[0]:
            return False
        logger.warning("the untouched gel is learnt anew, from images that are steady and unlike it")
        self._detector.take(self._detector.new_view)
        self._may_show_touch = clearance.distance < may_reach
        return True
