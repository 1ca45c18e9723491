"""Make the recording that `palpate demo` tracks: `python scripts/make_demo_recording.py [OUT.h5]`.

A DIGIT pushes the paper's rectangle three times, at three sides. Poses only, drawn from the estimator's own model
(limit surface, sticking contact, its noise), so that it shows how palpate is used, not how well it does on real pushes.
"""

import sys
from pathlib import Path

import numpy as np

from palpate import se2
from palpate.graph.factors import contact_models
from palpate.graph.noise import GraphNoise
from palpate.recording import Recording, episode_numbers, write_recording
from palpate.sensor import DIGIT
from palpate.shapes import Rectangle
from palpate.simulation.limit_surface import Steering, draw_residuals, push

SEED = 20211
SHAPE = Rectangle(0.2363, 0.1579)
STEERING = Steering(speed=1.3e-3, aim=0.03, sway=5e-3, period=110.0)
PUSH_FRAMES, WAY_FRAMES = 125, 36
CLEARANCE = 0.09  # [m] that the sensor backs off before it goes round
TOUCHES = [
    (-0.5 * SHAPE.size_x, 0.035, 0.0),  # left side, above the centre
    (-0.055, -0.5 * SHAPE.size_y, 0.5 * np.pi),  # lower side, left of the centre
    (-0.5 * SHAPE.size_x, -0.03, 0.1),  # left side again, below the centre
]


def main() -> None:
    """Draw the pushes, join them by ways round the object and write the file."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("src/palpate/data/demo.h5")
    rng = np.random.default_rng(SEED)
    noise, (tip,) = GraphNoise(), contact_models(SHAPE, DIGIT)
    object_pose, objects, sensors, contact = np.array([0.0, 0.0, 0.3]), [], [], []
    steps = PUSH_FRAMES - 1
    for touch in TOUCHES:
        outward = side_of(touch) + np.pi
        (gap,), slip, torque = draw_residuals(tip, noise, STEERING.speed, outward, steps, 1, rng)
        start = on_outline(touch) + gap * np.array([np.cos(outward), np.sin(outward), 0.0])
        pushed, pushing = push(tip, object_pose, start, steps, STEERING, 0.0, slip[:, 0], torque[:, 0])
        way = approach(sensors[-1] if sensors else None, pushing[0])
        objects += [*np.broadcast_to(object_pose, way.shape), *pushed]
        sensors += [*way, *pushing]
        contact += [False] * len(way) + [True] * len(pushed)
        object_pose = pushed[-1]
    leave = way_between(sensors[-1], backed_off(sensors[-1]), 20)
    objects += [*np.broadcast_to(object_pose, leave.shape)]
    sensors += [*leave]
    contact += [False] * len(leave)
    measured = se2.compose(np.array(sensors), se2.exp(rng.normal(0.0, noise.sensor, (len(sensors), 3))))
    recording = Recording(
        time=np.arange(len(sensors)) / DIGIT.rate,
        sensor_pose=measured,
        object_pose=np.array(objects),
        contact=np.array(contact),
        episode=episode_numbers(np.array(contact)),
        shape=SHAPE,
        sensor=DIGIT,
        source=f"drawn from the limit-surface model by scripts/make_demo_recording.py, seed {SEED}; no images",
        frames={
            "sensor_pose": "drawn motion plus drawn noise of 0.1 mm and 1 mrad",
            "object_pose": "drawn motion, without noise",
            "contact": "as drawn",
        },
    )
    write_recording(recording, out, overwrite=True)


def on_outline(touch: tuple[float, float, float]) -> np.ndarray:
    """A sensor pose in the object frame that touches the straight side on which its centre line stands."""
    x, y, theta = touch
    side = side_of(touch)
    back = DIGIT.radius * (1.0 - np.cos(theta - side))
    return np.array([x + back * np.cos(side), y + back * np.sin(side), theta])


def side_of(touch: tuple[float, float, float]) -> float:
    """Inward normal of the side that is touched [rad]."""
    return round(touch[2] / (0.5 * np.pi)) * 0.5 * np.pi


def approach(last: np.ndarray | None, first: np.ndarray) -> np.ndarray:
    """Sensor poses from the end of one push to the start of the next, clear of the object."""
    before = backed_off(first)
    touch_down = way_between(before, first, WAY_FRAMES // 2)[:-1]
    if last is None:
        return touch_down
    return np.concatenate(
        [
            way_between(last, backed_off(last), WAY_FRAMES // 2)[1:],
            way_between(backed_off(last), before, WAY_FRAMES),
            touch_down,
        ]
    )


def backed_off(pose: np.ndarray) -> np.ndarray:
    """The pose, moved back out of the object."""
    return se2.compose(pose, np.array([-CLEARANCE, 0.0, 0.0]))


def way_between(start: np.ndarray, end: np.ndarray, frames: int) -> np.ndarray:
    """Poses (frames, 3) on the constant-velocity curve from start to end, both included; slow at both."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, frames))
    return se2.compose(start, se2.exp(share[:, None] * se2.log(se2.between(start, end))))


if __name__ == "__main__":
    main()
