"""Geometry of the contact between an object's outline and a sensor made of round parts.

All factors that need the outline use the record CONTACT_GEOMETRY, which `ContactModel.touching` computes once per
sensor pose, with derivatives.

A flat pad is modelled as a row of n round parts, and each finger of a hand as one part. Part i is at the distance d_i
from the outline; nearer parts carry more of the load. The load share is w_i = exp(-d_i / s) / sum_j exp(-d_j / s),
where s is the indentation of the gel. Point and normal are means weighted by these shares, and the gap is
-s log(mean_i exp(-d_i / s)). The contact point thus moves smoothly from one edge of a pad to the other, like the centre
of pressure of an elastic foundation (K. L. Johnson, "Contact Mechanics", 1985, sec. 4.3).
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Complex, Records
from palpate.compiled import compiled, kernel
from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.shapes import Disc, Ellipse, Shape, sharp_corners
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.pushing.outline_distance import distance_at
from palpate.types.sensor import SensorProfile

_FIELD_MARGIN = 0.04  # [m] around the outline that the distance grid covers
LOAD_LENGTH = 2e-4
"""[m] Indentation over which the parts of a pad share the load: keeps the contact smooth."""
_WALK = 1e-3  # [m] step length along an outline

HALF_RIGHT_ANGLE = 0.25 * math.pi
"""Half the angle between the normals of the sides of a right-angled corner [rad]."""
CONTACT_GEOMETRY = np.dtype(
    [("gap", "f8"), ("gap_by_g", "3f8")]
    + [(name + by, size) for name in ("point", "material", "normal") for by, size in (("", "c16"), ("_by_g", "3c16"))],
    align=True,
)
"""Contact geometry at a sensor pose g in the object frame; ..._by_g are derivatives with respect to g.

- gap [m]: distance between the sensor's surface and the outline, negative where they overlap.
- point [m]: the point of the sensor's surface nearest to the outline, object frame.
- material [m]: the same point in the sensor frame.
- normal: the outline's outward normal there, object frame.
Vectors are complex numbers.
"""


class Surface(NamedTuple):
    """A contact model as compiled code takes it."""

    parts: Complex
    """Centre of curvature of each round part (n,) [m], sensor frame."""
    radius: float
    """Radius of curvature of the parts [m]."""
    field: DistanceField
    """Signed distance to the object's outline [m], object frame."""
    each: Records
    """Room for the CONTACT_GEOMETRY (n,) of each part."""


SURFACE = Surface(
    parts=np.zeros(1, np.complex128),
    radius=0.0,
    field=DistanceField(origin=np.zeros(2), cell=0.0, coefficients=np.zeros((1, 1))),
    each=np.zeros(1, CONTACT_GEOMETRY),
)
"""An example of a surface, for compiled functions."""


