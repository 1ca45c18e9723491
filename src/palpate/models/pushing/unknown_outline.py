"""An outline that nobody drew: heights across a curve, as variables of the object.

The curve is the outline as it is known when a contact begins, the heights are the change of its distance from a pole.
At the place u of the curve, heights and their slope move the contact and turn its normal; the contact geometry carries
both, so that all factors read the outline as they read a known one. A derivative by the outline is first one by height
and slope, and is spread over the four coefficients that the place depends on once a factor is linearised.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Complex, Records
from palpate.compiled import kernel
from palpate.geometry.closed_curve import BASIS_AT_POINTS, KNOTS, POINTS, ClosedCurve
from palpate.geometry.distance_field import DistanceField
from palpate.manifolds.se2_kernels import position
from palpate.models import generated_outline
from palpate.models.generated_outline import put_rotations
from palpate.models.pushing.compiled import compiled_model
from palpate.models.pushing.contact_geometry import SURFACE, ContactModel, put_mean
from palpate.models.pushing.outline_distance import distance_at, weights_at
from palpate.models.pushing.outline_variable import OUTLINE, OUTLINE_MODEL
from palpate.types.sensor import SensorProfile

_FARTHEST_SHARE = 4.0  # of motion along the curve to that of the tip, near a concave place
_AT = OUTLINE_MODEL.in_shared[OUTLINE].start
_COLUMN = OUTLINE_MODEL.column(OUTLINE)
_FIRST_POSE = [factor.name for factor in OUTLINE_MODEL.factors].index("first_pose")
_KNOTS_PER_RADIAN = KNOTS / (2.0 * math.pi)
_LEAST_REACH = 2e-3  # [m] from the pole to the place of contact
_GRAZING = 0.2  # least part of the normal along the way from the pole, as in `geometry.closed_curve`


@dataclass(frozen=True)
class _Grid:
    """Grid of distances from a curve."""

    field_nodes: int = 160
    """Nodes of the longer side of the distance grid: the curve is smooth, and the grid is made in each contact."""
    field_margin: float = 0.06
    """[m] around the curve that the grid covers, besides the tip."""


_GRID = _Grid()


class OutlineSurface(NamedTuple):
    """A contact model as compiled code takes it; see `contact_geometry.Surface`."""

    parts: Complex
    radius: float
    field: DistanceField
    each: Records
    pole: complex
    """Pole of the curve [m]."""


_SURFACE = OutlineSurface(*SURFACE[:3], each=np.zeros(1, OUTLINE_MODEL.geometry), pole=0j)  # an example


@dataclass(frozen=True, eq=False)
class OutlineContactModel(ContactModel):
    """The contact model of an outline that is known as a curve and heights across it."""

    curve: ClosedCurve = field(kw_only=True)
    """The curve, to which the distance field belongs."""

    @cached_property
    def surface(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The same for compiled code."""
        each = np.empty(len(self.parts), OUTLINE_MODEL.geometry)
        return OutlineSurface(self.parts, float(self.radius), self.field, each, self.curve.pole)

    @property
    def is_learnt(self) -> bool:
        """True, as the outline is a variable."""
        return True

    @cached_property
    def at_rest(self) -> ContactModel:
        """The contact model of the curve, without heights."""
        return ContactModel(self.field, self.parts, self.radius, self.friction_radius, self.friction_center, self.span)

    def touching(self, g: Array) -> NDArray[np.void]:
        """Return the CONTACT_GEOMETRY (B, N) of the curve at sensor poses g (B, N, 3) in the object frame."""
        return self.at_rest.touching(g)

    def moved_along(self, g: Array, lengths: Array) -> Array:
        """Return poses g (N, 3) moved along the curve; see `ContactModel`."""
        return self.at_rest.moved_along(g, lengths)

    def by_outline(self, near: NDArray[np.void]) -> Array:
        """Return the derivatives (B, N, K) of gaps by the coefficients of heights."""
        arm = near["point"] - near["gap"] * near["normal"] - self.curve.pole
        places = np.rint(np.angle(arm) * (POINTS / (2.0 * math.pi))).astype(int) % POINTS
        return -self.curve.outward[places][..., None] * BASIS_AT_POINTS[places]


def outline_contact_model(curve: ClosedCurve, sensor: SensorProfile) -> OutlineContactModel:
    """Return the contact model of a sensor and a curve; raises ShapeError where the curve crosses itself."""
    shape = curve.shape
    margin = _GRID.field_margin + 2.0 * sensor.radius
    parts = np.array([complex(x, y) for x, y in sensor.round_centers.tolist()])
    span = float(np.linalg.norm(sensor.centers[:, None] - sensor.centers, axis=-1).max())
    return OutlineContactModel(
        DistanceField.of(shape, margin, _GRID.field_nodes),
        parts,
        sensor.radius,
        shape.friction_radius(),
        complex(*shape.centroid.tolist()),
        span,
        curve=curve,
    )


@kernel
def prepare_step(now: Records, row: Records, surface: Any) -> None:
    """Write rotations and contact geometry, with the outline's heights in this row."""
    put_rotations(now)
    place = position(now.g)
    if len(surface.parts) == 1:
        _put_round(place, now.turn_g, surface.parts[0], row, surface, now.touch)
        return
    nearest = 0
    for i in range(len(surface.parts)):
        _put_round(place, now.turn_g, surface.parts[i], row, surface, surface.each[i])
        if surface.each[i].gap < surface.each[nearest].gap:
            nearest = i
    put_mean(surface.each, now.touch)
    part = surface.each[nearest]  # the load moves from part to part, of which the outline's derivatives know nothing
    now.touch.knot = part.knot
    now.touch.weights = part.weights
    now.touch.slopes = part.slopes
    now.touch.gap_by_outline = part.gap_by_outline
    now.touch.point_by_outline = part.point_by_outline
    now.touch.material_by_outline = part.material_by_outline
    now.touch.normal_by_outline = part.normal_by_outline


