"""A recording as the sources of a live session: its images and poses come when they came."""

import threading
from collections.abc import Iterator

from palpate.errors import SettingError
from palpate.live.clock import Clock
from palpate.live.images import TouchImage
from palpate.live.poses import TimedPose
from palpate.types.recording import Recording

_LEAD = 0.05  # [s] before the first frame


class Replay:
    """Plays a recording in real time; the clock shows the recording's own times."""

    def __init__(self, recording: Recording) -> None:
        """Take what is to be played. Raises SettingError if it has no images, FileError if the first is damaged."""
        if recording.image is None:
            raise SettingError(f"{recording.file or 'the recording'}: has no images, and live tracking goes by them")
        recording[0]  # if images are damaged, or OpenCV takes long to load, then not in the first step
        self._recording = recording
        self.begin()

    def begin(self) -> None:
        """Let the first frame come shortly from now."""
        self.clock = Clock(float(self._recording.time[0]) - _LEAD)
        """What its times are measured by."""

    def images(self, stop: threading.Event) -> Iterator[TouchImage]:
        """Yield each image when its time comes, as the recording keeps it."""
        assert self._recording.image is not None
        for index in self._due(stop):
            yield TouchImage(float(self._recording.time[index]), self._recording.image[index], self._recording.codec)

    def poses(self, stop: threading.Event) -> Iterator[TimedPose]:
        """Yield the sensor's pose of each frame when its time comes."""
        for index in self._due(stop):
            yield TimedPose(float(self._recording.time[index]), self._recording.sensor_pose[index])

    def _due(self, stop: threading.Event) -> Iterator[int]:
        """Yield the number of each frame when its time comes, those that are late at once."""
        for index, time in enumerate(self._recording.time):
            if stop.wait(max(0.0, time - self.clock.now())):
                return
            yield index