@dataclass(frozen=True, eq=False)
class ContactModel:
    """An object's outline and friction, and the round parts of a sensor."""

    field: DistanceField
    """Signed distance to the object's outline [m], object frame."""
    parts: NDArray[np.complex128]
    """Centre of curvature of each round part (n,) [m], sensor frame."""
    radius: float
    """Radius of curvature of the parts [m]; 0 for the paper's point contact."""
    friction_radius: float
    """c [m]: largest friction torque over largest friction force between object and table."""
    friction_center: complex = 0.0 + 0.0j
    """Nominal centre of friction, the outline's centroid [m], object frame."""
    span: float = 0.0
    """Distance between the outermost tips of the sensor [m]; 0 for one tip."""
    corners: Array = dataclasses.field(default_factory=lambda: np.empty((0, 4)))
    """Corners that stick out (K, 4): x, y [m], direction of the inward bisector, and half the angle between the normals
    of the sides [rad], object frame."""
    fingers: "tuple[ContactModel, ...]" = ()
    """Contact models of the fingers of a hand, each in its own frame; the hand itself has no parts."""
    finger: int = 0
    """Number of the finger in a hand."""

    @cached_property
    def center(self) -> complex:
        """Middle of the parts [m], sensor frame."""
        return complex(self.parts.mean())

    @cached_property
    def to_centroid(self) -> Array:
        """Matrix (3, 3) that takes a motion in the tangent space at the object's pose to that at its centroid.

        What is judged there does not depend on where a drawing has its origin.
        """
        return se2.adjoint(np.array((-self.friction_center.real, -self.friction_center.imag, 0.0)))

    def centroid_poses(self, poses: Array) -> Array:
        """Return poses (..., 3) of the object moved to its centroid."""
        return se2.compose(poses, np.array((self.friction_center.real, self.friction_center.imag, 0.0)))

    @cached_property
    def surfaces(self) -> Any:
        """Surface of the sensor, or those of all fingers, for compiled code."""
        return tuple(finger.surface for finger in self.fingers) if self.fingers else self.surface

    @cached_property
    def surface(self) -> Surface:
        """The same for compiled code."""
        each = np.empty(len(self.parts), CONTACT_GEOMETRY)
        return Surface(self.parts, float(self.radius), self.field, each)

    def touching(self, g: Array) -> NDArray[np.void]:
        """Return the CONTACT_GEOMETRY (B, N) at sensor poses g (B, N, 3) in the object frame."""
        out = np.empty(g.shape[:2], CONTACT_GEOMETRY)
        _touching(np.ascontiguousarray(g), self.surface, out)
        return out

    def directions(self, g: Array) -> Array:
        """Return the contact directions (N,) [rad] at sensor poses g (N, 3) in the object frame, without any bias."""
        normal = self.touching(g[:, None])["normal"][:, 0]
        return np.angle(-normal * np.exp(-1j * g[:, 2]))

    def moved_along(self, g: Array, lengths: Array) -> Array:
        """Return poses g (N, 3) moved along the outline by lengths (N,) [m], counter-clockwise, at constant yaw.

        The distance between the middle of the parts and the outline stays the same.
        """
        moved = np.array(g, order="C")
        _move_along(moved, np.ascontiguousarray(lengths), self.center, self.surface)
        return moved


def contact_model(shape: Shape, sensor: SensorProfile) -> ContactModel:
    """Return the contact model of a sensor and an object."""
    field = DistanceField.of(shape, margin=max(_FIELD_MARGIN, 2.0 * sensor.radius))
    parts = np.array([complex(x, y) for x, y in sensor.round_centers.tolist()])
    c = shape.friction_radius()
    span = float(np.linalg.norm(sensor.centers[:, None] - sensor.centers, axis=-1).max())
    return ContactModel(field, parts, sensor.radius, c, complex(*shape.centroid.tolist()), span, _corners(shape))


def hand_contact_model(shape: Shape, sensors: Sequence[SensorProfile]) -> ContactModel:
    """Return the contact model of a hand and an object: that of the object, with one for each finger's sensor."""
    models = [contact_model(shape, sensor) for sensor in sensors]
    fingers = tuple(replace(model, finger=number) for number, model in enumerate(models))
    return replace(models[0], parts=np.zeros(0, np.complex128), span=0.0, fingers=fingers)


def _corners(shape: Shape) -> Array:
    if isinstance(shape, Disc | Ellipse):
        return np.empty((0, 4))
    first, last = sharp_corners(shape.corners).T
    vertices = shape.corners @ (1.0, 1j)
    along = np.roll(vertices, -1) - vertices
    before = along[first - 1]
    place = 0.5 * (vertices[first] + vertices[last])
    half = 0.5 * np.angle(along[last] / before)
    return np.column_stack([place.real, place.imag, np.angle(1j * before) + half, half])


@compiled(np.zeros((1, 1, 3)), SURFACE, np.zeros((1, 1), CONTACT_GEOMETRY))
def _touching(g: Array, surface: Surface, out: Records) -> None:
    for b in range(g.shape[0]):
        for k in range(g.shape[1]):
            put_touch(position(g[b, k]), rotation(g[b, k, 2]), surface, out[b, k])


@kernel
def put_touch(place: complex, turn: complex, surface: Surface, touch: Records) -> None:
    """Write the geometry at a sensor pose in the object frame to `touch`."""
    if len(surface.parts) == 1:
        _put_round(place, turn, surface.parts[0], surface, touch)
        return
    for i in range(len(surface.parts)):
        _put_round(place, turn, surface.parts[i], surface, surface.each[i])
    put_mean(surface.each, touch)


