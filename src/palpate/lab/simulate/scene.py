"""The scene of a push as a MuJoCo model: an object on many small feet, a table, and a pusher that carries a soft gel.

Friction with the table comes from the feet alone, so that how an object turns follows from where it rests and from
Coulomb's law at each foot. Nothing here knows of a limit surface.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import SettingError
from palpate.geometry.shapes import Disc, Ellipse, Rectangle, Shape
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

HEIGHT = 0.02
"""Height of every object [m]; the gel touches it half way up."""
WARMS_FOR = 15.0
"""Time in which friction and stiffness of a gel drift [s], after which they stay."""
_FEET = 20
_FOOT = 0.002  # [m] radius of a foot
_GEL_MASS = 0.02  # [kg] on the vertical slide: light against the object
_ARMATURE = 1e4  # [kg], [kg m^2] of the pusher: contact cannot slow it down between two time steps
_PLIANT = 0.9  # MuJoCo's impedance of the gel, which stays the same at every depth: a linear spring
_FLAT_PARTS = 25  # spheres of a flat pad: at the Mini's width 0.7 mm apart
_FLATTEST = 0.01  # [m] radius of the spheres in its middle, which together are flat to 6 micrometres
_FLAT_STIFFER = 3.0  # times that all of a flat pad is stiffer than the patch on which a round tip is touched
_ELLIPSE_SIDES = 360  # a facet of 1.8 mm, 2 micrometres off the paper's ellipse


@dataclass(frozen=True, eq=False)
class WorldSettings:
    """What the world is like; raises SettingError on a value that is not allowed."""

    feet: Array
    """Where the object stands, (n, 2) [m] in the object frame."""
    mass: float = 0.8
    """Mass of the object [kg], spread evenly over its outline."""
    table_friction: float = 0.3
    """Coulomb friction between feet and table."""
    gel_friction: float = 0.4
    """Coulomb friction between gel and object."""
    gel_stiffness: float = 4000.0
    """Normal force per indentation of the gel [N/m], of a patch as a round tip has it."""
    gel_drift: tuple[float, float] = (0.0, 0.0)
    """Shares of friction and stiffness of the gel by which they grow [1/s], for WARMS_FOR."""
    time_step: float = 0.002
    """Longest time step of the simulation [s]; a frame is divided evenly."""

    def __post_init__(self) -> None:
        feet = np.asarray(self.feet, dtype=np.float64)
        if feet.ndim != 2 or feet.shape[1:] != (2,) or len(feet) < 3 or not np.isfinite(feet).all():
            raise SettingError(f"world feet have shape {feet.shape}; they must be 3 or more finite points (n, 2) [m]")
        object.__setattr__(self, "feet", feet)
        for name, low, high in (
            ("mass", 0.05, 20.0),
            ("table_friction", 0.01, 2.0),
            ("gel_friction", 0.0, 2.0),
            ("gel_stiffness", 200.0, 20000.0),
            ("time_step", 1e-4, 0.003),
        ):
            if not low <= getattr(self, name) <= high:
                raise SettingError(f"world {name} is {getattr(self, name)!r}; allowed is {low} to {high}")


def draw_settings(shape: Shape, rng: np.random.Generator) -> WorldSettings:
    """Draw a world for one object.

    Mass and table friction are those of a block of wood or plastic on a table. An elastomer that has been used and has
    dust on it has a friction of 0.25 to 0.6 on such a block, so that the contact slips in some worlds and not in
    others. The gel gives 0.4 to 1 mm at a force of 2.6 N, as a DIGIT's does.
    """
    return WorldSettings(
        feet=_draw_feet(shape, rng),
        mass=rng.uniform(0.6, 1.0),
        table_friction=rng.uniform(0.25, 0.4),
        gel_friction=rng.uniform(0.25, 0.6),
        gel_stiffness=rng.uniform(2600.0, 6500.0),
    )


def _draw_feet(shape: Shape, rng: np.random.Generator) -> Array:
    """Draw feet, each on the rim or anywhere under the object; how many on the rim is drawn too.

    A real underside touches at a few high spots, which lie anywhere, or along its edge where it is a little hollow.
    """
    outline = shape.outline(400)
    centroid = shape.centroid
    inner = centroid + 0.95 * (outline - centroid)
    low, high = outline.min(axis=0), outline.max(axis=0)
    reach = 0.3 * np.sqrt(shape.area / np.pi)
    rim_share = rng.uniform(0.0, 1.0)
    for _ in range(1000):
        anywhere = rng.uniform(low, high, (40 * _FEET, 2))
        anywhere = anywhere[shape.signed_distance(anywhere) < -_FOOT][:_FEET]
        rim = inner[rng.integers(len(inner), size=_FEET)]
        on_rim = (rng.uniform(size=_FEET) < rim_share) & (shape.signed_distance(rim) < 0.0)
        if len(anywhere) == _FEET:
            feet = np.where(on_rim[:, None], rim, anywhere)
            if _stands(feet, centroid, reach):
                return feet
    raise SettingError("no feet were found on which the object stands; its outline is too thin")


def _stands(feet: Array, centroid: Array, reach: float) -> bool:
    """Say whether the centre of mass lies inside the feet's hull, further than `reach` [m] from its edge."""
    import shapely

    return bool(shapely.MultiPoint(feet).convex_hull.contains(shapely.Point(centroid).buffer(reach)))


