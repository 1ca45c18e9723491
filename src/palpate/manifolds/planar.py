"""Vectors and poses of the plane, for numbers and for symbols.

Residuals are written with these. A pose carries cosine and sine of its angle, so that neither is computed twice.
"""

from dataclasses import dataclass

from palpate.manifolds.functions import Scalar, half_cotangent, wrap


@dataclass(frozen=True)
class Vector:
    """A vector of the plane."""

    x: Scalar
    y: Scalar

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(self.x - other.x, self.y - other.y)

    def __neg__(self) -> "Vector":
        return Vector(-self.x, -self.y)

    def __rmul__(self, factor: Scalar) -> "Vector":
        return Vector(factor * self.x, factor * self.y)

    def dot(self, other: "Vector") -> Scalar:
        """Return the scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: "Vector") -> Scalar:
        """Return the product x1 y2 - y1 x2, which is positive if the other vector is counter-clockwise of this one."""
        return self.x * other.y - self.y * other.x

    def turned_left(self) -> "Vector":
        """Return the vector turned counter-clockwise by a right angle."""
        return Vector(-self.y, self.x)


@dataclass(frozen=True)
class Pose:
    """A planar pose `a_T_b`: it maps coordinates of frame b to frame a."""

    position: Vector
    """Origin of b in a [m]."""
    cos: Scalar
    """Cosine of the angle."""
    sin: Scalar
    """Sine of the angle."""
    angle: Scalar
    """Angle of b's x axis in a [rad]."""

    def rotate(self, vector: Vector) -> Vector:
        """Return a vector of frame b in the axes of frame a."""
        return Vector(self.cos * vector.x - self.sin * vector.y, self.sin * vector.x + self.cos * vector.y)

    def rotate_back(self, vector: Vector) -> Vector:
        """Return a vector of frame a in the axes of frame b."""
        return Vector(self.cos * vector.x + self.sin * vector.y, self.cos * vector.y - self.sin * vector.x)

    def act(self, point: Vector) -> Vector:
        """Return a point of frame b in frame a [m]."""
        return self.position + self.rotate(point)

    def act_back(self, point: Vector) -> Vector:
        """Return a point of frame a in frame b [m]."""
        return self.rotate_back(point - self.position)

    def between(self, other: "Pose") -> "Pose":
        """Return `self^-1 other`, the other pose seen from this one."""
        cos = self.cos * other.cos + self.sin * other.sin
        sin = self.cos * other.sin - self.sin * other.cos
        return Pose(self.act_back(other.position), cos, sin, wrap(other.angle - self.angle))

    def compose(self, other: "Pose") -> "Pose":
        """Return `self other`."""
        cos = self.cos * other.cos - self.sin * other.sin
        sin = self.sin * other.cos + self.cos * other.sin
        return Pose(self.act(other.position), cos, sin, wrap(self.angle + other.angle))

    def inverse(self) -> "Pose":
        """Return the pose of frame a in frame b."""
        return Pose(-self.rotate_back(self.position), self.cos, -self.sin, -self.angle)

    def log(self) -> tuple[Scalar, Scalar, Scalar]:
        """Return the tangent vector x [m], y [m], theta [rad] whose exponential is this pose."""
        half = 0.5 * self.angle
        cotangent = half_cotangent(self.angle)
        x = cotangent * self.position.x + half * self.position.y
        y = cotangent * self.position.y - half * self.position.x
        return x, y, self.angle
