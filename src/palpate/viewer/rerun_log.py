"""Frames of a scene as Rerun's entities, any number at once: whole runs in one go, live ones as they come.

All that is seen from above is in millimetres, and y is turned round, for Rerun's plane has y pointing down.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.lines import closed_outline, ellipses_95
from palpate.geometry.shapes import Shape
from palpate.pipeline.metrics import deviations, rotation_errors, translation_errors
from palpate.types.sensor import SensorProfile
from palpate.viewer import colours
from palpate.viewer.geometry import contact_points
from palpate.viewer.scene import Scene

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

TIMELINE = "time"
_EPOCH = 1e8  # [s] times from here on are dates, and not seconds since something began
PLANE = np.array([1e3, -1e3])
"""From world coordinates (x, y) [m] to Rerun's plane."""


class SceneLog:
    """Sends frames of one object and sensor to a recording stream."""

    def __init__(self, stream: "rr.RecordingStream", shape: Shape, sensor: SensorProfile) -> None:
        """Take where to send and what is seen; colours and names are sent at once."""
        self._stream = stream
        self._outline = closed_outline(shape)
        self._field = DistanceField.of(shape)
        self._pads = _closed_pads(sensor)
        for path, parts in _looks().items():
            stream.log(path, *parts, static=True)

    def send(self, scene: Scene) -> None:
        """Send all frames, but for their images."""
        import rerun as rr

        recording = scene.recording
        self._time = recording.time
        self._send_sensor(recording.sensor_pose)
        if scene.truth is not None:
            self.send_truth(recording.time, scene.truth, None if scene.estimate is None else scene.estimate.pose)
        if scene.estimate is None:
            return
        pose, covariance = scene.estimate.pose, scene.estimate.covariance
        self._send_poses("estimate", pose)
        if covariance is not None:
            self._send_strips("above/estimate/ellipse", [[each] for each in ellipses_95(pose, covariance)])
            distance, angle = deviations(covariance)
            self._send_number("translation/sigma", 1e3 * distance)
            self._send_number("rotation/sigma", np.degrees(angle))
        if scene.contact is not None:
            points = contact_points(recording.sensor_pose, pose, recording.sensor, self._field)
            self._send_points("above/contact", points, scene.contact)
        if scene.answers:
            others = [[se2.transform(one.pose, self._outline) for one in several[1:]] for several in scene.answers]
            self._send_strips("above/others", others)
        if scene.friction is not None:
            value, deviation = scene.friction.T
            self._send_number("friction/learnt", value)
            self._send_number("friction/less", value - deviation)
            self._send_number("friction/more", value + deviation)
        if scene.estimate.status:
            self._columns("status", rr.StateChange.columns(state=list(scene.estimate.status)))

    def send_truth(self, time: Array, truth: Array, estimate: Array | None) -> None:
        """Send true poses (N, 3) at times (N,) [s] and, of estimates (N, 3) of the same times, their errors."""
        self._time = time
        self._send_poses("truth", truth)
        if estimate is not None:
            self._send_number("translation/error", 1e3 * translation_errors(estimate, truth))
            self._send_number("rotation/error", np.degrees(np.abs(rotation_errors(estimate, truth))))

    def send_images(self, path: str, time: Array, images: Sequence[bytes]) -> None:
        """Send encoded images (JPEG or PNG) at times (N,) [s]."""
        import rerun as rr

        if images:
            self._columns(path, rr.EncodedImage.columns(blob=[np.frombuffer(each, np.uint8) for each in images]), time)

    def _send_poses(self, name: str, pose: Array) -> None:
        """Outlines at poses (N, 3), none where they are NaN, and the path of the origin."""
        known = np.asarray(np.isfinite(pose).all(axis=1))
        placed = se2.transform(pose[:, None], self._outline)
        outlines = [[each] if there else [] for each, there in zip(placed, known, strict=True)]
        self._send_strips(f"above/{name}/outline", outlines)
        self._send_points(f"above/{name}/path", pose[:, :2], known)

    def _send_sensor(self, pose: Array) -> None:
        self._send_strips("above/sensor/pad", [[se2.transform(each, pad) for pad in self._pads] for each in pose])
        self._send_points("above/sensor/path", pose[:, :2], np.ones(len(pose), np.bool_))

    def _send_strips(self, path: str, strips: Sequence[Sequence[Array]]) -> None:
        """Line strips (P, 2) [m] at each frame, any number of them."""
        import rerun as rr

        # Rerun takes no column without a strip; one without points draws nothing either.
        filled = [several or [np.empty((0, 2))] for several in strips]
        flat = [each * PLANE for several in filled for each in several]
        counts = [len(several) for several in filled]
        self._columns(path, rr.LineStrips2D.columns(strips=flat).partition(counts))

    def _send_points(self, path: str, points: Array, shown: NDArray[np.bool_]) -> None:
        import rerun as rr

        self._columns(path, rr.Points2D.columns(positions=points[shown] * PLANE).partition(shown.astype(int)))

    def _send_number(self, path: str, values: Array) -> None:
        import rerun as rr

        self._columns(path, rr.Scalars.columns(scalars=values))

    def _columns(self, path: str, columns: Any, time: Array | None = None) -> None:
        import rerun as rr

        time = self._time if time is None else time
        kind = "timestamp" if time[0] > _EPOCH else "duration"
        rr.send_columns(path, [rr.TimeColumn(TIMELINE, **{kind: time})], columns, recording=self._stream)


