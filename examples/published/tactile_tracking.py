"""Reader of joehjhuang/TactileTracking (NormalFlow): a GelSight Mini that is turned and rolled on objects.

    python tactile_tracking.py DATASET/bead1 [UNIT.npz]

A trial is a folder with `gelsight.avi` and, from motion capture, `true_start_T_currs.npy` (N, 4, 4) [m]: the pose of
the sensor in its own frame at the first image, while the object stands still. In that frame x is along an image's
columns, y along its rows and z into the gel. Times are those of the video's rate. The set has no untouched images, and
neither outlines nor the objects' places.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from touch_data import TouchData, checked, film

import palpate

POSES = "true_start_T_currs.npy"


def read_trial(folder: Path) -> TouchData:
    """Read the folder of a trial. Raises FileError."""
    video, path = folder / "gelsight.avi", folder / POSES
    images = list(film(video))
    try:
        given = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise palpate.FileError(f"{path}: is missing, or no array of NumPy ({error})") from error
    if given.shape[1:] != (4, 4) or given.dtype.kind != "f":
        raise palpate.FileError(f"{path}: found {given.dtype} of shape {given.shape}, expected floats (N, 4, 4)")
    checked(path, images, poses=given)
    poses = np.full((len(given), 7), np.nan)
    known = np.isfinite(given).all(axis=(1, 2))
    turns = Rotation.from_matrix(given[known, :3, :3])
    poses[known] = np.column_stack([given[known, :3, 3], turns.as_quat()])
    rate = cv2.VideoCapture(str(video)).get(cv2.CAP_PROP_FPS) or palpate.GELSIGHT_MINI.rate
    time = np.arange(len(images)) / rate
    return TouchData(time, images, poses, None, palpate.GELSIGHT_MINI, f"TactileTracking, {folder.name}")


if __name__ == "__main__":
    unit = palpate.load_calibration(sys.argv[2]) if sys.argv[2:] else None
    print(read_trial(Path(sys.argv[1])).about(unit))
