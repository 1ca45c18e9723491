"""The overhead camera: its calibration by pictures of the printed board, its video, and the tags in it.

The camera stands still. The table's tags give its pose. The apparent size of another tag gives its height over the
table; its corners in the plane at that height give its pose, and their distance from a square its uncertainty.
"""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import Array, Image
from palpate.checks import NUMBERS, checked_array
from palpate.errors import FileError
from palpate.files import existing_file, in_file, read_json, write_json
from palpate.geometry import se2
from palpate_lab.truth.tags import OBJECT, SENSOR, TABLE, Tag, board, find_tags


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


@dataclass(frozen=True, eq=False)
class TagTrack:
    """A tag in a video, in the N pictures that show it."""

    time: Array
    """(N,) [s]"""
    pose: Array
    """table_T_tag, (N, 3) [m, m, rad]."""
    sigma: Array
    """Standard deviations of x, y [m] and angle [rad] of each pose, (3,)."""
    height: float
    """Height of the tag over the table [m]."""


def calibrated(pictures: Iterable[Image]) -> Camera:
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
    if len(seen) < 8:
        raise FileError(f"the board is seen in {len(seen)} pictures, at least 8 are needed")
    chosen = [seen[index] for index in np.unique(np.linspace(0, len(seen) - 1, 40).astype(int))]
    points = [each[0] for each in chosen]
    pixels = [each[1] for each in chosen]
    _, matrix, distortion, _, _, _, _, errors = cv2.calibrateCameraExtended(
        points, pixels, size[::-1], np.zeros((3, 3)), np.zeros(5)
    )
    rows = tuple((float(a), float(b), float(c)) for a, b, c in matrix)
    return Camera(size, rows, tuple(map(float, distortion.ravel())), float(np.median(errors)))


def save_camera(camera: Camera, path: Path, overwrite: bool = False) -> None:
    """Write a camera as JSON. Raises FileError if the file exists and `overwrite` is not set."""
    write_json(path, asdict(camera), overwrite)


def load_camera(path: Path) -> Camera:
    """Return the camera that `save_camera` wrote. Raises FileError on anything else."""
    data = read_json(path)
    try:
        with in_file(path):
            matrix = checked_array("matrix", data["matrix"], NUMBERS, (3, 3)).tolist()
            height, width = checked_array("size", data["size"], ("i", "whole numbers"), (2,)).tolist()
            distortion = checked_array("distortion", data["distortion"], NUMBERS, ("N",)).tolist()
            return Camera((height, width), tuple(map(tuple, matrix)), tuple(distortion), float(data["error"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no camera of palpate truth-camera ({error!r})") from error


def read_video(path: Path) -> Iterator[tuple[float, Image]]:
    """Yield each picture of a video, in grey, with its time [s]. Raises FileError if the file is no video."""
    import cv2

    capture = cv2.VideoCapture(str(existing_file(path)))
    try:
        rate = capture.get(cv2.CAP_PROP_FPS)
        count = 0
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


def track_tags(pictures: Iterable[tuple[float, Image]], camera: Camera) -> tuple[TagTrack, TagTrack]:
    """Return the tracks of object and sensor in pictures with their times [s].

    Raises FileError if a picture has another size than the camera's, or a tag is never seen.
    """
    seen: dict[int, list[tuple[float, Array]]] = {tag.number: [] for tag in (OBJECT, SENSOR, *TABLE)}
    count = 0
    for time, picture in pictures:
        if picture.shape != camera.size:
            raise FileError(f"its pictures have {picture.shape} rows and columns, the camera file is for {camera.size}")
        count += 1
        for number, corners in find_tags(picture).items():
            if number in seen:
                seen[number].append((time, corners))
    for tag in (*TABLE, OBJECT, SENSOR):
        if not seen[tag.number]:
            raise FileError(f"tag {tag.number}, of the {tag.owner}, is seen in none of its {count} pictures")
    times = {number: np.array([time for time, _ in each]) for number, each in seen.items()}
    corners = {number: np.array([found for _, found in each]) for number, each in seen.items()}
    table_R_camera, eye = _camera_pose(camera, {tag.number: np.median(corners[tag.number], axis=0) for tag in TABLE})

    def track(tag: Tag) -> TagTrack:
        rays = camera.rays(corners[tag.number].reshape(-1, 2)) @ table_R_camera.T
        on_table = (eye[:2] - eye[2] * rays[:, :2] / rays[:, 2:]).reshape(-1, 4, 2)
        side = np.linalg.norm(on_table - np.roll(on_table, 1, axis=1), axis=2).mean()
        height = float(eye[2] * (1.0 - tag.size / side))
        # Distances shrink in proportion towards the camera.
        seen_at = eye[:2] + (1.0 - height / eye[2]) * (on_table - eye[:2])
        pose = laid_over(tag.corners, seen_at)
        off = seen_at - se2.transform(pose[:, None], tag.corners)
        per_corner = np.sqrt((off**2).sum() / max(5 * len(off), 1))  # 8 numbers a square, 3 of them the pose
        sigma = per_corner * np.array([0.5, 0.5, 1.0 / np.sqrt((tag.corners**2).sum())])
        return TagTrack(times[tag.number], pose, sigma, height)

    return track(OBJECT), track(SENSOR)


def _camera_pose(camera: Camera, corners: dict[int, Array]) -> tuple[Array, Array]:
    """Return rotation table_R_camera (3, 3) and position (3,) [m] from the corners (4, 2) [px] of the table's tags."""
    import cv2

    points = np.concatenate([np.column_stack([tag.corners, np.zeros(4)]) for tag in TABLE])
    pixels = np.concatenate([corners[tag.number] for tag in TABLE])
    matrix = np.array(camera.matrix)
    distortion = np.array(camera.distortion)
    _, turn, shift = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, shift)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64).T
    return rotation, -rotation @ shift[:, 0]


def laid_over(points: Array, others: Array) -> Array:
    """Return the poses (..., 3) that lay points (K, 2) [m] over others (..., K, 2) [m] with the least squares."""
    source = points @ np.array([1.0, 1j])  # as complex numbers, which a rotation multiplies
    target = others @ np.array([1.0, 1j])
    centred = target - target.mean(axis=-1, keepdims=True)
    turn = ((source - source.mean()).conj() * centred).sum(axis=-1)
    place = target.mean(axis=-1) - turn / np.abs(turn) * source.mean()
    return np.stack([place.real, place.imag, np.angle(turn)], axis=-1)
