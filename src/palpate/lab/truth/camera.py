"""The overhead camera: its video, and its calibration by pictures of the printed board."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.checks import checked_array
from palpate.errors import FileError
from palpate.files import existing_file, read_json, whole_file
from palpate.lab.truth.tags import Gray, board

Array = NDArray[np.float64]

FEWEST = 8
"""Pictures of the board that a calibration needs."""


@dataclass(frozen=True)
class Camera:
    """A camera's projection."""

    size: tuple[int, int]
    """Rows and columns of its pictures [px]."""
    matrix: tuple[tuple[float, float, float], ...]
    """Camera matrix of OpenCV, 3 x 3 [px]."""
    distortion: tuple[float, ...]
    """Distortion coefficients of OpenCV: k1, k2, p1, p2, k3."""
    error: float
    """Reprojection error of the board's corners in the median picture [px]."""

    def rays(self, points: Array) -> Array:
        """Return directions (N, 3), of depth 1, of points in a picture (N, 2) [px]."""
        import cv2

        flat = cv2.undistortPoints(points[:, None], np.array(self.matrix), np.array(self.distortion))[:, 0]
        return np.column_stack([flat, np.ones(len(flat))]).astype(np.float64)


def calibrated(pictures: Iterable[Gray]) -> Camera:
    """Return the camera from pictures of the board, held at an angle all over the view.

    At most 40 of them are used. Raises FileError if the board is seen in too few.
    """
    import cv2

    detector = cv2.aruco.CharucoDetector(board())
    seen: list[tuple[Array, Array]] = []
    size = (0, 0)
    for picture in pictures:
        size = picture.shape[:2]
        corners, numbers, _, _ = detector.detectBoard(picture)
        if numbers is not None and len(numbers) >= 12:  # of 24
            seen.append(board().matchImagePoints(corners, numbers))
    if len(seen) < FEWEST:
        raise FileError(f"the board is seen in {len(seen)} pictures, at least {FEWEST} are needed")
    chosen = [seen[index] for index in np.unique(np.linspace(0, len(seen) - 1, 40).astype(int))]
    points, pixels = [each[0] for each in chosen], [each[1] for each in chosen]
    _, matrix, distortion, _, _, _, _, errors = cv2.calibrateCameraExtended(
        points, pixels, size[::-1], np.zeros((3, 3)), np.zeros(5)
    )
    rows = tuple((float(a), float(b), float(c)) for a, b, c in matrix)
    return Camera(size, rows, tuple(map(float, distortion.ravel())), float(np.median(errors)))


def save_camera(camera: Camera, path: Path, overwrite: bool = False) -> None:
    """Write a camera as JSON. Raises FileError if the file exists and `overwrite` is not set."""
    with whole_file(path, overwrite) as part:
        part.write_text(json.dumps(asdict(camera), indent=2) + "\n", encoding="utf-8")


def load_camera(path: Path) -> Camera:
    """Return the camera that `save_camera` wrote. Raises FileError on anything else."""
    data, numbers = read_json(path), ("fi", "numbers")
    try:
        matrix = checked_array("matrix", data["matrix"], numbers, (3, 3)).tolist()
        height, width = checked_array("size", data["size"], ("i", "whole numbers"), (2,)).tolist()
        distortion = checked_array("distortion", data["distortion"], numbers, ("N",)).tolist()
        return Camera((height, width), tuple(map(tuple, matrix)), tuple(distortion), float(data["error"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no camera of palpate truth-camera ({error!r})") from error
    except FileError as error:
        raise FileError(f"{path}: {error}") from error


def read_video(path: Path) -> Iterator[tuple[float, Gray]]:
    """Yield each picture of a video, in grey, with its time [s]. Raises FileError if the file is no video."""
    import cv2

    capture = cv2.VideoCapture(str(existing_file(path)))
    try:
        rate, count = capture.get(cv2.CAP_PROP_FPS), 0
        while capture.isOpened():
            done, picture = capture.read()
            if not done:
                break
            time = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            # Some containers have no times.
            time = time if time > 0.0 or not count else count / rate
            yield time, np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
            count += 1
    finally:
        capture.release()
    if not count:
        raise FileError(f"{path}: is no video that OpenCV can read")
