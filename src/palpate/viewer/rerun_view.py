"""Scenes in Rerun: in a file, in a viewer on this machine, or live beside tracking.

The view from above is in millimetres, and y is negated because Rerun's plane has y pointing down.
"""

import logging
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError, printable
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.live.session import Listen, LiveEstimate
from palpate.live.sources import TimedPose, TouchImage
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.truth import known_truth
from palpate.types.estimate import Estimate
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
    if os.fsencode(path) != str(path).encode(errors="replace"):
        raise FileError(f"{path}: Rerun writes only to names that are UTF-8; --save names another file")
    with whole_file(path, overwrite=force) as part, _opened(scene, part) as log:
        log.send_all(scene)


def show_scene(scene: Scene) -> None:
    """Show a scene in a viewer that stays open when this process ends."""
    with _opened(scene) as log:
        log.send_all(scene)


@contextmanager
def live_view(recording: Recording, name: str) -> Iterator[Listen]:
    """Open a viewer and yield the function that shows estimates; ten a second are shown.

    `recording` has the shape and the sensor. Rerun sends from a thread of its own, so that no frame waits for it.
    """
    next_time = -np.inf

    def show(item: TouchImage | TimedPose | LiveEstimate) -> None:
        nonlocal next_time
        if isinstance(item, LiveEstimate) and item.frame.time >= next_time:
            frame, untouched = item.frame, item.untouched
            next_time = frame.time + 0.1 - 1e-3  # times jitter
            log.send(frame.time, frame.sensor_pose, item.estimate)
            if frame.image is not None:
                log.send_images(frame.image, None if untouched is None else difference_image(frame.image, untouched))

    with _opened(Scene(name, recording), is_live=True) as log:
        yield show


@contextmanager
def _opened(scene: Scene, path: Path | None = None, is_live: bool = False) -> Iterator["SceneLog"]:
    """Open a new file, or a new viewer, for a scene; a warning is logged at the end if the viewer was closed."""
    stream, blueprint = rr.RecordingStream("palpate"), _blueprint(is_live)
    stream.send_recording_name(printable(scene.name))
    if path:
        stream.save(path, blueprint)
    else:
        stream.connect_grpc(start_viewer(), default_blueprint=blueprint)
    try:
        yield SceneLog(stream, scene.recording)
        stream.flush(timeout_sec=20.0)
    except RuntimeError as error:
        logger.warning("the view is not whole: %s", error)
    finally:
        stream.disconnect()


def start_viewer(*options: str) -> str:
    """Start Rerun's viewer in a process that outlives this one and return its address.

    Only this machine can reach it, and it sends no analytics. Raises SettingError if it does not start. `options` are
    further ones of Rerun's command line.
    """
    command = (sys.executable, "-P", "-m", "rerun_cli")  # no modules of the working folder
    home = tempfile.mkdtemp(prefix="palpate-rerun-")  # settings apart from the user's, who may have no home
    environment = {**os.environ, "XDG_CONFIG_HOME": home, "XDG_DATA_HOME": home}
    if subprocess.run([*command, "analytics", "disable"], env=environment, capture_output=True).returncode:
        raise SettingError(f"the viewer's analytics cannot be turned off in {home}, so it is not started")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    memory = ["--memory-limit", "1GiB", "--server-memory-limit", "256MiB"]  # the oldest data go first
    bind = ["--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", "--expect-data-soon"]
    silent: Any = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen([*command, *bind, *memory, *options], env=environment, start_new_session=True, **silent)
    last = time.monotonic() + 30.0
    while time.monotonic() < last and process.poll() is None:
        with socket.socket() as attempt:
            if attempt.connect_ex(("127.0.0.1", port)) == 0:
                return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.05)
    raise SettingError("the viewer does not start; `rerun` by itself says why, and a file can be written instead")


