"""Errors of a real set-up that last all through a recording, and wear of the gel while it is used.

- Mounting: the sensor is 1 mm and 1 degree off the robot's kinematics, as with a bracket printed at home and a ruler.
- Outline: 1 to 2 % too large or too small, as outlines from a drawing or a scan are.
- Time: the images of every second recording are a frame late, as from cameras without a trigger.
- First pose: 2 to 5 mm and 1 to 3 degrees off, as an object placed by hand on marks; its sigma says so.
- Gel: over the first 15 s friction and stiffness each drift by up to 20 %, as the gel warms and gathers dust.
- Light: over the same time all three lights grow or fade together by up to 5 %, and each by up to 5 % besides.
- Marks: none to two grains, dents or scratches appear at any moment and stay.

A change of the skin all over is one grey level in 15 s (`docs/study/wear.json`) and is not drawn.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.geometry.shapes import scaled
from palpate.io.recording import Recording
from palpate_lab.simulate.backdrop import GRAIN_LEVELS, GRAIN_RADIUS, grain
from palpate_lab.simulate.scene import WARM_UP
from palpate_lab.simulate.unit import SensorUnit


@dataclass(frozen=True)
class Mark:
    """A grain or a scratch that appears on the skin during a recording."""

    when: float
    """Share of the recording before it appears, 0 to 1; then it stays."""
    place: tuple[float, float]
    """Its middle, in shares of the image's height and width from the upper left, 0 to 1."""
    width: float
    """Standard deviation of a grain, width of a scratch [px]."""
    length: float
    """Length of a scratch, in shares of the image's width; 0 for a grain."""
    angle: float
    """Direction of a scratch's normal in the image, from its right downwards [rad]."""
    levels: tuple[float, float, float]
    """Change of red, green and blue [grey levels]."""

    def image(self, size: tuple[int, int]) -> Array:
        """Return the change of an image of this size, (rows, columns, 3) [grey levels]."""
        at = (self.place[0] * size[0], self.place[1] * size[1])
        if not self.length:
            return grain(size, at, self.width)[..., None] * np.array(self.levels)
        down, right = np.ogrid[: size[0], : size[1]]
        down = down - at[0]
        right = right - at[1]
        across = np.cos(self.angle) * right + np.sin(self.angle) * down
        along = np.cos(self.angle) * down - np.sin(self.angle) * right
        inside = (np.abs(across) < 0.5 * self.width) & (np.abs(along) < 0.5 * self.length * size[1])
        return inside[..., None] * np.array(self.levels)


@dataclass(frozen=True, eq=False)
class SetUpErrors:
    """Systematic errors of one recording."""

    mounting: Array
    """Stated sensor pose in the frame of the true one, (3,) [m, m, rad]."""
    outline: float
    """Size of the stated outline relative to the object."""
    late: int
    """Delay of the images [frames]."""
    first_pose: Array
    """Stated first pose in the frame of the true one, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """Standard deviations of first poses, (3,) [m, m, rad]."""
    gel_drift: tuple[float, float]
    """Relative growth of the gel's friction and stiffness [1/s], for WARM_UP."""
    light: Array
    """Relative growth of the three lights, (3,) [1/s], for WARM_UP."""
    marks: tuple[Mark, ...]
    """Marks that appear on the skin."""


