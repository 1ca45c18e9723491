"""Estimates in files: `estimates.csv` with covariance, status and its reason, and messages in an MCAP.

`estimates.csv` has one estimate a row in full double precision, SI units and radians; the covariance is that of the
tangent vector at the estimate (right, body frame), and contact is 1 or 0. Where there are several answers, origins are
those of `Answer.origin` with the number of answers of each, as "as before 1; shove 4".

Each estimate is written as three messages: a `PoseStamped`, which viewers draw; a `PoseWithCovarianceStamped`, whose
covariance is about the axes of the header's frame, as in ROS, not about those of the object; and a `DiagnosticArray`.
An outline that is learnt adds three `PolygonStamped`, itself and the edges of its 95 % band, and a `PointCloud2` of the
points of all three, since Rerun draws no polygons. They begin when the object has a place: one that may be anywhere
would be drawn at the world's origin.
"""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.config import ANYWHERE_SIGMA
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.io import ros_messages as ros
from palpate.types.estimate import Answers, Estimate, Trajectory, origins_text
from palpate.types.outline import Outline
from palpate.types.space import Plane, out_of_plane, spatial_covariance

COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
COLUMNS = ("time", "x", "y", "theta", *COVARIANCE, "contact", "status", "reason", "origins")
UPPER = np.triu_indices(3)

POSES = "/palpate/object_pose"
POSES_WITH_COVARIANCE = "/palpate/object_pose_with_covariance"
DIAGNOSTICS = "/palpate/diagnostics"
OUTLINES = ("/palpate/outline", "/palpate/outline_inner", "/palpate/outline_outer")
"""Topics of an outline that is learnt, and of the edges of its 95 % band."""
OUTLINE_POINTS = "/palpate/outline_points"
"""Topic of the points of all three."""
LEVELS = {"resting": 0, "tracking": 0, "indeterminate": 2, "faulty": 2}
"""DiagnosticStatus level of statuses: 0 is ok, 2 an error. All others have level 1, a warning."""


def write_estimates_mcap(
    trajectory: Trajectory, path: Path, plane: Plane, answers: Answers = (), outlines: Sequence[Outline] = ()
) -> None:
    """Write estimates, with any answers beside them and any outline that is learnt, as messages.

    Raises FileError if the file exists, or times cannot be stamps.
    """
    stamps = ros.nanoseconds(path, trajectory.time)
    rows = zip(*vars(trajectory).values(), strict=True)  # the fields of an Estimate up to the reason
    answers_of_rows = answers or ((),) * len(trajectory)
    outline_of_rows = outlines or (None,) * len(trajectory)
    with ros.new_mcap(path) as file:
        for stamp, row, those, outline in zip(stamps, rows, answers_of_rows, outline_of_rows, strict=True):
            file.add(stamp, estimate_messages(plane, stamp, Estimate(*row, answers=those, outline=outline)))


def estimate_messages(
    plane: Plane, stamp: int, estimate: Estimate, more: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return the messages of an estimate with its stamp [ns], by topic; `more` is added to its diagnosis."""
    header = ros.header(stamp, plane.frame)
    pose = ros.pose_in_space(plane, estimate.pose)
    covariance = spatial_covariance(plane, estimate.pose, estimate.covariance).reshape(36)
    pose_with_covariance = ros.message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance)
    values = {
        "reason": estimate.reason,
        "origins": origins_text(estimate.answers),
        "contact": str(bool(estimate.contact)).lower(),
        **(more or {}),
    }
    diagnosis = ros.message(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=LEVELS.get(estimate.status, 1),
        name="palpate: object pose",
        message=estimate.status,
        hardware_id="palpate",
        values=[ros.message("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
    )
    outlines: dict[str, Any] = {}
    if estimate.outline is not None and _has_place(estimate):
        outlines = _outline_messages(plane, header, estimate.pose, estimate.outline)
    return outlines | {
        POSES: ros.message(ros.POSE, header=header, pose=pose),
        POSES_WITH_COVARIANCE: ros.message(ros.POSE_WITH_COVARIANCE, header=header, pose=pose_with_covariance),
        DIAGNOSTICS: ros.message("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[diagnosis]),
    }


def _has_place(estimate: Estimate) -> bool:
    """Return False while the object may be anywhere."""
    return bool(np.sqrt(estimate.covariance.diagonal()[:2]).max() < ANYWHERE_SIGMA[0])


def _outline_messages(plane: Plane, header: Any, pose: Array, outline: Outline) -> dict[str, Any]:
    """Return a learnt outline and both edges of its 95 % band at a pose (3,), by topic."""
    messages: dict[str, Any] = {}
    lines: list[Array] = []
    for topic, line in zip(OUTLINES, (outline.points, *outline.edges()), strict=True):
        in_plane = se2.transform(pose, line)
        places = np.column_stack((in_plane, np.full(len(line), plane.height))) @ plane.axes.T
        points = [ros.message("geometry_msgs/msg/Point32", x=x, y=y, z=z) for x, y, z in places.tolist()]
        polygon = ros.message("geometry_msgs/msg/Polygon", points=points)
        messages[topic] = ros.message(ros.POLYGON, header=header, polygon=polygon)
        lines.append(places)
    return messages | {OUTLINE_POINTS: ros.point_cloud(header, np.concatenate(lines))}


def write_estimates_csv(data: Trajectory, path: Path, answers: Answers = ()) -> None:
    """Write estimates with covariance, contact, status, reason, and the origins of any answers beside them.

    Raises FileError if the file exists.
    """
    table = np.column_stack([data.time, data.pose, data.covariance[:, UPPER[0], UPPER[1]]])
    origins = [origins_text(those) for those in answers] or [""] * len(data)
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row, contact, *words in zip(table.tolist(), data.contact, data.status, data.reason, origins, strict=True):
            writer.writerow([*map(repr, row), int(contact), *words])


def write_tum(time: Array, pose: Array, path: Path, plane: Plane) -> None:
    """Write poses (N, 3) in a plane at times (N,) [s] as a trajectory in the format of TUM, as evo reads it.

    A row holds time, position [m] and quaternion x, y, z, w in the frame of the plane; poses that are unknown, NaN, are
    left out. Raises FileError if the file exists.
    """
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"# time [s], x y z [m], qx qy qz qw: world_T_object in {plane.frame}\n")
        for when, each in zip(time.tolist(), pose, strict=True):
            if np.isfinite(each).all():
                position, rotation = out_of_plane(plane, each)
                file.write(" ".join(map(repr, (when, *position.tolist(), *rotation.tolist()))) + "\n")
