"""palpate's estimates as messages.

Each estimate is a `PoseStamped`, which viewers draw; with a covariance also a `PoseWithCovarianceStamped`, whose
covariance is about the axes of the header's frame as ROS has it, not the object's; with a status also a
`DiagnosticArray`.

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
from palpate.types.space import Plane, flat, out_of_plane, spatial_covariance

Array = NDArray[np.float64]

POSES, POSES_WITH_COVARIANCE = "/palpate/object_pose", "/palpate/object_pose_with_covariance"
ANSWERS, DIAGNOSTICS = "/palpate/object_pose_answers", "/palpate/diagnostics"
LEVELS = {"resting": 0, "tracking": 0, "indeterminate": 2, "faulty": 2}
"""DiagnosticStatus level of each status: 0 is ok, 2 an error; any other is a warning, 1."""


def write_estimates_mcap(
    trajectory: Trajectory,
    path: Path,
    plane: Plane | None = None,
    answers: Answers | None = None,
) -> None:
    """Write estimates, by default in the plane z = 0 of the frame "world", and all answers where these are known.

    Raises FileError if the file exists, or times cannot be stamps.
    """
    stamps = nanoseconds(path, trajectory.time)
    with new_mcap(path) as file:
        add_estimates(file, trajectory, stamps, plane or flat(), answers)


def add_estimates(
    sink: MessageSink,
    trajectory: Trajectory,
    stamps: Sequence[int],
    plane: Plane,
    answers: Answers | None = None,
    values: Mapping[str, str] | None = None,
) -> None:
    """Add the messages of estimates with their stamps [ns]; `values` are added to each diagnosis.

    Where answers are given, estimates have covariances.
    """
    pose, covariance, contact = trajectory.pose, trajectory.covariance, trajectory.contact
    placed = [sink.pose(*each) for each in zip(*out_of_plane(plane, pose), strict=True)]
    spatial = None if covariance is None else spatial_covariance(plane, pose, covariance)
    for index, stamp in enumerate(stamps):
        header = sink.header(stamp, plane.frame)
        sink.add(POSES, POSE, stamp, header=header, pose=placed[index])
        found = {} if contact is None else {"contact": str(bool(contact[index])).lower()}
        if covariance is not None and spatial is not None:
            terms = spatial[index].reshape(36)
            both = sink.make("geometry_msgs/msg/PoseWithCovariance", pose=placed[index], covariance=terms)
            sink.add(POSES_WITH_COVARIANCE, POSE_WITH_COVARIANCE, stamp, header=header, pose=both)
            found |= _sigmas("sigma", covariance[index : index + 1])
            if answers is not None:
                several = answers[index] or (Answer(pose[index], covariance[index], 1.0),)
                at = zip(*out_of_plane(plane, np.array([one.pose for one in several])), strict=True)
                sink.add(ANSWERS, POSE_ARRAY, stamp, header=header, poses=[sink.pose(*each) for each in at])
                found["answer weights"] = " ".join(f"{one.weight:.4f}" for one in several)
                found |= _sigmas("answer sigmas", np.array([one.covariance for one in several]))
        if trajectory.status is not None:
            _add_diagnostics(sink, header, stamp, trajectory.status[index], {**found, **(values or {})})


def _sigmas(name: str, covariance: Array) -> dict[str, str]:
    """Return the standard deviations of covariances (N, 3, 3), N numbers each."""
    x, y, yaw = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).T
    units = {"x [mm]": 1e3 * x, "y [mm]": 1e3 * y, "yaw [deg]": np.degrees(yaw)}
    return {f"{name} {unit}": " ".join(f"{one:.2f}" for one in sigma) for unit, sigma in units.items()}


def _add_diagnostics(sink: MessageSink, header: object, stamp: int, status: str, values: Mapping[str, str]) -> None:
    diagnosis = sink.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=LEVELS.get(status, 1),
        name="palpate: object pose",
        message=status,
        hardware_id="palpate",
        values=[sink.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
    )
    sink.add(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", stamp, header=header, status=[diagnosis])
