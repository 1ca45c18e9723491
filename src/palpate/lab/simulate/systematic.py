"""Systematic errors: what a robot is told wrongly in the same way all through a recording.

What is drawn, and why:

- Mounting: the sensor is 1 mm and 1 degree from where the robot's kinematics have it, in any direction: what a bracket
  printed at home and a ruler leave.
- Outline: what is stated is 1 to 2 % larger or smaller than the object, as outlines from a drawing or a scan are.
- Time: every second recording has its images a frame late, as cameras without a trigger have them.
- First pose: 2 to 5 mm and 1 to 3 degrees off, as an object placed by hand on marks is, and its sigma says so.
- Gel: over the first 15 s its friction and stiffness drift by up to 20 % each, up or down, as it warms and gathers
  dust, and stay so.
- Light: over the same time all three lights grow or fade together by up to 5 %, and each by up to 5 % besides. A red
  LED loses some 0.7 % of its light with each kelvin, a blue or green one a fifth of that, and a closed housing warms by
  ten kelvin and more. So the balance of the colours changes by up to a tenth, as do two sides of the picture against
  each other where two lights share a colour: by as much as a detector has to stay quiet at.
- Marks: none to two grains, dents or scratches come at any moment and stay, see `marks`. Real units have one or two
  of them from years of use, so that one in a recording is many.

A skin that changes all over is not drawn: real images minutes apart differ as after 14 grey levels of a smooth pattern
(`docs/study/wear.json`), which is one level in 15 s. The bench of faults has it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import scaled
from palpate.lab.simulate.ageing import Ageing, draw_ageing
from palpate.lab.simulate.scene import WARMS_FOR
from palpate.types.recording import Recording

Array = NDArray[np.float64]

_MOUNTING = (1e-3, np.radians(1.0))  # [m], [rad]
_OUTLINE = (0.01, 0.02)
_FIRST = ((2e-3, 5e-3), (np.radians(1.0), np.radians(3.0)))  # [m], [rad]
_DRIFT = 0.2 / WARMS_FOR  # [1/s]


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """What is wrong all through one recording."""

    mounting: Array
    """Where the sensor is said to be, in the frame of where it is, (3,) [m, m, rad]."""
    outline: float
    """Size of the stated outline over that of the object."""
    late: int
    """Frames by which images come late."""
    first_pose: Array
    """The first pose as it is stated, in the frame of the true one, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """Standard deviations (3,) [m, m, rad] of what first poses are off."""
    gel_drift: tuple[float, float]
    """Shares by which the gel's friction and stiffness grow [1/s], for WARMS_FOR."""
    ageing: Ageing
    """What becomes of its light and its skin."""


def draw_errors(rng: np.random.Generator) -> SystematicErrors:
    """Draw what is wrong in one recording; the same generator gives the same."""
    (low, high), (least, most) = _FIRST
    length, turn = _MOUNTING
    return SystematicErrors(
        mounting=_off(rng, length, turn),
        outline=1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(*_OUTLINE),
        late=int(rng.integers(2)),
        first_pose=_off(rng, rng.uniform(low, high), rng.uniform(least, most)),
        first_pose_sigma=np.array([_rms(low, high) / np.sqrt(2.0)] * 2 + [_rms(least, most)]),
        gel_drift=(rng.uniform(-_DRIFT, _DRIFT), rng.uniform(-_DRIFT, _DRIFT)),
        # From a generator of its own: whatever is drawn for it, what rng draws next stays the same.
        ageing=draw_ageing(rng.spawn(1)[0]),
    )


def misstated(recording: Recording, errors: SystematicErrors) -> Recording:
    """Return the recording of an exact world as a robot with these errors makes it; truth stays what it is."""
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
        frames=recording.frames
        | {
            "shape": f"stated {abs(errors.outline - 1.0):.1%} too {'large' if errors.outline > 1.0 else 'small'}",
            "image": f"{errors.late} {'frame' if errors.late == 1 else 'frames'} late",
            "first_pose": "stated with an error; first_pose_sigma is its standard deviation",
        },
    )


def _off(rng: np.random.Generator, length: float, turn: float) -> Array:
    """A pose (3,) this far from nothing [m], [rad], in any direction and to either side."""
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([length * np.cos(angle), length * np.sin(angle), turn * rng.choice([-1.0, 1.0])])


def _rms(low: float, high: float) -> float:
    """Root mean square of what is even from low to high."""
    return float(np.sqrt((low * low + low * high + high * high) / 3.0))
