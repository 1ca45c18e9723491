"""The MuJoCo model of a push: an object on many small feet, a table, and a pusher for each soft gel.

The object's motion follows from Coulomb's law at each of its feet. Nothing here assumes a limit surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry.shapes import Disc, Ellipse, Rectangle, Shape
from palpate.types.sensor import SensorProfile
from palpate_lab import required
from palpate_lab.simulate.push_settings import ROBOT, PushSettings

WARM_UP = 15.0
"""Time in which friction and stiffness of a gel drift [s]; then they stay."""
_HEIGHT = 0.02  # [m] of every object; the gel touches it half way up
_FOOT_RADIUS = 0.002  # [m]
_FLAT_PARTS = 25  # spheres of a flat pad: at the Mini's width 0.7 mm apart


@dataclass(frozen=True, eq=False)
class WorldSettings:
    """Physical properties of one world."""

    feet: Array
    """Contact points with the table, (n, 2) [m] in the object frame."""
    mass: float = 0.8
    """Mass of the object [kg], spread evenly over its outline."""
    table_friction: float = 0.3
    """Coulomb friction between feet and table."""
    gel_friction: float = 0.4
    """Coulomb friction between gel and object."""
    gel_stiffness: float = 4000.0
    """Normal force per indentation of a round gel [N/m]."""
    gel_drift: tuple[float, float] = (0.0, 0.0)
    """Relative growth of friction and stiffness of the gel [1/s], for WARM_UP."""
    more_gels: tuple[tuple[float, float], ...] = ()
    """Friction and stiffness [N/m] of the gels of a hand's further fingers; those left out have that of the first."""

    def gel(self, finger: int) -> tuple[float, float]:
        """Return friction and stiffness [N/m] of a finger's gel."""
        gels = ((self.gel_friction, self.gel_stiffness), *self.more_gels)
        return gels[finger if finger < len(gels) else 0]


def draw_settings(shape: Shape, rng: np.random.Generator, pushes: PushSettings = ROBOT) -> WorldSettings:
    """Draw a world for one object: a block of wood or plastic on a table, and used, dusty elastomer.

    As pushes are by default, the contact slips in some worlds and sticks in others, and the gel gives 0.4 to 1 mm at
    2.6 N, as a DIGIT's does.
    """
    return WorldSettings(
        feet=_draw_feet(shape, rng),
        mass=rng.uniform(0.6, 1.0),
        table_friction=rng.uniform(0.25, 0.4),
        gel_friction=rng.uniform(*pushes.gel_friction),
        gel_stiffness=rng.uniform(*pushes.gel_stiffness),
    )


def draw_gels(settings: WorldSettings, count: int, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Draw friction and stiffness [N/m] of further gels of a hand, each within a fifth of the first one's."""
    factors = rng.uniform(0.8, 1.2, (count, 2)).tolist()
    return tuple((settings.gel_friction * slips, settings.gel_stiffness * gives) for slips, gives in factors)


def _draw_feet(shape: Shape, rng: np.random.Generator) -> Array:
    """Draw 20 feet on which the object stands, a drawn share of them on its rim and the others anywhere below it.

    A real underside touches at a few high spots, which lie anywhere, or along its edge if it is a little hollow.
    """
    import shapely

    count = 20
    outline = shape.outline(400)
    centroid = shape.centroid
    inner = centroid + 0.95 * (outline - centroid)
    low = outline.min(axis=0)
    high = outline.max(axis=0)
    # The centre of mass must be well inside the feet's hull.
    support = shapely.Point(centroid).buffer(0.3 * np.sqrt(shape.area / np.pi))
    rim_share = rng.uniform(0.0, 1.0)
    for _ in range(1000):
        anywhere = rng.uniform(low, high, (40 * count, 2))
        anywhere = anywhere[shape.signed_distance(anywhere) < -_FOOT_RADIUS][:count]
        rim = inner[rng.integers(len(inner), size=count)]
        on_rim = (rng.uniform(size=count) < rim_share) & (shape.signed_distance(rim) < 0.0)
        if len(anywhere) == count:
            feet = np.where(on_rim[:, None], rim, anywhere)
            if shapely.MultiPoint(feet).convex_hull.contains(support):
                return feet
    raise SettingError("no feet were found on which the object stands; its outline is too thin")


def build_model(
    settings: WorldSettings, shape: Shape, sensors: Sequence[SensorProfile], object_pose: ArrayLike
) -> tuple[Any, Any]:
    """Return the MuJoCo model and its data, the object at rest at world_T_object (3,) [m, m, rad].

    Joints in order: for each sensor x, y and yaw of the gel's centre of curvature, and the gel's vertical slide; then
    the object's free joint.
    """
    mujoco = required("simulation", "sim", "mujoco")
    for sensor in sensors:
        if not 0.001 <= sensor.radius <= 0.1:
            found = f"sensor {sensor.name!r} has radius {sensor.radius} m"
            raise SettingError(f"{found}; simulation needs 0.001 to 0.1 m")
    spec = mujoco.MjSpec()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # friction holds a hundred times harder than it yields: no creep under load
    spec.option.tolerance = 1e-13  # at the default of 1e-8 the solver sometimes stops early and the object jerks
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], contype=0, conaffinity=0)
    gels = [name for finger, sensor in enumerate(sensors) for name in _add_pusher(mujoco, spec, finger, sensor)]
    _add_object(mujoco, spec, settings, shape, np.asarray(object_pose, dtype=np.float64), gels)
    model = spec.compile()
    for finger, sensor in enumerate(sensors):
        set_gel(model, finger, sensor, *settings.gel(finger))
    return model, mujoco.MjData(model)


