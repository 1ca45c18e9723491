"""Scenes in Rerun: in a file, in a viewer on this machine, or live beside tracking.

The view from above is in millimetres, and y is negated because Rerun's plane has y pointing down.
"""

import logging
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.live.session import Watch
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.track import gathered
from palpate.touch.background import Background
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame
from palpate.types.recording import Recording
from palpate.viewer.scene import COLOURS, STATUS_COLOURS, Image, Scene, difference_image, jpeg, touch_images

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise SettingError("the viewer needs rerun-sdk, which is not installed: pip install palpate[view]") from error

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
TO_PLANE = np.array([1e3, -1e3])
"""Factors from world coordinates (x, y) [m] to Rerun's plane."""


def has_display() -> bool:
    """Return True if a window can be opened."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def save_scene(scene: Scene, path: Path, force: bool = False) -> None:
    """Write a scene for Rerun's viewer (.rrd); FileError if the file exists, unless `force`."""
    with whole_file(path, overwrite=force) as part:
        stream = _stream(scene.name)
        stream.save(part, _blueprint(scene))
        _send(stream, scene)


def show_scene(scene: Scene) -> None:
    """Show a scene in a viewer that stays open when this process ends."""
    address = start_viewer()
    stream = _stream(scene.name)
    stream.connect_grpc(address, default_blueprint=_blueprint(scene))
    _send(stream, scene)


@contextmanager
def live_view(recording: Recording, name: str) -> Iterator[Watch]:
    """Open a viewer and yield the function that shows a frame; ten a second are shown.

    `recording` has the shape and the sensor. Rerun sends from a thread of its own, so that no frame waits for it; if
    the viewer is closed meanwhile, a warning is logged at the end.
    """
    address = start_viewer()
    stream = _stream(name)
    stream.connect_grpc(address, default_blueprint=_blueprint(Scene(name, recording, None), is_live=True))
    log = SceneLog(stream, recording)
    next_time = -np.inf

    def show(frame: Frame, estimate: Estimate, untouched: Background | None) -> None:
        nonlocal next_time
        if frame.time < next_time:
            return
        next_time = frame.time + 0.1 - 1e-3  # times jitter
        online, answers, _ = gathered([estimate])
        one = Recording(online.time, frame.sensor_pose[None], recording.shape, recording.sensor)
        log.send(Scene("", one, None, online, answers))
        if frame.image is not None:
            difference = None if untouched is None else difference_image(frame.image, untouched)
            log.send_images(frame.time, frame.image, difference)

    try:
        yield show
    finally:
        try:
            _close(stream)
        except SettingError as error:
            logger.warning("%s", error)


def start_viewer(*options: str) -> str:
    """Start Rerun's viewer in a process that outlives this one and return its address.

    Only this machine can reach it, and it sends no analytics. Raises SettingError if it does not start. `options` are
    further options of Rerun's command line.
    """
    command = (sys.executable, "-m", "rerun_cli")
    home = str(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "palpate" / "rerun")
    environment = {**os.environ, "XDG_CONFIG_HOME": home, "XDG_DATA_HOME": home}  # settings apart from the user's
    if subprocess.run([*command, "analytics", "disable"], env=environment, capture_output=True).returncode:
        raise SettingError(f"the viewer's analytics cannot be turned off in {home}, so it is not started")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    memory = ["--memory-limit", "1GiB", "--server-memory-limit", "256MiB"]  # the oldest data go first
    bind = ["--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", "--expect-data-soon"]
    no_pipe = subprocess.DEVNULL
    process = subprocess.Popen(
        [*command, *bind, *memory, *options],
        env=environment,
        stdin=no_pipe,
        stdout=no_pipe,
        stderr=no_pipe,
        start_new_session=True,
    )
    last = time.monotonic() + 30.0
    is_listening = False
    while time.monotonic() < last and process.poll() is None:
        if is_listening:
            return f"rerun+http://127.0.0.1:{port}/proxy"
        with socket.socket() as attempt:
            is_listening = attempt.connect_ex(("127.0.0.1", port)) == 0
        time.sleep(1.0 if is_listening else 0.05)  # a viewer that can open no window ends soon after it listens
    process.kill()
    process.wait()
    raise SettingError("the viewer does not start; `rerun` by itself says why, and a file can be written instead")