def _closed_pads(sensor: SensorProfile) -> list[Array]:
    return [np.concatenate((pad, pad[:1])) for pad in sensor.pads]


def _looks() -> dict[str, list[Any]]:
    """Colours, widths and names of all entities."""
    import rerun as rr

    def lines(colour: str, width: float, above: float = 20.0) -> list[Any]:
        looks = {"colors": _rgb(colour), "radii": rr.Radius.ui_points(width), "draw_order": above}
        return [rr.LineStrips2D.from_fields(**looks)]

    def points(colour: str, size: float, above: float = 20.0) -> list[Any]:
        looks = {"colors": _rgb(colour), "radii": rr.Radius.ui_points(size), "draw_order": above}
        return [rr.Points2D.from_fields(**looks)]

    def series(name: str, colour: str, width: float = 1.5) -> list[Any]:
        return [rr.SeriesLines(names=name, colors=_rgb(colour), widths=width)]

    statuses = list(colours.STATUS)
    return {
        "above/others": lines(colours.OTHERS, 0.75, above=10.0),
        "above/truth/outline": lines(colours.TRUTH, 2.5, above=11.0),
        "above/truth/path": points(colours.TRUTH, 2.0, above=11.0),
        "above/sensor/path": points(colours.SENSOR, 0.75, above=12.0),
        "above/sensor/pad": lines(colours.SENSOR, 1.5, above=13.0),
        "above/estimate/path": points(colours.ESTIMATE, 1.0, above=14.0),
        "above/estimate/outline": lines(colours.ESTIMATE, 1.25, above=15.0),
        "above/estimate/ellipse": lines(colours.ESTIMATE, 1.0, above=16.0),
        "above/contact": points(colours.CONTACT, 4.0, above=17.0),
        "translation/error": series("error", colours.TRUTH),
        "translation/sigma": series("1 sigma", colours.ESTIMATE),
        "rotation/error": series("error", colours.TRUTH),
        "rotation/sigma": series("1 sigma", colours.ESTIMATE),
        "friction/learnt": series("friction", colours.ESTIMATE),
        "friction/less": series("- 1 sigma", colours.ESTIMATE, 0.5),
        "friction/more": series("+ 1 sigma", colours.ESTIMATE, 0.5),
        "status": [rr.StateConfiguration(values=statuses, colors=[_rgb(colours.STATUS[each]) for each in statuses])],
    }


def _rgb(colour: str) -> list[int]:
    return list(bytes.fromhex(colour[1:]))