@kernel
def _put_round(  # noqa: PLR0915 - a formula, a line a quantity
    place: complex, turn: complex, center: complex, row: Records, surface: Any, touch: Records
) -> None:
    """Write the geometry of one round part.

    At a distance d0 from the curve, with the height h at the nearest place, the tip is at (d0 - h) / |n| from the
    outline, where n is the gradient of d0 - h: exact for a straight outline however it is turned.
    """
    radius = surface.radius
    placed = place + turn * center
    distance, normal, bend_x, bend_y = distance_at(placed, surface.field)
    along = 1j * normal / abs(normal)
    bend = bend_x * along.real + bend_y * along.imag
    share = min(max(1.0 - distance * (bend * along.conjugate()).real, 0.0), _FARTHEST_SHARE)
    arm = placed - distance * normal - surface.pole
    reach = max(abs(arm), _LEAST_REACH)
    u = math.atan2(arm.imag, arm.real) * _KNOTS_PER_RADIAN
    first_knot = math.floor(u)
    value, first, second = weights_at(u - first_knot)
    knot = int(first_knot + 2 * KNOTS - 1) % KNOTS
    outward_share = max((normal.conjugate() * arm).real / reach, _GRAZING)
    height = 0.0
    slope = 0.0  # per knot
    change = 0.0
    for m in range(4):
        coefficient = row.shared[_AT + (knot + m) % KNOTS]
        height += outward_share * value[m] * coefficient
        slope += outward_share * first[m] * coefficient
        change += outward_share * second[m] * coefficient
        touch.weights[m] = outward_share * value[m]
        touch.slopes[m] = outward_share * first[m]
    touch.knot = knot
    by_place = share * _KNOTS_PER_RADIAN * outward_share / reach * along  # gradient of the place u
    turned = normal - slope * by_place
    size = abs(turned)
    outward = turned / size
    aside = 1j * outward
    outward_in_sensor = turn.conjugate() * outward
    touch.gap = (distance - height) / size - radius
    touch.point = placed - radius * outward
    touch.material = center - radius * outward_in_sensor
    touch.normal = outward
    for c in range(3):
        moved = turn  # motion of the centre by each number of g
        if c == 1:
            moved = 1j * turn
        elif c == 2:
            moved = 1j * turn * center
        bent = bend_x * moved.real + bend_y * moved.imag
        bent -= change * (by_place.conjugate() * moved).real * by_place
        turn_by = (bent * aside.conjugate()).real / size
        touch.gap_by_g[c] = (outward.conjugate() * moved).real
        touch.normal_by_g[c] = turn_by * aside
        touch.point_by_g[c] = moved - radius * turn_by * aside
        touch.material_by_g[c] = -radius * turn_by * turn.conjugate() * aside
    touch.material_by_g[2] += 1j * radius * outward_in_sensor
    turn_by_slope = -(by_place * aside.conjugate()).real / size
    stretch_by_slope = -(by_place * outward.conjugate()).real
    touch.gap_by_outline[0] = -1.0 / size
    touch.gap_by_outline[1] = -(distance - height) / size**2 * stretch_by_slope
    touch.point_by_outline[0] = 0.0
    touch.material_by_outline[0] = 0.0
    touch.normal_by_outline[0] = 0.0
    touch.normal_by_outline[1] = turn_by_slope * aside
    touch.point_by_outline[1] = -radius * turn_by_slope * aside
    touch.material_by_outline[1] = -radius * turn_by_slope * turn.conjugate() * aside


@kernel
def _spread(kind: int, count: int, now: Records, out: Records) -> None:
    """Spread derivatives by height and slope over the coefficients of the place; those of a belief are as they are."""
    if kind == _FIRST_POSE:
        return
    for r in range(count):
        by_height = out.jacobian[r, _COLUMN]
        by_slope = out.jacobian[r, _COLUMN + 1]
        if by_height == 0.0 and by_slope == 0.0:
            continue
        out.jacobian[r, _COLUMN] = 0.0
        out.jacobian[r, _COLUMN + 1] = 0.0
        for m in range(4):
            column = _COLUMN + (int(now.touch.knot) + m) % KNOTS
            out.jacobian[r, column] = by_height * now.touch.weights[m] + by_slope * now.touch.slopes[m]


@kernel
def linearise_step(kind: int, before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Write the linearised rows of a factor that needs no measurement, and return their number."""
    count = generated_outline.linearise_step(kind, before, now, row, settings, out)
    _spread(kind, count, now, out)
    return count


@kernel
def linearise_measured(
    kind: int, now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records
) -> int:
    """Write the linearised rows of the factor of a measurement, and return their number."""
    count = generated_outline.linearise_measured(kind, now, row, term, settings, places, out)
    _spread(kind, count, now, out)
    return count


OUTLINE_PUSHING = compiled_model(
    OUTLINE_MODEL,
    generated_outline,
    "outline",
    _SURFACE,
    prepare_step=prepare_step,
    linearise_step=linearise_step,
    linearise_measured=linearise_measured,
)
"""Pushing of an object whose outline is a variable."""