def _stream(name: str) -> rr.RecordingStream:
    """Return a stream with a name and no destination yet."""
    stream = rr.RecordingStream("palpate")
    stream.send_recording_name(name)
    return stream


def _close(stream: rr.RecordingStream) -> None:
    """Flush and disconnect a stream; SettingError if not all of it arrives."""
    try:
        stream.flush(timeout_sec=20.0)
    except RuntimeError as error:
        raise SettingError(f"the view is not whole: {error}") from error
    finally:
        stream.disconnect()


def _send(stream: rr.RecordingStream, scene: Scene) -> None:
    """Send a whole scene and close the stream."""
    log = SceneLog(stream, scene.recording)
    log.send(scene)
    if scene.recording.image is not None:
        images = touch_images(scene.recording, scene.calibration)
        for time, (image, difference) in zip(scene.recording.time, images, strict=True):
            log.send_images(time, image, difference)
    _close(stream)


class SceneLog:
    """Sends frames of one object and sensor to a Rerun stream, whole runs at once or live frames as they come."""

    def __init__(self, stream: rr.RecordingStream, recording: Recording) -> None:
        """Take shape and sensor of the recording; send colours and names of all entities."""
        self._stream = stream
        self._outline = recording.shape.closed_outline
        self._pads = [np.concatenate((pad, pad[:1])) for pad in recording.sensor.pads]
        for path, style in _styles().items():
            stream.log(path, style, static=True)

    def send(self, scene: Scene) -> None:
        """Send all frames except their images."""
        recording, truth, estimate = scene.recording, scene.truth, scene.estimate
        time, sensor_pose = recording.time, recording.sensor_pose
        pads = [[se2.transform(at, pad) for pad in self._pads] for at in sensor_pose]
        self._strips("above/sensor/pad", time, pads)
        self._points("above/sensor/path", time, sensor_pose[:, :2], np.ones(len(time), np.bool_))
        if truth is not None:
            self._poses("truth", time, truth)
        if estimate is None:
            return
        assert estimate.covariance is not None and estimate.contact is not None and estimate.status is not None
        self._poses("estimate", time, estimate.pose)
        self._strips("above/estimate/ellipse", time, [[one] for one in ellipses_95(estimate.pose, estimate.covariance)])
        distance, angle = deviations(estimate.covariance)
        self._number("translation/sigma", time, 1e3 * distance)
        self._number("rotation/sigma", time, np.degrees(angle))
        if truth is not None:
            self._number("translation/error", time, 1e3 * translation_errors(estimate.pose, truth))
            self._number("rotation/error", time, np.degrees(np.abs(rotation_errors(estimate.pose, truth))))
        touching = [several if touches else [] for several, touches in zip(pads, estimate.contact, strict=True)]
        self._strips("above/contact", time, touching)
        others = [[se2.transform(one.pose, self._outline) for one in several[1:]] for several in scene.answers]
        self._strips("above/others", time, others)
        self._columns("status", time, rr.StateChange.columns(state=list(estimate.status)))

    def send_images(self, time: float, image: Image, difference: Image | None) -> None:
        """Send a touch image and, where it is known, its difference from the untouched gel."""
        for name, picture in (("image", image), ("difference", difference)):
            if picture is not None:
                blob = np.frombuffer(jpeg(picture), np.uint8)
                self._columns(f"touch/{name}", np.array([time]), rr.EncodedImage.columns(blob=[blob]))

    def _poses(self, name: str, time: Array, pose: Array) -> None:
        """Send the outline at poses (N, 3), none where they are NaN, and the path of the origin."""
        is_known = np.asarray(np.isfinite(pose).all(axis=1))
        placed = se2.transform(pose[:, None], self._outline)
        outlines = [[one] if known else [] for one, known in zip(placed, is_known, strict=True)]
        self._strips(f"above/{name}/outline", time, outlines)
        self._points(f"above/{name}/path", time, pose[:, :2], is_known)

    def _strips(self, path: str, time: Array, strips: Sequence[Sequence[Array]]) -> None:
        """Send any number of line strips (P, 2) [m] at each frame."""
        filled = [several or [np.empty((0, 2))] for several in strips]  # Rerun takes no frame without a strip
        flat = [one * TO_PLANE for several in filled for one in several]
        columns = rr.LineStrips2D.columns(strips=flat).partition([len(several) for several in filled])
        self._columns(path, time, columns)

    def _points(self, path: str, time: Array, points: Array, is_shown: NDArray[np.bool_]) -> None:
        columns = rr.Points2D.columns(positions=points[is_shown] * TO_PLANE).partition(is_shown.astype(int))
        self._columns(path, time, columns)

    def _number(self, path: str, time: Array, values: Array) -> None:
        self._columns(path, time, rr.Scalars.columns(scalars=values))

    def _columns(self, path: str, time: Array, columns: Any) -> None:
        kind = "timestamp" if time[0] > 1e8 else "duration"  # [s] since 1970, or since the recording began
        rr.send_columns(path, [rr.TimeColumn("time", **{kind: time})], columns, recording=self._stream)


