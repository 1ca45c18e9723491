"""Poses of the tags on object and sensor, relative to the table, in a video of a camera that stands still.

The table's tags give the camera's pose. The apparent size of another tag gives its height over the table; its corners
in the plane at that height give its pose, and their distance from a square its uncertainty.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.lab.truth.camera import Camera
from palpate.lab.truth.tags import OBJECT, SENSOR, TABLE, Gray, Tag, find_tags

Array = NDArray[np.float64]


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


def track_tags(pictures: Iterable[tuple[float, Gray]], camera: Camera) -> tuple[TagTrack, TagTrack]:
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
        pose, off = _fitted(tag, eye[:2] + (1.0 - height / eye[2]) * (on_table - eye[:2]))
        per_corner = np.sqrt((off**2).sum() / max(5 * len(off), 1))  # 8 numbers a square, 3 of them the pose
        sigma = per_corner * np.array([0.5, 0.5, 1.0 / np.sqrt((tag.corners**2).sum())])
        return TagTrack(times[tag.number], pose, sigma, height)

    return track(OBJECT), track(SENSOR)


def _camera_pose(camera: Camera, corners: dict[int, Array]) -> tuple[Array, Array]:
    """Return rotation table_R_camera (3, 3) and position (3,) [m] from the corners (4, 2) [px] of the table's tags."""
    import cv2

    points = np.concatenate([np.column_stack([tag.corners, np.zeros(4)]) for tag in TABLE])
    pixels = np.concatenate([corners[tag.number] for tag in TABLE])
    matrix, distortion = np.array(camera.matrix), np.array(camera.distortion)
    _, turn, shift = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, shift)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64).T
    return rotation, -rotation @ shift[:, 0]


def _fitted(tag: Tag, points: Array) -> tuple[Array, Array]:
    """Return poses (N, 3) of a tag with corners at points (N, 4, 2) [m], and the residuals of these (N, 4, 2) [m]."""
    middle = points.mean(axis=1)
    away = points - middle[:, None]
    model = tag.corners - tag.corners.mean(axis=0)
    cos = np.einsum("nij,ij->n", away, model)
    sin = np.einsum("ni,i->n", away[:, :, 1], model[:, 0]) - np.einsum("ni,i->n", away[:, :, 0], model[:, 1])
    angle = np.arctan2(sin, cos)
    turned = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    return np.column_stack([middle, angle]), away - model @ turned.transpose(0, 2, 1)