def build_model(
    settings: WorldSettings, shape: Shape, sensor: SensorProfile, object_pose: ArrayLike
) -> tuple[Any, Any]:
    """Return the MuJoCo model and its data, the object at rest at world_T_object (3,) [m, m, rad].

    Joints in order: the pusher's x, y and yaw, the gel's vertical slide, the object's free joint. The joints of the
    pusher move the gel's centre of curvature, and yaw turns the pusher about it.
    """
    mujoco = load_mujoco()
    if not 0.001 <= sensor.radius <= 0.1:
        found = f"sensor {sensor.name!r} has radius {sensor.radius} m"
        raise SettingError(f"{found}; simulation needs 0.001 to 0.1 m")
    spec = mujoco.MjSpec()
    spec.option.timestep = settings.time_step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # friction holds a hundred times harder than it yields: no creep under load
    spec.option.tolerance = 1e-13  # at the usual 1e-8 the solver stops early now and then: an object at rest jerks
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], contype=0, conaffinity=0)
    spheres = gel_spheres(sensor)
    _add_pusher(mujoco, spec, spheres)
    _add_object(mujoco, spec, settings, shape, np.asarray(object_pose, dtype=np.float64), len(spheres.radii))
    model = spec.compile()
    set_gel(model, sensor, settings.gel_friction, settings.gel_stiffness)
    return model, mujoco.MjData(model)


class Spheres(NamedTuple):
    """The n spheres of which a gel is made."""

    centers: Array
    """Where they are, seen from the middle of the tips' centres of curvature, (n, 2) [m]."""
    radii: Array
    """(n,) [m]"""


def gel_spheres(sensor: SensorProfile) -> Spheres:
    """Return the spheres of a gel: one of a round tip, a bed of them of a flat pad, for each finger of a hand.

    Each is a spring of its own, so that pressure and torque on a pad follow from how deep each part of it is.
    """
    row = np.linspace(-0.5, 0.5, _FLAT_PARTS) * sensor.flat_width if sensor.flat_width else np.zeros(1)
    # Each sphere is as large as it can be without standing out beyond the round edge of the pad.
    to_edge = 0.5 * sensor.flat_width - np.abs(row) + sensor.radius
    radii = np.clip(to_edge**2 / sensor.radius, sensor.radius, max(_FLATTEST, sensor.radius))
    centers = (sensor.centers - sensor.center)[:, None] + np.column_stack((sensor.radius - radii, row))
    return Spheres(centers.reshape(-1, 2), np.tile(radii, len(sensor.tips)))


def load_mujoco() -> Any:
    """Return the module mujoco; raises SettingError where it is not installed."""
    try:
        import mujoco
    except ImportError as error:
        raise SettingError("simulation needs MuJoCo, which is not installed: pip install palpate[sim]") from error
    return mujoco


def convex_parts(shape: Shape) -> list[Array]:
    """Return convex polygons, corners (n, 2) [m] each, that together cover the shape, few and without overlap."""
    import shapely

    outline = shape.outline(_ELLIPSE_SIDES) if isinstance(shape, Disc | Ellipse) else shape.corners
    whole = shapely.Polygon(outline)
    parts: Any = np.array([whole] if _is_convex(whole) else shapely.constrained_delaunay_triangles(whole).geoms)
    i = 0
    while i < len(parts):  # joins triangles: a seam within a straight edge would be felt as a second contact
        others = i + 1 + np.flatnonzero(shapely.intersects(parts[i], parts[i + 1 :]))
        unions = shapely.union(parts[i], parts[others])
        fits = np.flatnonzero(_is_convex(unions))
        if len(fits):
            best = fits[np.argmax(shapely.area(unions[fits]))]
            parts[i] = unions[best]
            parts = np.delete(parts, others[best])
        else:
            i += 1
    return [np.asarray(part.exterior.coords)[:-1] for part in parts]


def _is_convex(polygon: Any) -> Any:
    import shapely

    return shapely.area(shapely.convex_hull(polygon)) <= shapely.area(polygon) * (1.0 + 1e-9)