def gel_spheres(sensor: SensorProfile) -> tuple[Array, Array]:
    """Return centres (n, 2) and radii (n,) [m] of the spheres that make up a gel, each a spring of its own.

    A round tip is one sphere and a flat pad a row of them, for each tip of the sensor. Centres are relative to the
    middle of the tips' centres of curvature.
    """
    row = np.linspace(-0.5, 0.5, _FLAT_PARTS) * sensor.flat_width if sensor.flat_width else np.zeros(1)
    # Each sphere is as large as the round edge of the pad allows; spheres of 10 mm are flat to 6 micrometres together.
    to_edge = 0.5 * sensor.flat_width - np.abs(row) + sensor.radius
    radii = np.clip(to_edge**2 / sensor.radius, sensor.radius, max(0.01, sensor.radius))
    centers = (sensor.centers - sensor.center)[:, None] + np.column_stack((sensor.radius - radii, row))
    return centers.reshape(-1, 2), np.tile(radii, len(sensor.tips))


def convex_parts(shape: Shape) -> list[Array]:
    """Return a few convex polygons, corners (n, 2) [m] each, that cover the shape without overlap."""
    import shapely

    # 360 sides of a facet of 1.8 mm are within 2 micrometres of the paper's ellipse.
    outline = shape.outline(360) if isinstance(shape, Disc | Ellipse) else shape.corners
    whole = shapely.Polygon(outline)
    parts: Any = np.array([whole] if _is_convex(whole) else shapely.constrained_delaunay_triangles(whole).geoms)
    i = 0
    while i < len(parts):  # join triangles: a seam within a straight edge would act as a second contact
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


def _add_pusher(mujoco: Any, spec: Any, finger: int, sensor: SensorProfile) -> list[str]:
    """Add the pusher that carries a sensor's gel, and return the names of the gel's spheres."""
    centers, radii = gel_spheres(sensor)
    pusher = spec.worldbody.add_body(name=f"pusher{finger}", pos=[0, 0, _FOOT_RADIUS + 0.5 * _HEIGHT], gravcomp=1.0)
    pusher.explicitinertial = True
    pusher.mass = 1.0
    pusher.inertia = [1e-3, 1e-3, 1e-3]
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    for kind, axis in ((slide, [1, 0, 0]), (slide, [0, 1, 0]), (mujoco.mjtJoint.mjJNT_HINGE, [0, 0, 1])):
        pusher.add_joint(type=kind, axis=axis, armature=1e4)  # so heavy that contact does not slow it down
    # The gel slides freely up and down, so contact does not carry the object.
    gel = pusher.add_body(name=f"gel{finger}", gravcomp=1.0)
    gel.add_joint(type=slide, axis=[0, 0, 1], stiffness=1.0, damping=0.05)
    for i, ((x, y), radius) in enumerate(zip(centers.tolist(), radii.tolist(), strict=True)):
        sphere = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [radius, 0, 0], "pos": [x, y, 0]}
        light = 0.02 / len(radii)  # [kg] against the object
        gel.add_geom(name=f"gel{finger}-{i}", mass=light, contype=0, conaffinity=0, **sphere)
    return [f"gel{finger}-{i}" for i in range(len(radii))]


