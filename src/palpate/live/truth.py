"""The object's true pose beside a live session, by an overhead camera and printed tags.

The robot says where the sensor is, the camera where the sensor's tag is. As soon as both together tell where the table
is and how late the camera, each picture with the object's tag tells a true pose; that is found again and more exactly
as there are more pictures, for a while.
"""

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.lab.truth.alignment import Alignment, align
from palpate.lab.truth.camera import Camera
from palpate.lab.truth.record import in_world
from palpate.lab.truth.table import Table
from palpate.lab.truth.tags import OBJECT, SENSOR, Gray, corners_in
from palpate.lab.truth.watched import Sightings, Watched
from palpate.live.poses import TimedPose

Array = NDArray[np.float64]

FIRST, LAST = 30, 3600
"""Pictures after which the table is looked for the first time, and no more."""

_MORE = 1.5  # times as many pictures before it is looked for again


class Picture(NamedTuple):
    """One picture of the overhead camera."""

    time: float
    """When it was there [s], by any clock."""
    gray: Gray
    """(height, width)."""


PictureSource = Callable[[threading.Event], Iterator[Picture | str]]
"""Gives the pictures as they come, and in between, in words, what is to be said of the camera; ends at the event."""


class TruePose(NamedTuple):
    """Where the object really was at one time."""

    time: float
    """[s], by the session's clock."""
    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    sigma: Array
    """Standard deviations along the world's x and y [m] and of the yaw [rad], (3,)."""


@dataclass(frozen=True, eq=False)
class _Known:
    """What pictures and poses so far tell together."""

    table: Table
    watched: Watched
    """The object."""
    alignment: Alignment


class LiveTruth:
    """Takes poses of the sensor and pictures, from a thread each, and tells where the object is."""

    def __init__(self, pictures: PictureSource, camera: Camera, close: Callable[[], None] = lambda: None) -> None:
        """Take where pictures come from, how their camera sees, and what closes it where it is not used."""
        self.pictures, self.close = pictures, close
        """Where they come from, and what lets go of that before they do."""
        self._sightings = Sightings(camera)
        self._robot: list[TimedPose] = []
        self._known: _Known | None = None
        self._next = FIRST

    def sensor(self, pose: TimedPose) -> None:
        """Take a pose of the sensor."""
        if self._next <= LAST:
            self._robot.append(pose)

    def look(self, picture: Picture) -> Iterator[TruePose | str]:
        """Look at a picture; yields what it tells of the object, and what is to be said.

        The first time that the table is found, all pictures so far tell something. Raises FileError if the picture is
        of another size than the camera's.
        """
        if self._next > LAST:  # what there is to be learnt is learnt
            corners = corners_in(picture.gray, (OBJECT.number,))
        else:
            corners = self._sightings.add(picture.time, picture.gray)
        first = self._known is None
        if self._sightings.pictures >= self._next:
            self._next = math.ceil(_MORE * self._next)
            yield self._find()
        if self._known is None:
            return
        if first:
            yield from self._true(self._known, self._known.watched.time, self._known.watched.pose)
        elif OBJECT.number in corners:
            seen = corners[OBJECT.number][None]
            pose, _ = self._known.table.poses(OBJECT, seen, self._known.watched.height)
            yield from self._true(self._known, np.array([picture.time]), pose)

    def _find(self) -> str:
        """Find where the table is and how late the camera, and say so, or why not."""
        robot = self._robot.copy()
        try:
            if not robot:
                raise FileError("no sensor pose has come")
            table = self._sightings.table()
            watched, sensor = (self._sightings.of(tag, table) for tag in (OBJECT, SENSOR))
            time, pose = np.array([each.time for each in robot]), np.array([each.pose for each in robot])
            alignment = align(time, pose, sensor)
        except FileError as error:
            return f"no ground truth {'yet' if self._known is None else 'that is better'}: {error}"
        self._known = _Known(table, watched, alignment)
        sigma = 1e3 * alignment.sigma
        return (
            f"ground truth by {self._sightings.pictures} pictures: the table is known to {sigma[:2].max():.1f} mm, the "
            f"camera's delay to {sigma[3]:.1f} ms, robot and camera are {1e3 * alignment.residual:.1f} mm apart"
        )

    def _true(self, known: _Known, time: Array, pose: Array) -> Iterator[TruePose]:
        """Yield poses (N, 3) on the table at times (N,) of the pictures, as poses in the world.

        What was before the first pose of the sensor is left out.
        """
        world, sigma = in_world(pose, known.watched.sigma, known.alignment)
        for when, placed, deviation in zip(time + known.alignment.delay, world, sigma, strict=True):
            if when >= self._robot[0].time:
                yield TruePose(float(when), placed, deviation)
