"""palpate's estimates as messages.

Each estimate is a `PoseStamped`, which viewers draw, a `PoseWithCovarianceStamped`, whose covariance is about the axes
of the header's frame as ROS has it, not the object's, and a `DiagnosticArray`.

All answers are a `PoseArray`, the best first; the diagnostics of the same stamp hold their weights and sigmas in the
same order, as no message that every ROS 2 has holds poses with weights.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.io.mcap_file import nanoseconds, new_mcap
from palpate.io.ros_messages import POSE, POSE_ARRAY, POSE_WITH_COVARIANCE, MessageSink
from palpate.types.estimate import Answer, Answers, Trajectory
from palpate.types.space import Plane, out_of_plane, spatial_covariance

Array = NDArray[np.float64]

POSES, POSES_WITH_COVARIANCE = "/palpate/object_pose", "/palpate/object_pose_with_covariance"
ANSWERS, DIAGNOSTICS = "/palpate/object_pose_answers", "/palpate/diagnostics"
LEVELS = {"resting": 0, "tracking": 0, "indeterminate": 2, "faulty": 2}
"""DiagnosticStatus level of each status: 0 is ok, 2 an error; any other is a warning, 1."""


def write_estimates_mcap(trajectory: Trajectory, path: Path, plane: Plane, answers: Answers) -> None:
    """Write estimates with all answers. Raises FileError if the file exists, or times cannot be stamps."""
    stamps = nanoseconds(path, trajectory.time)
    with new_mcap(path) as file:
        add_estimates(file, trajectory, stamps, plane, answers)


def add_estimates(
    sink: MessageSink,
    trajectory: Trajectory,
    stamps: Sequence[int],
    plane: Plane,
    answers: Answers,
    more: Mapping[str, str] | None = None,
) -> None:
    """Add the messages of estimates with covariance, contact and status, and their stamps [ns].

    `more` is added to each diagnosis. An estimate without answers is the only one.
    """
    pose, covariance, contact, status = trajectory.pose, trajectory.covariance, trajectory.contact, trajectory.status
    assert covariance is not None and contact is not None and status is not None
    placed = [sink.pose(*each) for each in zip(*out_of_plane(plane, pose), strict=True)]
    spatial = spatial_covariance(plane, pose, covariance).reshape(-1, 36)
    for index, stamp in enumerate(stamps):
        header = sink.header(stamp, plane.frame)
        sink.add(POSES, POSE, stamp, header=header, pose=placed[index])
        both = sink.make("geometry_msgs/msg/PoseWithCovariance", pose=placed[index], covariance=spatial[index])
        sink.add(POSES_WITH_COVARIANCE, POSE_WITH_COVARIANCE, stamp, header=header, pose=both)
        several = answers[index] or (Answer(pose[index], covariance[index], 1.0),)
        at = zip(*out_of_plane(plane, np.array([one.pose for one in several])), strict=True)
        sink.add(ANSWERS, POSE_ARRAY, stamp, header=header, poses=[sink.pose(*each) for each in at])
        values = {
            "contact": str(bool(contact[index])).lower(),
            **_sigmas("sigma", covariance[index : index + 1]),
            "answer weights": " ".join(f"{one.weight:.4f}" for one in several),
            **_sigmas("answer sigmas", np.array([one.covariance for one in several])),
            **(more or {}),
        }
        diagnosis = sink.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=LEVELS.get(status[index], 1),
            name="palpate: object pose",
            message=status[index],
            hardware_id="palpate",
            values=[sink.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
        )
        sink.add(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", stamp, header=header, status=[diagnosis])


def _sigmas(name: str, covariance: Array) -> dict[str, str]:
    """Return the standard deviations of covariances (N, 3, 3), N numbers each."""
    x, y, yaw = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).T
    units = {"x [mm]": 1e3 * x, "y [mm]": 1e3 * y, "yaw [deg]": np.degrees(yaw)}
    return {f"{name} {unit}": " ".join(f"{one:.2f}" for one in sigma) for unit, sigma in units.items()}