class SceneLog:
    """Sends frames of one object and sensor to a Rerun stream."""

    def __init__(self, stream: rr.RecordingStream, recording: Recording) -> None:
        """Take shape and sensor of the recording; send colours and widths of all that is drawn."""
        self._stream = stream
        self._outline = recording.shape.closed_outline
        self._pads = [np.concatenate((pad, pad[:1])) for pad in recording.sensor.pads]
        lines, points = rr.LineStrips2D, rr.Points2D
        drawn: list[tuple[str, Any, str, float]] = [  # from the back to the front
            ("others", lines, "others", 0.75),
            ("truth/outline", lines, "truth", 2.5),
            ("truth/path", points, "truth", 2.0),
            ("sensor/path", points, "sensor", 0.75),
            ("sensor/pad", lines, "sensor", 1.5),
            ("estimate/path", points, "estimate", 1.0),
            ("estimate/outline", lines, "estimate", 1.25),
            ("estimate/ellipse", lines, "estimate", 1.0),
            ("contact", lines, "contact", 3.0),
        ]
        for order, (path, kind, colour, radius) in enumerate(drawn, 10):
            style = {"colors": _rgb(COLOURS[colour]), "radii": rr.Radius.ui_points(radius), "draw_order": float(order)}
            stream.log(f"above/{path}", kind.from_fields(**style), static=True)
        for plot in ("translation", "rotation"):
            stream.log(f"{plot}/error", rr.SeriesLines(names="error", colors=_rgb(COLOURS["truth"])), static=True)
            stream.log(f"{plot}/sigma", rr.SeriesLines(names="1 sigma", colors=_rgb(COLOURS["estimate"])), static=True)
        colours = list(map(_rgb, STATUS_COLOURS.values()))
        stream.log("status", rr.StateConfiguration(values=list(STATUS_COLOURS), colors=colours), static=True)

    def send_all(self, scene: Scene) -> None:
        """Send all frames of a scene."""
        recording, images = scene.recording, touch_images(scene.recording, scene.calibration)
        truth = known_truth(recording)
        for index, when in enumerate(recording.time.tolist()):
            estimate = scene.estimates[index] if scene.estimates else None
            self.send(when, recording.sensor_pose[index], estimate, None if truth is None else truth[index])
            if recording.image is not None:
                self.send_images(*next(images))

    def send(
        self, time: float, sensor_pose: Array, estimate: Estimate | None = None, truth: Array | None = None
    ) -> None:
        """Send a frame without its images; the truth (3,) is NaN where it is unknown."""
        kind = "timestamp" if time > 1e8 else "duration"  # [s] since 1970, or since the recording began
        self._stream.set_time("time", **{kind: time})
        pads = [se2.transform(sensor_pose, pad) for pad in self._pads]
        self._strips("sensor/pad", pads)
        self._stream.log("above/sensor/path", rr.Points2D(sensor_pose[:2] * TO_PLANE))
        if truth is not None:
            self._object("truth", truth)
        if estimate is None:
            return
        self._object("estimate", estimate.pose)
        self._strips("estimate/ellipse", ellipses_95(estimate.pose[None], estimate.covariance[None]))
        self._strips("contact", pads if estimate.contact else [])
        self._strips("others", [se2.transform(one.pose, self._outline) for one in estimate.answers[1:]])
        self._stream.log("status", rr.StateChange(state=estimate.status))
        self._plots("sigma", *deviations(estimate.covariance[None]))
        if truth is not None:
            self._plots("error", translation_errors(estimate.pose, truth), rotation_errors(estimate.pose, truth))

    def send_images(self, image: Image, difference: Image | None) -> None:
        """Send the touch image of the last frame and, where it is known, its difference from the untouched gel."""
        for name, picture in (("image", image), ("difference", difference)):
            if picture is not None:
                self._stream.log(f"touch/{name}", rr.EncodedImage(contents=jpeg(picture), media_type="image/jpeg"))

    def _object(self, name: str, pose: Array) -> None:
        """Send the outline at a pose and the place of its origin; none where it is NaN."""
        poses = pose[None][np.isfinite(pose).all(keepdims=True)]
        self._strips(f"{name}/outline", se2.transform(poses[:, None], self._outline))
        self._stream.log(f"above/{name}/path", rr.Points2D(poses[:, :2] * TO_PLANE))

    def _strips(self, path: str, strips: Iterable[Array]) -> None:
        """Send line strips (P, 2) [m]."""
        self._stream.log(f"above/{path}", rr.LineStrips2D([strip * TO_PLANE for strip in strips]))

    def _plots(self, name: str, distance: Array, angle: Array) -> None:
        """Send a distance [m] and an angle [rad] to the plots."""
        self._stream.log(f"translation/{name}", rr.Scalars(1e3 * distance))
        self._stream.log(f"rotation/{name}", rr.Scalars(np.degrees(np.abs(angle))))


def _rgb(colour: str) -> list[int]:
    return list(bytes.fromhex(colour[1:]))


def _blueprint(is_live: bool) -> rrb.Blueprint:
    """Return the layout; a live one follows the last frame."""
    start, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    so_far = rrb.VisibleTimeRanges(timeline="time", start=start, end=cursor)
    paths = [f"above/{name}/path" for name in ("truth", "estimate", "sensor")]
    above = rrb.Spatial2DView(origin="above", name="From above [mm]", overrides=dict.fromkeys(paths, so_far))
    touch = rrb.Horizontal(
        rrb.Spatial2DView(origin="touch/image", name="Touch"),
        rrb.Spatial2DView(origin="touch/difference", name="Difference from the untouched gel"),
    )
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="translation", name="Translation [mm]"),
        rrb.TimeSeriesView(origin="rotation", name="Rotation [deg]"),
        rrb.StateTimelineView(origin="status", name="Status"),
        row_shares=[3, 3, 1.5],
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(above, touch, row_shares=[3, 2]), plots, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following" if is_live else "paused"),
        collapse_panels=True,
    )
