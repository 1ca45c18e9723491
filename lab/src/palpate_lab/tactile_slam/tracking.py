"""Pose and outline in turn: the pose by the outline so far, then the outline by this pose.

After Suresh et al., "Tactile SLAM: Real-time inference of shape and pose from planar pushing", ICRA 2021. Contacts
stick, pressure on the support is given and not learnt, and the first pose is known. Constants of the Gaussian process
are those of the authors' code; those of the graph, whose code was not at hand, were chosen on explorations. The
direction of a contact, there a matter of the outline, here corrects the pose, too: errors are a third less.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.arrays import Array, Flags
from palpate.geometry import se2
from palpate.types.measurements import ContactDirection, Frame, Measurement
from palpate.types.outline import Outline, Unknown
from palpate.types.sensor import SensorProfile
from palpate_lab.tactile_slam.smoother import Pressure, Push, Smoother, SmootherSettings, Tangent
from palpate_lab.tactile_slam.surface import ImplicitSurface, SurfaceSettings


@dataclass(frozen=True)
class SlamSettings:
    """Settings of the baseline; times, lengths and angles of what is seen are those of `palpate.exploring`."""

    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    smoother: SmootherSettings = field(default_factory=SmootherSettings)
    radius: float = 0.24
    """Radius of the first circle as a share of the mean of the stated widths: the authors' 3 cm."""
    interval: float = 0.25
    """Time between two contact points of the outline [s]."""
    way: float = 5e-4
    """Motion of the contact between two of them [m]."""
    indentation: float = 3e-4
    """Indentation of the gel at a contact [m]."""
    unmeasured: float = 0.25
    """Deviation of a direction that was not measured [rad]."""
    points: int = 128
    """Number of points of the outline."""
    patch: float = 0.004
    """Length to each side of a contact that counts as touched [m]."""
    rounds: int = 2
    """Times that the outline is linearised at a contact."""


class TactileSlam:
    """Estimates pose and outline of one object: `step` takes one frame after the other."""

    def __init__(
        self,
        stated: Unknown,
        sensor: SensorProfile,
        first_pose: Array,
        covariance: Array,
        pressure: Pressure,
        settings: SlamSettings | None = None,
    ) -> None:
        """Take the stated sizes, the sensor, and the first pose (3,) with its covariance (3, 3)."""
        self._settings = settings or SlamSettings()
        self._stated = stated
        self._sensor = sensor
        radius = self._settings.radius * stated.mean_width
        self._surface = ImplicitSurface(pressure.center, radius, self._settings.surface)
        self._smoother = Smoother(first_pose, covariance, pressure, self._settings.smoother)
        self._angles: Array = np.arange(self._settings.points) * np.float64(2.0 * np.pi / self._settings.points)
        self._touched: Flags = np.zeros(self._settings.points, np.bool_)
        self._sensor_pose: Array | None = None  # at the last frame, if it was in contact
        self._points = np.empty((0, 2))  # contact points at the last frame, in the world
        self._observed_at = -np.inf
        self._way = np.inf  # since then

    @property
    def pose(self) -> Array:
        """Pose of the object (3,)."""
        return self._smoother.pose

    @property
    def covariance(self) -> Array:
        """Its covariance (3, 3), tangent space at the pose."""
        return self._smoother.covariance

    def outline(self) -> Outline:
        """Return the outline as it is known now."""
        farthest = self._stated.size[1] / np.sqrt(2.0)  # corner of a square of this width
        return self._surface.outline(self._angles, farthest, self._touched.copy())

    def step(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> None:
        """Take a frame with what touch measured; outside of contact the object rests."""
        if not frame.contact:
            self._sensor_pose = None
            return
        direction = next((one for one in measurements if isinstance(one, ContactDirection)), None)
        angle = direction.angle if direction else 0.0
        deviation = float(np.sqrt(direction.variance)) if direction else None
        heading = float(frame.sensor_pose[2]) + angle
        inward = np.array((np.cos(heading), np.sin(heading)))
        reach = self._sensor.radius - self._settings.indentation
        points = se2.transform(frame.sensor_pose, self._sensor.centers) + reach * inward
        if self._sensor_pose is None:
            self._way = np.inf
        else:
            moved = se2.compose(frame.sensor_pose, se2.inverse(self._sensor_pose))
            motions = se2.transform(moved, self._points) - self._points
            self._smoother.push(Push(self._points, motions))
            self._way += float(np.hypot(*motions.mean(axis=0)))
        if frame.time - self._observed_at >= self._settings.interval and self._way >= self._settings.way:
            self.observe(points, heading, deviation)
            self._observed_at = frame.time
            self._way = 0.0
        self._sensor_pose = frame.sensor_pose
        self._points = points

    def observe(self, points: Array, heading: float, deviation: float | None) -> None:
        """Correct the pose by contacts at points (T, 2) in the world, and then the outline.

        The direction is that of the inward normal in the world, with its deviation [rad], None if it is a guess.
        """
        for _ in range(self._settings.rounds):
            self._smoother.touch(self._tangents(points, heading, deviation))
        outward = heading + np.pi - self.pose[2]
        normal = np.array((np.cos(outward), np.sin(outward)))
        for point in se2.transform(se2.inverse(self.pose), points):
            self._surface.add(point, normal, deviation or self._settings.unmeasured)
            wide = np.arctan2(self._settings.patch, np.hypot(*point))
            apart = np.abs(se2.wrap(self._angles - np.arctan2(point[1], point[0])))
            self._touched |= apart <= max(wide, np.pi / self._settings.points)

    def _tangents(self, points: Array, heading: float, deviation: float | None) -> list[Tangent]:
        """Return the outline so far at contacts, where the pose has them now."""
        in_object = se2.transform(se2.inverse(self.pose), points)
        local = self._surface.at(in_object)
        found: list[Tangent] = []
        for k, point in enumerate(in_object):
            outward = np.arctan2(local.normal[k, 1], local.normal[k, 0])
            off = np.inf if deviation is None else np.hypot(deviation, self._surface.normal_deviation(point))
            found.append(
                Tangent(
                    touched=points[k],
                    point=point,
                    distance=float(local.distance[k]),
                    deviation=float(np.hypot(self._settings.smoother.contact, local.deviation[k])),
                    normal=local.normal[k],
                    yaw=float(heading + np.pi - outward),
                    yaw_deviation=float(off),
                )
            )
        return found
