"""Pushes from the estimator's own model, and the shapes and tips that several tests use."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle, Shape
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.pushing import pushing, pushing_angle
from palpate.recording.frame import Frame
from palpate.recording.sensor import SensorProfile
from palpate.simulation.limit_surface import Steering, push

Array = np.ndarray

RADIUS = 0.021  # [m], the DIGIT's
RATE = 30.0  # [Hz]
SHAPES: dict[str, Shape] = {
    "disc": Disc(0.088),
    "rectangle": Rectangle(0.2363, 0.1579),
    "ellipse": Ellipse(0.1638, 0.2428),
    # An L whose centroid is not the origin.
    "concave": Polygon([(-0.09, -0.06), (0.07, -0.06), (0.07, 0.0), (-0.02, 0.0), (-0.02, 0.07), (-0.09, 0.07)]),
}


def sensor(radius: float = RADIUS, tips: tuple[tuple[float, float], ...] = ((0.0, 0.0),)) -> SensorProfile:
    return SensorProfile("test", radius=radius, tips=tips, rate=RATE)


@cache
def tips_of(name: str, profile: SensorProfile = sensor()) -> list[ContactModel]:  # noqa: B008
    return factors.contact_models(SHAPES[name], profile)


def contact_rows(g: Array, depth: float, tip: ContactModel) -> tuple[Array, Array]:
    """`factors.contact`, with the outline looked up; and so those below."""
    return factors.contact(factors.touching(g, tip), depth)


def direction_rows(g: Array, angle: Array | float, bias: Array | float, tip: ContactModel) -> tuple[Array, Array]:
    return factors.direction(factors.touching(g, tip), angle, bias)


def pushing_rows(
    g0: Array, e0: Array, g1: Array, e1: Array, tip: ContactModel, friction: ArrayLike, side: ArrayLike
) -> tuple[Array, Array]:
    return pushing(g0, e0, g1, e1, factors.touching(g1, tip), tip, friction, side)


def pushing_angles(g: Array, e: Array, tip: ContactModel, friction: ArrayLike) -> NDArray[np.float64]:
    return pushing_angle(g, e, factors.touching(g, tip), tip, friction)


def touching(tip: ContactModel, y: Array | float, theta: Array | float = 0.0) -> Array:
    """Sensor poses in the object frame (..., 3) that touch the object's left side at height y, pushing along +x."""
    g = np.stack(np.broadcast_arrays(-0.13, y, theta), axis=-1).astype(float)
    for _ in range(50):
        # Never overshoots: the distance falls no faster than x grows.
        g[..., 0] += factors.touching(g, tip).gap
    return g


def pushed(
    name: str = "rectangle",
    steps: int = 60,
    y: float = 0.01,
    first: Array | None = None,
    steering: Steering | None = None,
    radius: float = RADIUS,
) -> tuple[Array, Array]:
    """Noise-free object and sensor poses (steps + 1, 3) of one push from the left."""
    tip = tips_of(name, sensor(radius))[0]
    first = np.zeros(3) if first is None else first
    o, e = push(tip, first[None], touching(tip, np.array([y]), 0.05), steps, steering or Steering())
    return o[:, 0], e[:, 0]


def in_two_contacts(name: str, steps: int = 50, radius: float = RADIUS) -> tuple[Array, Array, Array]:
    """Object poses, sensor poses (N, 3) and contact (N,): push, ten frames away from the object, push again."""
    o1, e1 = pushed(name, steps, 0.015, radius=radius)
    o2, e2 = pushed(name, steps, -0.01, first=o1[-1], radius=radius)
    away = se2.compose(se2.compose(o1[-1], np.array([-0.25, 0.0, 0.0])), np.zeros((10, 3)))
    o = np.concatenate([o1, np.broadcast_to(o1[-1], (10, 3)), o2])
    contact = np.repeat([True, False, True], [len(o1), 10, len(o2)])
    return o, np.concatenate([e1, away, e2]), contact


def frames(o: Array, e: Array, contact: Array | bool = True, start: float = 0.0) -> list[Frame]:
    """Frames of these object and sensor poses (N, 3), with the object poses as ground truth."""
    flags = np.broadcast_to(contact, len(e))
    return [
        Frame(start + k / RATE, e[k].copy(), contact=bool(flags[k]), object_pose=o[k].copy()) for k in range(len(e))
    ]


def noisy(poses: Array, sigmas: tuple[float, float, float], rng: np.random.Generator) -> Array:
    return se2.compose(poses, se2.exp(rng.normal(size=poses.shape) * sigmas))
