"""A scene as Rerun's entities, and their layout.

The view from above is in millimetres, and y is negated because Rerun's plane has y pointing down.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.se2 import ellipses_95
from palpate.geometry.shapes import Shape
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.types.sensor import SensorProfile
from palpate.viewer import colours
from palpate.viewer.scene import Scene, contact_points

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

Array = NDArray[np.float64]
TO_PLANE = np.array([1e3, -1e3])
"""Factors from world coordinates (x, y) [m] to Rerun's plane."""


class SceneLog:
    """Sends frames of one object and sensor to a Rerun stream, whole runs at once or live frames as they come."""

    def __init__(self, stream: "rr.RecordingStream", shape: Shape, sensor: SensorProfile) -> None:
        """Send colours and names of all entities."""
        self._stream = stream
        self._outline, self._field = shape.closed_outline, DistanceField.of(shape)
        self._pads = [np.concatenate((pad, pad[:1])) for pad in sensor.pads]
        for path, parts in _styles().items():
            stream.log(path, *parts, static=True)

    def send(self, scene: Scene) -> None:
        """Send all frames except their images."""
        import rerun as rr

        recording, estimate = scene.recording, scene.estimate
        time, sensor_pose = recording.time, recording.sensor_pose
        self._strips("above/sensor/pad", time, [[se2.transform(at, pad) for pad in self._pads] for at in sensor_pose])
        self._points("above/sensor/path", time, sensor_pose[:, :2], np.ones(len(time), np.bool_))
        if scene.truth is not None:
            self._poses("truth", time, scene.truth)
        if estimate is None:
            return
        pose, covariance = estimate.pose, estimate.covariance
        self._poses("estimate", time, pose)
        if scene.truth is not None:
            self._number("translation/error", time, 1e3 * translation_errors(pose, scene.truth))
            self._number("rotation/error", time, np.degrees(np.abs(rotation_errors(pose, scene.truth))))
        if covariance is not None:
            self._strips("above/estimate/ellipse", time, [[one] for one in ellipses_95(pose, covariance)])
            distance, angle = deviations(covariance)
            self._number("translation/sigma", time, 1e3 * distance)
            self._number("rotation/sigma", time, np.degrees(angle))
        if scene.contact is not None:
            points = contact_points(sensor_pose, pose, recording.sensor, self._field)
            self._points("above/contact", time, points, scene.contact)
        if scene.answers:
            others = [[se2.transform(one.pose, self._outline) for one in several[1:]] for several in scene.answers]
            self._strips("above/others", time, others)
        if scene.friction is not None:
            value, sigma = scene.friction.T
            for name, number in (("learnt", value), ("less", value - sigma), ("more", value + sigma)):
                self._number(f"friction/{name}", time, number)
        if estimate.status:
            self._columns("status", time, rr.StateChange.columns(state=list(estimate.status)))

    def send_images(self, path: str, time: Array, images: Sequence[bytes]) -> None:
        """Send encoded images (JPEG or PNG) at times (N,) [s]."""
        import rerun as rr

        if images:
            blobs = [np.frombuffer(one, np.uint8) for one in images]
            self._columns(path, time, rr.EncodedImage.columns(blob=blobs))

    def _poses(self, name: str, time: Array, pose: Array) -> None:
        """Send the outline at poses (N, 3), none where they are NaN, and the path of the origin."""
        is_known = np.asarray(np.isfinite(pose).all(axis=1))
        placed = se2.transform(pose[:, None], self._outline)
        outlines = [[one] if known else [] for one, known in zip(placed, is_known, strict=True)]
        self._strips(f"above/{name}/outline", time, outlines)
        self._points(f"above/{name}/path", time, pose[:, :2], is_known)

    def _strips(self, path: str, time: Array, strips: Sequence[Sequence[Array]]) -> None:
        """Send any number of line strips (P, 2) [m] at each frame."""
        import rerun as rr

        filled = [several or [np.empty((0, 2))] for several in strips]  # Rerun takes no frame without a strip
        flat = [one * TO_PLANE for several in filled for one in several]
        columns = rr.LineStrips2D.columns(strips=flat).partition([len(several) for several in filled])
        self._columns(path, time, columns)

    def _points(self, path: str, time: Array, points: Array, is_shown: NDArray[np.bool_]) -> None:
        import rerun as rr

        columns = rr.Points2D.columns(positions=points[is_shown] * TO_PLANE).partition(is_shown.astype(int))
        self._columns(path, time, columns)

    def _number(self, path: str, time: Array, values: Array) -> None:
        import rerun as rr

        self._columns(path, time, rr.Scalars.columns(scalars=values))

    def _columns(self, path: str, time: Array, columns: Any) -> None:
        import rerun as rr

        kind = "timestamp" if time[0] > 1e8 else "duration"  # [s] since 1970, or since the recording began
        rr.send_columns(path, [rr.TimeColumn("time", **{kind: time})], columns, recording=self._stream)


