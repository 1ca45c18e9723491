"""The table as a camera that stands still sees it, and where tags are in planes parallel to it.

How large a tag appears tells how high over the table it is; its corners in the plane at that height tell its pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.lab.truth.camera import Camera
from palpate.lab.truth.tags import TABLE, Tag

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Table:
    """Where the camera is on the table."""

    camera: Camera
    """How it sees."""
    rotation: Array
    """table_R_camera, (3, 3)."""
    eye: Array
    """Its place, (3,) [m]."""

    def height(self, tag: Tag, corners: Array) -> float:
        """How high over the table [m] a tag is, by its corners in N pictures, (N, 4, 2) [px]."""
        ground = self._ground(corners)
        side = np.linalg.norm(ground - np.roll(ground, 1, axis=1), axis=2).mean()
        return float(self.eye[2] * (1.0 - tag.size / side))

    def poses(self, tag: Tag, corners: Array, height: float) -> tuple[Array, Array]:
        """Poses table_T_tag (N, 3) of a tag at a height [m], and how far its corners are off a square (N, 4, 2) [m]."""
        # Towards the eye, all distances become smaller in proportion.
        share = 1.0 - height / self.eye[2]
        return _squares(tag, self.eye[:2] + share * (self._ground(corners) - self.eye[:2]))

    def _ground(self, corners: Array) -> Array:
        """Where the rays of corners (N, 4, 2) [px] meet the table, (N, 4, 2) [m]."""
        rays = self.camera.rays(corners.reshape(-1, 2)) @ self.rotation.T
        return (self.eye[:2] - self.eye[2] * rays[:, :2] / rays[:, 2:]).reshape(-1, 4, 2)


def table_of(camera: Camera, corners: Mapping[int, Array]) -> Table:
    """The table by the corners (4, 2) [px] of all its tags, by their ids."""
    import cv2

    points = np.concatenate([np.column_stack([tag.corners, np.zeros(4)]) for tag in TABLE])
    pixels = np.concatenate([corners[tag.number] for tag in TABLE])
    matrix, distortion = np.array(camera.matrix), np.array(camera.distortion)
    _, turn, way = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, way = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, way)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64).T
    return Table(camera, rotation, -rotation @ way[:, 0])


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
