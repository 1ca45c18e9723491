"""What a video tells: the poses of object and sensor on the table, by their tags.

The camera stands still, so all pictures together tell where the table is. A tag on an object lies in a plane parallel
to the table, at a height that follows from how large the tag appears. Its corners in that plane tell its pose, and how
far they are off a square tells how well.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.truth.camera import Camera
from palpate.truth.tags import OBJECT, SENSOR, TABLE, Gray, Tag, corners_in

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Watched:
    """A tag in a video, in the pictures where it is seen."""

    time: Array
    """(N,) [s]"""
    pose: Array
    """table_T_tag, (N, 3) [m, m, rad]."""
    sigma: Array
    """Standard deviations of x, y [m] and angle [rad] of each of them, (3,), as squares fit."""
    height: float
    """How high over the table the tag is [m]."""


def watch(pictures: Iterable[tuple[float, Gray]], camera: Camera) -> tuple[Watched, Watched]:
    """The object and the sensor in pictures with their times [s].

    Raises FileError where pictures are of another size, or a tag is never seen.
    """
    table: dict[int, list[Array]] = {tag.number: [] for tag in TABLE}
    seen: dict[int, list[tuple[float, Array]]] = {OBJECT.number: [], SENSOR.number: []}
    count = 0
    for time, picture in pictures:
        count += 1
        if picture.shape != camera.size:
            raise FileError(f"its pictures have {picture.shape} rows and columns, the camera file is for {camera.size}")
        for number, corners in corners_in(picture).items():
            if number in table:
                table[number].append(corners)
            elif number in seen:
                seen[number].append((time, corners))
    names = {OBJECT.number: "object", SENSOR.number: "sensor"} | {tag.number: "table" for tag in TABLE}
    for number, found in {**table, **seen}.items():
        if not found:
            raise FileError(f"tag {number}, of the {names[number]}, is seen in none of its {count} pictures")
    place = _table(camera, {number: np.median(corners, axis=0) for number, corners in table.items()})
    return _tag(OBJECT, seen[OBJECT.number], camera, place), _tag(SENSOR, seen[SENSOR.number], camera, place)


def _table(camera: Camera, corners: dict[int, Array]) -> tuple[Array, Array]:
    """Where the camera is on the table: table_R_camera (3, 3), and its place (3,) [m]."""
    import cv2

    points = np.concatenate([np.column_stack([tag.corners, np.zeros(4)]) for tag in TABLE])
    pixels = np.concatenate([corners[tag.number] for tag in TABLE])
    matrix, distortion = np.array(camera.matrix), np.array(camera.distortion)
    _, turn, way = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, way = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, way)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64).T
    return rotation, -rotation @ way[:, 0]


def _tag(tag: Tag, seen: list[tuple[float, Array]], camera: Camera, place: tuple[Array, Array]) -> Watched:
    rotation, eye = place
    rays = camera.rays(np.concatenate([corners for _, corners in seen])) @ rotation.T
    # Where the rays meet the table; towards the eye, all distances become smaller in proportion.
    ground = (eye[:2] - eye[2] * rays[:, :2] / rays[:, 2:]).reshape(-1, 4, 2)
    side = np.linalg.norm(ground - np.roll(ground, 1, axis=1), axis=2).mean()
    share = tag.size / side
    points = eye[:2] + share * (ground - eye[:2])
    pose, off = _squares(tag, points)
    per_corner = np.sqrt((off**2).sum() / max(5 * len(off), 1))  # 8 numbers a square, 3 of them the pose
    across = np.sqrt((tag.corners**2).sum())
    sigma = per_corner * np.array([0.5, 0.5, 1.0 / across])
    return Watched(np.array([time for time, _ in seen]), pose, sigma, float(eye[2] * (1.0 - share)))


def _squares(tag: Tag, points: Array) -> tuple[Array, Array]:
    """Poses (N, 3) of a tag whose corners are at points (N, 4, 2) [m], and how far these are off it (N, 4, 2)."""
    middle = points.mean(axis=1)
    away = points - middle[:, None]
    model = tag.corners - tag.corners.mean(axis=0)
    cos = np.einsum("nij,ij->n", away, model)
    sin = np.einsum("ni,i->n", away[:, :, 1], model[:, 0]) - np.einsum("ni,i->n", away[:, :, 0], model[:, 1])
    angle = np.arctan2(sin, cos)
    turned = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    return np.column_stack([middle, angle]), away - model @ turned.transpose(0, 2, 1)
