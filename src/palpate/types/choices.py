"""Groups of choices that the command line offers as options; nothing heavy is imported, so `--help` stays fast.

Values are checked where they are used.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Tactile = Literal["none", "oracle", "learnt"]
"""Source of the touch measurements: none, the true turn by ground truth (oracle), or the touch model (learnt)."""
TactileChoice = Literal["auto", Tactile]
"""auto is learnt if there are images that fit the touch model, else none."""
SmootherName = Literal["fixed-lag", "batch"]
"""Solver for the graph of a contact: Gauss-Newton on a sliding window, or on all steps of the contact (batch)."""
MarkersChoice = Literal["auto", "off"]
"""auto looks for dark dots on the gel and leaves them out; off takes images as they are."""
Unit = Literal["m", "cm", "mm", "in"]
"""Unit of lengths."""
TimeUnit = Literal["s", "ms", "us", "ns"]
"""Unit of times."""
Normal = tuple[float, float, float] | Literal["fit"]
"""The normal of a plane, or "fit" for the plane through the sensor's path."""

DEFAULT_SENSOR = "digit"
"""Sensor of bags, images and presses, which do not say theirs: a name in `palpate.types.sensor.SENSORS`."""
DEFAULT_NOISE = "palpate"
"""Name of the defaults of `palpate.NoiseSettings` where a file of settings may be named too."""


@dataclass(frozen=True)
class TrackerChoices:
    """Settings of a tracker that are also options of commands, with the defaults of both."""

    tactile: TactileChoice = "auto"
    """Source of the touch measurements."""
    smoother: SmootherName = "fixed-lag"
    """Solver for the graph of a contact."""
    hypotheses: int = 9
    """Largest number of hypotheses kept after a contact's first frames; 1 keeps one always."""
    markers: MarkersChoice = "auto"
    """Dark dots on the gel are found and left out, or images are taken as they are."""


@dataclass(frozen=True)
class Placement:
    """Steps that make images and poses of a robot those of a sensor in a plane, for bags, arrays and live sessions."""

    orientation: str = ""
    """Steps to make images upright: 90, 180, 270 (degrees counter-clockwise), mirrored, bgr; or upright alone."""
    sensor_T_gel: tuple[float, float, float, float, float, float, float] | None = None
    """Pose of the gel in the frame of the sensor's poses, such as that of a flange: x, y, z [m], quaternion x, y, z, w.
    In Python it may also be a 4x4 matrix, or x, y, theta."""
    time_offset: float = 0.0
    """Added to the times of the images [s]: negative where they are stamped late."""
    plane: Normal = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the poses, or "fit" for the plane through the sensor's path."""
    off_plane: float = 0.01
    """Largest distance of poses from the plane [m]."""


@dataclass(frozen=True)
class BagChoices(Placement):
    """Settings for reading a bag; what is None is found where there is only one."""

    images: str | None = None
    """Topic of the touch images or, without images, of contact flags (std_msgs/Bool); with image times, a folder."""
    image_times: Path | str | None = None
    """Table of images in a folder, not in the bag: columns time, seconds or whole nanoseconds, and file."""
    sensor_poses: str | None = None
    """Topic of the sensor's poses, or its frames in the transforms, PARENT:CHILD."""
    object_poses: str | None = None
    """Topic or frames, likewise, of the object's poses, which are ground truth."""
    clock: Literal["header", "log"] = "header"
    """Clock of all times: the messages' headers, or their recording."""


@dataclass(frozen=True)
class TableChoices:
    """Settings for a folder of images with a table of poses; what is None is found where names or numbers tell it."""

    poses: Path | None = None
    """Table of times and poses of the sensor: 3 numbers a row (x, y, theta), 7 (x, y, z and a quaternion) or 16."""
    rate: float | None = None
    """Images a second [Hz], where neither a table nor their names have times; they begin with the first pose."""
    time_unit: TimeUnit | None = None
    """Unit of the times in tables and names of files."""
    poses_unit: Unit | None = None
    """Unit of the positions in tables."""
    quaternion: Literal["xyzw", "wxyz"] | None = None
    """Order of quaternions in a table whose columns have no names."""
