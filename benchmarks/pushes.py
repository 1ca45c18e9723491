"""What the cases of the benchmark are fed: one push of a rectangle, with what touch says of it or with its images."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.graph.contact_geometry import ContactModel, contact_model
from palpate.lab.simulate.gel import render
from palpate.lab.simulate.limit_surface import Steering, push
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.background import first_frames
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, Measurement, Turn
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]
SHAPE = Rectangle(0.2363, 0.1579)
RATE = 30.0  # [Hz]
_FIRST = first_frames(RATE)  # frames that are taken as untouched

_FELT = 0.01  # [rad], standard deviation of directions and turns
_OFFSET = 0.7  # [rad] by which turns are less than the yaw
_SENSOR = (1e-4, 1e-4, 1e-3)  # [m, m, rad] by which measured sensor poses are off
_PRESSED = 5e-4  # [m]
_AWAY = 0.02  # [m] from the object before it is touched


@dataclass(frozen=True)
class Push:
    """A single contact, the object pushed and turned to and fro along an edge of the rectangle."""

    model: ContactModel
    objects: Array
    """True object poses (N, 3)."""
    sensors: Array
    """True sensor poses (N, 3)."""

    @property
    def first_pose(self) -> Array:
        """world_T_object (3,) at the first frame."""
        return self.objects[0]

    def frames(self) -> list[Frame]:
        """Return the frames with their ground truth, from which oracle touch makes pairs; without noise."""
        poses = zip(self.sensors, self.objects, strict=True)
        return [Frame(k / RATE, sensor, contact=True, object_pose=pose) for k, (sensor, pose) in enumerate(poses)]

    def felt(self) -> list[tuple[Frame, tuple[Measurement, ...]]]:
        """Return noisy frames, each with the direction and turn that learnt touch would tell of its image."""
        random, count = np.random.default_rng(0), len(self.sensors)
        sensors = se2.compose(self.sensors, se2.exp(random.normal(0.0, _SENSOR, (count, 3))))
        g = se2.between(self.objects, self.sensors)
        inward = -self.model.touching(g[None])["normal"][0] * np.exp(-1j * g[:, 2])
        direction = np.angle(inward) + random.normal(0.0, _FELT, count)
        turn = se2.wrap(g[:, 2] - _OFFSET + random.normal(0.0, _FELT, count))
        return [
            (
                Frame(k / RATE, sensors[k], contact=True),
                (ContactDirection(float(direction[k]), _FELT**2), Turn(float(turn[k]), _FELT**2)),
            )
            for k in range(count)
        ]

    def seen(self) -> tuple[list[Frame], list[Frame]]:
        """Return frames with rendered images before the contact and in it."""
        random, unit = np.random.default_rng(0), draw_unit(DIGIT, 1)
        g = se2.between(self.objects, self.sensors)
        sensors = se2.compose(self.sensors, se2.exp(random.normal(0.0, _SENSOR, g.shape)))
        untouched = render(unit, SHAPE, np.repeat(g[:1], _FIRST, axis=0), 0.0, rng=random)
        touched = render(unit, SHAPE, g, _PRESSED, rng=random)
        away = se2.compose(sensors[0], np.array([-_AWAY, 0.0, 0.0]))
        before = [Frame(k / RATE, away, image=image) for k, image in enumerate(untouched)]
        contact = [
            Frame((_FIRST + k) / RATE, sensor, image=image)
            for k, (sensor, image) in enumerate(zip(sensors, touched, strict=True))
        ]
        return before, contact


def make_push(count: int) -> Push:
    """Return a push of count frames."""
    model, first = contact_model(SHAPE, DIGIT), np.array([[-0.5 * SHAPE.size_x, 0.01, 0.0]])
    objects, sensors = push(model, np.zeros((1, 3)), first, count - 1, Steering())
    return Push(model, objects[:, 0], sensors[:, 0])