def _styles() -> dict[str, Any]:
    """Return colours, widths and names of all entities."""

    def rgb(colour: str) -> list[int]:
        return list(bytes.fromhex(colour[1:]))

    def drawn(kind: Any, name: str, radius: float, order: float) -> Any:
        return kind.from_fields(colors=rgb(COLOURS[name]), radii=rr.Radius.ui_points(radius), draw_order=order)

    lines, points = rr.LineStrips2D, rr.Points2D
    styles = {
        "above/others": drawn(lines, "others", 0.75, 10.0),
        "above/truth/outline": drawn(lines, "truth", 2.5, 11.0),
        "above/truth/path": drawn(points, "truth", 2.0, 11.0),
        "above/sensor/path": drawn(points, "sensor", 0.75, 12.0),
        "above/sensor/pad": drawn(lines, "sensor", 1.5, 13.0),
        "above/estimate/path": drawn(points, "estimate", 1.0, 14.0),
        "above/estimate/outline": drawn(lines, "estimate", 1.25, 15.0),
        "above/estimate/ellipse": drawn(lines, "estimate", 1.0, 16.0),
        "above/contact": drawn(lines, "contact", 3.0, 17.0),
        "status": rr.StateConfiguration(values=list(STATUS_COLOURS), colors=list(map(rgb, STATUS_COLOURS.values()))),
    }
    for plot in ("translation", "rotation"):
        styles[f"{plot}/error"] = rr.SeriesLines(names="error", colors=rgb(COLOURS["truth"]))
        styles[f"{plot}/sigma"] = rr.SeriesLines(names="1 sigma", colors=rgb(COLOURS["estimate"]))
    return styles


def _blueprint(scene: Scene, is_live: bool = False) -> rrb.Blueprint:
    """Return the layout of a scene; a live one follows the last frame."""
    start, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    so_far = rrb.VisibleTimeRanges(timeline="time", start=start, end=cursor)
    paths = [f"above/{name}/path" for name in ("truth", "estimate", "sensor")]
    recording, estimate = scene.recording, scene.estimate
    places = np.concatenate((recording.sensor_pose, recording.sensor_pose if estimate is None else estimate.pose))
    reach = np.hypot(*recording.shape.outline().T).max()
    low, high = places[:, :2].min(axis=0) - reach, places[:, :2].max(axis=0) + reach
    x_range, y_range = zip(TO_PLANE * low, TO_PLANE * high, strict=True)
    views = rrb.Vertical(
        rrb.Spatial2DView(
            origin="above",
            name="From above [mm]",
            visual_bounds=rrb.VisualBounds2D(x_range=x_range, y_range=sorted(y_range)),
            overrides=dict.fromkeys(paths, so_far),
        ),
        rrb.Horizontal(
            rrb.Spatial2DView(origin="touch/image", name="Touch"),
            rrb.Spatial2DView(origin="touch/difference", name="Difference from the untouched gel"),
        ),
        row_shares=[3, 2],
    )
    legend = rrb.PlotLegend("LeftTop")
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="translation", name="Translation [mm]", plot_legend=legend),
        rrb.TimeSeriesView(origin="rotation", name="Rotation [deg]", plot_legend=legend),
        rrb.StateTimelineView(origin="status", name="Status"),
        row_shares=[3, 3, 1.5],
    )
    return rrb.Blueprint(
        rrb.Horizontal(views, plots, column_shares=[3, 2]) if is_live or estimate else views,
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following" if is_live else "paused"),
        collapse_panels=True,
    )
