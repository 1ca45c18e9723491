"""Tracking as it goes on, in Rerun: ten times a second, by a thread that tracking never waits for."""

import logging
import queue
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.geometry.shapes import Shape
from palpate.pipeline.run import gathered
from palpate.pipeline.truth import known_truth
from palpate.touch.background import Background
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile
from palpate.viewer.blueprint import blueprint
from palpate.viewer.images import jpeg, seen
from palpate.viewer.rerun_log import SceneLog
from palpate.viewer.scene import Scene
from palpate.viewer.show import close_stream, open_stream
from palpate.viewer.viewer import open_viewer

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

INTERVAL = 0.1
"""[s] between frames that are shown."""
_ROUNDING = 1e-3  # [s] that a frame may be early
_WAITING = 10  # frames that may wait for the thread: a second of them
_PATIENCE = 20.0  # [s] for what waits still when tracking has ended


@dataclass(frozen=True, eq=False)
class _Shown:
    frame: Frame
    estimate: Estimate
    background: Background | None


@dataclass(frozen=True, eq=False)
class _Truth:
    time: float
    pose: Array
    estimate: Array | None


class LiveLog:
    """Takes what a tracker says, and sends some of it to Rerun from a thread of its own.

    What the thread is too slow for is left out and counted.
    """

    def __init__(self, stream: "rr.RecordingStream", shape: Shape, sensor: SensorProfile) -> None:
        """Take where to send, and what is tracked by what."""
        self._shape, self._sensor = shape, sensor
        self._log = SceneLog(stream, shape, sensor)
        self._queue: queue.Queue[_Shown | _Truth | None] = queue.Queue(_WAITING)
        self._next = self._next_truth = -np.inf
        self._frames_tell_truth = False
        self.dropped = 0
        """Frames that should have been shown and were not."""
        self._thread = threading.Thread(target=self._run, name="palpate-view", daemon=True)
        self._thread.start()

    def show(self, frame: Frame, estimate: Estimate, background: Background | None) -> None:
        """Take a frame, its estimate and the untouched gel as known then; returns at once."""
        if frame.time < self._next:
            return
        self._next = frame.time + INTERVAL - _ROUNDING
        if self._queue.full():
            self.dropped += 1
            return
        image = None if frame.image is None else frame.image.copy()  # cameras may reuse their buffers
        self._queue.put_nowait(_Shown(replace(frame, image=image), estimate, background))

    def show_truth(self, time: float, pose: Array, estimate: Array | None) -> None:
        """Take a true pose of the object (3,) at a time [s], which frames do not tell, and what was estimated then."""
        if time < self._next_truth or self._queue.full():
            return
        self._next_truth = time + INTERVAL - _ROUNDING
        self._queue.put_nowait(_Truth(time, pose, estimate))

    def close(self) -> None:
        """Send what waits still, for a while at most, and say what was dropped."""
        with suppress(queue.Full):
            self._queue.put(None, timeout=_PATIENCE)
            self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self.dropped += self._queue.qsize()
        if self.dropped:
            logger.warning("the view was too slow for %d frames, which it does not show", self.dropped)

    def _run(self) -> None:
        ended = failed = False
        while not ended:
            waiting = [self._queue.get()]
            with suppress(queue.Empty):
                while True:  # all that waits is sent in one go, which takes little longer than one frame
                    waiting.append(self._queue.get_nowait())
            ended = None in waiting
            shown = [each for each in waiting if isinstance(each, _Shown)]
            truths = [each for each in waiting if isinstance(each, _Truth)]
            if failed:
                self.dropped += len(shown)
                continue
            try:
                self._send(shown)
                for true in truths:
                    estimate = None if true.estimate is None else true.estimate[None]
                    self._log.send_truth(np.array([true.time]), true.pose[None], estimate)
            except Exception as error:  # whatever is the matter with the view, tracking goes on
                failed = True
                self.dropped += len(shown)
                time = shown[0].frame.time if shown else truths[0].time
                logger.warning("the view ends at %.3f s: %s", time, error)

    def _send(self, shown: Sequence[_Shown]) -> None:
        if not shown:
            return
        self._log.send(self._scene(shown))
        for frame, background in ((each.frame, each.background) for each in shown):
            if frame.image is None:
                continue
            time = np.array([frame.time])
            self._log.send_images("touch/image", time, [jpeg(frame.image)])
            if background is not None:
                self._log.send_images("touch/seen", time, [jpeg(seen(frame.image, background))])

    def _scene(self, shown: Sequence[_Shown]) -> Scene:
        """The scene of some frames, but for their images."""
        frames, unknown = [each.frame for each in shown], np.full(3, np.nan)
        self._frames_tell_truth |= any(frame.object_pose is not None for frame in frames)
        truth = np.array([unknown if frame.object_pose is None else frame.object_pose for frame in frames])
        return Scene(
            "",
            Recording(
                np.array([frame.time for frame in frames]),
                np.array([frame.sensor_pose for frame in frames]),
                self._shape,
                self._sensor,
            ),
            truth if self._frames_tell_truth else None,
            *gathered([each.estimate for each in shown]),
        )


@contextmanager
def live_view(recording: Recording, name: str, file: Path | None, force: bool, window: bool) -> Iterator[LiveLog]:
    """Show a recording while it is tracked: in a viewer, if `window`, and in a file (.rrd), if one is given.

    The file is written whole or not at all. Raises FileError if it exists, unless `force`.
    """
    import rerun as rr

    scene = Scene(name, recording, known_truth(recording))
    with whole_file(file, force) if file else nullcontext() as part:
        stream = open_stream(name)
        sinks: list[rr.FileSink | rr.GrpcSink] = [rr.FileSink(part)] if part else []
        if window:
            sinks.append(rr.GrpcSink(open_viewer()))
        stream.set_sinks(*sinks, default_blueprint=blueprint(scene, live=True))
        log = LiveLog(stream, recording.shape, recording.sensor)
        try:
            yield log
        finally:
            log.close()
            try:
                close_stream(stream)
            except SettingError as error:  # the viewer may have been closed meanwhile
                logger.warning("%s", error)