def _styles() -> dict[str, list[Any]]:
    """Return colours, widths and names of all entities."""
    import rerun as rr

    def rgb(colour: str) -> list[int]:
        return list(bytes.fromhex(colour[1:]))

    def drawn(kind: Any, colour: str, radius: float, order: float) -> list[Any]:
        return [kind.from_fields(colors=rgb(colour), radii=rr.Radius.ui_points(radius), draw_order=order)]

    def series(name: str, colour: str, width: float = 1.5) -> list[Any]:
        return [rr.SeriesLines(names=name, colors=rgb(colour), widths=width)]

    lines, points, statuses = rr.LineStrips2D, rr.Points2D, list(colours.STATUS)
    return {
        "above/others": drawn(lines, colours.OTHERS, 0.75, 10.0),
        "above/truth/outline": drawn(lines, colours.TRUTH, 2.5, 11.0),
        "above/truth/path": drawn(points, colours.TRUTH, 2.0, 11.0),
        "above/sensor/path": drawn(points, colours.SENSOR, 0.75, 12.0),
        "above/sensor/pad": drawn(lines, colours.SENSOR, 1.5, 13.0),
        "above/estimate/path": drawn(points, colours.ESTIMATE, 1.0, 14.0),
        "above/estimate/outline": drawn(lines, colours.ESTIMATE, 1.25, 15.0),
        "above/estimate/ellipse": drawn(lines, colours.ESTIMATE, 1.0, 16.0),
        "above/contact": drawn(points, colours.CONTACT, 4.0, 17.0),
        **{f"{plot}/error": series("error", colours.TRUTH) for plot in ("translation", "rotation")},
        **{f"{plot}/sigma": series("1 sigma", colours.ESTIMATE) for plot in ("translation", "rotation")},
        "friction/learnt": series("friction", colours.ESTIMATE),
        "friction/less": series("- 1 sigma", colours.ESTIMATE, 0.5),
        "friction/more": series("+ 1 sigma", colours.ESTIMATE, 0.5),
        "status": [rr.StateConfiguration(values=statuses, colors=[rgb(colours.STATUS[one]) for one in statuses])],
    }


def blueprint(scene: Scene, live: bool) -> "rrb.Blueprint":
    """Return the layout of a scene; a live one follows the last frame."""
    import rerun.blueprint as rrb

    start, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    so_far = rrb.VisibleTimeRanges(timeline="time", start=start, end=cursor)
    low, high = _bounds(scene)
    left: Any = rrb.Spatial2DView(
        origin="above",
        name="From above [mm]",
        visual_bounds=rrb.VisualBounds2D(x_range=(low[0], high[0]), y_range=(low[1], high[1])),
        overrides=dict.fromkeys([f"above/{name}/path" for name in ("truth", "estimate", "sensor")], so_far),
    )
    if scene.recording.image is not None:
        touch = rrb.Horizontal(
            rrb.Spatial2DView(origin="touch/image", name="Touch"),
            rrb.Spatial2DView(origin="touch/seen", name="Difference from the untouched gel"),
        )
        left = rrb.Vertical(left, touch, row_shares=[3, 2])
    legend, no_legend = rrb.PlotLegend("LeftTop"), rrb.PlotLegend(visible=False)
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="translation", name="Translation [mm]", plot_legend=legend),
        rrb.TimeSeriesView(origin="rotation", name="Rotation [deg]", plot_legend=legend),
        rrb.TimeSeriesView(origin="friction", name="Friction, as learnt, with 1 sigma", plot_legend=no_legend),
        rrb.StateTimelineView(origin="status", name="Status"),
        row_shares=[3, 3, 2, 1.5],
    )
    is_tracked = live or scene.estimate is not None
    return rrb.Blueprint(
        rrb.Horizontal(left, plots, column_shares=[3, 2]) if is_tracked else left,
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following" if live else "paused"),
        collapse_panels=True,
    )


def _bounds(scene: Scene) -> tuple[Array, Array]:
    """Return the corners of the area that sensor and object cover, in Rerun's plane."""
    recording = scene.recording
    reach = np.hypot(*recording.shape.outline().T).max()
    corners = []
    for poses in (recording.sensor_pose, scene.truth, None if scene.estimate is None else scene.estimate.pose):
        if poses is not None and (known := poses[np.isfinite(poses).all(axis=1), :2]).size:
            is_sensor_only = poses is recording.sensor_pose and scene.truth is not None
            margin = 0.02 + (0.0 if is_sensor_only else reach)
            corners += [TO_PLANE * (known.min(axis=0) - margin), TO_PLANE * (known.max(axis=0) + margin)]
    return np.min(corners, axis=0), np.max(corners, axis=0)
