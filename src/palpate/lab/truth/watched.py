"""What a video tells: the poses of object and sensor on the table, by their tags.

The camera stands still, so all pictures together tell where the table is. How far a tag's corners are off a square
tells how well its poses are known.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.lab.truth.camera import Camera
from palpate.lab.truth.table import Table, table_of
from palpate.lab.truth.tags import OBJECT, SENSOR, TABLE, Gray, Tag, corners_in

Array = NDArray[np.float64]

_NAMES = {OBJECT.number: "object", SENSOR.number: "sensor"} | {tag.number: "table" for tag in TABLE}


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


class Sightings:
    """Where tags are seen in the pictures of a camera, one picture after the other."""

    def __init__(self, camera: Camera) -> None:
        """Begin without a picture."""
        self._camera = camera
        self._seen: dict[int, list[tuple[float, Array]]] = {number: [] for number in _NAMES}
        self.pictures = 0
        """How many there were."""

    def add(self, time: float, picture: Gray) -> dict[int, Array]:
        """Take a picture of a time [s]; returns the corners (4, 2) [px] of the tags in it, by their ids.

        Raises FileError if it is of another size than the camera's.
        """
        if picture.shape != self._camera.size:
            raise FileError(
                f"its pictures have {picture.shape} rows and columns, the camera file is for {self._camera.size}"
            )
        self.pictures += 1
        found = {number: corners for number, corners in corners_in(picture).items() if number in _NAMES}
        for number, corners in found.items():
            self._seen[number].append((time, corners))
        return found

    def table(self) -> Table:
        """Where the table is, by the middle of all pictures. Raises FileError where one of its tags is never seen."""
        return table_of(self._camera, {tag.number: np.median(self._corners(tag), axis=0) for tag in TABLE})

    def of(self, tag: Tag, table: Table) -> Watched:
        """Where a tag is on the table. Raises FileError where it is never seen."""
        corners = self._corners(tag)
        height = table.height(tag, corners)
        pose, off = table.poses(tag, corners, height)
        per_corner = np.sqrt((off**2).sum() / max(5 * len(off), 1))  # 8 numbers a square, 3 of them the pose
        across = np.sqrt((tag.corners**2).sum())
        sigma = per_corner * np.array([0.5, 0.5, 1.0 / across])
        return Watched(np.array([time for time, _ in self._seen[tag.number]]), pose, sigma, height)

    def _corners(self, tag: Tag) -> Array:
        seen = self._seen[tag.number]
        if not seen:
            what = f"tag {tag.number}, of the {_NAMES[tag.number]}"
            raise FileError(f"{what}, is seen in none of its {self.pictures} pictures")
        return np.array([corners for _, corners in seen])


def watch(pictures: Iterable[tuple[float, Gray]], camera: Camera) -> tuple[Watched, Watched]:
    """The object and the sensor in pictures with their times [s].

    Raises FileError where pictures are of another size, or a tag is never seen.
    """
    sightings = Sightings(camera)
    for time, picture in pictures:
        sightings.add(time, picture)
    table = sightings.table()
    return sightings.of(OBJECT, table), sightings.of(SENSOR, table)
