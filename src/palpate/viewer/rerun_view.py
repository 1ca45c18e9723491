"""Scenes shown in Rerun: in a file, in a viewer on this machine, or live beside tracking."""

import logging
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.geometry.shapes import Shape
from palpate.pipeline.track import gathered
from palpate.pipeline.truth import known_truth
from palpate.touch.background import Background
from palpate.touch.calibration import view_of
from palpate.touch.camera_view import AS_IT_IS
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile
from palpate.viewer.rerun_scene import SceneLog, blueprint
from palpate.viewer.scene import Scene, difference_image, jpeg, touch_images

if TYPE_CHECKING:
    import rerun as rr

logger = logging.getLogger(__name__)

INTERVAL = 0.1
"""Time between frames of a live view [s]."""
WAITING = 10
"""Frames that may wait for the thread of a live view."""
PATIENCE = 20.0
"""Time for the last frames to arrive [s]."""


def check_rerun() -> None:
    """Raise SettingError if Rerun is not installed."""
    try:
        import rerun  # noqa: F401
    except ImportError as error:
        raise SettingError("the viewer needs rerun-sdk, which is not installed: pip install palpate[view]") from error


def has_display() -> bool:
    """Return True if a window can be opened."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def save_scene(scene: Scene, path: Path, force: bool = False) -> None:
    """Write a scene for Rerun's viewer (.rrd); FileError if the file exists, unless `force`."""
    with whole_file(path, overwrite=force) as part:
        stream = open_stream(scene.name)
        stream.save(part, blueprint(scene, live=False))
        _send_scene(stream, scene)
        close_stream(stream)


def show_scene(scene: Scene) -> None:
    """Show a scene in a viewer that stays open when this process ends."""
    address = start_viewer()
    stream = open_stream(scene.name)
    stream.connect_grpc(address, default_blueprint=blueprint(scene, live=False))
    _send_scene(stream, scene)
    close_stream(stream)


def open_stream(name: str) -> "rr.RecordingStream":
    """Return a stream with a name and no destination yet; SettingError if Rerun is not installed."""
    check_rerun()
    import rerun as rr

    stream = rr.RecordingStream("palpate")
    stream.send_recording_name(name)
    return stream


def close_stream(stream: "rr.RecordingStream") -> None:
    """Flush and disconnect a stream; SettingError if not all of it arrives."""
    try:
        stream.flush(timeout_sec=PATIENCE)
    except RuntimeError as error:
        raise SettingError(f"the view is not whole: {error}") from error
    finally:
        stream.disconnect()


def _send_scene(stream: "rr.RecordingStream", scene: Scene) -> None:
    recording = scene.recording
    log = SceneLog(stream, recording.shape, recording.sensor)
    log.send(scene)
    if recording.image is None:
        return
    encoded, is_turned = recording.image, view_of(scene.calibration) != AS_IT_IS
    images = enumerate(touch_images(recording, scene.calibration))
    while some := list(islice(images, 200)):  # as many as fit in memory
        time = recording.time[[index for index, _ in some]]
        log.send_images("touch/image", time, [jpeg(one) if is_turned else encoded[i] for i, (one, _) in some])
        is_known = [difference is not None for _, (_, difference) in some]
        log.send_images("touch/seen", time[is_known], [jpeg(one) for _, (_, one) in some if one is not None])


