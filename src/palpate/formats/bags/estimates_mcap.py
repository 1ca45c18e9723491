"""palpate's estimates as MCAP, and back without loss.

Each estimate is a `PoseStamped`, which viewers draw; with a covariance also a `PoseWithCovarianceStamped`, whose
covariance is about the axes of the header's frame as ROS has it, not the object's; with a status also a
`DiagnosticArray`. palpate's own `estimates.csv`, which holds all of it to the last bit, comes along as an attachment.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from palpate.formats.bags.mcap_file import leading_attachments
from palpate.formats.bags.mcap_writer import nanoseconds, new_mcap
from palpate.formats.bags.message_sink import MessageSink
from palpate.formats.bags.messages import POSE, POSE_WITH_COVARIANCE
from palpate.formats.estimates_csv import trajectory_from_text, trajectory_to_text
from palpate.recording.plane import Plane, flat, out_of_plane, spatial_covariance
from palpate.recording.trajectory import Trajectory

ATTACHMENT, MEDIA_TYPE = "palpate-estimates.csv", "text/csv"
POSES, POSES_WITH_COVARIANCE = "/palpate/object_pose", "/palpate/object_pose_with_covariance"
DIAGNOSTICS = "/palpate/diagnostics"

NOTHING: Mapping[str, str] = MappingProxyType({})

OK, WARN, ERROR = 0, 1, 2
LEVELS = {"resting": OK, "tracking": OK, "indeterminate": ERROR, "faulty": ERROR}
"""How bad a status is to ROS; any other is a warning."""


def write_estimates_mcap(
    trajectory: Trajectory, path: Path, overwrite: bool = False, plane: Plane | None = None
) -> None:
    """Write estimates, by default in the plane z = 0 of the frame "world".

    Raises FileError if the file exists and `overwrite` is not set, or times cannot be stamps.
    """
    stamps = nanoseconds(path, trajectory.time)
    with new_mcap(path, overwrite) as file:
        file.attach(ATTACHMENT, MEDIA_TYPE, trajectory_to_text(trajectory).encode())
        add_estimates(file, trajectory, stamps, plane or flat())


def add_estimates(
    sink: MessageSink, trajectory: Trajectory, stamps: Sequence[int], plane: Plane, said: Mapping[str, str] = NOTHING
) -> None:
    """Add the messages of estimates with their stamps [ns]; `said` is more that each diagnosis is to tell."""
    position, rotation = out_of_plane(plane, trajectory.pose)
    spatial = (
        None if trajectory.covariance is None else spatial_covariance(plane, trajectory.pose, trajectory.covariance)
    )
    for index, stamp in enumerate(stamps):
        header, pose = sink.header(stamp, plane.frame), sink.pose(position[index], rotation[index])
        sink.add(POSES, POSE, stamp, header=header, pose=pose)
        if spatial is not None:
            both = sink.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=spatial[index].reshape(36))
            sink.add(POSES_WITH_COVARIANCE, POSE_WITH_COVARIANCE, stamp, header=header, pose=both)
        if trajectory.status is not None:
            _add_diagnostics(sink, trajectory, index, stamp, plane.frame, said)


def read_estimates_mcap(path: Path) -> Trajectory | None:
    """The estimates in an MCAP that palpate wrote, or None."""
    text = leading_attachments(path).get(ATTACHMENT)
    return None if text is None else trajectory_from_text(text.decode("utf-8", errors="replace"), path)


def _add_diagnostics(
    sink: MessageSink, trajectory: Trajectory, index: int, stamp: int, frame: str, said: Mapping[str, str]
) -> None:
    assert trajectory.status is not None
    status = trajectory.status[index]
    values: dict[str, str] = {}
    if trajectory.contact is not None:
        values["contact"] = str(bool(trajectory.contact[index])).lower()
    if trajectory.covariance is not None:
        x, y, yaw = np.sqrt(np.diag(trajectory.covariance[index]))
        values |= {"sigma x [mm]": f"{x * 1e3:.2f}", "sigma y [mm]": f"{y * 1e3:.2f}"}
        values["sigma yaw [deg]"] = f"{np.degrees(yaw):.2f}"
    values |= said
    diagnosis = sink.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=LEVELS.get(status, WARN),
        name="palpate: object pose",
        message=status,
        hardware_id="palpate",
        values=[sink.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
    )
    sink.add(
        DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", stamp, header=sink.header(stamp, frame), status=[diagnosis]
    )