def draw_errors(rng: np.random.Generator, unit: int | None = None) -> SetUpErrors:
    """Draw the errors of one recording; the same generator gives the same.

    Those of mounting, outline and time are the same in all recordings of a robot with this `unit`.
    """

    def offset(length: float, turn: float) -> Array:
        angle = rng.uniform(-np.pi, np.pi)
        return np.array([length * np.cos(angle), length * np.sin(angle), turn * rng.choice([-1.0, 1.0])])

    def rms(low: float, high: float) -> float:
        return float(np.sqrt((low * low + low * high + high * high) / 3.0))  # of a uniform distribution

    light, marks = draw_wear(rng.spawn(1)[0])  # a generator of its own: later draws from rng do not depend on the wear
    first_place = (2e-3, 5e-3)  # [m] least and largest error of the first pose
    first_turn = (np.radians(1.0), np.radians(3.0))  # [rad]
    drift = 0.2 / WARM_UP
    errors = SetUpErrors(
        mounting=offset(1e-3, np.radians(1.0)),
        outline=1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.02),
        late=int(rng.integers(2)),
        first_pose=offset(rng.uniform(*first_place), rng.uniform(*first_turn)),
        first_pose_sigma=np.array([rms(*first_place) / np.sqrt(2.0)] * 2 + [rms(*first_turn)]),
        gel_drift=(rng.uniform(-drift, drift), rng.uniform(-drift, drift)),
        light=light,
        marks=marks,
    )
    if unit is None:
        return errors
    robot = draw_errors(np.random.default_rng([unit, 1]))  # draw_unit begins with the other
    return replace(errors, mounting=robot.mounting, outline=robot.outline, late=robot.late)


def draw_wear(rng: np.random.Generator) -> tuple[Array, tuple[Mark, ...]]:
    """Draw the change of a unit's light, and the marks on its skin."""
    light = rng.uniform(-0.05, 0.05) + rng.uniform(-0.05, 0.05, 3)
    marks = tuple(draw_mark(rng) for _ in range(rng.integers(3)))
    return light / WARM_UP, marks


def draw_mark(rng: np.random.Generator) -> Mark:
    """Draw a mark at any moment and place; it is a scratch as often as a grain."""
    when, row, column, angle = rng.uniform((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, math.pi)).tolist()
    if rng.random() < 0.5:
        red, green, blue = rng.uniform(*GRAIN_LEVELS, 3).tolist()
        width = rng.uniform(*GRAIN_RADIUS)
        length = 0.0
    else:
        red = green = blue = float(rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 60.0))
        width = rng.uniform(2.0, 4.0)  # no finer than the coating of 0.15 mm
        length = rng.uniform(0.1, 0.5)
    return Mark(when, (row, column), width, length, angle, (red, green, blue))


def worn(unit: SensorUnit, errors: SetUpErrors, time: Array) -> Iterator[SensorUnit]:
    """Yield the unit at each of these times (N,) [s], from 0.

    The image without contact changes as the lights that reach each pixel do.
    """
    lit = np.maximum(np.tensordot(unit.illumination, unit.colour, axes=(0, 0)), 1e-6)
    marks = [(mark.when * float(time[-1]), mark.image(lit.shape[:2])) for mark in errors.marks]
    now = unit
    last = -1
    for step in (time / 0.5).astype(int).tolist():  # in half a second no light changes by a grey level
        if step != last:
            last = step
            seconds = 0.5 * step
            colour = (1.0 + errors.light * min(seconds, WARM_UP))[:, None] * unit.colour
            image = unit.no_contact * (np.tensordot(unit.illumination, colour, axes=(0, 0)) / lit)
            for when, mark in marks:
                if when <= seconds:
                    image += mark
            now = replace(unit, colour=colour, no_contact=np.clip(np.rint(image), 0, 255).astype(np.uint8))
        yield now


def with_errors(recording: Recording, errors: SetUpErrors) -> Recording:
    """Return the recording of an exact world as a robot with these errors makes it; its truth stays exact."""
    assert recording.object_pose is not None
    images = recording.image
    if images is not None:
        images = [images[max(index - errors.late, 0)] for index in range(len(images))]
    return replace(
        recording,
        sensor_pose=se2.compose(recording.sensor_pose, errors.mounting),
        shape=scaled(recording.shape, errors.outline),
        image=images,
        first_pose=se2.compose(recording.object_pose[0], errors.first_pose),
        first_pose_sigma=errors.first_pose_sigma,
    )
