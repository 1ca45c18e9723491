"""TUM trajectories: lines `t x y z qx qy qz qw` [s, m]; '#' starts a comment. Planar ones only."""

import math
import re
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import in_file, read_text, whole_file
from palpate.io.text_files import NUMBER, text_start
from palpate.types.estimate import Trajectory
from palpate.types.recording import Recording

DESCRIPTION = "TUM trajectory (.tum, .txt)"
ROW = re.compile(rf"({NUMBER}\s+){{7}}{NUMBER}")


def detect(path: Path) -> bool:
    """Return true if the first rows are poses."""
    lines = text_start(path).splitlines()
    rows = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")][:5]
    # The last row may be cut off by the end of what was read.
    return bool(rows) and all(ROW.fullmatch(row) and _is_unit(row) for row in rows[:-1] or rows)


def read(path: Path) -> Trajectory:
    """Read a trajectory. Raises FileError that names the line, also for a pose out of the plane."""
    table = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        row = line.split("#")[0].strip()
        if not row:
            continue
        if not ROW.fullmatch(row):
            raise FileError(f"{path}: line {number}: found {row[:80]!r}, expected 8 numbers with blanks between")
        values = [float(value) for value in row.split()]
        _, _, _, z, qx, qy, qz, qw = values
        if not _is_unit(row):
            length = math.hypot(*values[4:])
            quaternion = f"{qx:g} {qy:g} {qz:g} {qw:g}"
            raise FileError(f"{path}: line {number}: quaternion {quaternion} has length {length:.6g}, expected 1")
        if max(abs(z), abs(qx), abs(qy)) > 1e-6:
            raise FileError(
                f"{path}: line {number}: the pose is out of the plane (z = {z:g}, qx = {qx:g}, qy = {qy:g}), "
                "allowed are absolute values up to 1e-06"
            )
        table.append(values)
    if not table:
        raise FileError(f"{path}: holds no poses")
    time, x, y, _, _, _, qz, qw = np.array(table).T
    # q and -q are one rotation: folding qw to positive keeps the angle in [-pi, pi].
    angle = 2.0 * np.arctan2(np.where(qw < 0, -qz, qz), np.abs(qw))
    with in_file(path):
        return Trajectory(time, np.column_stack([x, y, angle]))


def write(data: Recording | Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write poses of the object with 9 decimals: a trajectory, or the ground truth of a recording. Raises FileError."""
    if isinstance(data, Recording):
        if data.object_pose is None:
            raise FileError(f"{path}: the recording has no object poses to write")
        known = ~np.isnan(data.object_pose).any(axis=1)
        time, pose = data.time[known], data.object_pose[known]
    else:
        time, pose = data.time, data.pose
    zero = np.zeros(len(time))
    half = pose[:, 2] / 2
    table = np.column_stack([time, pose[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    with whole_file(path, overwrite) as temporary:
        np.savetxt(temporary, table, fmt="%.9f")


def lost(data: Recording | Trajectory) -> list[str]:
    """Return the names of data that poses alone do not hold."""
    if isinstance(data, Recording):
        unknown = 0 if data.object_pose is None else int(np.isnan(data.object_pose).any(axis=1).sum())
        frames = [f"{unknown} of {len(data)} frames (without ground truth)"] if unknown else []
        fields = {
            "images": data.image,
            "contact flags": data.contact,
            "contact episodes": data.episode,
            "other measurements": data.extra,
        }
        frames += ["sensor poses", "outline and sensor"]
    else:
        frames = []
        fields = {"covariances": data.covariance, "contact flags": data.contact, "statuses": data.status}
    return [*frames, *(name for name, values in fields.items() if values is not None and len(values))]


def _is_unit(row: str) -> bool:
    return abs(math.hypot(*(float(value) for value in row.split()[4:])) - 1.0) < 1e-3
