"""The frames of one sensor, one after the other: what of each can be believed, and what speaks against it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FrameError, SettingError
from palpate.filter.consistency import Status
from palpate.gate.checked_frame import checked_frame
from palpate.gate.guard import DRAWN_BACK, StreamGuard
from palpate.gate.quality import StreamQuality
from palpate.gate.unfelt import UnfeltTouch
from palpate.touch.background import Background, Image
from palpate.touch.calibration import Calibration, view_of
from palpate.touch.detector import detector_for
from palpate.types.frame import Frame
from palpate.types.measurements import Measurement
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_FROZEN = "the sensor's pose stands still to the last bit since it moved; it may be {:.0f} mm farther on"
_PAUSE = 10  # intervals without a frame after which a contact is a new one


class Stream:
    """Follows the frames of one sensor: `checked` says what to believe of one, `take` that the estimate has it."""

    def __init__(self, sensor: SensorProfile, calibration: Calibration | None, deviation: Sequence[float]) -> None:
        """Take the sensor, what is known of its unit, and how well its poses are measured (3,) [m, m, rad]."""
        self._sensor, self._deviation = sensor, math.hypot(*deviation[:2]) / math.sqrt(2.0)
        self._detector, self._view = detector_for(sensor, calibration), view_of(calibration)
        self._begin()

    def reset(self) -> None:
        """Begin anew, at whatever time the next frame has; how the gel looks untouched stays known if it is sure."""
        if self._unfelt.is_doubtful:
            self._detector.forget()  # its images may have shown a touch
        self._begin()

    def _begin(self) -> None:
        self._guard = StreamGuard(self._sensor.rate)
        self._quality = StreamQuality(self._sensor.rate, self._deviation)
        self._unfelt = UnfeltTouch(self._detector.background is None, self._sensor.rate)
        self._gone = False  # whether the sensor is elsewhere than it can have gone since the last frame
        self._last: Frame | None = None

    def checked(
        self,
        frame: Frame,
        measurements: Sequence[Measurement],
        check_readable: Callable[[Frame], None],
        gap: Callable[[Array], tuple[float, float]],
    ) -> Frame:
        """Return a frame as it can be believed: its image as the profile's lie, contact as the image tells.

        With it go all its measurements. `check_readable` raises FrameError on what touch cannot read; `gap` tells of a
        sensor's pose (3,) how far from the object it is, and the deviation of that [m]. Raises FrameError where the
        frame cannot be used; see Tracker.update.
        """
        after = -math.inf if self._last is None else self._last.time
        frame = checked_frame(frame, measurements, after, len(self._sensor.tips))
        self._guard.check_time(frame.time)
        is_unfelt = False
        if frame.image is None:
            check_readable(frame)
        else:
            frame = self._felt(frame, frame.image, check_readable)
            if self._unfelt.is_doubtful:
                is_known = self.background is not None
                is_unfelt = self._unfelt.sees(gap(frame.sensor_pose), bool(frame.contact), is_known)
                frame = replace(frame, contact=frame.contact or is_unfelt)
        self._gone = self._guard.check_pose(frame.time, frame.sensor_pose, bool(frame.contact))
        self._unfelt.now = is_unfelt
        if frame.image is not None and self._guard.drawn_back:
            self._detector.forget()
            self._unfelt.end()
            return replace(frame, contact=False)
        return frame

    def _felt(self, frame: Frame, image: Image, check_readable: Callable[[Frame], None]) -> Frame:
        """A frame with this image as the profile's lie, and contact as it tells."""
        try:
            image = self._detector.read(self._view.of(image))
            frame = replace(frame, image=image)
            check_readable(frame)
            return replace(frame, contact=self._detector.update(image))
        except (SettingError, IndexError) as error:  # the latter of an image without three channels
            raise FrameError(f"frame at {frame.time:.3f} s: {error}") from error

    def take(self, frame: Frame, paused: bool) -> None:
        """Take a checked frame as the last one, before which the stream has paused or not; see `has_paused`."""
        self._last = frame
        felt = bool(frame.contact) and frame.image is not None and not paused
        self._quality.see(frame.time, frame.sensor_pose, self._detector.light, felt)

    @property
    def last(self) -> Frame | None:
        """The last frame that was taken."""
        return self._last

    @property
    def background(self) -> Background | None:
        """The untouched gel as it is known now; None before the first images have told, and without images."""
        return self._detector.background

    def known_background(self) -> Background:
        """Return the untouched gel; it is known before the first contact that an image tells of."""
        assert self.background is not None
        return self.background

    @property
    def is_unfelt(self) -> bool:
        """Whether the object is touched since before it was known how the gel looks untouched."""
        return self._unfelt.now

    def has_paused(self, frame: Frame) -> bool:
        """Return whether so much is missing before a checked frame that its contact is another one."""
        if self._last is None:
            return False
        return self._gone or frame.time - self._last.time > _PAUSE * self._quality.interval

    def moved_unseen(self, paused: bool) -> float:
        """Return how far the object may have been moved as nobody looked [m], where a contact is over."""
        guard = self._guard
        return guard.pushed if paused else max(guard.unseen, DRAWN_BACK if guard.drawn_back else 0.0)

    @property
    def blind(self) -> float:
        """How far the sensor may have gone while its pose stands still in a contact [m]; 0 where nothing tells that."""
        return self._guard.blind

    @property
    def alarm(self) -> tuple[Status, str] | None:
        """The status that the last frame gives whatever the estimate is like, and why; None where it gives none."""
        if blind := self.blind:
            return "faulty", _FROZEN.format(1e3 * blind)
        return ("uncertain", self._unfelt.reason) if self._unfelt.now else None

    @property
    def doubt(self) -> str:
        """What speaks against the untouched gel of a calibration, in words; nothing where all is well."""
        return self._detector.doubt

    @property
    def weakness(self) -> str:
        """What of the stream is worse than it should be, in a sentence; nothing where all is well."""
        return self._quality.reason

    @property
    def too_often(self) -> str:
        """That frames come more often than serves the estimate, in a sentence; nothing where they do not."""
        return self._quality.too_often
