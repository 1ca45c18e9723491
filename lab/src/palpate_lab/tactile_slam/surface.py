"""An outline as the zero line of a Gaussian process of contact points and normals.

The function is 0 on the outline and its gradient the outward normal there, so that near the outline it is the signed
distance. Its kernel is that of a thin plate, k(r) = 2 r^3 - 3 R r^2 + R^3 at a distance r (Williams and Fitzgibbon,
2007); a derivative of the function has the derivative of the kernel. One process has all contacts: the local ones of
the paper save time where there are thousands.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky

from palpate.arrays import Array, Flags
from palpate.types.outline import Outline


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of the Gaussian process."""

    range: float = 1.0
    """R of the kernel [m], more than contacts are apart; the authors' code has 1 for a single process."""
    distance: float = 3.2e-3
    """Deviation of the function at a contact point [m]; the authors' code has a variance of 1e-5."""
    prior_points: int = 4
    """Number of points on the circle that is the outline before the first contact, as in the authors' code."""
    prior: float = 0.1
    """Deviation of function [m] and gradient at these points; the authors' code has a variance of 1e-2."""
    flattest: float = 0.1
    """Least gradient by which a value is taken as a distance."""
    ray: int = 80
    """Number of points on a ray on which the outline is sought."""


class Local(NamedTuple):
    """The function at P points, as distance from the outline."""

    distance: Array
    """(P,) [m], negative inside."""
    deviation: Array
    """Its standard deviation (P,) [m]."""
    normal: Array
    """Gradient of the distance, (P, 2)."""


class ImplicitSurface:
    """The outline of an object by its contacts so far, in the object frame."""

    def __init__(self, center: Array, radius: float, settings: SurfaceSettings) -> None:
        """Begin with a circle, given its centre (2,) and radius [m]."""
        self._settings = settings
        self._points = np.empty((0, 2))
        self._targets = np.empty(0)
        self._covariance = np.empty((0, 0))
        angle = np.arange(settings.prior_points) * (2.0 * np.pi / settings.prior_points)
        outward = np.column_stack((np.cos(angle), np.sin(angle)))
        self._add(center + radius * outward, outward, np.full((settings.prior_points, 3), settings.prior))

    def add(self, point: Array, normal: Array, deviation: float) -> None:
        """Take a contact point (2,) [m] with the outward normal (2,) and the deviation of its direction [rad].

        A point so far from the origin that the kernel does not hold, as the pose is lost, is left out.
        """
        if np.hypot(*point) < 0.5 * self._settings.range:
            self._add(point[None], normal[None], np.array([[self._settings.distance, deviation, deviation]]))

    def at(self, points: Array) -> Local:
        """Return the function at points (P, 2) [m]."""
        cross = self._kernel(points, self._points)
        mean = (cross @ self._weights).reshape(-1, 3)
        of_value = cross[::3]
        explained = (of_value * cho_solve((self._factor, True), of_value.T).T).sum(axis=1)
        variance = np.maximum(self._settings.range**3 - explained, 0.0)
        steepness = np.maximum(np.hypot(mean[:, 1], mean[:, 2]), self._settings.flattest)
        return Local(mean[:, 0] / steepness, np.sqrt(variance) / steepness, mean[:, 1:] / steepness[:, None])

    def normal_deviation(self, point: Array) -> float:
        """Return the deviation of the normal's direction at a point (2,) [rad]."""
        cross = self._kernel(point[None], self._points)[1:]
        gradient = cross @ self._weights
        steepness = max(float(np.hypot(*gradient)), self._settings.flattest)
        along = np.array((-gradient[1], gradient[0])) / steepness
        covariance = 6.0 * self._settings.range * np.eye(2) - cross @ cho_solve((self._factor, True), cross.T)
        return float(np.sqrt(max(along @ covariance @ along, 0.0))) / steepness

    def outline(self, angles: Array, farthest: float, touched: Flags) -> Outline:
        """Return the outline at angles (N,) about the origin, at most so far from it [m], with its band.

        It is where the function first becomes positive.
        """
        radii: Array = np.arange(1, self._settings.ray + 1) * np.float64(farthest / self._settings.ray)
        way = np.column_stack((np.cos(angles), np.sin(angles)))
        points = (radii[None, :, None] * way[:, None]).reshape(-1, 2)
        value = (self._kernel_of_value(points, self._points) @ self._weights).reshape(len(angles), -1)
        is_outside = value > 0.0
        after = np.where(is_outside.any(axis=1), is_outside.argmax(axis=1), len(radii) - 1)
        before = np.maximum(after - 1, 0)
        every = np.arange(len(angles))
        rise = np.maximum(value[every, after] - value[every, before], np.finfo(np.float64).tiny)
        share = np.clip(-value[every, before] / rise, 0.0, 1.0)
        radius = radii[before] + share * (radii[after] - radii[before])
        on_outline = radius[:, None] * way
        return Outline(on_outline, self.at(on_outline).deviation, touched)

    def _add(self, points: Array, normals: Array, noise: Array) -> None:
        """Take points (P, 2), normals (P, 2) and deviations (P, 3) of the function and its gradient there."""
        cross = self._kernel(points, self._points)
        own = self._kernel(points, points) + np.diag(np.square(noise).ravel())
        self._covariance = np.block([[self._covariance, cross.T], [cross, own]])
        self._points = np.vstack((self._points, points))
        self._targets = np.append(self._targets, np.column_stack((np.zeros(len(points)), normals)).ravel())
        self._factor = cholesky(self._covariance, lower=True)
        self._weights = cho_solve((self._factor, True), self._targets)

    def _kernel(self, left: Array, right: Array) -> Array:
        """Return the covariance (3 P, 3 Q) of function and gradient at points (P, 2) and at (Q, 2)."""
        apart = left[:, None] - right[None]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        slope = 6.0 * (distance - self._settings.range)  # derivative of the kernel over the distance
        unit = apart / np.maximum(distance, np.finfo(np.float64).tiny)[..., None]
        both = 6.0 * apart[..., :, None] * unit[..., None, :] + slope[..., None, None] * np.eye(2)
        block = np.empty((len(left), 3, len(right), 3))
        block[:, 0] = self._kernel_of_value(left, right).reshape(len(left), len(right), 3)
        block[:, 1:, :, 0] = np.moveaxis(slope[..., None] * apart, 2, 1)
        block[:, 1:, :, 1:] = -np.moveaxis(both, 2, 1)
        return block.reshape(3 * len(left), 3 * len(right))

    def _kernel_of_value(self, left: Array, right: Array) -> Array:
        """Return the covariance (P, 3 Q) of the function at points (P, 2) with function and gradient at (Q, 2)."""
        apart = left[:, None] - right[None]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        range_ = self._settings.range
        value = 2.0 * distance**3 - 3.0 * range_ * distance**2 + range_**3
        gradient = -6.0 * (distance - range_)[..., None] * apart
        return np.concatenate((value[..., None], gradient), axis=2).reshape(len(left), 3 * len(right))
