"""A run or a recording as a file for Rerun.

The view from above is in millimetres, and y is negated because Rerun's plane has y pointing down.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError, printable
from palpate.files import read_json, whole_file
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.io import load_recording
from palpate.io.estimates import read_estimates_csv
from palpate.pipeline.figures import COLOURS, STATUS_COLOURS
from palpate.types.estimate import Trajectory
from palpate.types.images import codec_of
from palpate.types.recording import Recording

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise SettingError("the viewer needs rerun-sdk, which is not installed: pip install palpate[view]") from error

Array = NDArray[np.float64]
TO_PLANE = np.array([1e3, -1e3])
"""Factors from world coordinates (x, y) [m] to Rerun's plane."""


def write_view(path: Path, file: Path, force: bool = False) -> None:
    """Write the folder of a run, or a recording of any known format, for Rerun's viewer (.rrd).

    Raises FileError if the file exists, unless `force`, and if the run is not whole.
    """
    if os.fsencode(file) != str(file).encode(errors="replace"):
        raise FileError(f"{file}: Rerun writes only to names that are UTF-8; --save names another file")
    recording, online = _run_of(path) if path.is_dir() else (load_recording(path), None)
    with whole_file(file, overwrite=force) as part:
        stream = rr.RecordingStream("palpate")
        stream.send_recording_name(printable(path.resolve().name))
        stream.save(part, _blueprint())
        _send_frames(stream, recording, online)
        stream.disconnect()


def _run_of(folder: Path) -> tuple[Recording, Trajectory]:
    """Return the recording of a run and its estimates. Raises FileError."""
    if not (folder / "settings.json").exists():
        raise FileError(f"{folder}: is no run of palpate track: there is no settings.json in it")
    if not isinstance(file := read_json(folder / "settings.json").get("recording"), str):
        raise FileError(f"{folder / 'settings.json'}: recording is {file!r}, expected the name of a file")
    recording, online = load_recording(folder / file), read_estimates_csv(folder / "estimates.csv")
    if not np.array_equal(online.time, recording.time):
        raise FileError(
            f"{folder}: its {len(online)} estimates are not of the {len(recording)} frames of {recording.file}, "
            "which is another recording now; track it again"
        )
    return recording, online


def _send_frames(stream: rr.RecordingStream, recording: Recording, online: Trajectory | None) -> None:
    """Send all frames; nothing is drawn where it is unknown."""
    kind = "timestamp" if recording.time[0] > 1e8 else "duration"  # [s] since 1970, or since the recording began
    time = rr.TimeColumn("time", **{kind: recording.time})
    outline = recording.shape.closed_outline
    pads = [np.concatenate((pad, pad[:1])) for pad in recording.sensor.pads]
    at_pads = [[se2.transform(pose, pad) for pad in pads] for pose in recording.sensor_pose]

    def send_strips(name: str, strips: Sequence[Sequence[Array]], colour: str, radius: float, order: float) -> None:
        """Send line strips (P, 2) [m], of each frame none, one or several; a higher order is drawn on top."""
        style = {"colors": _rgb(COLOURS[colour]), "radii": rr.Radius.ui_points(radius), "draw_order": order}
        stream.log(f"above/{name}", rr.LineStrips2D.from_fields(**style), static=True)
        lengths, placed = list(map(len, strips)), [strip * TO_PLANE for some in strips for strip in some]
        stream.send_columns(f"above/{name}", [time], rr.LineStrips2D.columns(strips=placed).partition(lengths))

    def send_path(name: str, poses: Array) -> None:
        """Send the path of the origin of poses (N, 3)."""
        style = {"colors": _rgb(COLOURS[name]), "radii": rr.Radius.ui_points(1.0)}
        stream.log(f"above/{name}_path", rr.Points2D(poses[:, :2] * TO_PLANE, **style), static=True)

    def send_object(name: str, poses: Array, radius: float, order: float) -> None:
        is_known = np.asarray(np.isfinite(poses).all(axis=1))
        send_path(name, poses[is_known])
        placed = zip(se2.transform(poses[:, None], outline), is_known, strict=True)
        send_strips(name, [[strip] if known else [] for strip, known in placed], name, radius, order)

    send_path("sensor", recording.sensor_pose)
    send_strips("sensor", at_pads, "sensor", 1.5, 11.0)
    for when, image in zip(recording.time.tolist(), recording.image or (), strict=False):
        if codec := codec_of(image):  # else it is damaged
            stream.set_time("time", **{kind: when})
            stream.log("touch", rr.EncodedImage(contents=image, media_type=f"image/{codec}"))
    if recording.trusted_truth.any() and recording.object_pose is not None:
        send_object("truth", recording.object_pose, 2.5, 10.0)
    if online is None:
        return
    assert online.covariance is not None and online.contact is not None
    send_object("estimate", online.pose, 1.25, 12.0)
    ellipses = ellipses_95(online.pose, online.covariance)
    send_strips("ellipse", [[ellipse] for ellipse in ellipses], "estimate", 1.0, 13.0)
    touching = [some if touches else [] for some, touches in zip(at_pads, online.contact, strict=True)]
    send_strips("contact", touching, "contact", 3.0, 14.0)
    colours = list(map(_rgb, STATUS_COLOURS.values()))
    stream.log("status", rr.StateConfiguration(values=list(STATUS_COLOURS), colors=colours), static=True)
    stream.send_columns("status", [time], rr.StateChange.columns(state=online.status))


def _rgb(colour: str) -> list[int]:
    return list(bytes.fromhex(colour[1:]))


def _blueprint() -> rrb.Blueprint:
    """Return the layout."""
    above = rrb.Spatial2DView(origin="above", name="From above [mm]")
    touch = rrb.Spatial2DView(origin="touch", name="Touch")
    status = rrb.StateTimelineView(origin="status", name="Status")
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(above, touch, column_shares=[3, 1]), status, row_shares=[5, 1]),
        rrb.TimePanel(state="collapsed", timeline="time"),
        collapse_panels=True,
    )