@kernel
def put_touch_of_finger(
    place: complex, turn: complex, mount: complex, mount_turn: complex, surface: Surface, touch: Records
) -> None:
    """Write the geometry of a finger that is mounted in a hand at a pose, at the hand's pose in the object frame.

    The material point is in the finger's frame; derivatives are by the hand's pose.
    """
    if len(surface.parts) == 1:
        _put_round(place, turn, mount + mount_turn * surface.parts[0], surface, touch)
    else:
        for i in range(len(surface.parts)):
            _put_round(place, turn, mount + mount_turn * surface.parts[i], surface, surface.each[i])
        put_mean(surface.each, touch)
    touch.material = mount_turn.conjugate() * (touch.material - mount)
    for c in range(3):
        touch.material_by_g[c] *= mount_turn.conjugate()


@kernel
def _put_round(place: complex, turn: complex, center: complex, surface: Surface, touch: Records) -> None:
    """Write the geometry of one round part, whose centre is given in the sensor frame, to `touch`."""
    radius = surface.radius
    placed = place + turn * center
    distance, normal, bend_x, bend_y = distance_at(placed, surface.field)
    normal_in_sensor = turn.conjugate() * normal
    touch.gap = distance - radius
    touch.point = placed - radius * normal
    touch.material = center - radius * normal_in_sensor
    touch.normal = normal
    for c in range(3):
        moved = turn  # motion of the centre by each number of g
        if c == 1:
            moved = 1j * turn
        elif c == 2:
            moved = 1j * turn * center
        normal_by = bend_x * moved.real + bend_y * moved.imag
        touch.gap_by_g[c] = (normal.conjugate() * moved).real
        touch.normal_by_g[c] = normal_by
        touch.point_by_g[c] = moved - radius * normal_by
        touch.material_by_g[c] = -radius * turn.conjugate() * normal_by
    touch.material_by_g[2] += 1j * radius * normal_in_sensor


@kernel
def put_mean(parts: Records, touch: Records) -> None:
    """Write the load-weighted mean of the parts' geometries to `touch`."""
    nearest = math.inf
    for i in range(len(parts)):
        nearest = min(nearest, parts[i].gap)
    total = 0.0
    touch.point = 0.0
    touch.material = 0.0
    touch.normal = 0.0
    touch.gap_by_g[:] = 0.0
    touch.point_by_g[:] = 0.0
    touch.material_by_g[:] = 0.0
    touch.normal_by_g[:] = 0.0
    for i in range(len(parts)):
        total += math.exp((nearest - parts[i].gap) / LOAD_LENGTH)
    for i in range(len(parts)):
        part = parts[i]
        share = math.exp((nearest - part.gap) / LOAD_LENGTH) / total
        touch.point += share * part.point
        touch.material += share * part.material
        touch.normal += share * part.normal
        for c in range(3):
            touch.gap_by_g[c] += share * part.gap_by_g[c]
    touch.gap = nearest - LOAD_LENGTH * math.log(total / len(parts))
    for i in range(len(parts)):
        part = parts[i]
        share = math.exp((nearest - part.gap) / LOAD_LENGTH) / total
        for c in range(3):
            grows = (touch.gap_by_g[c] - part.gap_by_g[c]) / LOAD_LENGTH  # derivative of the share over the share
            touch.point_by_g[c] += share * (part.point_by_g[c] + grows * part.point)
            touch.material_by_g[c] += share * (part.material_by_g[c] + grows * part.material)
            touch.normal_by_g[c] += share * (part.normal_by_g[c] + grows * part.normal)


@compiled(np.zeros((1, 3)), np.zeros(1), 0j, SURFACE)
def _move_along(g: Array, lengths: Array, center: complex, surface: Surface) -> None:
    for k in range(len(g)):
        place = position(g[k])
        arm = rotation(g[k, 2]) * center
        kept = distance_at(place + arm, surface.field)[0]
        count = math.ceil(abs(lengths[k]) / _WALK)
        for _ in range(count):
            normal = distance_at(place + arm, surface.field)[1]
            place += 1j * normal * lengths[k] / count
            distance, normal, _bend_x, _bend_y = distance_at(place + arm, surface.field)
            place += (kept - distance) * normal
        g[k, 0] = place.real
        g[k, 1] = place.imag