def _add_object(mujoco: Any, spec: Any, settings: WorldSettings, shape: Shape, pose: Array, gels: list[str]) -> None:
    x, y, theta = pose.tolist()
    body = spec.worldbody.add_body(name="object", pos=[x, y, 0], quat=[np.cos(theta / 2), 0, 0, np.sin(theta / 2)])
    body.add_freejoint()
    geom = mujoco.mjtGeom
    half = 0.5 * _HEIGHT
    parts: list[dict[str, Any]]
    if isinstance(shape, Disc):
        parts = [{"type": geom.mjGEOM_CYLINDER, "size": [shape.radius, half, 0], "mass": settings.mass}]
    elif isinstance(shape, Rectangle):
        size = [0.5 * shape.size_x, 0.5 * shape.size_y, half]
        parts = [{"type": geom.mjGEOM_BOX, "size": size, "mass": settings.mass}]
    else:
        outlines = convex_parts(shape)
        parts = []
        areas = np.array([_area(outline) for outline in outlines])
        for i, (outline, share) in enumerate(zip(outlines, areas / areas.sum(), strict=True)):
            prism = np.column_stack((np.repeat(outline, 2, axis=0), np.tile([-half, half], len(outline))))
            spec.add_mesh(name=f"part{i}", uservert=prism.ravel())
            parts.append({"type": geom.mjGEOM_MESH, "meshname": f"part{i}", "mass": settings.mass * share})
    friction = [settings.gel_friction] * 2 + [0, 0, 0]
    for k, part in enumerate(parts):
        body.add_geom(name=f"part{k}", pos=[0, 0, _FOOT_RADIUS + half], contype=0, conaffinity=0, **part)
        for gel in gels:
            pair = {"geomname1": f"part{k}", "geomname2": gel, "condim": 3, "friction": friction}
            spec.add_pair(name=f"part{k}-{gel}", **pair)
    friction = [settings.table_friction] * 2 + [0, 0, 0]
    solver = {"solref": [0.04, 1.0], "solimp": [0.5, 0.5, 0.001, 0.5, 2.0]}
    for i, (px, py) in enumerate(settings.feet):
        foot = {"size": [_FOOT_RADIUS, 0, 0], "pos": [px, py, _FOOT_RADIUS], "mass": 0}
        body.add_geom(name=f"foot{i}", type=geom.mjGEOM_SPHERE, contype=0, conaffinity=0, **foot)
        spec.add_pair(name=f"foot{i}", geomname1="table", geomname2=f"foot{i}", condim=3, friction=friction, **solver)


def _area(corners: Array) -> float:
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)).__abs__())


def set_gel(model: Any, finger: int, sensor: SensorProfile, friction: float, stiffness: float) -> None:
    """Set Coulomb friction and stiffness [N/m] of the contact between a finger's gel and the object.

    The normal force at rest is `stiffness` times the indentation of a round tip, of each tip if there are more. A flat
    pad, touched all over, is three times as stiff in all.

    MuJoCo gives contacts a stiffness k per unit of inertia; at rest f (1 - d) / d A = k d r with the impedance d and
    the inverse inertia A, see "Computation: constraint model" in its documentation. k = 1 / (d t)^2 for critical
    damping, with the time constant t of the contact pair.
    """
    impedance = 0.9  # constant over depth: a linear spring
    inverse_inertia = sum(float(model.body(name).invweight0[0]) for name in (f"gel{finger}", "object"))
    per_sphere = 3.0 / _FLAT_PARTS if sensor.flat_width else 1.0
    k = per_sphere * stiffness * (1.0 - impedance) / impedance**2 * inverse_inertia
    body = model.geom_bodyid[np.stack((model.pair_geom1, model.pair_geom2))]
    pairs = (body == model.body(f"gel{finger}").id).any(axis=0)
    model.pair_friction[pairs, :2] = friction
    model.pair_solref[pairs] = (1.0 / (impedance * np.sqrt(k)), 1.0)
    model.pair_solimp[pairs] = (impedance, impedance, 0.001, 0.5, 2.0)
