"""A run or a recording as a file for Rerun.

The view from above is in millimetres, and y is negated because Rerun's plane has y pointing down.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError, printable
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.pipeline.truth import known_truth
from palpate.types.images import codec_of
from palpate.viewer.scene import COLOURS, STATUS_COLOURS, Scene

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise SettingError("the viewer needs rerun-sdk, which is not installed: pip install palpate[view]") from error

Array = NDArray[np.float64]
TO_PLANE = np.array([1e3, -1e3])
"""Factors from world coordinates (x, y) [m] to Rerun's plane."""


def save_scene(scene: Scene, path: Path, force: bool = False) -> None:
    """Write a scene for Rerun's viewer (.rrd); FileError if the file exists, unless `force`."""
    if os.fsencode(path) != str(path).encode(errors="replace"):
        raise FileError(f"{path}: Rerun writes only to names that are UTF-8; --save names another file")
    with whole_file(path, overwrite=force) as part:
        stream = rr.RecordingStream("palpate")
        stream.send_recording_name(printable(scene.name))
        stream.save(part, _blueprint())
        _send_styles(stream)
        _send_scene(stream, scene)
        stream.disconnect()


def _send_styles(stream: rr.RecordingStream) -> None:
    """Send colours and widths of all that is drawn."""
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


def _send_scene(stream: rr.RecordingStream, scene: Scene) -> None:
    """Send all frames; nothing is drawn where it is unknown."""
    recording, online = scene.recording, scene.online
    kind = "timestamp" if recording.time[0] > 1e8 else "duration"  # [s] since 1970, or since the recording began
    time = rr.TimeColumn("time", **{kind: recording.time})
    outline = recording.shape.closed_outline
    pads = [np.concatenate((pad, pad[:1])) for pad in recording.sensor.pads]
    at_pads = [[se2.transform(pose, pad) for pad in pads] for pose in recording.sensor_pose]

    def send(path: str, columns: rr.ComponentColumnList) -> None:
        stream.send_columns(path, [time], columns)

    def send_strips(path: str, strips: Sequence[Sequence[Array]]) -> None:
        """Send line strips (P, 2) [m], of each frame none, one or several."""
        lengths, placed = list(map(len, strips)), [strip * TO_PLANE for some in strips for strip in some]
        send(f"above/{path}", rr.LineStrips2D.columns(strips=placed).partition(lengths))

    def send_path(name: str, poses: Array) -> None:
        """Send the origin of poses (N, 3)."""
        is_known = np.isfinite(poses).all(axis=1)
        points = rr.Points2D.columns(positions=poses[is_known, :2] * TO_PLANE)
        send(f"above/{name}/path", points.partition(is_known.astype(int)))

    def send_object(name: str, poses: Array) -> None:
        send_path(name, poses)
        known = [pose[None][np.isfinite(pose).all(keepdims=True)] for pose in poses]
        send_strips(f"{name}/outline", [[se2.transform(pose, outline) for pose in some] for some in known])

    def send_plots(name: str, distance: Array, angle: Array) -> None:
        """Send distances [m] and angles [rad] (N,)."""
        send(f"translation/{name}", rr.Scalars.columns(scalars=1e3 * distance))
        send(f"rotation/{name}", rr.Scalars.columns(scalars=np.degrees(np.abs(angle))))

    send_path("sensor", recording.sensor_pose)
    send_strips("sensor/pad", at_pads)
    for when, image in zip(recording.time.tolist(), recording.image or (), strict=False):
        if codec := codec_of(image):  # else it is damaged
            stream.set_time("time", **{kind: when})
            stream.log("touch", rr.EncodedImage(contents=image, media_type=f"image/{codec}"))
    truth = known_truth(recording)
    if np.isfinite(truth).any():
        send_object("truth", truth)
    if online is None:
        return
    assert online.covariance is not None and online.contact is not None
    send_object("estimate", online.pose)
    send_strips("estimate/ellipse", [[ellipse] for ellipse in ellipses_95(online.pose, online.covariance)])
    send_strips("contact", [some if touches else [] for some, touches in zip(at_pads, online.contact, strict=True)])
    send_strips("others", [[se2.transform(one.pose, outline) for one in some[1:]] for some in scene.answers])
    send("status", rr.StateChange.columns(state=online.status))
    send_plots("sigma", *deviations(online.covariance))
    if np.isfinite(truth).any():
        send_plots("error", translation_errors(online.pose, truth), rotation_errors(online.pose, truth))


def _rgb(colour: str) -> list[int]:
    return list(bytes.fromhex(colour[1:]))


def _blueprint() -> rrb.Blueprint:
    """Return the layout."""
    start, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    so_far = rrb.VisibleTimeRanges(timeline="time", start=start, end=cursor)
    paths = [f"above/{name}/path" for name in ("truth", "estimate", "sensor")]
    above = rrb.Spatial2DView(origin="above", name="From above [mm]", overrides=dict.fromkeys(paths, so_far))
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="translation", name="Translation [mm]"),
        rrb.TimeSeriesView(origin="rotation", name="Rotation [deg]"),
        rrb.StateTimelineView(origin="status", name="Status"),
        row_shares=[3, 3, 1.5],
    )
    touch = rrb.Spatial2DView(origin="touch", name="Touch")
    return rrb.Blueprint(
        rrb.Horizontal(above, touch, plots, column_shares=[4, 1.5, 3]),
        rrb.TimePanel(state="collapsed", timeline="time"),
        collapse_panels=True,
    )
