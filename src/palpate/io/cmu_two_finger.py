"""Pushes of a rectangle by a two-finger hand, CMU PlanarManipulationToolBox: CSV without a header.

Columns: time [s], object x, y [mm], theta [rad], hand x, y [mm], theta [rad], action id. Object rows of exactly 0, 0, 0
are a lost tag: NaN. The first row is not valid. A new action id is a new contact, on another side.

The 16 logs of `bigrect_3pts` show, and this reader applies:

- The hand's x axis points along the push. The rectangle is 51 mm along the object's x.
- The camera is late: when the hand stops, the object is seen to move on, as far as the hand goes in 0.14 to 0.20 s,
  median 0.164 s. Ground truth is therefore taken 0.164 s later in the file.
- With that, and the hand's origin midway between the centres of the tips, the gap between tips and rectangle in steady
  pushing is 0.0 mm on average, standard deviation 1.0 mm. The sensor pose is the midpoint of the apexes, one radius
  ahead of the hand's origin.

Logs of other objects look the same; they are refused for their gaps.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate.arrays import Array, Flags
from palpate.checks import checked_times
from palpate.errors import FileError
from palpate.files import numbers_of, read_text, text_start
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.io.recording import Recording, contact_flags
from palpate.types.sensor import SensorProfile

RECTANGLE = Rectangle(0.051, 0.036)
HAND = SensorProfile(name="CMU two-finger hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=1.0 / 0.03)

LATENCY = 0.164
"""[s] by which the camera's object pose is older than the hand pose in the same row."""


def is_cmu_log(path: Path) -> bool:
    """Return true if the first rows are those of a log: eight numbers, the last one an action id.

    Tables of poses have eight numbers, too, and may end in the quaternion 0, 0, 0, 1.
    """
    lines = text_start(path).splitlines()[:5]
    # The last line may be cut off, as only the start of the file was read.
    rows = [numbers_of(line.split(",")) or [] for line in lines[:-1] or lines]
    if {len(row) for row in rows} != {8}:
        return False
    action = rows[0][7]
    return action >= 1.0 and action.is_integer() and any(rows[-1][4:7])


def read_cmu_log(path: Path) -> Recording:
    """Read one log. Raises FileError."""
    all_rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        row = numbers_of(line.split(",")) or []
        if len(row) != 8 and line.strip():
            raise FileError(f"line {number}: found {line[:80]!r}, expected 8 numbers")
        if row:
            all_rows.append(row)
    rows = np.array(all_rows)[1:]
    if not len(rows):
        raise FileError("found a single row, and the first row of a log is not valid")
    is_later = np.append(True, rows[1:, 0] > np.maximum.accumulate(rows[:, 0])[:-1])  # than all rows before
    rows = rows[is_later]
    time = checked_times(rows[:, 0]) - rows[0, 0]
    metres = np.array([1e-3, 1e-3, 1.0])
    sensor_pose = se2.compose(rows[:, 4:7] * metres, np.array([[HAND.radius, 0.0, 0.0]]))
    camera_pose = rows[:, 1:4] * metres
    is_known = (camera_pose != 0).any(axis=1)
    camera_pose[~is_known] = np.nan  # which interpolation spreads to all times next to a lost tag
    camera_pose[is_known, 2] = np.unwrap(camera_pose[is_known, 2])
    # After the last row its pose stays: the hand stands still at the end of a log.
    truth = np.column_stack([np.interp(time + LATENCY, time, column) for column in camera_pose.T])
    truth[:, 2] = se2.wrap(truth[:, 2])
    # The action id may change one row before the hand is in its new place; the clock jumps with the hand.
    is_new = (np.diff(rows[:, 7]) != 0) | (np.diff(time) > 0.5)
    return Recording(
        time=time,
        sensor_pose=sensor_pose,
        shape=RECTANGLE,
        sensor=HAND,
        object_pose=truth,
        contact=_contacts(is_new, sensor_pose, HAND.gaps(sensor_pose, truth, RECTANGLE)),
        source=f"CMU PlanarManipulationToolBox, {path.name}",
        file=path,
    )


def _contacts(is_new: Flags, sensor_pose: Array, gap: Array) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m]; `is_new` (N - 1,) is true where the next frame begins an action.

    The hand leaves the object between actions, so each action has flags of its own. Raises FileError if the tips push
    anything but the rectangle.
    """
    contact = np.zeros(len(gap), np.bool_)
    for start, end in pairwise([0, *(np.flatnonzero(is_new) + 1).tolist(), len(gap)]):
        travel = np.maximum.accumulate(np.hypot(*(sensor_pose[start:end, :2] - sensor_pose[start, :2]).T))
        pushing = gap[start:end][(travel > 0.01) & np.isfinite(gap[start:end])]
        off = float(np.median(pushing)) if len(pushing) else 0.0
        if abs(off) > 3e-3:  # [m], 1.4 mm at most in the 16 logs
            raise FileError(
                f"from row {start + 2} on the tips push {off * 1e3:.1f} mm off a rectangle of 51 x 36 mm; "
                "logs of other objects are not read"
            )
        is_clear = travel < 1e-3  # [m] an action starts clear of the object
        # The gap of a steady push is 1.0 mm uncertain and drifts by up to 2 mm across the table, so the last 1 to 2 mm
        # of an approach count as contact too.
        contact[start:end] = contact_flags(np.where(is_clear, np.inf, gap[start:end]), touch=2.5e-3, release=3.5e-3)
    return contact