def _add_pusher(mujoco: Any, spec: Any, spheres: Spheres) -> None:
    pusher = spec.worldbody.add_body(name="pusher", pos=[0, 0, _FOOT + 0.5 * HEIGHT], gravcomp=1.0)
    pusher.explicitinertial, pusher.mass, pusher.inertia = True, 1.0, [1e-3, 1e-3, 1e-3]
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for kind, axis in ((slide, [1, 0, 0]), (slide, [0, 1, 0]), (hinge, [0, 0, 1])):
        pusher.add_joint(type=kind, axis=axis, armature=_ARMATURE)
    # Contact must not hold the object up or down, as it would on a pusher that cannot yield.
    gel = pusher.add_body(name="gel", gravcomp=1.0)
    gel.add_joint(type=slide, axis=[0, 0, 1], stiffness=1.0, damping=0.05)
    for i, ((x, y), radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True)):
        gel.add_geom(
            name=f"gel{i}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0, 0],
            pos=[x, y, 0],
            mass=_GEL_MASS / len(spheres.radii),
            contype=0,
            conaffinity=0,
        )


def _add_object(mujoco: Any, spec: Any, settings: WorldSettings, shape: Shape, pose: Array, gel_parts: int) -> None:
    x, y, theta = pose.tolist()
    middle = _FOOT + 0.5 * HEIGHT
    body = spec.worldbody.add_body(name="object", pos=[x, y, 0], quat=[np.cos(theta / 2), 0, 0, np.sin(theta / 2)])
    body.add_freejoint()
    plain = {"pos": [0, 0, middle], "contype": 0, "conaffinity": 0}
    names = ["part0"]
    if isinstance(shape, Disc):
        size = [shape.radius, 0.5 * HEIGHT, 0]
        body.add_geom(name="part0", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, mass=settings.mass, **plain)
    elif isinstance(shape, Rectangle):
        size = [0.5 * shape.size_x, 0.5 * shape.size_y, 0.5 * HEIGHT]
        body.add_geom(name="part0", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, mass=settings.mass, **plain)
    else:
        parts = convex_parts(shape)
        names = [f"part{i}" for i in range(len(parts))]
        areas = np.array([_area(part) for part in parts])
        for name, part, share in zip(names, parts, areas / areas.sum(), strict=True):
            flat = np.repeat(part, 2, axis=0)
            up = np.tile([-0.5 * HEIGHT, 0.5 * HEIGHT], len(part))
            spec.add_mesh(name=name, uservert=np.column_stack((flat, up)).ravel())
            kind = mujoco.mjtGeom.mjGEOM_MESH
            body.add_geom(name=name, type=kind, meshname=name, mass=settings.mass * share, **plain)
    friction = [settings.gel_friction] * 2 + [0, 0, 0]
    for name, i in product(names, range(gel_parts)):
        spec.add_pair(name=f"{name}-{i}", geomname1=name, geomname2=f"gel{i}", condim=3, friction=friction)
    for i, (px, py) in enumerate(settings.feet):
        foot, size, place = f"foot{i}", [_FOOT, 0, 0], [px, py, _FOOT]
        kind = mujoco.mjtGeom.mjGEOM_SPHERE
        body.add_geom(name=foot, type=kind, size=size, pos=place, mass=0, contype=0, conaffinity=0)
        spec.add_pair(
            name=foot,
            geomname1="table",
            geomname2=foot,
            condim=3,
            friction=[settings.table_friction] * 2 + [0, 0, 0],
            solref=[0.04, 1.0],
            solimp=[0.5, 0.5, 0.001, 0.5, 2.0],
        )


def _area(corners: Array) -> float:
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)).__abs__())


def set_gel(model: Any, sensor: SensorProfile, friction: float, stiffness: float) -> None:
    """Set the contact of gel and object: Coulomb friction and stiffness [N/m].

    The normal force at rest is `stiffness` times the indentation, of a flat pad on a patch of it (see
    _FLAT_STIFFER), and of a hand at each finger.

    MuJoCo gives contacts a stiffness k per unit of inertia; at rest f (1 - d) / d A = k d r with the impedance d and
    the inverse inertia A, see "Computation: constraint model" in its documentation. k = 1 / (d t)^2 for critical
    damping, where t is the time constant that a contact pair is given.
    """
    inverse_inertia = sum(float(model.body(name).invweight0[0]) for name in ("gel", "object"))
    of_each = _FLAT_STIFFER / _FLAT_PARTS if sensor.flat_width else 1.0
    k = of_each * stiffness * (1.0 - _PLIANT) / _PLIANT**2 * inverse_inertia
    time_constant = 1.0 / (_PLIANT * np.sqrt(k))
    pairs = [i for i in range(model.npair) if model.pair(i).name.startswith("part")]
    model.pair_friction[pairs, :2] = friction
    model.pair_solref[pairs] = (time_constant, 1.0)
    model.pair_solimp[pairs] = (_PLIANT, _PLIANT, 0.001, 0.5, 2.0)