class LiveLog:
    """Sends ten frames a second to Rerun from a thread of its own, which tracking never waits for.

    Frames that the thread is too slow for are dropped and counted.
    """

    def __init__(self, stream: "rr.RecordingStream", shape: Shape, sensor: SensorProfile) -> None:
        """Start the thread."""
        self._shape, self._sensor = shape, sensor
        self._log = SceneLog(stream, shape, sensor)
        self._queue: queue.Queue[tuple[Frame, Estimate, Background | None] | None] = queue.Queue(WAITING)
        self._next = -np.inf
        self.dropped = 0
        """Frames that should have been shown and were not."""
        self._thread = threading.Thread(target=self._run, name="palpate-view", daemon=True)
        self._thread.start()

    def show(self, frame: Frame, estimate: Estimate, background: Background | None) -> None:
        """Queue a frame, its estimate and the untouched gel; returns at once."""
        if frame.time < self._next:
            return
        self._next = frame.time + INTERVAL - 1e-3  # times jitter
        image = None if frame.image is None else frame.image.copy()  # cameras may reuse their buffers
        try:
            self._queue.put_nowait((replace(frame, image=image), estimate, background))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Send the frames that wait, and log how many were dropped."""
        with suppress(queue.Full):
            self._queue.put(None, timeout=PATIENCE)
            self._thread.join(PATIENCE)
        if self._thread.is_alive():
            self.dropped += self._queue.qsize()
        if self.dropped:
            logger.warning("the view was too slow for %d frames, which it does not show", self.dropped)

    def _run(self) -> None:
        has_failed = is_over = False
        while not is_over:
            waiting = [self._queue.get()]
            with suppress(queue.Empty):
                while True:  # sending all at once takes little longer than sending one
                    waiting.append(self._queue.get_nowait())
            is_over = None in waiting
            shown = [one for one in waiting if one is not None]
            if has_failed or not shown:
                self.dropped += len(shown)
                continue
            try:
                self._send(shown)
            except Exception as error:  # tracking goes on without a view
                has_failed = True
                self.dropped += len(shown)
                logger.warning("the view ends at %.3f s: %s", shown[0][0].time, error)

    def _send(self, shown: Sequence[tuple[Frame, Estimate, Background | None]]) -> None:
        frames = [frame for frame, _, _ in shown]
        times, sensor_poses = (np.array([getattr(one, name) for one in frames]) for name in ("time", "sensor_pose"))
        is_known = any(frame.object_pose is not None for frame in frames)
        truth = [np.full(3, np.nan) if frame.object_pose is None else frame.object_pose for frame in frames]
        recording = Recording(times, sensor_poses, self._shape, self._sensor)
        estimates = gathered([estimate for _, estimate, _ in shown])
        self._log.send(Scene("", recording, np.array(truth) if is_known else None, *estimates))
        for frame, _, background in shown:
            if frame.image is not None:
                at = np.array([frame.time])
                self._log.send_images("touch/image", at, [jpeg(frame.image)])
                if background is not None:
                    self._log.send_images("touch/seen", at, [jpeg(difference_image(frame.image, background))])


@contextmanager
def live_view(recording: Recording, name: str, file: Path | None, force: bool, window: bool) -> Iterator[LiveLog]:
    """Show a recording while it is tracked, in a window, a file (.rrd) or both.

    Raises FileError if the file exists, unless `force`.
    """
    import rerun as rr

    scene = Scene(name, recording, known_truth(recording))
    with whole_file(file, force) if file else nullcontext() as part:
        stream = open_stream(name)
        sinks: list[rr.FileSink | rr.GrpcSink] = [rr.FileSink(part)] if part else []
        if window:
            sinks.append(rr.GrpcSink(start_viewer()))
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


def start_viewer(*options: str) -> str:
    """Start Rerun's viewer in a process that outlives this one and return its address.

    Only this machine can reach it, and it sends no analytics. Raises SettingError if it does not start. `options` are
    further options of Rerun's command line.
    """
    command = (sys.executable, "-m", "rerun_cli")
    environment = _environment_without_analytics(command)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    memory = ["--memory-limit", "1GiB", "--server-memory-limit", "256MiB"]  # the oldest data go first
    bind = ["--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", "--expect-data-soon"]
    process = subprocess.Popen(
        [*command, *bind, *memory, *options],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    last = time.monotonic() + 30.0
    while time.monotonic() < last and process.poll() is None:
        with socket.socket() as attempt:
            is_listening = attempt.connect_ex(("127.0.0.1", port)) == 0
        # A viewer that can open no window ends within a second of listening.
        with suppress(subprocess.TimeoutExpired):
            process.wait(1.0 if is_listening else 0.05)
        if process.poll() is None and is_listening:
            return f"rerun+http://127.0.0.1:{port}/proxy"
    process.kill()
    process.wait()
    raise SettingError("the viewer does not start; `rerun` by itself says why, and a file can be written instead")


def _environment_without_analytics(command: Sequence[str]) -> dict[str, str]:
    """Return an environment in which Rerun's settings are palpate's own, with analytics off."""
    home = str(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "palpate" / "rerun")
    environment = {**os.environ, "XDG_CONFIG_HOME": home, "XDG_DATA_HOME": home}
    if subprocess.run([*command, "analytics", "disable"], env=environment, capture_output=True).returncode:
        raise SettingError(f"the viewer's analytics cannot be turned off in {home}, so it is not started")
    return environment
