"""A hundred thousand frames through one tracker, in one contact and in many: time, memory and coverage to the end.

    python benchmarks/long.py [--frames 100000] [--seed 0] [--into FILE.json]

A rectangle is pushed in a world as the estimator assumes it: its noise and the object's unknowns are drawn. Each frame
has a contact flag, a direction and a turn, and no image. In one run the contact never ends; in the other the sensor
draws back every ten seconds and pushes at another place. Printed for each tenth of the frames are

- `p50_ms` and `p95_ms` of `Tracker.update`, of processor time, which does not depend on other work on the machine;
- `rss_mb`, the memory of the process at its end;
- `inside_95`, the share of true poses in the 95 % region, and `error_mm`, the median error of estimates.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import tyro
from limit_surface import Steering, push
from numpy.typing import NDArray
from scipy.signal import lfilter

from palpate import DIGIT, ContactDirection, Frame, Measurement, NoiseSettings, Rectangle, Tracker, Turn
from palpate.geometry import se2
from palpate.models.pushing import variables as var
from palpate.models.pushing.contact_geometry import contact_model
from palpate.models.pushing.layout import IN_OBJECT
from palpate.models.pushing.priors import object_prior
from palpate.pipeline.metrics import inside_95, nees, translation_errors

Array = NDArray[np.float64]
SHAPE = Rectangle(0.2363, 0.1579)
CONTACT = 300
"""Frames of a contact, if there are many."""
AWAY = 30
"""Frames between contacts."""
ERROR = 2e-3
"""Standard deviation of touch [rad]."""
STATED = 1e-2
"""Standard deviation of touch as the measurements state it [rad]."""
LASTS = 19.0
"""Time constant of the errors of touch [frames]."""
BACK = 0.03
"""Distance from the object between contacts [m]."""
PARTS = 10
NOISE = NoiseSettings()
MODEL = contact_model(SHAPE, DIGIT)
STEERING = Steering()


@dataclass(frozen=True)
class Truth:
    """True poses in the world."""

    objects: Array
    """(N, 3)"""
    sensors: Array
    """(N, 3)"""
    contact: NDArray[np.bool_]
    """(N,)"""


def pushed(count: int, contact: int, values: Array, rng: np.random.Generator) -> Truth:
    """Push the rectangle for `count` frames in contacts of `contact` frames, each at another place of its sides."""
    objects = [np.zeros((1, 3))]
    sensors = list[Array]()
    flags = list[NDArray[np.bool_]]()
    c = MODEL.friction_radius
    slip_sigma = np.hypot(NOISE.sticking.still, NOISE.sticking.share * STEERING.speed)
    torque_sigma = np.hypot(NOISE.balance.still, NOISE.balance.share * STEERING.speed * c)
    friction = {variable: values[IN_OBJECT[variable]] for variable in (var.FRICTION_RATIO, var.FRICTION_CENTER)}
    grip = float(np.exp(values[IN_OBJECT[var.GRIP]][0]))
    made = 0
    while made < count:
        steps = min(contact, count - made) - 1
        quarter = rng.integers(4)
        along = rng.uniform(-0.03, 0.03)
        turned = rng.uniform(-0.2, 0.2)
        side = [0.0, 0.0, quarter * np.pi / 2]
        far = 0.5 * (SHAPE.size_x, SHAPE.size_y)[quarter % 2]
        r = DIGIT.radius
        gap = gaps(steps + 1, rng) - values[IN_OBJECT[var.DEPTH]] + values[IN_OBJECT[var.OUTLINE_SCALE]] * far
        first = se2.compose(side, [-far - gap[0] + r * (np.cos(turned) - 1.0), along + r * np.sin(turned), turned])
        slid = rng.normal(0.0, slip_sigma, steps)
        torque = rng.normal(0.0, torque_sigma, (steps, 1))
        # Off a side whose normal is -x, an opening gap moves the sensor along x.
        slip = se2.transform(side, np.column_stack([np.diff(gap), slid]))[:, None]
        o, e = push(MODEL, objects[-1][-1:], first[None], steps, STEERING, 0.0, slip, torque, friction, grip)
        rest = AWAY // 2 if contact < count else 0
        lifted = se2.compose(e[:, 0], [-BACK, 0.0, 0.0])
        objects += [np.tile(o[0], (rest, 1)), o[:, 0], np.tile(o[-1], (rest, 1))]
        sensors += [np.tile(lifted[0], (rest, 1)), e[:, 0], np.tile(lifted[-1], (rest, 1))]
        flags.append(np.repeat([False, True, False], [rest, len(o), rest]))
        made += len(flags[-1])
    return Truth(np.concatenate(objects[1:])[:count], np.concatenate(sensors)[:count], np.concatenate(flags)[:count])


def gaps(count: int, rng: np.random.Generator) -> Array:
    """Draw gaps (count,) [m] as contact and sticking assume them together: small, with small differences."""
    difference = np.hypot(NOISE.sticking.still, NOISE.sticking.share * STEERING.speed)
    ratio = (difference / NOISE.contact.deviation) ** 2
    stays = 1.0 + 0.5 * ratio - np.sqrt(ratio + 0.25 * ratio**2)
    return correlated(count, difference * np.sqrt(stays / (1.0 - stays**2)), stays, rng)


def correlated(count: int, sigma: float, stays: float, rng: np.random.Generator) -> Array:
    """Draw values (count,) of a first-order process with this deviation and correlation from one to the next."""
    drawn = rng.normal(0.0, sigma, count)
    drawn[1:] *= math.sqrt(1.0 - stays**2)
    return np.asarray(lfilter([1.0], [1.0, -stays], drawn))


def felt(truth: Truth, values: Array, rng: np.random.Generator) -> Iterator[tuple[Frame, tuple[Measurement, ...]]]:
    """Yield frames as a sensor measures them, each with the measurements of touch."""
    count = len(truth.objects)
    g = se2.between(truth.objects, truth.sensors)
    sensors = se2.compose(truth.sensors, se2.exp(rng.normal(size=(count, 3)) * NOISE.sensor_pose.deviation))
    inward = -MODEL.touching(g[None])["normal"][0] * np.exp(-1j * g[:, 2])
    stays = math.exp(-1.0 / LASTS)
    direction = np.angle(inward) + values[IN_OBJECT[var.DIRECTION_BIAS]] + correlated(count, ERROR, stays, rng)
    begins = np.diff(truth.contact, prepend=False)
    turn = g[:, 2] + rng.uniform(-3.0, 3.0, count)[np.maximum.accumulate(begins * np.arange(count))]  # a contact each
    turn = se2.wrap(turn + correlated(count, ERROR, stays, rng))
    for k in range(count):
        measured = ContactDirection(float(direction[k]), STATED**2), Turn(float(turn[k]), STATED**2)
        touched = bool(truth.contact[k])
        yield Frame(k / DIGIT.rate, sensors[k], contact=touched), measured if touched else ()


def tracked(truth: Truth, values: Array, rng: np.random.Generator) -> dict[str, Any]:
    """Track a push and return the results by tenths of its frames."""
    count = len(truth.objects)
    process = psutil.Process()
    first = se2.compose(truth.objects[0], se2.exp(rng.normal(size=3) * NOISE.first_pose.deviation))
    tracker = Tracker(SHAPE, DIGIT, first)
    statuses = Counter[str]()
    pose = np.empty((count, 3))
    covariance = np.empty((count, 3, 3))
    ms = np.empty(count)
    memory = list[float]()
    for k, (frame, measured) in enumerate(felt(truth, values, rng)):
        begin = time.thread_time()
        estimate = tracker.update(frame, measured)
        ms[k] = 1e3 * (time.thread_time() - begin)
        pose[k] = estimate.pose
        covariance[k] = estimate.covariance
        statuses[estimate.status] += 1
        if len(memory) < (k + 1) * PARTS // count:
            memory.append(process.memory_info().rss / 1e6)

    def by_tenth(function: Any, values: Any) -> list[float]:
        return [round(float(function(part)), 3) for part in np.array_split(values, PARTS)]

    return {
        "frames": count,
        "contacts": int(np.sum(np.diff(truth.contact, prepend=False) & truth.contact)),
        "p50_ms": by_tenth(np.median, ms),
        "p95_ms": by_tenth(lambda part: np.percentile(part, 95), ms),
        "rss_mb": [round(each, 1) for each in memory],
        "inside_95": by_tenth(np.mean, inside_95(nees(pose, covariance, truth.objects))),
        "error_mm": by_tenth(np.median, 1e3 * translation_errors(pose, truth.objects)),
        "statuses": dict(statuses),
    }


def main(frames: int = 100_000, seed: int = 0, into: Path | None = None) -> None:
    """Track both and print the results."""
    found = dict[str, dict[str, Any]]()
    for name, contact in (("one contact", frames), ("many contacts", CONTACT)):
        rng = np.random.default_rng([seed, contact])
        values = (
            object_prior(NOISE.priors).mean
            + rng.normal(size=object_prior(NOISE.priors).mean.shape) * object_prior(NOISE.priors).deviation
        )
        found[name] = tracked(pushed(frames, contact, values, rng), values, rng)
        print(name, json.dumps(found[name]), flush=True)
        if into is not None:
            into.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
