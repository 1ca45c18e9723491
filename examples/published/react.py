"""Reader of yxma/React: two GelSight Minis held in the hands, with OptiTrack; a table and videos for each episode.

    python react.py DATASET/data/motherboard/meta/2026-09-11/episode_000.parquet left [UNIT.npz]

Each row of the table is a frame of `videos/DATE/EPISODE/tactile_left.mp4` and `tactile_right.mp4`. Columns: timestamp
[s]; sensor_left_pose, sensor_right_pose and object_pose, x, y, z [m] and a quaternion x, y, z, w in a world whose z is
up, NaN where the object is not tracked (all of pushT); tactile_left_is_new and tactile_right_is_new, false where an
image repeats the one before, which is left out. Poses are those of marked bodies: `sensor_T_gel` follows from
`calibration/T_gel_to_rigid_left.json`. Images of recordings up to 2026-06-18 are half a second older than their row:
`time_offset=-0.5`. It needs pyarrow.
"""

import sys
from itertools import compress
from pathlib import Path

import numpy as np
from pyarrow import ArrowException, parquet
from touch_data import TouchData, checked, film

import palpate


def read_episode(path: Path, side: str) -> TouchData:
    """Read the images of a side, left or right. Raises FileError."""
    names = "timestamp", f"sensor_{side}_pose", "object_pose"
    try:
        rows = parquet.ParquetFile(path).read().to_pydict()
    except (OSError, ArrowException) as error:
        raise palpate.FileError(f"{path}: is missing, or no table in Parquet ({error})") from error
    if missing := [name for name in names if name not in rows]:
        found = ", ".join(rows)
        raise palpate.FileError(
            f"{path}: found the columns {found}; {', '.join(missing)} is missing: side left or right?"
        )
    time, sensor, placed = (np.array(rows[name], np.float64) for name in names)
    is_new = np.array(rows.get(f"tactile_{side}_is_new", np.ones(len(time))), np.bool_)
    task, date = path.parents[2], path.parent.name
    video = task / "videos" / date / path.stem / f"tactile_{side}.mp4"
    images = list(film(video))
    checked(video, images, rows=time)
    kept, source = list(compress(images, is_new)), f"React, {task.name} {date} {path.stem}, {side}"
    return TouchData(time[is_new], kept, sensor[is_new], placed[is_new], palpate.GELSIGHT_MINI, source)


if __name__ == "__main__":
    unit = palpate.load_calibration(sys.argv[3]) if sys.argv[3:] else None
    print(read_episode(Path(sys.argv[1]), sys.argv[2]).about(unit))
